"""Decoded AIS rows, from NMEA or tables, to AIS reports: which are refused, which values are not available, time of the fix."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Literal, TypeVar

import numpy as np
from pydantic import Field

from coastwatch.batches import AisReports, AisStatics, Batch, Bools, Floats, Ints, column
from coastwatch.sensors.recorded.faults import SET_ASIDE, Tally
from coastwatch.sensors.recorded.reception_time import reception_times, repeated
from coastwatch.stage import Settings

Location = Callable[[int], str]
"""Location of a row, from its number: "file:line"."""

Timed = TypeVar("Timed", AisReports, AisStatics)

Seconds = Annotated[float, Field(ge=0.0)]

NOT_AVAILABLE_LATITUDE, NOT_AVAILABLE_LONGITUDE = 91.0, 181.0  # ITU-R M.1371
HIGHEST_LATITUDE = 85.0  # limit of coastwatch.geodesy
NOT_AVAILABLE_SOG_KN = 102.25  # 102.3 is not available; a table may have rounded it
CLOCK_SLACK_S = 2.0  # the clock of the receiver may be this late against the second in a message

FIRST_MID, LAST_MID = 201, 775

NOT_AN_MMSI = "not an MMSI"
COAST_STATION = SET_ASIDE + "coast station"
AID_TO_NAVIGATION = SET_ASIDE + "aid to navigation"
AIRCRAFT = SET_ASIDE + "search and rescue aircraft"
NON_FINITE = "non-finite"
NO_POSITION = "position not available"
LATITUDE = "latitude out of range"
LONGITUDE = "longitude out of range"
DUPLICATE = SET_ASIDE + "duplicate"
QUICK_REPEAT = SET_ASIDE + "quick repeat of one position"


class AisIntake(Settings):
    """Which AIS records are accepted."""

    order: Literal["arrival", "time"] = "arrival"  # order of the rows of a file; "time" sorts them first
    lateness_s: Seconds = 60.0  # a record may be this much older than the newest before it
    longest_silence_s: Seconds = 86400.0  # of a stream; records beyond it have a wrong clock
    duplicate_within_s: Seconds = 30.0  # the same message, from another station
    repeat_within_s: Seconds = 1.5  # the same position again (tables, which do not have the message)
    message_second: bool = True  # take the time of the fix from the UTC second in the message
    message_second_within_s: Annotated[float, Field(ge=0.0, lt=58.0)] = 10.0  # if it is at most this old


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


@dataclass(frozen=True, eq=False)
class StaticRows(Batch):
    """Static data as recorded, in the order of the file."""

    row: Ints = column(np.int64, "M")
    stamp_s: Floats = column(np.float64, "M")
    digest: Ints = column(np.int64, "M")
    static: Ints = column(np.int64, "M")  # row in the AisStatics that belong to it


def accept(
    rows: AisRows, statics: AisStatics, static_rows: StaticRows, intake: AisIntake, tally: Tally, location: Location
) -> tuple[AisReports, AisStatics]:
    """The accepted reports and static data, in order of arrival. The others are counted in the tally.

    Args: rows, static_rows: of one stream, with finite stamps; statics: the data that `static_rows.static` refers to.
    """
    number = np.concatenate([rows.row, static_rows.row])
    stamp = np.concatenate([rows.stamp_s, static_rows.stamp_s])
    order = np.argsort(stamp if intake.order == "time" else number, kind="stable")
    arrived = reception_times(stamp[order], intake.lateness_s, intake.longest_silence_s)
    for kind, mask in arrived.faults.items():
        tally.add_rows(kind, mask, lambda i: location(number[order[i]]), lambda i: utc(stamp[order[i]]))
    back = np.argsort(order, kind="stable")
    received, accepted = arrived.received_s[back], arrived.accepted[back]
    n = len(rows)
    reports = _positions(rows.take(accepted[:n]), received[:n][accepted[:n]], intake, tally, location)
    static = _statics(static_rows.take(accepted[n:]), received[n:][accepted[n:]], statics, intake, tally, location)
    return (reports, static) if intake.order == "arrival" else (_sorted(reports), _sorted(static))


def _sorted(reports: Timed) -> Timed:
    return reports.take(np.argsort(reports.received_s, kind="stable"))


def _positions(rows: AisRows, received: Floats, intake: AisIntake, tally: Tally, location: Location) -> AisReports:
    good = np.ones(len(rows), np.bool_)
    for kind, mask in _faults(rows).items():
        tally.add_rows(kind, good & mask, lambda i: location(rows.row[i]), lambda i: _example(rows, i))
        good &= ~mask
    rows, received = rows.take(good), received[good]
    again = {DUPLICATE: repeated((rows.digest, rows.mmsi), received, intake.duplicate_within_s)}
    if len(rows) and (rows.second < 0).all():
        same = (rows.mmsi, rows.position_deg[:, 0], rows.position_deg[:, 1])
        again[QUICK_REPEAT] = repeated(same, rows.stamp_s, intake.repeat_within_s) & ~again[DUPLICATE]
    good = np.ones(len(rows), np.bool_)
    for kind, mask in again.items():
        tally.add_rows(kind, mask, lambda i: location(rows.row[i]), lambda i: _example(rows, i))
        good &= ~mask
    rows, received = rows.take(good), received[good]
    return AisReports(
        time_s=np.minimum(_fix_s(rows, intake), received),
        received_s=received,
        mmsi=rows.mmsi,
        position_deg=rows.position_deg,
        sog_kn=np.where(_known(rows.sog_kn, NOT_AVAILABLE_SOG_KN), rows.sog_kn, np.nan),
        cog_deg=np.where(_known(rows.cog_deg, 360.0), rows.cog_deg, np.nan),
        class_b=rows.class_b,
        origin=np.full(len(rows), -1, np.int64),
    )


def _faults(rows: AisRows) -> dict[str, Bools]:
    lat, lon = rows.position_deg[:, 0], rows.position_deg[:, 1]
    infinite = ~np.isfinite(lat) | ~np.isfinite(lon) | np.isinf(rows.sog_kn) | np.isinf(rows.cog_deg)
    return {
        **non_vessels(rows.mmsi),
        NON_FINITE: infinite,
        NO_POSITION: (lat == NOT_AVAILABLE_LATITUDE) | (lon == NOT_AVAILABLE_LONGITUDE),
        LATITUDE: ~(np.abs(lat) <= HIGHEST_LATITUDE),
        LONGITUDE: ~(np.abs(lon) <= 180.0),
    }


def _known(value: Floats, below: float) -> Bools:
    return np.asarray((value >= 0.0) & (value < below))


def _fix_s(rows: AisRows, intake: AisIntake) -> Floats:
    """The time of each fix: by the second in the message if it agrees with the clock, else as recorded, else as received."""
    stated = np.where(np.isnan(rows.fix_s), rows.stamp_s, rows.fix_s)
    if not intake.message_second:
        return stated
    age = (rows.stamp_s - rows.second + CLOCK_SLACK_S) % 60.0 - CLOCK_SLACK_S
    agrees = (rows.second >= 0) & (rows.second < 60) & (age <= intake.message_second_within_s)
    return np.where(agrees, rows.stamp_s - age, stated)


def _statics(
    static_rows: StaticRows, received: Floats, statics: AisStatics, intake: AisIntake, tally: Tally, location: Location
) -> AisStatics:
    good = np.ones(len(static_rows), np.bool_)
    mmsi = statics.mmsi[static_rows.static]
    again = repeated((static_rows.digest, mmsi), received, intake.duplicate_within_s)
    for kind, mask in {**non_vessels(mmsi), DUPLICATE: again}.items():
        tally.add_rows(kind, good & mask, lambda i: location(static_rows.row[i]), lambda i: f"static data of MMSI {mmsi[i]}")
        good &= ~mask
    kept = statics.take(static_rows.static[good])
    return AisStatics(received[good], kept.mmsi, kept.name, kept.call_sign, kept.ship_type, kept.length_m, kept.beam_m)


def _example(rows: AisRows, i: int) -> str:
    lat, lon = rows.position_deg[i]
    return f"MMSI {rows.mmsi[i]} latitude {lat:.6g} longitude {lon:.6g} SOG {rows.sog_kn[i]:.3g} COG {rows.cog_deg[i]:.4g}"


def utc(stamp_s: float) -> str:
    """Date and time of a stamp, to the millisecond."""
    if not -6e10 < stamp_s < 2.5e11:  # what a date can hold
        return f"{stamp_s:.6g} s"
    return str(np.datetime64(round(stamp_s * 1000.0), "ms")) + "Z"


def _is_mid(number: Ints) -> Bools:
    return (number >= FIRST_MID) & (number <= LAST_MID)


def is_vessel(mmsi: Ints) -> Bools:
    """Whether each MMSI is of a vessel: MID and six digits, 98 MID and four (a craft of a mother ship), or 970, 972, 974 and six
    (distress transmitter, man overboard, emergency beacon: these must be in the picture).

    Source: Recommendation ITU-R M.585-9 (2022), annex 1. MID are the three digits of a country, 201 to 775.
    """
    craft = (mmsi // 10_000_000 == 98) & _is_mid(mmsi // 10_000 % 1000)
    distress = np.isin(mmsi // 1_000_000, (970, 972, 974))
    return np.asarray(_is_mid(mmsi // 1_000_000) | craft | distress)


def non_vessels(mmsi: Ints) -> dict[str, Bools]:
    """Which MMSI are not of a vessel, by kind of fault: 00 MID and four, 99 MID and four, 111 MID and three; others are no MMSI."""
    coast = (mmsi < 10_000_000) & _is_mid(mmsi // 10_000)
    aid = (mmsi // 10_000_000 == 99) & _is_mid(mmsi // 10_000 % 1000)
    aircraft = (mmsi // 1_000_000 == 111) & _is_mid(mmsi // 1000 % 1000)
    return {
        COAST_STATION: coast,
        AID_TO_NAVIGATION: aid,
        AIRCRAFT: aircraft,
        NOT_AN_MMSI: ~(is_vessel(mmsi) | coast | aid | aircraft),
    }
