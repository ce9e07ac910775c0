"""Finished tracks of other systems, as they come: they are not filtered a second time."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import numpy as np
from pydantic import Field

from coastwatch.batches import (
    ID_STRIDE,
    Batch,
    Bools,
    Floats,
    Ints,
    Sensors,
    Struct,
    TrackReports,
    Tracks,
    TrackSources,
    TrackSourceStates,
    column,
    joint_keys,
    optional_column,
)
from coastwatch.geodesy import KNOT_M_S, difference_m, earth_centred, offset_deg
from coastwatch.kernels.filters.gaussian import squared_distance
from coastwatch.kernels.tables.lookup import row_of
from coastwatch.stage import Method, Positive
from coastwatch.tracks.inputs import ReceivedInput

INTERVALS = 2.5  # of a track's own, until it is dropped
SHORTEST_STEP_S = 1.0  # between two positions that give a velocity
KEPT = 256  # newest differences to AIS partners of a source
MEDIAN_OF_SQUARE = 2.0 * np.log(2.0)  # of the squared length of two normal errors of variance 1
SIGMAS_MADE = 6.0  # of one position, in the velocity between two, over the time between them: three standard deviations
INTERVAL_GAIN = 0.1  # of a cycle, in the interval of a source
LOST_KEPT_S = 300.0  # for how long tracks that ended are known
OVERDUE = 0.75  # of its interval: a track that is sent is not silent for longer when another one of its source begins
SUCCESSOR_GATE = 9.21  # squared distance of a track to the one that it goes on as, of two dimensions: 99 %
LEAST_SIGMA_M, LEAST_SIGMA_M_S = 1.0, 0.05


@dataclass(frozen=True, eq=False)
class ReceivedTable(Batch):
    """The newest state of each track, sorted by source, then number."""

    sensor: Ints = column(np.int64, "N")
    number: Ints = column(np.int64, "N")  # as the source gives it
    track: Ints = column(np.int64, "N")  # part of the track id: never used again
    time_s: Floats = column(np.float64, "N")
    started_s: Floats = column(np.float64, "N")
    interval_s: Floats = column(np.float64, "N")  # between its two newest states
    position_deg: Floats = column(np.float64, "N", 2)
    velocity_m_s: Floats = column(np.float64, "N", 2)
    base_time_s: Floats = column(np.float64, "N")  # of the state from which the next velocity is measured
    base_position_deg: Floats = column(np.float64, "N", 2)
    covariance: Floats = column(np.float64, "N", 4, 4)  # as given; NaN where the source gives none
    origin: Ints = column(np.int64, "N")
    echo_length_m: Floats = optional_column("N")
    echo_width_m: Floats = optional_column("N")
    echo_axis_deg: Floats = optional_column("N")
    alternative_m: Floats = optional_column("N")
    made_over_s: Floats = optional_column("N")  # time between the two positions that the velocity is made of; NaN: it is given


@dataclass(frozen=True, eq=False)
class Differences(Struct):
    """Squared differences of tracks without covariance to their AIS partners, the newest last, NaN before the first."""

    position_m2: Floats = column(np.float64, "S", KEPT, new=np.nan)  # of each source, less the variance of AIS
    velocity_m2_s2: Floats = column(np.float64, "S", KEPT, new=np.nan)


class _Made(NamedTuple):
    """Velocities that are made of positions at least SHORTEST_STEP_S apart, NaN where there are none."""

    velocity_m_s: Floats  # (M, 2)
    over_s: Floats  # (M,) the time between the two positions
    base_time_s: Floats  # (M,) of the position from which the next one is made
    base_position_deg: Floats  # (M, 2)


@dataclass(frozen=True, eq=False)
class ReceivedMemory:
    """The tracks, and what is known of their errors."""

    table: ReceivedTable
    differences: Differences
    next_track: int
    states: Ints  # (S,) of each source, so far
    dropped: Ints  # (S,) of them: stamp not finite, from the future, or before that of the state that is kept
    lost: ReceivedTable = ReceivedTable.empty()  # tracks that ended lately: a state of one tells the interval of its source
    interval_s: Floats = field(default_factory=lambda: np.zeros(0))  # (S,) usual one between states; 0: not known


class ReceivedTracks(Method):
    """The newest state of each track, with its own covariance.

    - A track keeps its id while its source sends its number, and ends where another one goes on with its vessel. After its patience,
      or an impossible jump, the number is of another track. The patience is 2.5 intervals, if longer than `patience_s`.
    - A track without velocity gets the one between its two newest positions, or over 1 s where they are nearer in time. Its variance
      is that of these positions, with which it goes together.
    - Tracks without covariance get one for the whole source: the median of their squared differences to AIS partners, less the
      variance of AIS. A partner is the nearest AIS track within `partner_m`, of which it is the nearest too, of similar velocity.

    Source of the median: of |d|^2 with two independent normal components of variance s^2 it is 2 ln(2) s^2.
    """

    method: Literal["received"] = "received"
    max_speed_kn: Positive = 80.0  # no vessel jumps faster; beyond, a number is of another track
    partner_m: Positive = 500.0  # largest distance of an AIS partner
    partner_m_s: Positive = 3.0  # largest difference of its velocity
    partners: int = Field(20, ge=2)  # differences that an estimate needs
    ahead_s: Positive = 5.0  # a state stamped more than this after the cycle is dropped

    def init(self) -> ReceivedMemory:
        none = np.zeros(0, np.int64)
        return ReceivedMemory(ReceivedTable.empty(), Differences.empty(), 1, none, none.copy())

    def step(self, memory: ReceivedMemory, given: ReceivedInput) -> tuple[ReceivedMemory, Tracks]:
        """The tracks that are alive, each at the time of its newest state.

        Returns: memory, with the dropped states counted; Tracks sorted by source, then number. A velocity that nobody knows is 0,
        with a standard deviation of `max_speed_kn` / 4.
        """
        reports, time_s, sensors, ais_tracks = given
        sources = sensors.track_sources
        if not len(sources):
            return memory, Tracks.empty()
        before, states, dropped = memory.differences, memory.states, memory.dropped
        if len(states) != len(sources):
            before = Differences.empty(S=len(sources))
            states = dropped = np.zeros(len(sources), np.int64)
        usable = np.isfinite(reports.time_s) & (reports.time_s <= time_s + self.ahead_s)
        newest = _newest(reports.take(usable))
        known_s = np.append(memory.table.time_s, -np.inf)[_row_of(memory.table, newest)]  # row -1: a new track
        refused = np.concatenate([reports.sensor[~usable], newest.sensor[newest.time_s < known_s]])
        states = states + np.bincount(reports.sensor, minlength=len(sources))
        dropped = dropped + np.bincount(refused, minlength=len(sources))
        table, fresh, next_track = self._updated(memory.table, newest, sources.position_sigma_m, memory.next_track)
        interval_s = _interval_s(memory, newest, len(sources))
        usual_s = np.maximum(table.interval_s, interval_s[table.sensor])
        alive = time_s - table.time_s <= np.maximum(sources.patience_s[table.sensor], INTERVALS * usual_s)
        lost = ReceivedTable.join([memory.lost.take(_row_of(table, memory.lost) < 0), table.take(~alive)])
        table, fresh, usual_s = table.take(alive), fresh[alive], usual_s[alive]
        of_source = np.sqrt(self._variances(before, sources)[0])
        differences = self._compared(before, table.take(fresh), time_s, ais_tracks, of_source)
        position_m2, velocity_m2_s2 = self._variances(differences, sources)
        tracks = self._tracks(table, position_m2[table.sensor], velocity_m2_s2[table.sensor], sensors)
        ended = self._renumbered(table, tracks, fresh, usual_s, time_s)
        lost = ReceivedTable.join([lost, table.take(ended)])
        lost = lost.take(time_s - lost.time_s <= LOST_KEPT_S)
        memory = ReceivedMemory(table.take(~ended), differences, next_track, states, dropped, lost, interval_s)
        return memory, tracks.take(~ended)

    def summary(self, memory: ReceivedMemory, sensors: Sensors) -> TrackSourceStates:
        """What is known of each track source after a cycle; empty before the first. Args: memory: as `step` returns it."""
        if not len(memory.states):
            return TrackSourceStates.empty()
        position_m2, velocity_m2_s2 = self._variances(memory.differences, sensors.track_sources)
        return TrackSourceStates(
            states=memory.states,
            dropped=memory.dropped,
            tracks=np.bincount(memory.table.sensor, minlength=len(memory.states)),
            position_sigma_m=np.sqrt(position_m2),
            velocity_sigma_m_s=np.sqrt(velocity_m2_s2),
            partners=np.count_nonzero(np.isfinite(memory.differences.position_m2), axis=1),
        )

    def _variances(self, differences: Differences, sources: TrackSources) -> tuple[Floats, Floats]:
        """The variances of position and of velocity of the tracks of each source, per axis. (S,), (S,)"""
        position_m2 = _variance(differences.position_m2, self.partners, sources.position_sigma_m, LEAST_SIGMA_M)
        return position_m2, _variance(differences.velocity_m2_s2, self.partners, sources.velocity_sigma_m_s, LEAST_SIGMA_M_S)

    def _updated(
        self, table: ReceivedTable, new: TrackReports, sigma_m: Floats, next_track: int
    ) -> tuple[ReceivedTable, Bools, int]:
        """The table with these states, no track twice; which rows are new or changed; the next number of a track."""
        old = _row_of(table, new)
        known = old >= 0
        row = np.maximum(old, 0)
        late = known.copy()
        late[known] = new.time_s[known] <= table.time_s[row[known]]
        new, known, row = new.take(~late), known[~late], row[~late]
        step_s = np.full(len(new), np.nan)
        moved = np.full((len(new), 2), np.nan)
        step_s[known] = new.time_s[known] - table.time_s[row[known]]
        moved[known] = difference_m(new.position_deg[known], table.position_deg[row[known]])
        reach = self.max_speed_kn * KNOT_M_S * step_s + 8.0 * sigma_m[new.sensor]
        same = known & (np.hypot(moved[:, 0], moved[:, 1]) <= reach)
        made = _made_velocities(table, new, same, row)
        track = np.full(len(new), -1, np.int64)
        track[same] = table.track[row[same]]
        track[~same] = next_track + np.arange(int((~same).sum()))
        started = new.time_s.copy()
        started[same] = table.started_s[row[same]]
        fresh = ReceivedTable(
            sensor=new.sensor,
            number=new.number,
            track=track,
            time_s=new.time_s,
            started_s=started,
            interval_s=np.where(same, step_s, 0.0),
            position_deg=new.position_deg,
            velocity_m_s=np.where(np.isfinite(new.velocity_m_s), new.velocity_m_s, made.velocity_m_s),
            base_time_s=made.base_time_s,
            base_position_deg=made.base_position_deg,
            covariance=new.covariance,
            origin=new.origin,
            echo_length_m=new.echo_length_m,
            echo_width_m=new.echo_width_m,
            echo_axis_deg=new.echo_axis_deg,
            alternative_m=new.alternative_m,
            made_over_s=np.where(np.isfinite(new.velocity_m_s).all(axis=1), np.nan, made.over_s),
        )
        kept = np.ones(len(table), np.bool_)
        kept[row[known]] = False
        joined = ReceivedTable.join([table.take(kept), fresh])
        changed = np.concatenate([np.zeros(int(kept.sum()), np.bool_), np.ones(len(fresh), np.bool_)])
        order = np.lexsort((joined.number, joined.sensor))
        return joined.take(order), changed[order], next_track + int((~same).sum())

    def _compared(self, before: Differences, fresh: ReceivedTable, time_s: float, ais: Tracks, sigma_m: Floats) -> Differences:
        """The differences, with those of the fresh states without covariance to their AIS partners.

        A velocity that is made of positions is compared as uncertain as they make it, and says nothing of velocities that are given.
        Then the partner goes back to the time of the state by its own velocity.
        Args: sigma_m: (S,) standard deviation of positions, as known so far.
        """
        without = ~np.isfinite(fresh.covariance).all(axis=(1, 2)) & np.isfinite(fresh.velocity_m_s).all(axis=1)
        fresh = fresh.take(np.flatnonzero(without))
        if not len(fresh) or not len(ais):
            return before
        now_deg = offset_deg(fresh.position_deg, (time_s - fresh.time_s)[:, None] * fresh.velocity_m_s)
        here, there = earth_centred(now_deg), earth_centred(ais.position_deg)
        mine, rows = _mutual(here, there, self.partner_m)
        apart_m = difference_m(now_deg[mine], ais.position_deg[rows])
        apart_m_s = fresh.velocity_m_s[mine] - ais.velocity_m_s[rows]
        given = np.isnan(fresh.made_over_s[mine])
        apart_m -= np.where(given, 0.0, time_s - fresh.time_s[mine])[:, None] * apart_m_s
        made_m_s = np.nan_to_num(SIGMAS_MADE * sigma_m[fresh.sensor[mine]] / fresh.made_over_s[mine])
        alike = np.hypot(apart_m_s[:, 0], apart_m_s[:, 1]) <= self.partner_m_s + made_m_s
        variance = np.nan_to_num(np.diagonal(ais.covariance[rows], axis1=1, axis2=2))
        position = (apart_m**2).sum(axis=1) - MEDIAN_OF_SQUARE * 0.5 * variance[:, :2].sum(axis=1)
        velocity = (apart_m_s**2).sum(axis=1) - MEDIAN_OF_SQUARE * 0.5 * variance[:, 2:].sum(axis=1)
        sensor = fresh.sensor[mine]
        return Differences(
            _appended(before.position_m2, sensor[alike], position[alike]),
            _appended(before.velocity_m2_s2, sensor[alike & given], velocity[alike & given]),
        )

    def _renumbered(self, table: ReceivedTable, tracks: Tracks, fresh: Bools, usual_s: Floats, time_s: float) -> Bools:
        """Which tracks go on under another number. (N,) Args: tracks: of the table; fresh: (N,) sent in this cycle; usual_s: (N,)."""
        ended = np.zeros(len(table), np.bool_)
        silent = ~fresh & (usual_s > 0.0) & (time_s - table.time_s >= OVERDUE * usual_s)
        young = time_s - table.started_s <= INTERVALS * usual_s + SHORTEST_STEP_S
        for source in np.unique(table.sensor[silent]).tolist():
            of_source = table.sensor == source
            old, new = np.flatnonzero(silent & of_source), np.flatnonzero(young & of_source)
            old, new = self._nearest(table, time_s, old, new)
            dt = (table.time_s[new] - table.time_s[old])[:, None]
            began = table.started_s[new] - table.time_s[old] >= OVERDUE * usual_s[old]
            expected_deg = offset_deg(table.position_deg[old], dt * tracks.velocity_m_s[old])
            p = tracks.covariance[old]
            cross, step_s = p[:, :2, 2:], dt[:, :, None]
            spread = p[:, :2, :2] + step_s * (cross + p[:, 2:, :2]) + step_s**2 * p[:, 2:, 2:] + tracks.covariance[new, :2, :2]
            near = squared_distance(difference_m(table.position_deg[new], expected_deg), spread) <= SUCCESSOR_GATE
            apart_m_s = np.nan_to_num(table.velocity_m_s[new] - table.velocity_m_s[old])
            ended[old[began & near & (np.hypot(*apart_m_s.T) <= self.partner_m_s)]] = True
        return ended

    def _nearest(self, table: ReceivedTable, time_s: float, old: Ints, new: Ints) -> tuple[Ints, Ints]:
        """The pairs of an old and a new row that are each other's nearest, within `partner_m`. (P,), (P,)"""
        rows = np.append(old, new)
        moved_m = (time_s - table.time_s[rows])[:, None] * np.nan_to_num(table.velocity_m_s[rows])
        now = earth_centred(offset_deg(table.position_deg[rows], moved_m))
        of_old, of_new = _mutual(now[: len(old)], now[len(old) :], self.partner_m)
        return old[of_old], new[of_new]

    def _tracks(self, table: ReceivedTable, position_m2: Floats, velocity_m2_s2: Floats, sensors: Sensors) -> Tracks:
        n = len(table)
        unmoved = np.asarray(np.isnan(table.velocity_m_s).any(axis=1))
        made = np.zeros((n, 4, 4))
        made[:, 0, 0] = made[:, 1, 1] = position_m2
        made[:, 2, 2] = made[:, 3, 3] = np.where(unmoved, (0.25 * self.max_speed_kn * KNOT_M_S) ** 2, velocity_m2_s2)
        covariance = table.covariance.copy()
        unknown = ~np.isfinite(covariance[:, :2, :2]).all(axis=(1, 2))
        covariance[unknown] = made[unknown]
        half = ~np.isfinite(covariance).all(axis=(1, 2))
        covariance[half, :2, 2:] = covariance[half, 2:, :2] = 0.0
        covariance[half, 2:, 2:] = made[half, 2:, 2:]
        of_two = np.flatnonzero((half | unknown) & np.isfinite(table.made_over_s))
        position, step_s = covariance[of_two, :2, :2], table.made_over_s[of_two, None, None]
        covariance[of_two, :2, 2:] = covariance[of_two, 2:, :2] = position / step_s
        covariance[of_two, 2:, 2:] = 2.0 * position / step_s**2 + LEAST_SIGMA_M_S**2 * np.eye(2)
        source = sensors.track_source(0) + table.sensor
        return Tracks(
            track_id=source * ID_STRIDE + table.track,
            source=source,
            time_s=table.time_s,
            position_deg=table.position_deg,
            velocity_m_s=np.where(unmoved[:, None], 0.0, table.velocity_m_s),
            covariance=covariance,
            report_covariance=covariance[:, :2, :2].copy(),
            updated_s=table.time_s,
            started_s=table.started_s,
            mmsi=np.full(n, -1, np.int64),
            origin=table.origin,
            echo_length_m=table.echo_length_m,
            echo_width_m=table.echo_width_m,
            echo_axis_deg=table.echo_axis_deg,
            alternative_m=table.alternative_m,
        )


