"""The feed `solent`: AIS recorded in the Solent on 12 January 2016, and radars simulated along the recorded motion.

The even fixes of each vessel are the AIS reports, unchanged. The odd fixes, smoothed, are the truth that the radars observe.
So AIS is never scored against itself.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np

from coastwatch.batches import (
    AisReports,
    Bools,
    Fault,
    FileContent,
    Floats,
    Ints,
    Radars,
    Recording,
    Reports,
    Sensors,
    Trajectories,
)
from coastwatch.errors import InputError
from coastwatch.formats.intake.ais_validation import utc
from coastwatch.formats.intake.faults import Tally
from coastwatch.geodesy import KNOT_M_S, difference_m, from_plane, to_plane, turn
from coastwatch.sensors.recorded.datasets.smoothing import between, smooth
from coastwatch.sensors.recorded.files import Fingerprint, data_folder, fingerprint
from coastwatch.sensors.recorded.merging import span_of
from coastwatch.sensors.recorded.tables.ais import AisTable
from coastwatch.sensors.simulated.radar import RadarTruth, interpolated, observe
from coastwatch.sensors.simulated.simulation import truths_of
from coastwatch.stage import Method, NotNegative, Plan, Positive, Share

FILE = "SolentAIS_20160112_130211.csv.gz"
PLANE_DEG = np.array([50.78, -1.11])
SILENCE = 31  # stream of random numbers
GRID_S = 1.0  # between samples of the truth: at a turn rate of 1 deg/s linear interpolation is wrong by 2 cm

POSITION_JUMP = "position jump"
OF_TRUTH, SILENCED = "fixes of the truth", "reports of AIS that is switched off"
JUMP_M, JUMP_M_S = 500.0, 50.0  # a fix this far from both neighbours, at this speed, is an error

# Errors of a fix. The README of the data gives 5 m along the track and 0.7 s of time jitter. The jitter of neighbouring fixes is
# correlated, so smaller values predict left-out fixes better: at 5-12 m/s 95 % within 12.0 m instead of 16.6 m (README.md).
ACROSS_M, ALONG_M, JITTER_S = 1.0, 2.0, 0.3
SOG_SIGMA_M_S, COG_SIGMA_RAD, COG_FROM_M_S = 0.2 * KNOT_M_S, np.radians(2.0), 2.0 * KNOT_M_S
UNKNOWN_COURSE_M = 5.0  # in both axes, if the course is unknown
JERK_M2_S5 = 1e-2

MOVING_M_S = 0.5 * KNOT_M_S  # median speed of a vessel that counts as moving
COVERED_SHARE, COVERED_S = (
    0.5,
    60.0,
)  # a vessel can be silenced if it is in radar range for this share of its time and at least this long


class Solent(Method):
    """Recorded AIS with radars simulated along the recorded motion."""

    method: Literal["solent"] = "solent"
    root: Path | None = None  # the folder of the dataset; none: shared/data/solent_ais next to the checkout
    gap_s: Positive = 60.0  # a silence longer than this ends a path
    berthed_gap_s: NotNegative = 0.0  # bridged if the vessel is at rest before and after; 0: never
    silence_mmsi: tuple[int, ...] = ()  # vessels whose AIS is switched off
    silence_share: Share = 0.0  # of the other moving vessels in radar cover, drawn at random
    silence_from_s: NotNegative = 0.0  # after the start of the run
    radar: RadarTruth = RadarTruth()  # how every radar departs from its specification
    radars: tuple[RadarTruth, ...] = ()  # the same of single radars, by name

    def load(self, sensors: Sensors, seed: int, plan: Plan) -> Recording:
        """The even fixes as AIS, radar reports along the smoothed odd fixes, that truth, and the silenced vessels.

        Raises: FileNotFoundError that names the folder; InputError for an unknown radar name or an MMSI that is not recorded.
        """
        fixes, paths, faults = self._recorded()
        stop_s = plan.instant_s(plan.cycles - 1)
        truth = _trajectories(fixes, paths, plan, stop_s)
        silenced = self._silenced(fixes, truth, sensors.radars, seed)
        ais = fixes.ais
        dark = np.isin(ais.origin, silenced) & (ais.received_s > plan.start_s + self.silence_from_s)
        truths = truths_of("radars", sensors.radars.name, self.radar, self.radars)
        radar = observe(sensors.radars, truths, interpolated(truth), truth.vessel, plan.start_s, stop_s, seed)
        beside = *fixes.content.beside, (SILENCED, int(dark.sum()))
        content = replace(fixes.content, records=int((~dark).sum()), beside=beside)
        reports = Reports(radar, ais.take(~dark))
        return Recording(reports, truth, faults, tuple(silenced.tolist()), contents=(content,))

    def span(self, sensors: Callable[[], Sensors], after_s: float, to_the_end: bool) -> tuple[float, float]:
        """Whole seconds before the first and after the last report."""
        fixes, _, faults = self._recorded()
        return span_of(fixes.ais.received_s, faults=faults)

    def _recorded(self) -> tuple[_Fixes, _Paths, tuple[Fault, ...]]:
        file = data_folder(self.root, "solent_ais") / FILE
        return _read_files(fingerprint((file,)), self.gap_s, self.berthed_gap_s)

    def _silenced(self, fixes: _Fixes, truth: Trajectories, radars: Radars, seed: int) -> Ints:
        """The numbers of the vessels whose AIS is switched off, in order."""
        unknown = set(self.silence_mmsi) - set(fixes.mmsi.tolist())
        if unknown:
            raise InputError(f"input.silence_mmsi: got {sorted(unknown)}, needed numbers of the recording")
        named = np.flatnonzero(np.isin(fixes.mmsi, self.silence_mmsi))
        free = np.setdiff1d(truth.vessel[_moves_in_cover(truth, radars)], named)
        drawn = np.random.default_rng([seed, SILENCE]).permutation(free)[: round(self.silence_share * len(free))]
        return np.union1d(named, drawn).astype(np.int64)


class _Fixes(NamedTuple):
    """The cleaned recording."""

    mmsi: Ints  # of each vessel number
    ais: AisReports  # the even fixes, in order of arrival
    content: FileContent


class _Paths(NamedTuple):
    """The odd fixes, smoothed; by vessel, then time."""

    vessel: Ints
    part: Ints
    time_s: Floats
    state: Floats  # (M, 6) in the plane


@lru_cache(maxsize=1)
def _read_files(files: Fingerprint, gap_s: float, berthed_gap_s: float) -> tuple[_Fixes, _Paths, tuple[Fault, ...]]:
    path = files[0][0]
    table = AisTable(files=(path,))
    reports, _, faults = table.read()
    mmsi, vessel = np.unique(reports.mmsi, return_inverse=True)
    reports = replace(reports, origin=vessel.astype(np.int64))
    reports = reports.take(np.lexsort((reports.received_s, reports.origin)))
    tally = Tally()
    jump = _jumps(reports)
    where = [f"{path.name}, at {utc(t)}" for t in reports.time_s[jump]]
    tally.add_rows(POSITION_JUMP, jump, lambda _: where[0], lambda i: f"MMSI {reports.mmsi[i]} {reports.position_deg[i]}")
    reports = reports.take(~jump)
    part = np.cumsum(_breaks(reports, gap_s, berthed_gap_s))
    odd = (np.arange(len(part)) - np.searchsorted(part, part)) % 2 == 1
    seen, sent = reports.take(odd), reports.take(~odd)
    paths = _Paths(seen.origin, part[odd], seen.time_s, _smoothed(seen, part[odd]))
    replayed = sent.take(np.argsort(sent.received_s, kind="stable"))
    (content,) = table.contents()
    beside = *content.beside, (OF_TRUTH, len(seen))
    return _Fixes(mmsi, replayed, replace(content, records=len(replayed), beside=beside)), paths, faults + tally.faults()


def _steps(reports: AisReports) -> tuple[Bools, Floats, Floats]:
    """From each row to the next: whether it is the same vessel, distance in m, time in s. (M - 1,) each"""
    moved = difference_m(reports.position_deg[1:], reports.position_deg[:-1])
    same = np.diff(reports.origin) == 0
    return same, np.hypot(moved[:, 0], moved[:, 1]), np.diff(reports.time_s)


def _jumps(reports: AisReports) -> Bools:
    """Fixes that are too far from both neighbours."""
    same, far, long = _steps(reports)
    leap = np.concatenate([[False], same & (far > JUMP_M) & (far > JUMP_M_S * long), [False]])
    return np.asarray(leap[1:] & leap[:-1])


def _breaks(reports: AisReports, gap_s: float, berthed_gap_s: float) -> Bools:
    """Which rows start a new path."""
    same, far, long = _steps(reports)
    still = (reports.sog_kn[1:] * KNOT_M_S < MOVING_M_S) & (reports.sog_kn[:-1] * KNOT_M_S < MOVING_M_S) & (far < 25.0)
    joined = same & ((long <= gap_s) | (still & (long <= berthed_gap_s)))
    return np.concatenate([[True], ~joined])


def _smoothed(fixes: AisReports, part: Ints) -> Floats:
    """The states of the odd fixes, path by path. (M, 6)"""
    start = np.flatnonzero(np.concatenate([[True], np.diff(part) > 0]))
    length = np.diff(np.append(start, len(part)))
    plane = turn(fixes.position_deg, PLANE_DEG)
    speed = np.nan_to_num(fixes.sog_kn) * KNOT_M_S
    has_course = np.isfinite(fixes.cog_deg) & (speed > 0.0)
    course = np.radians(np.where(has_course, fixes.cog_deg, 0.0))
    ahead = np.einsum("mij,mj->mi", plane, np.stack([np.sin(course), np.cos(course)], axis=-1))
    beside = np.stack([ahead[:, 1], -ahead[:, 0]], axis=-1)
    along_m = np.where(has_course, np.hypot(ALONG_M, JITTER_S * speed), UNKNOWN_COURSE_M)
    across_m = np.where(has_course, ACROSS_M, UNKNOWN_COURSE_M)
    turning = np.where(speed > COG_FROM_M_S, speed * COG_SIGMA_RAD, speed) + SOG_SIGMA_M_S
    swift = np.where(has_course, SOG_SIGMA_M_S, speed + SOG_SIGMA_M_S)
    noise = np.zeros((len(part), 4, 4))
    noise[:, :2, :2] = _ellipse(ahead, along_m) + _ellipse(beside, across_m)
    noise[:, 2:, 2:] = _ellipse(ahead, swift) + _ellipse(beside, turning)
    seen = np.concatenate([to_plane(fixes.position_deg, PLANE_DEG), np.where(has_course, speed, 0.0)[:, None] * ahead], axis=1)
    return smooth(start, length, fixes.time_s, seen, noise, JERK_M2_S5)


def _ellipse(axis: Floats, sigma: Floats) -> Floats:
    return (sigma**2)[:, None, None] * axis[:, :, None] * axis[:, None, :]


def _trajectories(fixes: _Fixes, paths: _Paths, plan: Plan, stop_s: float) -> Trajectories:
    """The truth of all vessels that are present during the run, each second and at the instants of the plan."""
    time_s: Floats = np.unique(np.concatenate([plan.instants_s, np.arange(plan.start_s, stop_s, GRID_S)]))
    vessels, states = [], []
    for vessel in range(len(fixes.mmsi)):
        mine = slice(*np.searchsorted(paths.vessel, [vessel, vessel + 1]))
        if mine.stop - mine.start < 2:
            continue
        state_of_vessel = between(paths.time_s[mine], paths.state[mine], paths.part[mine], time_s)
        if state_of_vessel[2].any():
            vessels.append(vessel)
            states.append(state_of_vessel)
    shape = (len(states), len(time_s))
    present = np.array([f[2] for f in states], np.bool_).reshape(shape)
    nearest = _nearest(present, time_s)
    flat, rate = (np.array([f[k] for f in states]).reshape(*shape, 2) for k in (0, 1))
    flat, velocity = (np.take_along_axis(a, nearest[..., None], axis=1) for a in (flat, rate))
    position = from_plane(flat, PLANE_DEG)
    back = np.swapaxes(turn(position, PLANE_DEG), -1, -2)
    velocity = np.einsum("vtij,vtj->vti", back, velocity)
    return Trajectories.without_model(np.array(vessels, np.int64), time_s, position, velocity, present)


def _nearest(present: Bools, time_s: Floats) -> Ints:
    """For each sample the nearest sample at which the vessel is present. Every vessel is present at some sample. (V, T)"""
    number = np.broadcast_to(np.arange(len(time_s)), present.shape)
    before = np.maximum.accumulate(np.where(present, number, -1), axis=1)
    after = np.minimum.accumulate(np.where(present, number, len(time_s))[:, ::-1], axis=1)[:, ::-1]
    since = np.where(before >= 0, time_s - time_s[np.maximum(before, 0)], np.inf)
    until = np.where(after < len(time_s), time_s[np.minimum(after, len(time_s) - 1)] - time_s, np.inf)
    return np.where(since <= until, before, after)


def _moves_in_cover(truth: Trajectories, radars: Radars) -> Bools:
    """Which vessels move and are in radar range long enough to be seen by radar without AIS. (V,)"""
    covered = np.zeros(truth.present.shape, np.bool_)
    for r in range(len(radars)):
        away = to_plane(truth.position_deg, radars.site_deg[r])
        covered |= np.hypot(away[..., 0], away[..., 1]) <= radars.range_m[r]
    seconds = (covered & truth.present).sum(axis=1) * float(np.median(np.diff(truth.time_s)))
    covered_share = (covered & truth.present).sum(axis=1) / np.maximum(truth.present.sum(axis=1), 1)
    speed = np.where(truth.present, np.hypot(truth.velocity_m_s[..., 0], truth.velocity_m_s[..., 1]), np.nan)
    moving = np.array(
        [np.median(s[p]) > MOVING_M_S if p.any() else False for s, p in zip(speed, truth.present, strict=True)], np.bool_
    )
    return np.asarray(moving & (covered_share >= COVERED_SHARE) & (seconds >= COVERED_S))
