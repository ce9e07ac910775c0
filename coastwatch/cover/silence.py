"""Which sensors are silent: heard before, and now not for much longer than they usually pause."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np

from coastwatch import kernels
from coastwatch.batches import Bools, Floats, Ints, Reports, Sensors, Tracks
from coastwatch.batches.hearing import Hearing, SensorHearing
from coastwatch.batches.struct import Batch, column
from coastwatch.cover.inputs import SilenceInput
from coastwatch.stage import Method, NotNegative, Positive

LEARNT_OVER = 20.0  # pauses whose mean is the usual one
LEAST_PAUSES = 4.0  # without so many of them nothing is known of a sensor
NEVER_HEARD_S = (
    180.0  # since the start, before AIS that was never heard is silent: the longest interval of AIS (ITU-R M.1371-5)
)
MOST_LEARNT = 2.0  # a pause is learnt as at most so many times what makes a sensor silent: a failure is no habit


@dataclass(frozen=True, eq=False)
class Habits(Batch):
    """What was heard of sensors: radars, track sources, AIS as a whole, then each AIS station. S rows."""

    heard_s: Floats = column(np.float64, "S", new=-np.inf)  # newest report; -inf: none
    stood_s: Floats = column(np.float64, "S")  # time since then in which nothing was asked of it
    usual_s: Floats = column(np.float64, "S", new=np.nan)  # mean pause between cycles with reports; NaN: not known
    pauses: Floats = column(np.float64, "S")  # behind it, up to less than LEARNT_OVER
    amount: Floats = column(np.float64, "S")  # as of `Hearing`
    silent: Bools = column(np.bool_, "S")
    returned_s: Floats = column(np.float64, "S", new=-np.inf)  # as of `Hearing`
    has_own: Bools = column(np.bool_, "S")  # of a station: heard from where no other one reaches


@dataclass(frozen=True, eq=False)
class SilenceMemory:
    """What is known of the sensors between two cycles; no row before the first."""

    habits: Habits
    time_s: float  # of the newest cycle
    began_s: float = np.nan  # first cycle of the run; NaN: not known


class Heard(NamedTuple):
    """What came in a cycle. (S,) each."""

    reports: Floats  # how many
    newest_s: Floats  # when the newest one was received; -inf: none came
    amount: Floats
    has_own: Bools  # as of `Habits`, after the cycle


class UsualPauses(Method):
    """A sensor is silent when it has sent nothing for so many times its usual pause.

    - The usual pause is the mean of the last pauses between cycles with reports; of a radar at least one turn.
    - A sensor of which few vessels or plots were heard is never silent: they may have left. One vessel that stops sending is dark.
    - A sensor that was not heard since the start is not silent either. It covers nothing: nothing shows that it works.
      AIS as a whole is silent then too, 180 s after the start, where there are stations: only its alarm follows from that.
    - A station is heard by reports from where no other station reaches, if there were any.
    - While AIS as a whole is silent, nothing is asked of a station.
    """

    method: Literal["usual_pauses"] = "usual_pauses"
    ais_pauses: Positive = 10.0  # number of usual pauses without a report, after which AIS or a station is silent
    ais_least_s: Positive = 30.0  # without a report, before AIS or a station is silent
    radar_pauses: Positive = 5.0  # usual pauses, or turns if these are longer, without a plot, after which a radar is silent
    radar_least_s: Positive = 15.0  # without a plot, before a radar is silent
    source_pauses: Positive = 5.0  # usual pauses without a track, after which a track source is silent
    source_least_s: Positive = 30.0  # without a track, before a track source is silent
    least_amount: NotNegative = (
        3.0  # vessels on AIS, or plots or tracks of a cycle; of a sensor that had fewer silence proves nothing
    )

    def init(self) -> SilenceMemory:
        return SilenceMemory(Habits.empty(), -np.inf)

    def step(self, memory: SilenceMemory, given: SilenceInput) -> tuple[SilenceMemory, SensorHearing]:
        """Which sensors are heard in this cycle."""
        reports, ais_tracks, time_s, sensors = given
        kinds = len(sensors.radars), len(sensors.track_sources), 1 + len(sensors.stations)
        whole = kinds[0] + kinds[1]
        before = memory.habits if len(memory.habits) else Habits.empty(S=sum(kinds))
        turn_s = np.append(sensors.radars.period_s, np.zeros(sum(kinds[1:])))
        came = _heard(reports, ais_tracks, before, time_s, sensors)
        after = _learnt(before, came, self._allowed_s(before, turn_s, kinds), kinds[0] + kinds[1])
        from_s = np.where(before.silent, memory.time_s, before.heard_s + before.stood_s)  # since when each is silent, if it is
        allowed_s = self._allowed_s(after, turn_s, kinds)
        may_be = (after.pauses >= LEAST_PAUSES) & (after.amount >= self.least_amount)
        all_silent = bool(may_be[whole] and time_s - after.heard_s[whole] > allowed_s[whole])
        if all_silent:  # nothing is asked of a station: its clock stands too
            after.stood_s[whole + 1 :] += time_s - from_s[whole]
        silent = may_be & (time_s - after.heard_s - after.stood_s > allowed_s)
        returned_s = np.where(before.silent & ~silent, time_s, before.returned_s)
        after = replace(after, silent=silent, returned_s=returned_s)
        shown, shown_from_s, shown_back_s = silent.copy(), from_s.copy(), returned_s.copy()
        shown_back_s[whole + 1 :] = np.maximum(shown_back_s[whole + 1 :], returned_s[whole])
        if all_silent:
            shown[whole + 1 :] = np.isfinite(after.heard_s[whole + 1 :])
            shown_from_s[whole + 1 :] = np.where(silent & before.silent, from_s, from_s[whole])[whole + 1 :]
        began_s = float(time_s) if np.isnan(memory.began_s) else memory.began_s
        if len(sensors.stations) and after.heard_s[whole] == -np.inf:
            shown[whole], shown_from_s[whole] = time_s - began_s > max(self.ais_least_s, NEVER_HEARD_S), began_s
        row, ends = np.arange(sum(kinds)), (kinds[0], whole, whole + 1)
        stands = shown | (before.silent & (row < kinds[0]))  # of a radar that returns too: see `Hearing`
        stands_s, known_until_s = np.where(stands, shown_from_s, np.inf), np.where(may_be, after.heard_s, np.inf)
        hearing = Hearing(after.heard_s, after.usual_s, after.amount, shown, stands_s, shown_back_s, known_until_s)
        of_radars, of_sources, of_ais, of_stations = (hearing.take(rows) for rows in np.split(row, ends))
        return SilenceMemory(after, float(time_s), began_s), SensorHearing(of_radars, of_stations, of_sources, of_ais)

    def _allowed_s(self, habits: Habits, turn_s: Floats, kinds: tuple[int, int, int]) -> Floats:
        """How long each sensor may pause. (S,) Args: turn_s: (S,) of radars; kinds: how many sensors are of each."""
        pauses = np.repeat([self.radar_pauses, self.source_pauses, self.ais_pauses], kinds)
        least_s = np.repeat([self.radar_least_s, self.source_least_s, self.ais_least_s], kinds)
        allowed_s: Floats = np.fmax(least_s, pauses * np.fmax(habits.usual_s, turn_s))
        return allowed_s


def _heard(reports: Reports, ais_tracks: Tracks, before: Habits, time_s: float, sensors: Sensors) -> Heard:
    """What came of each sensor, of the reports with a time. Args: before: the habits before the cycle."""
    radars, sources, stations = len(sensors.radars), len(sensors.track_sources), len(sensors.stations)
    whole = radars + sources
    count, newest_s = np.zeros(len(before)), np.full(len(before), -np.inf)
    spokes = [(0, radars, np.full(len(part), part.sensor), part.received_s) for part in reports.video.parts]
    for first, rows, sensor, received_s in (
        (0, radars, reports.radar.sensor, reports.radar.received_s),
        (radars, sources, reports.tracks.sensor, reports.tracks.received_s),
        *spokes,
    ):
        is_counted = (sensor >= 0) & (sensor < rows) & np.isfinite(received_s)
        count[first : first + rows] += np.bincount(sensor[is_counted], minlength=rows)
        np.maximum.at(newest_s, first + sensor[is_counted], received_s[is_counted])
    amount, has_own, ais = count.copy(), before.has_own.copy(), reports.ais
    timed = np.isfinite(ais.received_s)
    ais = ais if timed.all() else ais.take(timed)
    received_s = np.append(ais.received_s, reports.statics.received_s[np.isfinite(reports.statics.received_s)])
    count[whole:], newest_s[whole:] = len(received_s), received_s.max(initial=-np.inf)
    amount[whole:] = len(ais_tracks)
    if stations > 1:  # a single one hears all there is
        each = slice(whole + 1, None)
        row, station, own = _at_stations(ais.position_deg, sensors)
        has_own[each] |= np.bincount(station[own], minlength=stations) > 0
        counts = own | ~has_own[each][station]
        row, station = row[counts], station[counts]
        count[each], newest_s[each] = np.bincount(station, minlength=stations), -np.inf
        np.maximum.at(newest_s, whole + 1 + station, ais.received_s[row])
        _, station, own = _at_stations(ais_tracks.position_deg, sensors)
        amount[each] = np.bincount(station[own | ~has_own[each][station]], minlength=stations)
    return Heard(count, np.minimum(newest_s, time_s), amount, has_own)


def _at_stations(position_deg: Floats, sensors: Sensors) -> tuple[Ints, Ints, Bools]:
    """Pairs of a position and a station that reaches it: (P,) rows, (P,) stations, (P,) whether no other station does."""
    stations = sensors.stations
    row, station, _ = kernels.geometry.sensor_coverage.pairs_in_range(
        stations.site_deg, stations.range_m, position_deg, np.zeros(len(position_deg))
    )
    return row, station, np.bincount(row, minlength=len(position_deg))[row] == 1


def _learnt(before: Habits, came: Heard, allowed_s: Floats, averaged: int) -> Habits:
    """The habits after a cycle. Args: averaged: so many first rows have the mean amount of cycles; the others the last one."""
    now = came.reports > 0.0
    again = now & np.isfinite(before.heard_s)
    pauses = before.pauses + again
    most_s = np.where(before.pauses >= LEAST_PAUSES, MOST_LEARNT * allowed_s, np.inf)
    weight = 1.0 / np.maximum(pauses, 1.0)
    pause_s = np.clip(came.newest_s[again] - before.heard_s[again] - before.stood_s[again], 0.0, most_s[again])
    usual_s = before.usual_s.copy()
    known_s = np.nan_to_num(usual_s[again])
    usual_s[again] = known_s + weight[again] * (pause_s - known_s)
    amount = np.where(now, came.amount, before.amount)
    amount[:averaged] = before.amount[:averaged] + np.where(again, weight, now)[:averaged] * (amount - before.amount)[:averaged]
    return Habits(
        np.where(now, np.maximum(before.heard_s, came.newest_s), before.heard_s),
        np.where(now, 0.0, before.stood_s),
        usual_s,
        np.minimum(pauses, LEARNT_OVER - 1.0),
        amount,
        before.silent,
        before.returned_s,
        came.has_own,
    )
