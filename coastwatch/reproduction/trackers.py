"""Several radar trackers on the same plots, or the same video, of a few targets. What makes the plots runs once.

Of radar video one turn is kept for drawing, and particles while filters search and when they have vessels.
"""

from __future__ import annotations

import base64
from typing import Self

import numpy as np
from pydantic import Field, model_validator

from coastwatch.batches import Floats, Plots, RadarExcess, Truth
from coastwatch.geodesy import to_plane
from coastwatch.reproduction.region_inputs import cycle_inputs
from coastwatch.scenario import Scenario
from coastwatch.scores.targets import Figures, MultiTargetScores
from coastwatch.stage import Count, NotNegative, Positive, Running, Settings
from coastwatch.tracks import ParticlesMemory, RadarTracker, RegionInput

SIDE = 240  # cells of a picture to each side
EVERY = 5  # particles, of which one is drawn

Picture = dict[str, "float | str | list[list[float]]"]
Paths = dict[str, list[list[float]]]
"""Points by name."""


class Trackers(Settings):
    """Asks for the scores of several radar trackers on the same plots, in place of those of a whole run."""

    methods: dict[str, RadarTracker] = Field(default_factory=dict)  # by name; "scenario" is that of the scenario itself
    cutoffs_m: tuple[Positive, ...] = (250.0, 500.0)  # of OSPA
    near_m: Positive = 250.0  # a track farther from its target is false
    settled_s: NotNegative = 60.0  # after the start: false tracks are also counted from then on
    every_s: Positive = 200.0  # spans over which OSPA is averaged
    drawn: tuple[str, ...] = ()  # methods whose paths are kept and drawn
    draw_every: Count = 5  # number of cycles from one point of a path to the next
    scan_cycle: Count = 20  # number of the cycle whose video is drawn, if methods are

    @model_validator(mode="after")
    def _draws_what_there_is(self) -> Self:
        unknown = sorted(set(self.drawn) - {"scenario", *self.methods})
        if unknown:
            raise ValueError(f"drawn: got {', '.join(unknown)}, needed some of scenario, {', '.join(self.methods)}")
        return self


def measure(scenario: Scenario, seed: int, asked: Trackers) -> dict[str, Figures | Paths | Picture]:
    """Figures by method, as of `MultiTargetScores.as_dict`; `plots`: those of the plots themselves, as of `figures_of_plots`.

    `paths`: points east and north of the origin of the region, of plots (`candidates`), `targets` and the methods that are drawn.
    `scan`: the video of a cycle, as of `scan`. `searching`, `acquired`: particles, as of `clouds`, of the first drawn
    method that comes to it: when it has one vessel and looks for another, and when it has two.
    """
    sensors, plan = scenario.sensors(), scenario.plan()
    recording = scenario.input.load(sensors, seed, plan)
    truth = recording.truth
    assert truth is not None
    methods: dict[str, RadarTracker] = {"scenario": scenario.tracks, **asked.methods}
    memories = {name: method.init() for name, method in methods.items()}
    start = MultiTargetScores(asked.cutoffs_m, asked.near_m, plan.start_s, asked.settled_s, asked.every_s)
    scores, plots = dict.fromkeys(methods, start), list[Plots]()
    drawn: dict[str, Paths | Picture] = {}
    paths: Paths = {name: [] for name in ("candidates", "targets", *asked.drawn)}
    for now_s, seen, _, video in cycle_inputs(scenario, recording, video=any(m.takes_video for m in methods.values())):
        now = truth.at(now_s)
        plots.append(seen)
        draws = bool(asked.drawn) and len(plots) % asked.draw_every == 0
        if asked.drawn:
            paths["candidates"] += points(seen.position_m)
        if draws:
            paths["targets"] += points(to_plane(now.position_deg, sensors.region_origin_deg[0]))
        if asked.drawn and video and len(plots) == asked.scan_cycle:
            drawn["scan"] = scan(video[0], seen.position_m)
        for name, method in methods.items():
            given = RegionInput.of_plots(seen, now_s, sensors)._replace(video=video)
            memories[name], found = Running(method, memories[name]).next(given)
            scores[name] = scores[name].seen(now_s, now, scenario.alignment.step(found.tracks, now_s))
            now_has = memories[name]
            if name in asked.drawn and isinstance(now_has, ParticlesMemory):
                held, all_ = int(now_has.filters.acquired.sum()), len(now_has.filters)
                stage = "acquired" if held > 1 else "searching" if held == 1 and all_ > 1 else ""
                if stage and stage not in drawn:
                    drawn[stage] = clouds(now_has)
            if draws and name in asked.drawn:
                paths[name] += points(to_plane(found.tracks.position_deg, sensors.region_origin_deg[0]))
    return {
        **{name: of.as_dict() for name, of in scores.items()},
        "plots": figures_of_plots(plots, now),
        "paths": paths,
        **drawn,
    }


def figures_of_plots(cycles: list[Plots], truth: Truth) -> Figures:
    """`false_plots`: of a cycle; `detected`: share of the cycles in which there is a plot of each target."""
    every = max(len(cycles), 1)
    seen = {
        str(target): sum(bool((plots.origin == target).any()) for plots in cycles) / every for target in truth.vessel.tolist()
    }
    return {"false_plots": float(np.mean([(plots.origin < 0).sum() for plots in cycles])), "detected": seen}


def points(position_m: Floats) -> list[list[float]]:
    """East and north of each point, to a metre."""
    rounded: list[list[float]] = np.round(position_m).tolist()
    return rounded


def scan(video: RadarExcess, plots_m: Floats) -> Picture:
    """A turn as the level over the background in squares around the antenna, the strongest cell of each, and the plots in it.

    Returns: `reach_m`: half a side; `half_db`: base64 of uint8 rows from south, 0: nothing over the background; `candidates`.
    """
    cells = video.half_db.shape[1]
    reach_m = video.first_m + cells * video.cell_m
    range_m = video.first_m + (np.arange(cells) + 0.5) * video.cell_m
    east, north = (range_m * turn(video.azimuth_rad)[:, None] for turn in (np.sin, np.cos))
    column, row = (np.clip((at / reach_m + 1.0) * 0.5 * SIDE, 0, SIDE - 1).astype(np.int64) for at in (east, north))
    picture = np.zeros((SIDE, SIDE), np.uint8)
    np.maximum.at(picture, (row, column), np.maximum(video.half_db, 0).astype(np.uint8))
    text = base64.b64encode(picture.tobytes()).decode()
    return {"reach_m": reach_m, "half_db": text, "candidates": points(plots_m)}


def picture_of(kept: Picture) -> Floats:
    """The picture of `scan`. (SIDE, SIDE)"""
    levels = np.frombuffer(base64.b64decode(str(kept["half_db"])), np.uint8)
    return levels.reshape(SIDE, SIDE).astype(float)


def clouds(memory: ParticlesMemory) -> dict[str, list[list[float]]]:
    """Some particles of the filters that have vessels (`acquired`) and of those that look for one (`searching`)."""
    f = memory.filters
    return {
        name: points(f.particle[rows][:, ::EVERY, :2].reshape(-1, 2))
        for name, rows in (("acquired", f.acquired), ("searching", ~f.acquired))
    }
