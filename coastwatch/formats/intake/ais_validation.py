"""Decoded AIS rows, from NMEA or tables, to AIS reports: which are refused, which values are not available, time of the fix."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import IntEnum
from functools import partial
from typing import Annotated, Literal, TypeVar

import numpy as np
from pydantic import Field

from coastwatch.batches import AisReports, AisStatics, Batch, Bools, Floats, Ints, column
from coastwatch.batches.ais_codes import LARGEST_MMSI, is_aid_to_navigation, is_coast_station, is_rescue_aircraft
from coastwatch.batches.limits import HIGHEST_LATITUDE_DEG
from coastwatch.batches.struct import optional_column
from coastwatch.formats.intake.faults import SET_ASIDE, Tally
from coastwatch.formats.intake.reception_time import (
    BACKWARDS,
    FAR,
    LATE,
    ReceptionTimes,
    is_out_of_order,
    reception_times,
    repeated,
)
from coastwatch.stage import NotNegative, Settings

Location = Callable[[int], str]
"""Location of a row, from its number: "file:line"."""

Timed = TypeVar("Timed", AisReports, AisStatics)


NOT_AVAILABLE_LATITUDE, NOT_AVAILABLE_LONGITUDE = 91.0, 181.0  # ITU-R M.1371
NOT_AVAILABLE_SOG_KN = 102.25  # 102.3 is not available; a table may have rounded it
CLOCK_SLACK_S = 2.0  # the clock of the receiver may be this late against the second in a message

NOT_AN_MMSI = "not an MMSI"
COAST_STATION = SET_ASIDE + "coast station"
AID_TO_NAVIGATION = SET_ASIDE + "aid to navigation"
AIRCRAFT = SET_ASIDE + "search and rescue aircraft"
NON_FINITE = "non-finite"
NO_POSITION = "position not available"
LATITUDE = f"latitude out of range, {-HIGHEST_LATITUDE_DEG:g} to {HIGHEST_LATITUDE_DEG:g}"
LONGITUDE = "longitude out of range"
DUPLICATE = SET_ASIDE + "duplicate"
QUICK_REPEAT = SET_ASIDE + "quick repeat of one position"
SOG_RANGE = SET_ASIDE + "SOG that no message can hold, taken as not available"
COG_RANGE = SET_ASIDE + "COG that no message can hold, taken as not available"

HIGHEST_SOG_KN = 102.35  # 102.2 kn and more is 102.2, 102.3 is not available; a table may have rounded them
FIRST_WRONG_COG_DEG = 360.05  # 360 is not available
LATE_FEED = "received late, as the reports of most vessels: the second in the message is the time of the fix"
FEWEST_AGES, MOST_AGES, SAME_DELAY = 5, 2_000, 0.7
"""Vessels that show the delay of a feed, at least and at most, and the share of them that have it."""

REMEMBERED_STAMPS = 10_000  # accepted stamps before a block, by which its own are judged


class AisIntake(Settings):
    """Which AIS records are accepted."""

    order: Literal["auto", "arrival", "time"] = "auto"
    """Order of the records of a file. "arrival": as they stand. "time": they are sorted first. "auto": a table is sorted of which more
    than 5 % would be refused as going back in time, in stretches, e.g. one sorted by vessel or newest first; NMEA is as it stands."""
    lateness_s: NotNegative = 60.0  # a record may be this much older than the newest before it
    longest_silence_s: NotNegative = 86400.0  # of a stream; records beyond it have a wrong clock
    duplicate_within_s: NotNegative = 30.0  # the same message, from another station
    repeat_within_s: NotNegative = 1.5  # the same position again (tables, which do not have the message)
    message_second: bool = True  # take the time of the fix from the UTC second in the message
    message_second_within_s: Annotated[float, Field(ge=0.0, lt=58.0)] = (
        10.0  # if it is at most this old; else the time of reception, taken as uncertain by the difference
    )


def of_table(intake: AisIntake, stamp_s: Floats) -> AisIntake:
    """The settings with the order that a table has, "time" or "arrival". Args: stamp_s: (M,) finite, of all its rows."""
    if intake.order != "auto":
        return intake
    disorder = is_out_of_order(stamp_s, intake.lateness_s, intake.longest_silence_s)
    return intake.model_copy(update={"order": "time" if disorder else "arrival"})


class StationKind(IntEnum):
    """What a row says of its sender beside the MMSI, if that is no vessel; -1 in a batch: nothing."""

    UNKNOWN = -1
    BASE = 0
    AID_TO_NAVIGATION = 1
    AIRCRAFT = 2


@dataclass(frozen=True, eq=False)
class AisRows(Batch):
    """Position reports as recorded, in the order of the file."""

    row: Ints = column(np.int64, "M")  # number of the line or row
    stamp_s: Floats = column(np.float64, "M")  # time of reception, as recorded
    fix_s: Floats = column(np.float64, "M")  # time of the fix, as recorded; NaN: none
    second: Ints = column(np.int64, "M")  # UTC second of the fix, in the message; -1 none
    mmsi: Ints = column(np.int64, "M")
    position_deg: Floats = column(np.float64, "M", 2)
    sog_kn: Floats = column(np.float64, "M")
    cog_deg: Floats = column(np.float64, "M")
    class_b: Bools = column(np.bool_, "M")
    digest: Ints = column(np.int64, "M")  # equal for equal messages
    nav_status: Ints = optional_column("M", dtype=np.int64)  # as in AisReports, and the two that follow
    accuracy: Ints = optional_column("M", dtype=np.int64)
    covariance: Floats = optional_column("M", 2, 2)
    station: Ints = optional_column("M", dtype=np.int64)  # StationKind
    heading_deg: Floats = optional_column("M")  # of the bow; what is no direction counts as not available


@dataclass(frozen=True, eq=False)
class StaticRows(Batch):
    """Static data as recorded, in the order of the file."""

    row: Ints = column(np.int64, "M")
    stamp_s: Floats = column(np.float64, "M")
    digest: Ints = column(np.int64, "M")
    static: Ints = column(np.int64, "M")  # row in the AisStatics that belong to it


@dataclass(frozen=True, eq=False)
class Seen(Batch):
    """The newest records of a stream: what makes two of them one message, and when they came."""

    digest: Ints = column(np.int64, "M")
    mmsi: Ints = column(np.int64, "M")
    received_s: Floats = column(np.float64, "M")


@dataclass(frozen=True, eq=False)
class _SecondAges(Batch):
    """How old the second in the newest message of each vessel was, sorted by MMSI."""

    mmsi: Ints = column(np.int64, "N")
    age_s: Floats = column(np.float64, "N")

    def updated(self, mmsi: Ints, age_s: Floats) -> _SecondAges:
        """With the newest of these messages too. Of very many vessels every second is kept. Args: (M,), (M,) in order of arrival."""
        every, age = np.concatenate([self.mmsi, mmsi])[::-1], np.concatenate([self.age_s, age_s])[::-1]
        vessel, newest = np.unique(every, return_index=True)
        kept = slice(None, None, 1 + len(vessel) // MOST_AGES)
        return _SecondAges(vessel[kept], age[newest][kept])

    def common_s(self, within_s: float) -> float:
        """The delay of the whole feed, if most vessels have one that is longer than `within_s`, and about the same; else 0."""
        if len(self) < FEWEST_AGES or np.mean(self.age_s <= within_s) >= 0.5:
            return 0.0
        start = np.sort(self.age_s)
        count = np.searchsorted(start, start + within_s, side="right") - np.arange(len(start))
        best = int(count.argmax())
        return float(start[best]) if count[best] >= SAME_DELAY * len(start) else 0.0


class Acceptance:
    """Which rows of one stream are accepted, decided block by block, in order of the file.

    It keeps the newest stamps, to judge the next ones, and the newest messages, to find duplicates. A whole file in one block is
    judged by all of its stamps.
    """

    def __init__(self, intake: AisIntake, tally: Tally, location: Location, feed: int = -1) -> None:
        self._intake, self._tally, self._location, self._feed = intake, tally, location, feed
        self._accepted_s = np.zeros(0)
        self.newest_s = -math.inf  # time of reception, so far
        self.backwards = 0  # records refused so far because they go back in time
        self._positions, self._statics = Seen.empty(), Seen.empty()
        self._ages = _SecondAges.empty()

    def block(
        self, rows: AisRows, statics: AisStatics, static_rows: StaticRows, ahead_s: Floats | None = None
    ) -> tuple[AisReports, AisStatics]:
        """The accepted reports and static data of the next block, in order of arrival. The others are counted in the tally.

        Args: rows, static_rows: with finite stamps; statics: the data that `static_rows.static` refers to; ahead_s: stamps of the
        block after this one, which show whether a jump of the clock lasts.
        """
        number = np.concatenate([rows.row, static_rows.row])
        stamp = np.concatenate([rows.stamp_s, static_rows.stamp_s])
        order = np.argsort(stamp if self._intake.order == "time" else number, kind="stable")
        arrived = self._arrived(stamp[order], np.zeros(0) if ahead_s is None else ahead_s)
        for kind, mask in arrived.faults.items():
            self._tally.add_rows(
                kind, mask, lambda i: self._location(number[order[i]]), lambda i: utc(stamp[order[i]]), used=kind == LATE
            )
        back = np.argsort(order, kind="stable")
        self.backwards += int(arrived.faults[BACKWARDS].sum())
        received, accepted = arrived.received_s[back], arrived.accepted[back]
        n = len(rows)
        reports = self._reports(rows.take(accepted[:n]), received[:n][accepted[:n]])
        static = self._static_data(static_rows.take(accepted[n:]), received[n:][accepted[n:]], statics)
        return (_sorted(reports), _sorted(static)) if self._intake.order == "time" else (reports, static)

    def _arrived(self, stamp_s: Floats, ahead_s: Floats) -> ReceptionTimes:
        """The reception times of a block, judged by the stamps before and after it."""
        before, n = len(self._accepted_s), len(stamp_s)
        around = np.concatenate([self._accepted_s, stamp_s, ahead_s])
        judged = reception_times(around, self._intake.lateness_s, self._intake.longest_silence_s)
        received = np.maximum(judged.received_s[before : before + n], self.newest_s)
        faults = {kind: mask[before : before + n].copy() for kind, mask in judged.faults.items()}
        too_late = received - stamp_s > 2.0 * self._intake.lateness_s
        accepted = judged.accepted[before : before + n] & ~too_late
        faults[BACKWARDS] |= too_late & ~faults[FAR]
        faults[LATE] = accepted & (stamp_s < received)
        if n:
            self.newest_s = float(received[-1])
            self._accepted_s = np.concatenate([self._accepted_s, stamp_s[accepted]])[-REMEMBERED_STAMPS:]
        return ReceptionTimes(received, accepted, faults)

    def _reports(self, rows: AisRows, received: Floats) -> AisReports:
        intake = self._intake
        good = self._good(_faults(rows), rows.row, partial(_example, rows))
        rows, received = rows.take(good), received[good]
        twice, self._positions = repeated_in_stream(
            self._positions, rows.digest, rows.mmsi, received, intake.duplicate_within_s
        )
        again = {DUPLICATE: twice}
        if len(rows) and (rows.second < 0).all():
            same = (rows.mmsi, rows.position_deg[:, 0], rows.position_deg[:, 1])
            again[QUICK_REPEAT] = repeated(same, rows.stamp_s, intake.repeat_within_s) & ~again[DUPLICATE]
        good = self._good(again, rows.row, partial(_example, rows))
        rows, received = rows.take(good), received[good]
        sog, cog = rows.sog_kn, rows.cog_deg
        no_value = {SOG_RANGE: (sog < 0.0) | (sog > HIGHEST_SOG_KN), COG_RANGE: (cog < 0.0) | (cog >= FIRST_WRONG_COG_DEG)}
        for kind, mask in no_value.items():
            self._tally.add_rows(kind, mask, lambda i: self._location(rows.row[i]), lambda i: _example(rows, i), used=True)
        fix_s, error_s = self._fix_s(rows)
        return AisReports(
            time_s=np.minimum(fix_s, received),
            received_s=received,
            mmsi=rows.mmsi,
            position_deg=rows.position_deg,
            sog_kn=np.where(_within(rows.sog_kn, NOT_AVAILABLE_SOG_KN), rows.sog_kn, np.nan),
            cog_deg=np.where(_within(rows.cog_deg, 360.0), rows.cog_deg, np.nan),
            class_b=rows.class_b,
            nav_status=rows.nav_status,
            accuracy=rows.accuracy,
            covariance=rows.covariance,
            feed=np.full(len(rows), self._feed, np.int64),
            heading_deg=np.where(_within(rows.heading_deg, 360.0), rows.heading_deg, np.nan),
            time_error_s=error_s,
        )

    def _fix_s(self, rows: AisRows) -> tuple[Floats, Floats]:
        """The time of each fix: by the second in the message if it agrees with the clock, else as recorded, else as received. (M,)

        A feed may come late as a whole: then the second agrees if it is as old as that of most vessels.
        Returns also by how much that second contradicts the time, s, from 0 to 30, as a second does not say the minute; NaN: it does
        not. (M,)
        """
        recorded, intake = ~np.isnan(rows.fix_s), self._intake
        stated, unknown = np.where(recorded, rows.fix_s, rows.stamp_s), np.full(len(rows), np.nan)
        if not intake.message_second:
            return stated, unknown
        age = (rows.stamp_s - rows.second + CLOCK_SLACK_S) % 60.0 - CLOCK_SLACK_S
        has_second = (rows.second >= 0) & (rows.second < 60)
        self._ages = self._ages.updated(rows.mmsi[has_second], age[has_second])
        delay_s = self._ages.common_s(intake.message_second_within_s)
        agrees = has_second & (age <= intake.message_second_within_s)
        late = has_second & ~agrees & (delay_s > 0.0) & (np.abs(age - delay_s) <= intake.message_second_within_s)
        self._tally.add_rows(LATE_FEED, late, lambda i: self._location(rows.row[i]), lambda i: f"{age[i]:.0f} s", used=True)
        agrees |= late
        contradicted = has_second & ~agrees & ~recorded
        return np.where(agrees, rows.stamp_s - age, stated), np.where(contradicted, np.minimum(age, 60.0 - age), unknown)

    def _static_data(self, static_rows: StaticRows, received: Floats, statics: AisStatics) -> AisStatics:
        mmsi = statics.mmsi[static_rows.static]
        again, self._statics = repeated_in_stream(
            self._statics, static_rows.digest, mmsi, received, self._intake.duplicate_within_s
        )
        unknown = np.full(len(mmsi), StationKind.UNKNOWN, np.int64)
        faults = {**no_vessels(mmsi, unknown), DUPLICATE: again}
        good = self._good(faults, static_rows.row, lambda i: f"static data of MMSI {mmsi[i]}")
        kept = statics.take(static_rows.static[good])
        return replace(kept, received_s=received[good])

    def _good(self, faults: dict[str, Bools], row: Ints, example: Callable[[int], str]) -> Bools:
        """Which rows have no fault. A row is counted in its first one. Args: row: (M,) its number; example: of a row. Returns: (M,)."""
        good = np.ones(len(row), np.bool_)
        for kind, mask in faults.items():
            self._tally.add_rows(kind, good & mask, lambda i: self._location(row[i]), example)
            good &= ~mask
        return good


def _sorted(reports: Timed) -> Timed:
    return reports.take(np.argsort(reports.received_s, kind="stable"))


def repeated_in_stream(before: Seen, digest: Ints, mmsi: Ints, received_s: Floats, within_s: float) -> tuple[Bools, Seen]:
    """Which records repeat one at most so long before them, and the records that the next block must know."""
    every = Seen.join([before, Seen(digest, mmsi, received_s)])
    again = repeated((every.digest, every.mmsi), every.received_s, within_s)[len(before) :]
    return again, every.take(every.received_s >= every.received_s.max(initial=-np.inf) - within_s)


def _faults(rows: AisRows) -> dict[str, Bools]:
    lat, lon = rows.position_deg[:, 0], rows.position_deg[:, 1]
    infinite = ~np.isfinite(lat) | ~np.isfinite(lon) | np.isinf(rows.sog_kn) | np.isinf(rows.cog_deg)
    return {
        **no_vessels(rows.mmsi, rows.station),
        NON_FINITE: infinite,
        NO_POSITION: (lat == NOT_AVAILABLE_LATITUDE) | (lon == NOT_AVAILABLE_LONGITUDE),
        LATITUDE: ~(np.abs(lat) <= HIGHEST_LATITUDE_DEG),
        LONGITUDE: ~(np.abs(lon) <= 180.0),
    }


def _within(value: Floats, below: float) -> Bools:
    return np.asarray((value >= 0.0) & (value < below))


def _example(rows: AisRows, i: int) -> str:
    lat, lon = rows.position_deg[i]
    return f"MMSI {rows.mmsi[i]} latitude {lat:.6g} longitude {lon:.6g} SOG {rows.sog_kn[i]:.3g} COG {rows.cog_deg[i]:.4g}"


def utc(stamp_s: float) -> str:
    """Date and time of a stamp, to the millisecond."""
    if not -6e10 < stamp_s < 2.5e11:  # what a date can hold
        return f"{stamp_s:.6g} s"
    return str(np.datetime64(round(stamp_s * 1000.0), "ms")) + "Z"


def no_vessels(mmsi: Ints, station: Ints) -> dict[str, Bools]:
    """Which rows are not of a vessel, by kind of fault. An MMSI that no station has is of a vessel whose number is wrong.

    Args: mmsi: (M,); station: (M,) StationKind, what the row says beside its number.
    """
    return {
        COAST_STATION: (station == StationKind.BASE) | is_coast_station(mmsi),
        AID_TO_NAVIGATION: (station == StationKind.AID_TO_NAVIGATION) | is_aid_to_navigation(mmsi),
        AIRCRAFT: (station == StationKind.AIRCRAFT) | is_rescue_aircraft(mmsi),
        NOT_AN_MMSI: (mmsi < 0) | (mmsi > LARGEST_MMSI),
    }
