"""Out-of-sequence AIS reports: a late report gives the answer that it would have given in order.

Two snapshots of all tracks are kept: `old`, from before any report that may still arrive, and `recent`. The log holds the reports
admitted since `old`, one entry a cycle. A late report resets only its own vessel, to the snapshot before the report; then the
vessel's reports in the log are replayed. Arrays in memory are never overwritten, so a snapshot is a reference, not a copy. The log
is bounded by time: twice the lateness and two cycles of reports. A report that is later still is taken if it is the newest of its
vessel: there is nothing to replay, and it goes into the snapshots too.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from coastwatch import kernels
from coastwatch.batches import AisReports, Batch, Bools, Floats, Ints, column
from coastwatch.batches.ais_codes import LARGEST_MMSI
from coastwatch.geodesy import KNOT_M_S
from coastwatch.kernels.arrays import Records
from coastwatch.kernels.tables.lookup import find
from coastwatch.tracks.ais.feed_clocks import FeedClocks

Rows = Records
"""Of coastwatch.kernels.filters.ais_records: REPORT or TRACK."""

NOT_COMPARED = ("error", "jitter", "nn", "en", "ee", "feed", "status")
"""Fields that order reports which are the same otherwise."""

SLOTS = 4  # tracks of one MMSI at most, the one on trial included
TOP_SOG_KN = 102.2  # ITU-R M.1371: greater values mean "not available", as does a COG of 360
VERDICTS = ("repeated position", "impossible speed", "crowded", "doubtful velocity")
"""Of coastwatch.kernels.filters.ais_records, from REPEAT on."""


class KernelSettings(NamedTuple):
    """The settings of a method as the kernel takes them."""

    rules: np.void  # coastwatch.kernels.filters.ais_records.RULES
    models: Records  # (J,) coastwatch.kernels.filters.motion_models.MODEL
    position_variance: Floats  # (4,) m2 per axis, by PositionAccuracy + 1
    time_jitter_s: float | None  # of the times of all feeds; None: estimated


@dataclass(frozen=True, eq=False)
class Snapshot:
    """All tracks at the end of a cycle, with every admitted report up to its time and no other."""

    time_s: float
    tracks: Rows  # sorted by mmsi


@dataclass(frozen=True, eq=False)
class Delays(Batch):
    """Vessels whose newest report came later than `lateness_s`: its feed may be late by as much all the time."""

    mmsi: Ints = column(np.int64, "K")  # ascending
    delay_s: Floats = column(np.float64, "K")  # from the fix to its receipt

    def of(self, mmsi: Ints) -> Floats:
        """The delay of each of these vessels, 0 where it is not late."""
        return np.append(self.delay_s, 0.0)[find(self.mmsi, mmsi)]

    def after(self, reports: AisReports, tracks: Rows, time_s: float, lateness_s: float) -> Delays:
        """The delays after the reports of a cycle. Args: tracks: after these reports."""
        delay_s = _received_s(reports, time_s) - reports.time_s
        if not len(self) and not (delay_s > lateness_s).any():
            return self
        newest = reports.time_s == _newest_report_s(tracks, reports.mmsi)
        mmsi, delay_s = reports.mmsi[newest], delay_s[newest]
        order = np.lexsort((delay_s, mmsi))
        mmsi, first = np.unique(mmsi[order], return_index=True)
        now = Delays(mmsi, delay_s[order[first]])
        kept = (find(mmsi, self.mmsi) < 0) & (find(np.unique(tracks["mmsi"]), self.mmsi) >= 0)
        every = Delays.join([now.take(now.delay_s > lateness_s), self.take(kept)])
        return every.take(np.argsort(every.mmsi))


@dataclass(frozen=True, eq=False)
class AisMemory:
    """The tracks of all vessels, with the snapshots and the log that a replay of late reports needs."""

    now: Snapshot
    recent: Snapshot
    old: Snapshot
    log: tuple[Rows, ...]  # admitted in the cycles since `old`, each sorted by `in_order`
    log_time_s: tuple[float, ...]  # when each of these cycles ended
    held: Rows  # reports stamped in the future
    counter: int  # tracks numbered so far
    refused: dict[str, int]
    clocks: FeedClocks
    delays: Delays = Delays.empty()


def initial_memory() -> AisMemory:
    """The memory before the first cycle."""

    nothing = Snapshot(-np.inf, np.zeros(0, kernels.filters.ais_records.TRACK))
    return AisMemory(
        nothing, nothing, nothing, (), (), np.zeros(0, kernels.filters.ais_records.REPORT), 0, {}, FeedClocks.empty()
    )


def in_order(reports: Rows) -> Ints:
    """The indices that sort reports by vessel, then time, then every other column, so that the order of arrival has no effect."""
    order = np.lexsort((reports["time"], reports["mmsi"]))
    mmsi, time = reports["mmsi"][order], reports["time"][order]
    again = (mmsi[1:] == mmsi[:-1]) & (time[1:] == time[:-1])
    if again.any():
        tied = np.flatnonzero(np.append(again, False) | np.append(False, again))
        some = reports[order[tied]]
        names = (*NOT_COMPARED, "origin", "class_b", "cog", "sog", "lon", "lat", "time", "mmsi")
        order[tied] = order[tied][np.lexsort([some[n] for n in names])]
    return order


def vessels(reports: Rows) -> tuple[Ints, Ints, Ints]:
    """Each MMSI in reports sorted by it, and the rows where its reports begin and end."""
    mmsi = reports["mmsi"]
    begin = np.flatnonzero(np.append(True, mmsi[1:] != mmsi[:-1])[: len(mmsi)])
    return mmsi[begin], begin, np.append(begin[1:], len(mmsi)).astype(np.int64)


def records(reports: AisReports, settings: KernelSettings, jitter_s: Floats) -> Rows:
    """The reports as rows for the kernel, in SI and radians. Args: jitter_s: (F,) of the times of each feed."""

    rows = np.empty(len(reports), kernels.filters.ais_records.REPORT)
    rows["time"], rows["mmsi"] = reports.time_s, reports.mmsi
    rows["lat"], rows["lon"] = reports.position_deg[:, 0] + 0.0, reports.position_deg[:, 1] + 0.0  # no -0.0: bits are compared
    speed, course = reports.sog_kn, reports.cog_deg
    rows["sog"] = np.where((speed >= 0.0) & (speed <= TOP_SOG_KN), speed * KNOT_M_S, np.nan)
    rows["cog"] = np.where((course >= 0.0) & (course < 360.0), np.radians(course), np.nan)
    rows["class_b"], rows["origin"], rows["status"] = reports.class_b, reports.origin, reports.nav_status
    rows["feed"] = np.maximum(reports.feed, 0)
    rows["error"] = np.where(reports.time_error_s > 0.0, reports.time_error_s, 0.0)
    rows["ee"] = rows["nn"] = settings.position_variance[reports.accuracy + 1]
    rows["en"] = 0.0
    own = np.flatnonzero(np.isfinite(reports.covariance[:, 0, 0]))
    for name, i, j in (("ee", 0, 0), ("en", 0, 1), ("nn", 1, 1)):
        rows[name][own] = reports.covariance[own, i, j]
    known = np.append(jitter_s, np.zeros(int(rows["feed"].max(initial=0)) + 1))
    rows["jitter"] = known[rows["feed"]] if settings.time_jitter_s is None else settings.time_jitter_s
    return rows


def admit(
    memory: AisMemory,
    reports: AisReports,
    time_s: float,
    lateness_s: float,
    oldest_s: float,
    ahead_s: float,
    settings: KernelSettings,
) -> tuple[Rows, AisMemory]:
    """Admit reports. Args: lateness_s: largest delay of any; oldest_s: of one that is the newest of its vessel.

    Returns: those to take now, sorted by `in_order`; the memory with the others held, or counted as refused.
    """
    rows = records(reports, settings, memory.clocks.sigma_s())
    lat, lon, time = rows["lat"], rows["lon"], rows["time"]
    delay = np.where(np.isfinite(time), _received_s(reports, time_s) - time, 0.0)
    late = (delay > lateness_s) | (time <= memory.old.time_s)
    some = np.flatnonzero(late)
    late[some] = (delay[some] > oldest_s) | (time[some] <= _newest_report_s(memory.now.tracks, rows["mmsi"][some]))
    wrong = {
        "time not finite": ~np.isfinite(time),
        "not a position": ~((np.abs(lat) < 90.0) & (np.abs(lon) <= 180.0)),
        "not an MMSI": (rows["mmsi"] < 0) | (rows["mmsi"] > LARGEST_MMSI),
        "from the future": delay < -ahead_s,
        "too late": late,
    }
    refused, good = dict(memory.refused), np.ones(len(rows), bool)
    for kind, bad in wrong.items():
        _count(refused, kind, int((good & bad).sum()))
        good &= ~bad
    rows = np.concatenate([memory.held, rows[good]])
    wait = rows["time"] > time_s
    held, rows = rows[wait], rows[~wait]
    rows = rows[in_order(rows)]
    fresh = rows[~_is_duplicate(memory, rows)]
    _count(refused, "duplicate", len(rows) - len(fresh))
    return fresh, replace(memory, held=held, refused=refused)


def _received_s(reports: AisReports, time_s: float) -> Floats:
    """When each report was received, not later than now; now where it does not say. (M,)"""
    return np.where(np.isfinite(reports.received_s), np.minimum(reports.received_s, time_s), time_s)


def _count(refused: dict[str, int], kind: str, count: int) -> None:
    if count:
        refused[kind] = refused.get(kind, 0) + count


def _repeats(rows: Rows) -> Bools:
    """Which rows have vessel, time and position of the row before."""
    same = np.ones(max(len(rows) - 1, 0), bool)
    for name in ("mmsi", "time", "lat", "lon"):
        same &= rows[name][1:] == rows[name][:-1]
    return np.append(False, same)[: len(rows)]


def _is_duplicate(memory: AisMemory, rows: Rows) -> Bools:
    """Which reports, sorted by `in_order`, are duplicates of the log or of each other."""
    again = _repeats(rows)
    back = np.flatnonzero(rows["time"] <= _newest_report_s(memory.now.tracks, rows["mmsi"]))
    if len(back):
        logged = _logged(memory, np.unique(rows["mmsi"][back]))
        both = np.concatenate([logged, rows[back]])
        order = np.lexsort((both["lon"], both["lat"], both["time"], both["mmsi"]))  # stable: the logged come first
        again[back] |= _repeats(both[order])[np.argsort(order)][len(logged) :]
    return again


def _newest_report_s(tracks: Rows, mmsi: Ints) -> Floats:
    """Time of each vessel's newest report, -inf for an unknown vessel."""
    known = np.ascontiguousarray(tracks["mmsi"])  # the rows are wide: a search among them misses the cache at every step
    at, out = find(known, mmsi), np.full(len(mmsi), -np.inf)
    out[at >= 0] = tracks["received"][at[at >= 0]]
    return out