def _interval_s(memory: ReceivedMemory, newest: TrackReports, count: int) -> Floats:
    """The usual interval of each source after these states, also of tracks that have ended between two of them. (S,)"""
    out = memory.interval_s.copy() if len(memory.interval_s) == count else np.zeros(count)
    every = ReceivedTable.join([memory.table, memory.lost])
    row = _row_of(every, newest)
    step_s = newest.time_s[row >= 0] - every.time_s[row[row >= 0]]
    sensor, step_s = newest.sensor[row >= 0][step_s > 0.0], step_s[step_s > 0.0]
    for source in np.unique(sensor).tolist():
        now_s = float(np.median(step_s[sensor == source]))
        out[source] += INTERVAL_GAIN * (now_s - out[source]) if out[source] else now_s
    return out


def _made_velocities(table: ReceivedTable, new: TrackReports, same: Bools, row: Ints) -> _Made:
    """The velocities of tracks by their positions. Args: same: (M,) tracks that go on; row: (M,) theirs in the table."""
    velocity, over_s = np.full((len(new), 2), np.nan), np.full(len(new), np.nan)
    base_time_s, base_position_deg = new.time_s.copy(), new.position_deg.copy()
    velocity[same], over_s[same] = table.velocity_m_s[row[same]], table.made_over_s[row[same]]
    base_time_s[same], base_position_deg[same] = table.base_time_s[row[same]], table.base_position_deg[row[same]]
    due = np.flatnonzero(new.time_s - base_time_s >= SHORTEST_STEP_S)
    over_s[due] = new.time_s[due] - base_time_s[due]
    velocity[due] = difference_m(new.position_deg[due], base_position_deg[due]) / over_s[due, None]
    base_time_s[due], base_position_deg[due] = new.time_s[due], new.position_deg[due]
    return _Made(velocity, over_s, base_time_s, base_position_deg)


