"""Simulated AIS: `transponders` decides which vessels send, `transmit` makes the position reports that are received.

`transmit_static_data` makes names, ship types and sizes: invented, equal for equal seeds.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from coastwatch.batches import AisReports, AisStatics, Array, Bools, Floats, Ints, NavStatus, Stations
from coastwatch.errors import InputError
from coastwatch.geodesy import KNOT_M_S, offset_deg, within_any
from coastwatch.sensors.simulated.trajectories import chosen
from coastwatch.stage import CountOrZero, NotNegative, Positive, Settings, Share

# Streams of random numbers: a change of one does not change the others.
TRANSPONDERS, PHASE, NOISE, LOSS, LATENCY, SILENCE, SPOOFING, CLONES, GAPS = 21, 22, 23, 24, 25, 26, 27, 28, 29
WHO, WHEN, WHAT, LIES = 31, 32, 33, 34  # of names, types and sizes

StateAt = Callable[[Ints, Floats], tuple[Floats, Floats]]
POSITION_STEP_DEG = 1.0 / 600_000.0  # 1/10 000 minute
SOG_STEP_KN, COG_STEP_DEG, SOG_MOST_KN = 0.1, 0.1, 102.2
AT_ANCHOR_KN, ANCHORED_S = 0.01, 180.0  # a vessel at rest is at anchor; those of class A say so, and report this often
TURNING_RAD_S = np.radians(5.0) / 15.0  # heading more than 5 deg off its mean over the last 30 s
# Upper speed in knots: seconds between reports on a steady course, and while turning (class B has no such rule).
CLASS_A = ((14.0, 10.0, 10.0 / 3.0), (23.0, 6.0, 2.0), (np.inf, 2.0, 2.0))
CLASS_B = ((2.0, 180.0, 180.0), (14.0, 30.0, 30.0), (23.0, 15.0, 15.0), (np.inf, 5.0, 5.0))
COUNTRIES = np.array([710, 701, 770, 636, 538, 352, 255, 311, 477, 563, 235, 244, 219, 257, 371, 248])


FIRST_WORDS = "AMBER BOLD CALM CORAL DAWN EAST GOLDEN GRAND IVORY LONE NORTH NOBLE QUIET SILVER SWIFT WILD"
LAST_WORDS = "ALBATROSS BRIGHT CURRENT DOLPHIN EAGLE FORTUNE GULL HARBOUR HORIZON ISLAND PEARL SPIRIT STAR TIDE WAVE WIND"
FIRST, LAST = np.array(FIRST_WORDS.split()), np.array(LAST_WORDS.split())
LETTERS = np.array(list("ABCDEFGHIJKLMNOPQRSTUVWXYZ"))
# ITU-R M.1371 ship type, its share, smallest and largest length in metres.
TYPES = np.array(
    [
        (30, 0.20, 10.0, 45.0),  # fishing
        (36, 0.08, 8.0, 20.0),  # sailing
        (37, 0.12, 8.0, 30.0),  # pleasure craft
        (52, 0.10, 20.0, 40.0),  # tug
        (60, 0.10, 20.0, 300.0),  # passenger
        (70, 0.25, 80.0, 400.0),  # cargo
        (80, 0.15, 80.0, 330.0),  # tanker
    ]
)
LENGTH_OVER_BEAM = 6.0


class AisTruth(Settings):
    """Which vessels carry AIS, what they send and which reports are received."""

    share: Share = 0.5  # of the vessels carry AIS: this exact share, drawn at random
    carried_by: tuple[CountOrZero, ...] = ()  # numbers, from 0, of the vessels that carry AIS, instead of a share
    class_b_share: Share = 0.0  # of these carry class B
    intervals: Literal["fixed", "itu"] = "fixed"  # one interval for all, or those of ITU-R M.1371 for class A and class B
    interval_s: Annotated[float, Field(gt=0.0, le=3600.0)] = 3.0  # if fixed; each vessel has a random phase
    position_sigma_m: Annotated[float, Field(ge=0.0, le=10_000.0)] = 3.33  # per axis
    antenna_sigma_m: Annotated[float, Field(ge=0.0, le=200.0)] = (
        0.0  # of the antenna before the middle of the echo, along the course: one draw each vessel
    )
    velocity_sigma_kn: Annotated[float, Field(ge=0.0, le=20.0)] = 0.2  # per axis; the errors of SOG and COG follow from it
    wire_steps: bool = True  # round to 1/10 000 minute, 0.1 kn and 0.1 deg as a message does
    whole_seconds: bool = False  # round the time of the fix down to a whole second, as a message does
    velocity_missing_share: Share = 0.0  # of reports without SOG and COG
    loss: Share = 0.0  # share of reports that are not received
    gap_s: NotNegative = 0.0  # duration of repeated gaps in the reception of each vessel
    gap_every_s: Positive = 120.0  # period of the gaps; the first is at a random time
    latency_s: Annotated[float, Field(ge=0.0, le=3600.0)] = 0.0  # from the fix to the arrival, at least
    latency_spread_s: Annotated[float, Field(ge=0.0, le=3600.0)] = (
        0.0  # mean of an additional exponential part, which puts reports out of order
    )
    silent_share: Share = 0.0  # of the transponders are switched off for a time
    silent_from_s: NotNegative = 0.0  # after the start of the run
    silent_to_s: float | None = Field(default=None, ge=0.0, description="after the start of the run; none: to the end")
    spoofing_share: Share = 0.0  # of the transponders report positions that drift away from the truth
    spoofing_from_s: NotNegative = 0.0  # after the start of the run
    spoofing_drift_m_s: Annotated[float, Field(ge=0.0, le=1000.0)] = (
        5.0  # growth of the offset, in a direction of each vessel's own
    )
    cloned_share: Share = 0.0  # of the vessels without AIS send under the MMSI of another vessel
    cloned_from_s: NotNegative = 0.0  # after the start of the run
    static_interval_s: Positive = 360.0  # between messages with name and type
    static_within_s: NotNegative = 30.0  # the first of these is sent within this time of the start
    type_missing_share: Share = 0.0  # of the transponders have no ship type set
    type_wrong_share: Share = 0.0  # of the transponders have a random ship type set

    @model_validator(mode="after")
    def _it_is_heard_between_gaps(self) -> Self:
        if self.gap_s >= self.gap_every_s:
            raise InputError(f"gap_s: got {self.gap_s}, needed less than gap_every_s = {self.gap_every_s}")
        return self


@dataclass(frozen=True, eq=False)
class Transponders:
    """The vessels that send: those with AIS in order of their number, then clones."""

    row: Ints  # (C,) of the vessel that sends
    mmsi: Ints  # (C,)
    class_b: Bools  # (C,)
    silent: Bools  # (C,)
    spoofing: Bools  # (C,)
    clone: Bools  # (C,)


def transponders(truth: AisTruth, count: int, seed: int) -> Transponders:
    """Which of the vessels 0..count-1 send, and under which MMSI."""
    rng = np.random.default_rng([seed, TRANSPONDERS])
    row = chosen(count, truth.share, rng)
    if truth.carried_by:
        row = np.unique(np.array(truth.carried_by, np.int64))
        if row[-1] >= count:
            raise InputError(f"input.ais.carried_by: got vessel {row[-1]}, needed numbers below input.count = {count}")
    number = rng.permutation(1_000_000)[:count] if count <= 1_000_000 else np.arange(count) % 1_000_000
    mmsi = (COUNTRIES[rng.integers(0, len(COUNTRIES), count)] * 1_000_000 + number)[row]
    class_b, silent, spoofing = (np.zeros(len(row), np.bool_) for _ in range(3))
    class_b[chosen(len(row), truth.class_b_share, rng)] = True
    silent[chosen(len(row), truth.silent_share, np.random.default_rng([seed, SILENCE]))] = True
    spoofing[chosen(len(row), truth.spoofing_share, np.random.default_rng([seed, SPOOFING]))] = True
    rng = np.random.default_rng([seed, CLONES])
    without = np.setdiff1d(np.arange(count), row)
    clone = without[chosen(len(without), truth.cloned_share if len(row) else 0.0, rng)]
    victim = rng.integers(0, max(len(row), 1), len(clone))
    off = np.zeros(len(clone), np.bool_)
    return Transponders(
        np.concatenate([row, clone]),
        np.concatenate([mmsi, mmsi[victim]]),
        np.concatenate([class_b, class_b[victim]]),
        np.concatenate([silent, off]),
        np.concatenate([spoofing, off]),
        np.concatenate([np.zeros(len(row), np.bool_), ~off]),
    )


def transmit(
    truth: AisTruth,
    senders: Transponders,
    stations: Stations,
    state: StateAt,
    start_s: float,
    stop_s: float,
    seed: int,
) -> AisReports:
    """Position reports that arrive between two times, in order of arrival. A report that arrives later is lost.

    Args: senders: (C); stations: a report is received inside the range of one of them, and everywhere if there are none;
    state: returns position (M, 2) deg, NaN if absent, and velocity (M, 2) m/s of vessel rows (M,) at times (M,).
    """
    who, time = _times(truth, senders, state, start_s, stop_s, seed)
    elapsed = time - start_s
    position, velocity = state(senders.row[who], time)
    at_rest = np.hypot(velocity[:, 0], velocity[:, 1]) < AT_ANCHOR_KN * KNOT_M_S
    received = np.isfinite(position[:, 0]) & within(stations, position)
    received &= np.random.default_rng([seed, LOSS]).random(len(who)) >= truth.loss
    until = np.inf if truth.silent_to_s is None else truth.silent_to_s
    received &= ~(senders.silent[who] & (elapsed >= truth.silent_from_s) & (elapsed < until))
    phase = np.random.default_rng([seed, GAPS]).random(len(senders.row))[who] * truth.gap_every_s
    received &= (elapsed + phase) % truth.gap_every_s >= truth.gap_s
    received &= ~senders.clone[who] | (elapsed >= truth.cloned_from_s)
    drift = truth.spoofing_drift_m_s * np.maximum(elapsed - truth.spoofing_from_s, 0.0)
    away = np.random.default_rng([seed, SPOOFING, 1]).uniform(0.0, 2.0 * np.pi, len(senders.row))[who]
    offset = np.where(senders.spoofing[who], drift, 0.0)[:, None] * np.column_stack([np.sin(away), np.cos(away)])
    rng = np.random.default_rng([seed, NOISE])
    draws, missing = rng.standard_normal((len(who), 4)), rng.random(len(who)) < truth.velocity_missing_share
    if truth.antenna_sigma_m > 0.0:
        offset = offset + _before_the_echo(truth.antenna_sigma_m, velocity, who, len(senders.row), seed)
    position = offset_deg(position, truth.position_sigma_m * draws[:, :2] + offset)
    position, sog, cog = _on_the_wire(truth, position, velocity + truth.velocity_sigma_kn * KNOT_M_S * draws[:, 2:], missing)
    delay = np.random.default_rng([seed, LATENCY]).exponential(1.0, len(who)) * truth.latency_spread_s + truth.latency_s
    made = AisReports(
        time_s=np.floor(time) if truth.whole_seconds else time,
        received_s=time + delay,
        mmsi=senders.mmsi[who],
        position_deg=position,
        sog_kn=sog,
        cog_deg=cog,
        class_b=senders.class_b[who],
        origin=senders.row[who],
        nav_status=np.where(senders.class_b[who], -1, np.where(at_rest, NavStatus.AT_ANCHOR, NavStatus.UNDER_WAY_USING_ENGINE)),
    ).take(received & (time + delay <= stop_s))
    return made.take(np.lexsort((made.mmsi, made.time_s, made.received_s)))


def _before_the_echo(sigma_m: float, velocity_m_s: Floats, who: Ints, count: int, seed: int) -> Floats:
    """Metres east and north from the echo to the antenna. A vessel at rest has a heading of its own. Args: who: (M,) of count."""
    rng = np.random.default_rng([seed, NOISE, 1])
    ahead_m, heading = sigma_m * rng.standard_normal(count), rng.uniform(0.0, 2.0 * np.pi, count)
    moves = np.hypot(velocity_m_s[:, 0], velocity_m_s[:, 1]) > AT_ANCHOR_KN * KNOT_M_S
    angle = np.where(moves, np.arctan2(velocity_m_s[:, 0], velocity_m_s[:, 1]), heading[who])
    out: Floats = ahead_m[who, None] * np.column_stack([np.sin(angle), np.cos(angle)])
    return out


def within(stations: Stations, position_deg: Floats) -> Bools:
    """Whether a position is in range of a station; true everywhere if there are none. Args: position_deg: (M, 2). Returns: (M,)."""
    if not len(stations):
        return np.ones(len(position_deg), np.bool_)
    return within_any(position_deg, stations.site_deg, stations.range_m)


def _on_the_wire(truth: AisTruth, position: Floats, velocity: Floats, missing: Bools) -> tuple[Floats, Floats, Floats]:
    """Position, SOG and COG in the resolution of a message."""
    sog = np.hypot(velocity[:, 0], velocity[:, 1]) / KNOT_M_S
    cog = np.degrees(np.arctan2(velocity[:, 0], velocity[:, 1])) % 360.0
    if truth.wire_steps:
        position = np.round(position / POSITION_STEP_DEG) * POSITION_STEP_DEG
        sog, cog = np.round(sog / SOG_STEP_KN) * SOG_STEP_KN, np.round(cog / COG_STEP_DEG) * COG_STEP_DEG % 360.0
    return position, np.where(missing, np.nan, np.minimum(sog, SOG_MOST_KN)), np.where(missing, np.nan, cog)


def _times(
    truth: AisTruth, senders: Transponders, state: StateAt, start_s: float, stop_s: float, seed: int
) -> tuple[Ints, Floats]:
    """Sender and time of each report, sorted by sender, then time. (M,), (M,)"""
    phase = np.random.default_rng([seed, PHASE]).random(len(senders.row))
    if truth.intervals == "fixed":
        number = np.arange(int(np.ceil((stop_s - start_s) / truth.interval_s)) + 1)
        times = start_s + (phase[:, None] + number) * truth.interval_s
        who, _ = np.nonzero(times <= stop_s)
        return who, times[times <= stop_s]
    return _itu_times(senders, state, phase, start_s, stop_s)


def _itu_times(senders: Transponders, state: StateAt, phase: Floats, start_s: float, stop_s: float) -> tuple[Ints, Floats]:
    """Sender and time of each report. The speed and turn rate at a report give the interval to the next.

    Source: Recommendation ITU-R M.1371-5 (2014), annex 1, tables 1 and 2.
    """
    who = np.arange(len(senders.row))
    time = np.full(len(who), start_s)
    wait = _itu_interval(senders, state, who, time) * phase
    sent = [(who[:0], time[:0])]
    while len(who):
        time = time + wait
        who, time = who[time <= stop_s], time[time <= stop_s]
        sent.append((who, time))
        wait = _itu_interval(senders, state, who, time)
    everyone, times = np.concatenate([w for w, _ in sent]), np.concatenate([t for _, t in sent])
    order = np.lexsort((times, everyone))
    return everyone[order], times[order]


def _itu_interval(senders: Transponders, state: StateAt, who: Ints, time_s: Floats) -> Floats:
    row = senders.row[who]
    _, now = state(row, time_s)
    _, before = state(row, time_s - 1.0)
    return itu_interval_s(now, before, 1.0, senders.class_b[who])


def itu_interval_s(now_m_s: Floats, before_m_s: Floats, apart_s: float, class_b: Bools) -> Floats:
    """The interval until the next report of vessels. (M,)

    Args: now_m_s, before_m_s: velocities (M, 2) now and `apart_s` before.
    Source: Recommendation ITU-R M.1371-5 (2014), annex 1, tables 1 and 2.
    """
    speed = np.hypot(now_m_s[:, 0], now_m_s[:, 1]) / KNOT_M_S
    cross = now_m_s[:, 0] * before_m_s[:, 1] - now_m_s[:, 1] * before_m_s[:, 0]
    turned = np.arctan2(cross, (now_m_s * before_m_s).sum(axis=1))
    turning = np.abs(turned) > TURNING_RAD_S * apart_s
    out = np.empty(len(speed))
    for of_b, table in ((False, CLASS_A), (True, CLASS_B)):
        limits, steady, in_turn = (np.array(part) for part in zip(*table, strict=True))
        step = np.searchsorted(limits, speed, side="right")
        step = np.minimum(step, len(limits) - 1)
        out = np.where(class_b == of_b, np.where(turning, in_turn[step], steady[step]), out)
    return np.where((speed < AT_ANCHOR_KN) & ~class_b, ANCHORED_S, out)


def transmit_static_data(
    truth: AisTruth, senders: Transponders, reports_mmsi: Ints, start_s: float, stop_s: float, seed: int
) -> AisStatics:
    """Static reports in order of arrival: of each transponder one soon after the start, then one per interval.

    Args: reports_mmsi: (M,) of the position reports that were received; vessels that are not among them are out of range.
    """
    mine = ~senders.clone
    mmsi, silent = senders.mmsi[mine], senders.silent[mine]
    count = len(mmsi)
    name, call_sign, kind, length = _identities(count, seed)
    first = np.random.default_rng([seed, WHEN]).random(count) * truth.static_within_s
    times = (
        start_s + first[:, None] + truth.static_interval_s * np.arange(int((stop_s - start_s) / truth.static_interval_s) + 1)
    )
    until = np.inf if truth.silent_to_s is None else truth.silent_to_s
    quiet = silent[:, None] & (times - start_s >= truth.silent_from_s) & (times - start_s < until)
    rng, ship_type = np.random.default_rng([seed, LIES]), TYPES[kind, 0].astype(np.int64)
    never_set, wrong, other = rng.random(count), rng.random(count), rng.choice(len(TYPES), count)
    ship_type = np.where(wrong < truth.type_wrong_share, TYPES[other, 0].astype(np.int64), ship_type)
    ship_type = np.where(never_set < truth.type_missing_share, 0, ship_type)
    row, sent = np.nonzero((times <= stop_s) & ~quiet & np.isin(mmsi, reports_mmsi)[:, None])
    made = AisStatics(
        received_s=times[row, sent],
        mmsi=mmsi[row],
        name=name[row],
        call_sign=call_sign[row],
        ship_type=ship_type[row],
        length_m=length[row],
        beam_m=np.maximum(np.round(length[row] / LENGTH_OVER_BEAM), 2.0),
    )
    return made.take(np.lexsort((made.mmsi, made.received_s)))


def true_types(senders: Transponders, count: int, seed: int) -> Ints:
    """The true ITU-R M.1371 ship type of the vessels 0..count-1, with and without AIS. Returns: (count,)."""
    mine = ~senders.clone
    kind = np.random.default_rng([seed, WHAT]).choice(len(TYPES), count, p=TYPES[:, 1])
    kind[senders.row[mine]] = _identities(int(mine.sum()), seed)[2]
    return np.asarray(TYPES[kind, 0], np.int64)


def _identities(count: int, seed: int) -> tuple[Array, Array, Ints, Floats]:
    """Name, call sign, row of TYPES and length in metres of this many transponders."""
    rng = np.random.default_rng([seed, WHO])
    number = np.arange(count)
    name = FIRST[rng.integers(0, len(FIRST), count)] + " " + LAST[rng.integers(0, len(LAST), count)]
    name = np.where(number < 256, name, name + " " + (number % 1000).astype("U3")).astype("U20")
    call = np.ascontiguousarray(LETTERS[rng.integers(0, 26, (count, 4))]).view("U4").ravel() if count else np.zeros(0, "U4")
    call_sign = (call + rng.integers(0, 10, count).astype("U1")).astype("U7")
    kind = rng.choice(len(TYPES), count, p=TYPES[:, 1])
    length = np.round(rng.uniform(TYPES[kind, 2], TYPES[kind, 3]))
    return name, call_sign, kind, length