def _logged(memory: AisMemory, mmsi: Ints) -> Rows:
    """Reports of these vessels in the log since the old snapshot."""
    parts = [entry[(find(mmsi, entry["mmsi"]) >= 0) & (entry["time"] > memory.old.time_s)] for entry in memory.log]
    return np.concatenate([memory.held[:0], *parts])


def _rows_of_vessels(rows: Rows, mmsi: Ints) -> tuple[Ints, Ints]:
    """Where the rows of each vessel begin and end, among rows sorted by MMSI."""
    known = np.ascontiguousarray(rows["mmsi"])
    return np.searchsorted(known, mmsi), np.searchsorted(known, mmsi, side="right")


def track_vessels(tracks: Rows, mmsi: Ints, reports: Rows, settings: KernelSettings) -> tuple[Rows, Rows]:
    """The tracks of these vessels after their reports, sorted by MMSI, and the outcome of each report. (V,) TRACK, (M,) OUTCOME

    Args: tracks: sorted by mmsi; mmsi: (V,) sorted; reports: of these vessels only, sorted by `in_order`.
    """
    (low, high), (begin, end) = _rows_of_vessels(tracks, mmsi), _rows_of_vessels(reports, mmsi)
    update, of_kernel = kernels.filters.ais_tracker.update, (settings.rules, settings.models)
    outcome = np.zeros(len(reports), kernels.filters.ais_records.OUTCOME)
    if len(tracks):
        single = tracks[np.minimum(low, len(tracks) - 1)]
        single[low == high] = np.zeros(1, tracks.dtype)
    else:
        single = np.zeros(len(mmsi), tracks.dtype)
    several = high - low > 1
    overflowed = update(single, 1, reports, begin, np.where(several, begin, end), *of_kernel, outcome)
    again = np.flatnonzero(several | overflowed)
    if not len(again) and single["hits"].all():
        return single, outcome
    wide = np.zeros(len(again) * SLOTS, tracks.dtype)
    for k in range(SLOTS):
        there = np.flatnonzero(low[again] + k < high[again])
        wide[there * SLOTS + k] = tracks[low[again][there] + k]
    update(wide, SLOTS, reports, begin[again], end[again], *of_kernel, outcome)
    single["hits"][again] = 0
    rows = np.concatenate([single, wide])
    rows = rows[rows["hits"] > 0]
    return rows[np.argsort(rows["mmsi"], kind="stable")], outcome


