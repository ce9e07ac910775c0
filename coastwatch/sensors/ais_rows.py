"""Decoded AIS rows to AIS reports: what is refused, what is not available, when the fix was. The same for wire and table."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Literal, TypeVar

import numpy as np
from pydantic import Field

from coastwatch.batches import AisReports, AisStatics, Batch, Bools, Floats, Ints, column
from coastwatch.sensors import mmsi as numbers
from coastwatch.sensors.arrival import arrive, repeated
from coastwatch.sensors.faults import SET_ASIDE, Tally
from coastwatch.stage import Settings

Place = Callable[[int], str]
"""Where a row stood, from its number: "file:line"."""

Timed = TypeVar("Timed", AisReports, AisStatics)

Seconds = Annotated[float, Field(ge=0.0)]

NOT_AVAILABLE_LATITUDE, NOT_AVAILABLE_LONGITUDE = 91.0, 181.0  # ITU-R M.1371
HIGHEST_LATITUDE = 85.0  # up to which coastwatch.geodesy is right
NOT_AVAILABLE_SOG_KN = 102.25  # 102.3 and, after rounding of a table, what is near
CLOCK_SLACK_S = 2.0  # by which the receiver's clock may be behind the second in a message

NON_FINITE = "non-finite"
NO_POSITION = "position not available"
LATITUDE = "latitude out of range"
LONGITUDE = "longitude out of range"
DUPLICATE = SET_ASIDE + "duplicate"
QUICK_REPEAT = SET_ASIDE + "quick repeat of one position"


class AisIntake(Settings):
    """What is believed of AIS input."""

    order: Literal["arrival", "time"] = "arrival"  # of the rows of a file; "time" sorts a file that is in another order
    lateness_s: Seconds = 60.0  # a record may be this much older than those before it
    longest_silence_s: Seconds = 86400.0  # of a stream; what lies beyond is a wrong clock
    duplicate_within_s: Seconds = 30.0  # the same message by another station
    repeat_within_s: Seconds = 1.5  # the same position again (tables, where the message is not known)
    message_second: bool = True  # take the time of the fix from the UTC second in the message
    message_second_within_s: Annotated[float, Field(ge=0.0, lt=58.0)] = 10.0  # where that is at most so old


@dataclass(frozen=True, eq=False)
class AisRows(Batch):
    """Position reports as they were written, in the order of the file."""

    row: Ints = column(np.int64, "M")  # number of the line or row
    stamp_s: Floats = column(np.float64, "M")  # when it says it was received
    fix_s: Floats = column(np.float64, "M")  # when it says the fix was; NaN: does not say
    second: Ints = column(np.int64, "M")  # UTC second of the fix, in the message; -1 none
    mmsi: Ints = column(np.int64, "M")
    position_deg: Floats = column(np.float64, "M", 2)
    sog_kn: Floats = column(np.float64, "M")
    cog_deg: Floats = column(np.float64, "M")
    class_b: Bools = column(np.bool_, "M")
    digest: Ints = column(np.int64, "M")  # equal where the message is


@dataclass(frozen=True, eq=False)
class StaticRows(Batch):
    """Static data as it was written, in the order of the file."""

    row: Ints = column(np.int64, "M")
    stamp_s: Floats = column(np.float64, "M")
    digest: Ints = column(np.int64, "M")
    static: Ints = column(np.int64, "M")  # row in the AisStatics that came with it


def accept(
    rows: AisRows, statics: AisStatics, said: StaticRows, intake: AisIntake, tally: Tally, place: Place
) -> tuple[AisReports, AisStatics]:
    """The reports and static data that can be believed, in order of arrival; the rest is counted in the tally.

    Args: rows, said: of one stream, with finite stamps; statics: what `said.static` numbers.
    """
    number = np.concatenate([rows.row, said.row])
    stamp = np.concatenate([rows.stamp_s, said.stamp_s])
    order = np.argsort(stamp if intake.order == "time" else number, kind="stable")
    arrived = arrive(stamp[order], intake.lateness_s, intake.longest_silence_s)
    for kind, mask in arrived.faults.items():
        tally.add_rows(kind, mask, lambda i: place(number[order[i]]), lambda i: utc(stamp[order[i]]))
    back = np.argsort(order, kind="stable")
    received, believed = arrived.received_s[back], arrived.believed[back]
    n = len(rows)
    reports = _positions(rows.take(believed[:n]), received[:n][believed[:n]], intake, tally, place)
    static = _statics(said.take(believed[n:]), received[n:][believed[n:]], statics, intake, tally, place)
    return (reports, static) if intake.order == "arrival" else (_sorted(reports), _sorted(static))


def _sorted(reports: Timed) -> Timed:
    return reports.take(np.argsort(reports.received_s, kind="stable"))


def _positions(rows: AisRows, received: Floats, intake: AisIntake, tally: Tally, place: Place) -> AisReports:
    good = np.ones(len(rows), np.bool_)
    for kind, mask in _faults(rows).items():
        tally.add_rows(kind, good & mask, lambda i: place(rows.row[i]), lambda i: _example(rows, i))
        good &= ~mask
    rows, received = rows.take(good), received[good]
    again = {DUPLICATE: repeated((rows.digest, rows.mmsi), received, intake.duplicate_within_s)}
    if len(rows) and (rows.second < 0).all():
        same = (rows.mmsi, rows.position_deg[:, 0], rows.position_deg[:, 1])
        again[QUICK_REPEAT] = repeated(same, rows.stamp_s, intake.repeat_within_s) & ~again[DUPLICATE]
    good = np.ones(len(rows), np.bool_)
    for kind, mask in again.items():
        tally.add_rows(kind, mask, lambda i: place(rows.row[i]), lambda i: _example(rows, i))
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
        **numbers.others(rows.mmsi),
        NON_FINITE: infinite,
        NO_POSITION: (lat == NOT_AVAILABLE_LATITUDE) | (lon == NOT_AVAILABLE_LONGITUDE),
        LATITUDE: ~(np.abs(lat) <= HIGHEST_LATITUDE),
        LONGITUDE: ~(np.abs(lon) <= 180.0),
    }


def _known(value: Floats, below: float) -> Bools:
    return np.asarray((value >= 0.0) & (value < below))


def _fix_s(rows: AisRows, intake: AisIntake) -> Floats:
    """The time of each fix: as written, else by the second in the message where that agrees with the clock, else as received."""
    stated = np.where(np.isnan(rows.fix_s), rows.stamp_s, rows.fix_s)
    if not intake.message_second:
        return stated
    age = (rows.stamp_s - rows.second + CLOCK_SLACK_S) % 60.0 - CLOCK_SLACK_S
    agrees = (rows.second >= 0) & (rows.second < 60) & (age <= intake.message_second_within_s)
    return np.where(agrees, rows.stamp_s - age, stated)


def _statics(
    said: StaticRows, received: Floats, statics: AisStatics, intake: AisIntake, tally: Tally, place: Place
) -> AisStatics:
    good = np.ones(len(said), np.bool_)
    mmsi = statics.mmsi[said.static]
    again = repeated((said.digest, mmsi), received, intake.duplicate_within_s)
    for kind, mask in {**numbers.others(mmsi), DUPLICATE: again}.items():
        tally.add_rows(kind, good & mask, lambda i: place(said.row[i]), lambda i: f"static data of MMSI {mmsi[i]}")
        good &= ~mask
    kept = statics.take(said.static[good])
    return AisStatics(received[good], kept.mmsi, kept.name, kept.call_sign, kept.ship_type, kept.length_m, kept.beam_m)


def _example(rows: AisRows, i: int) -> str:
    lat, lon = rows.position_deg[i]
    return f"MMSI {rows.mmsi[i]} latitude {lat:.6g} longitude {lon:.6g} SOG {rows.sog_kn[i]:.3g} COG {rows.cog_deg[i]:.4g}"


def utc(stamp_s: float) -> str:
    """Date and time of a stamp, to the millisecond."""
    if not -6e10 < stamp_s < 2.5e11:  # what a date can hold
        return f"{stamp_s:.6g} s"
    return str(np.datetime64(round(stamp_s * 1000.0), "ms")) + "Z"
