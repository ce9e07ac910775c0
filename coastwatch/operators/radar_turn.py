"""One turn of radar video, and its drawing as a PNG: north up, range rings, levels in grey, the plots that extraction found.

As Fig. 2 of F. Heymann et al., Validation of Radar Image Tracking Algorithms with Simulated Data.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from coastwatch.batches import Array, Floats, RadarVideo, Videos
from coastwatch.errors import InputError
from coastwatch.geodesy import NAUTICAL_MILE_M
from coastwatch.operators.output_file import written
from coastwatch.plots import ExtractionInput, HeadingMemory, true_azimuths
from coastwatch.scenario import Scenario
from coastwatch.sensors import has_video
from coastwatch.server.live_video import COARSE_BITS, FIRST_DB, SHADES, STEP_DB, shades_of
from coastwatch.spelling import did_you_mean, printable, utc_text

matplotlib.use("Agg")

USUAL_TURN = 10
"""Drawn where no instant and no number is asked for, or the last of a shorter run: by then the background is known."""

LEARNT_TURNS = 5  # before the drawn one, from which extraction learns the background
LATE_S = 2.0  # after the drawn turn, within which its last spokes come
TURN_RAD = 2.0 * np.pi
BACK_RAD = TURN_RAD / 36.0  # a spoke that is less than this behind the one before stepped back
HALF = 512  # squares of the picture from the antenna to its edge, about one for each pixel
FILLED = 1.5  # usual distances of spokes, up to which a square shows the nearest spoke
RINGS_NM = (0.05, 0.1, 0.25, 0.5, 1.0, 2.0, 4.0, 6.0, 12.0, 24.0)
MOST_RINGS = 6
SIDE_IN, DPI = 9.0, 140
AXES = (0.02, 0.02, 0.96, 0.96)  # left, bottom, width and height in shares of the figure
EDGE = 1.16  # of the axes, in ranges of the radar: bearings and titles are outside the range
RING, PLOT, INK, BLANK = "#4fae80", "#ffb000", "#1d2733", (0.80, 0.86, 0.90)


class RadarTurn(NamedTuple):
    """The spokes of one turn of a radar, and the plots in it."""

    title: str
    video: RadarVideo
    shade: Array  # (S, C) uint8, 0 to `SHADES`: the level over the noise, or as sent where cells have few bits or are cleaned
    range_m: Floats  # (F,) of the plots
    azimuth_rad: Floats  # (F,) of the plots


def load(scenario: Scenario, radar: str, at_s: float | None, number: int | None) -> RadarTurn:
    """One turn of the video of a radar of a scenario.

    Args: at_s: an instant in the turn, Unix time; number: of the turn from 1, counted by the radar's rpm from the start of the run;
    neither: `USUAL_TURN`.
    Raises: InputError: no such radar or turn, no video; OSError: a file cannot be read.
    """
    if not has_video(scenario.input):
        raise InputError(
            f"plot --video: scenario {scenario.name} has input.method = {scenario.input.method!r} and no radar video, needed "
            "'simulated_video', 'video_files', or 'tables' with a feed video+file:PATH, pictures or haxr"
        )
    sensors, plan = scenario.sensors(), scenario.plan()
    names = [str(name) for name in sensors.radars.name]
    if radar not in names:
        raise InputError(f"plot --video: got {radar!r}, needed one of {', '.join(names)}{did_you_mean(radar, names)}")
    row, stop_s = names.index(radar), plan.instant_s(plan.cycles - 1)
    period_s = float(sensors.radars.period_s[row])
    turns = max(int((stop_s - plan.start_s) / period_s + 1e-6), 1)
    if number is not None and not 1 <= number <= turns:
        raise InputError(f"plot --turn: got {number}, needed 1 to {turns}: so often {radar} turns in this run")
    if at_s is None:
        at_s = plan.start_s + ((number or min(USUAL_TURN, turns)) - 0.5) * period_s
    elif not plan.start_s <= at_s <= stop_s:
        raise InputError(f"plot --at: got {utc_text(at_s)}, needed {utc_text(plan.start_s)} to {utc_text(stop_s)}")

    recording = scenario.input.load(sensors, scenario.seed, plan)
    until_s = at_s + 1.5 * period_s + LATE_S
    reports = recording.reports.between(at_s - (LEARNT_TURNS + 1) * period_s, until_s)
    _, reports = true_azimuths(HeadingMemory(), reports, sensors.radars)
    ours = Videos(tuple(part for part in reports.video.parts if part.sensor == row))
    video = _turn_at(ours, at_s, period_s)
    if video is None:
        raise InputError(
            f"plot --video: {radar} sent no video about {utc_text(at_s)}, needed another turn of {turns} from "
            f"{utc_text(plan.start_s)} to {utc_text(stop_s)}"
        )
    _, (plots, _) = scenario.extraction.step(scenario.extraction.init(), ExtractionInput(ours, sensors))
    plots = plots.take((plots.time_s >= video.time_s.min()) & (plots.time_s <= video.time_s.max()))
    levels = np.bincount(video.level.ravel(), minlength=256).astype(np.float64)
    shades = shades_of(levels, float(sensors.radars.db_per_level[row]), video.bits)
    as_sent = video.bits <= COARSE_BITS or levels[0] > 0.5 * levels.sum()
    grey = "level as the radar sends it" if as_sent else f"{FIRST_DB:g} dB or more over the noise, in steps of {STEP_DB:g} dB"
    title = (
        f"{scenario.name}: {radar}, {utc_text(float(video.time_s[0]))}\n"
        f"{len(video):,} spokes of {video.level.shape[1]:,} cells of {video.cell_m:.1f} m; grey: {grey}; "
        f"{len(plots)} plots ({scenario.extraction.method})"
    )
    return RadarTurn(title, video, shades[video.level], plots.range_m, np.radians(plots.azimuth_deg))


def _turn_at(videos: Videos, at_s: float, period_s: float) -> RadarVideo | None:
    """The spokes from north to north about an instant, of the range scale of the spoke that is nearest to it; None: there are none."""
    near = [part for part in videos.parts if len(part) and np.abs(part.time_s - at_s).min() < 0.5 * period_s]
    if not near:
        return None
    first = min(near, key=lambda part: float(np.abs(part.time_s - at_s).min()))
    same = [replace(part, vessel_m=part.vessel_m[:, :0]) for part in videos.parts if part.scale == first.scale]
    joined = RadarVideo.join(same)
    forward = np.diff(joined.azimuth_rad, prepend=0.0) % TURN_RAD
    forward[forward > TURN_RAD - BACK_RAD] -= TURN_RAD
    turn = np.floor(np.cumsum(forward) / TURN_RAD)
    off_s = np.abs(joined.time_s - at_s)
    return joined.take((turn == turn[off_s.argmin()]) & (off_s < period_s))


def picture(turn: RadarTurn) -> Array:
    """The turn in squares around the antenna, rows from south: each has its strongest cell, 0 to `SHADES`; -1: no video. (P, P)"""
    video, cells = turn.video, turn.video.level.shape[1]
    range_m = video.first_m + cells * video.cell_m
    order = np.argsort(video.azimuth_rad)
    azimuth, shade = video.azimuth_rad[order], turn.shade[order]
    around = np.concatenate([azimuth[-1:] - TURN_RAD, azimuth, azimuth[:1] + TURN_RAD])

    middle_m = (np.arange(2 * HALF) + 0.5 - HALF) * (range_m / HALF)
    east, north = np.meshgrid(middle_m, middle_m)
    towards = np.arctan2(east, north) % TURN_RAD
    after = np.searchsorted(around, towards, side="right").clip(1, len(around) - 1)
    before_rad, after_rad = towards - around[after - 1], around[after] - towards
    spoke = (np.where(before_rad <= after_rad, after - 1, after) - 1) % len(azimuth)
    cell = np.floor((np.hypot(east, north) - video.first_m) / video.cell_m).astype(np.int64)
    is_near = np.minimum(before_rad, after_rad) <= FILLED * float(np.median(np.diff(around)))
    is_seen = (cell >= 0) & (cell < cells) & is_near
    out = np.full(east.shape, -1, np.int16)
    out[is_seen] = shade[spoke[is_seen], cell[is_seen]]

    lit = np.nonzero(shade)  # where several cells are in one square, none of them is lost
    at_m = video.first_m + (lit[1] + 0.5) * video.cell_m
    column, line = (
        np.clip((at_m * of(azimuth[lit[0]]) / range_m + 1.0) * HALF, 0, 2 * HALF - 1).astype(np.int64)
        for of in (np.sin, np.cos)
    )
    np.maximum.at(out, (line, column), shade[lit].astype(np.int16))
    return out


def draw(turn: RadarTurn) -> Figure:
    """The figure of a turn: `AXES` of it show `EDGE` ranges of the radar to each side of the antenna."""
    reach = (turn.video.first_m + turn.video.level.shape[1] * turn.video.cell_m) / NAUTICAL_MILE_M
    figure = Figure(figsize=(SIDE_IN, SIDE_IN), dpi=DPI, facecolor="white")
    axes = figure.add_axes(AXES)
    axes.set_axis_off()
    axes.set_xlim(-EDGE * reach, EDGE * reach)
    axes.set_ylim(-EDGE * reach, EDGE * reach)
    shade = picture(turn)
    grey = np.repeat(np.sqrt(np.maximum(shade, 0) / SHADES)[:, :, None], 3, axis=2)  # the root: weak echoes are seen too
    grey[shade < 0] = BLANK
    middle = np.arange(-HALF, HALF) + 0.5
    grey[np.hypot(middle, middle[:, None]) > HALF] = 1.0  # outside the range
    axes.imshow(grey, origin="lower", extent=(-reach, reach, -reach, reach), interpolation="nearest", zorder=1)

    angle = np.linspace(0.0, 2.0 * np.pi, 361)
    step = next((step for step in RINGS_NM if reach / step <= MOST_RINGS), RINGS_NM[-1])
    for k in range(1, int(reach / step + 1e-6) + 1):
        axes.plot(k * step * np.sin(angle), k * step * np.cos(angle), color=RING, linewidth=0.6, zorder=2)
        axes.text(0.0, k * step, f" {k * step:g} NM", color=RING, fontsize=8, ha="left", va="top", zorder=2)
    axes.plot(reach * np.sin(angle), reach * np.cos(angle), color=INK, linewidth=0.8, zorder=2)
    for bearing in range(0, 360, 10):
        east, north = math.sin(math.radians(bearing)) * reach, math.cos(math.radians(bearing)) * reach
        length = 1.03 if bearing % 30 == 0 else 1.015
        axes.plot([east, length * east], [north, length * north], color=INK, linewidth=0.8, zorder=2)
        if bearing % 30 == 0:
            axes.text(1.065 * east, 1.065 * north, f"{bearing:03d}", color=INK, fontsize=8, ha="center", va="center")

    range_nm = turn.range_m / NAUTICAL_MILE_M
    east_nm, north_nm = range_nm * np.sin(turn.azimuth_rad), range_nm * np.cos(turn.azimuth_rad)
    axes.scatter(east_nm, north_nm, s=70.0, facecolors="none", edgecolors=PLOT, linewidths=0.9, zorder=3)
    heading, _, below = turn.title.partition("\n")
    figure.text(0.02, 0.985, printable(heading), color=INK, fontsize=11, va="top", parse_math=False)
    figure.text(0.02, 0.015, printable(below), color=INK, fontsize=8, va="bottom", parse_math=False)
    return figure


def write(turn: RadarTurn, output: str) -> None:
    """Draws the turn to a PNG file. Raises: OSError."""
    figure = draw(turn)
    with written(output) as file:
        figure.savefig(file, format="png", dpi=DPI, metadata={"Title": turn.title.partition("\n")[0]})