def replace_tracks(tracks: Rows, mmsi: Ints, rows: Rows) -> Rows:
    """Tracks with those of these vessels (sorted) replaced by `rows`, sorted by MMSI."""
    out = find(mmsi, tracks["mmsi"]) >= 0
    if out.all():
        return rows
    if np.array_equal(tracks["mmsi"][out], rows["mmsi"]):
        tracks = tracks.copy()
        tracks[out] = rows
        return tracks
    return _merge(tracks[~out], rows)


def _merge(first: Rows, second: Rows) -> Rows:
    """Two sets of rows as one, sorted by MMSI."""
    order = np.argsort(np.concatenate([first["mmsi"], second["mmsi"]]), kind="stable")
    at = np.empty_like(order)
    at[order] = np.arange(len(order))
    out = np.empty(len(order), first.dtype)
    out[at[: len(first)]], out[at[len(first) :]] = first, second
    return out


def update_tracks(memory: AisMemory, fresh: Rows, settings: KernelSettings) -> tuple[AisMemory, Rows]:
    """Update tracks by the admitted reports. Vessels with a late report are replayed; the others are updated in order.

    Returns: the memory; the reports, without the velocities that were not believed.
    """
    mmsi, begin, _ = vessels(fresh)
    late = fresh["time"][begin] <= np.maximum(_newest_report_s(memory.now.tracks, mmsi), memory.recent.time_s)
    behind = find(mmsi[late], fresh["mmsi"]) >= 0
    rows, outcome = track_vessels(memory.now.tracks, mmsi[~late], fresh[~behind], settings)
    recent, old, refused = memory.recent, memory.old, dict(memory.refused)
    _count_verdicts(refused, outcome["verdict"])
    clocks = memory.clocks.updated(fresh["feed"][~behind], outcome["delay"], outcome["variance"])
    doubted = np.flatnonzero(~behind)[outcome["verdict"] == kernels.filters.ais_records.DOUBTED]
    if late.any():
        old, recent, played = _replay(memory, mmsi[late], fresh[behind], settings, refused)
        rows = _merge(rows, played)
    now = replace(memory.now, tracks=replace_tracks(memory.now.tracks, mmsi, rows))
    believed = fresh
    if len(doubted):
        believed = fresh.copy()
        believed["sog"][doubted] = believed["cog"][doubted] = np.nan
    return replace(memory, now=now, recent=recent, old=old, refused=refused, clocks=clocks), believed