def _newest(reports: TrackReports) -> TrackReports:
    """The newest state of each track, sorted by source, then number."""
    order = np.lexsort((reports.received_s, reports.time_s, reports.number, reports.sensor))
    some = reports.take(order)
    last = np.ones(len(some), np.bool_)
    last[:-1] = (some.sensor[1:] != some.sensor[:-1]) | (some.number[1:] != some.number[:-1])
    return some.take(last)


def _row_of(table: ReceivedTable, new: TrackReports | ReceivedTable) -> Ints:
    """The row of each track in the table, -1 where it has none. (M,)"""
    known, wanted = joint_keys((table.sensor, table.number), (new.sensor, new.number))
    return row_of(known, wanted)


def _mutual(here: Floats, there: Floats, within_m: float) -> tuple[Ints, Ints]:
    """The rows of positions that are each other's nearest, within a distance. (P,), (P,) Args: here, there: (N, 3), (M, 3) m."""
    if not len(here) or not len(there):
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    from scipy.spatial import cKDTree  # here: only a run with received tracks needs its 40 MB

    distance_m, nearest = cKDTree(there).query(here, distance_upper_bound=within_m)
    mine = np.flatnonzero(np.isfinite(distance_m))
    theirs = np.asarray(nearest)[mine]
    mutual = cKDTree(here).query(there[theirs])[1] == mine
    return mine[mutual], theirs[mutual]


def _appended(kept: Floats, sensor: Ints, values: Floats) -> Floats:
    """The newest values of each source, with these after them."""
    out = kept.copy()
    for source in np.unique(sensor):
        out[source] = np.concatenate([kept[source], values[sensor == source]])[-KEPT:]
    return out


def _variance(squares: Floats, least: int, sigma: Floats, smallest: float) -> Floats:
    """The variance per axis of each source: from its differences if there are enough, else as set. (S,)"""
    out = sigma**2
    counted = np.count_nonzero(np.isfinite(squares), axis=1)
    enough = np.flatnonzero(counted >= least)
    if len(enough):
        out[enough] = np.maximum(np.nanmedian(squares[enough], axis=1) / MEDIAN_OF_SQUARE, smallest**2)
    return np.asarray(out)
