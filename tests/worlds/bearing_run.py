"""The chain from bearings to associations, cycle by cycle, for tests of what is promised of it."""

from __future__ import annotations

from dataclasses import is_dataclass
from typing import Any

import bearing_world as bw
import numpy as np

from coastwatch.associations import BearingAssociationInput
from coastwatch.batches import AisStatics, BearingTracks, Picture, Sensors
from coastwatch.spots import OctantInput
from coastwatch.spots.octants import OctantSpots
from coastwatch.stage import Groups, NoMemory, serial
from coastwatch.tracks import BearingInput
from coastwatch.tracks.bearing import BearingWindow

SEED = 40  # not one of those that settings were chosen on (1000 to 1009, 2000 to 2015)


def read_only(array: Any) -> Any:
    out = array.view()
    out.flags.writeable = False
    return out


def piecewise(work: Any, settings: Any, arrays: Any, spots: Any) -> list[Any]:
    """A Spread that cuts every spot into three, works from the last to the first, and lends its arrays read-only."""
    lent = {name: tuple(map(read_only, a)) if isinstance(a, tuple) else read_only(a) for name, a in arrays.items()}
    answers = []
    for rows in reversed([spots.of(k) for k in range(len(spots))]):
        thirds = [rows[k::3] for k in range(3)]
        parts = [work(settings, lent, Groups(part, np.array([0, len(part)]))) for part in reversed(thirds)]
        answers.append(tuple(np.concatenate(columns) for columns in zip(*parts, strict=True)))
    return answers


class Run:
    """The chain from bearings to associations, cycle by cycle."""

    def __init__(self, method: Any, sensors: Sensors, vessels: int, seconds: int, seed: int = SEED, **hear: float) -> None:
        self.method, self.sensors, self.hears, self.hear, self.seed = method, sensors, sensors, hear, seed
        self.world = bw.make_world(vessels, seconds, seed)
        self.tracker, self.tracks_memory, self.memory = BearingWindow(), BearingWindow().init(), method.init()
        self.seconds, self.statics, self.found = seconds, AisStatics.empty(), None

    def inputs(self, t: int) -> tuple[BearingTracks, Picture]:
        reports = bw.hear(self.world, self.hears, t, self.seed, **self.hear)
        self.tracks_memory, tracks = self.tracker.step(self.tracks_memory, BearingInput(reports, bw.START_S + t, self.sensors))
        return tracks, self.world.picture(t)

    def associate(self, memory: Any, tracks: BearingTracks, picture: Picture, t: int, spread: Any = serial) -> Any:
        known = None if self.found is None else self.found.sensor_bias_rad
        _, octants = OctantSpots().step(NoMemory(), OctantInput(tracks, picture, self.sensors, known))
        given = BearingAssociationInput(tracks, picture, octants, bw.START_S + t, self.sensors, self.statics, spread)
        return self.method.step(memory, given)

    def counts(self, after: int) -> Any:
        total = np.zeros(4)
        for t in range(3, self.seconds + 1, 3):
            tracks, picture = self.inputs(t)
            self.memory, found = self.associate(self.memory, tracks, picture, t)
            self.found = found
            if t >= after:
                total += bw.count(found.bearing_row, found.vessel_row, tracks.origin, picture.origin)
        return total


def by_id(found: Any, tracks: BearingTracks, picture: Picture) -> dict[tuple[int, int], float]:
    pairs = zip(tracks.track_id[found.bearing_row].tolist(), picture.vessel_id[found.vessel_row].tolist(), strict=True)
    return dict(zip(pairs, found.statistic.tolist(), strict=True))


def assert_same(a: Any, b: Any) -> None:
    """Equal to the bit, struct within struct."""
    for name, value in vars(a).items():
        other = getattr(b, name)
        if is_dataclass(value):
            assert_same(value, other)
        else:
            np.testing.assert_array_equal(value, other, strict=True)