def _replay(
    memory: AisMemory, mmsi: Ints, fresh: Rows, settings: KernelSettings, refused: dict[str, int]
) -> tuple[Snapshot, Snapshot, Rows]:
    """Replay vessels with their late reports in order. Returns: the old and recent snapshot, their tracks. Counts into `refused`."""
    old, very_late = memory.old, fresh["time"] <= memory.old.time_s
    if very_late.any():  # each newer than any report of its vessel
        first = np.unique(fresh["mmsi"][very_late])
        rows, outcome = track_vessels(old.tracks, first, fresh[very_late], settings)
        _count_verdicts(refused, outcome["verdict"])
        old = replace(old, tracks=replace_tracks(old.tracks, first, _with_former_numbers(memory.now.tracks, rows, first)))
    logged = _logged(memory, mmsi)
    play = np.concatenate([logged, fresh[~very_late]])
    order = in_order(play)
    play, new = play[order], order >= len(logged)
    recent = memory.recent
    first = np.unique(fresh["mmsi"][fresh["time"] <= recent.time_s])
    before = play["time"] <= recent.time_s
    if len(first):
        part = before & (find(first, play["mmsi"]) >= 0)
        rows, outcome = track_vessels(old.tracks, first, play[part], settings)
        _count_verdicts(refused, outcome["verdict"][new[part]])
        recent = replace(recent, tracks=replace_tracks(recent.tracks, first, _with_former_numbers(recent.tracks, rows, first)))
    rows, outcome = track_vessels(recent.tracks, mmsi, play[~before], settings)
    _count_verdicts(refused, outcome["verdict"][new[~before]])
    return old, recent, _with_former_numbers(memory.now.tracks, rows, mmsi)


def _count_verdicts(refused: dict[str, int], verdict: Ints) -> None:
    if verdict.any():
        for code, kind in enumerate(VERDICTS, start=1):
            _count(refused, kind, int((verdict == code).sum()))


def _with_former_numbers(former: Rows, rows: Rows, mmsi: Ints) -> Rows:
    """Tracks after a replay, with the numbers that they had before."""

    rows = rows.copy()
    kernels.filters.ais_tracker.carry_numbers(former, *_rows_of_vessels(former, mmsi), rows, *_rows_of_vessels(rows, mmsi))
    return rows


def end_cycle(memory: AisMemory, fresh: Rows, tracks: Rows, counter: int, time_s: float, lateness_s: float) -> AisMemory:
    """The memory at the end of a cycle: snapshots advance where the lateness allows, and the log is cut to what they need."""
    now, recent, old = Snapshot(time_s, tracks), memory.recent, memory.old
    if recent.time_s <= time_s - lateness_s:
        old, recent = recent, now
    entries = [(t, e) for t, e in zip((*memory.log_time_s, time_s), (*memory.log, fresh), strict=True) if t > old.time_s]
    log, times = tuple(e for _, e in entries), tuple(t for t, _ in entries)
    return replace(memory, now=now, recent=recent, old=old, log=log, log_time_s=times, counter=counter)
