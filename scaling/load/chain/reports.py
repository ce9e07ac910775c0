"""The reports of a coast, one cycle at a time: plots of radars, AIS, bearings. Every cycle has random numbers of its own."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from coastwatch.batches import AisReports, BearingReports, Floats, Ints, RadarReports, Reports
from coastwatch.geodesy import KNOT_M_S, offset_deg, to_plane, wrap_rad
from coastwatch.sensors.simulated import ais as simulated_ais
from coastwatch.sensors.simulated.radar import RadarTruth
from coastwatch.sensors.simulated.simulation import truths_of
from scaling.load.chain.world import World

TURN_RAD = 2.0 * np.pi
PHASE, RADAR, AIS, SONAR = 71, 72, 73, 74  # streams of random numbers
BEAM_ROUNDS = (
    2  # iterations of the beam time; it is then right to a tenth of a millisecond, and the position is that of this time
)


@dataclass(frozen=True, eq=False)
class State:
    """The part that changes from cycle to cycle."""

    cycle: int  # the next one
    due_s: Floats  # (C,) time of the next AIS report of each transponder
    waiting: Reports  # measured, not yet received


def initial_state(world: World) -> State:
    """The state before the first cycle."""
    start_s = np.full(len(world.senders.row), world.plan.start_s)
    phase = np.random.default_rng([world.seed, PHASE, AIS]).random(len(start_s))
    wait_s = _ais_interval(world, np.arange(len(start_s)), start_s) * phase
    none = Reports(RadarReports.empty(), AisReports.empty(), world.statics, BearingReports.empty())
    return State(0, start_s + wait_s, none)


def next_cycle(world: World, state: State) -> tuple[State, Reports]:
    """The state after a cycle, and all reports that arrive in it, each kind in order of arrival."""
    plan, number = world.plan, state.cycle
    after_s, until_s = plan.start_s if number == 0 else plan.instant_s(number - 1), plan.instant_s(number)
    due_s, ais = _ais(world, state.due_s, until_s, np.random.default_rng([world.seed, AIS, number]))
    made = _radars(world, number, after_s, until_s), ais, _bearings(world, number, after_s, until_s)
    old = state.waiting
    radar, reports, bearing = (
        _in_order(type(new).join([before, new]), "sensor" if hasattr(new, "sensor") else "mmsi")
        for before, new in zip((old.radar, old.ais, old.bearing), made, strict=True)
    )
    every = Reports(radar, reports, old.statics, bearing)
    return State(number + 1, due_s, every.between(until_s, np.inf)), every.between(-np.inf, until_s)


def _in_order(reports: Any, last_key: str) -> Any:
    return reports.take(np.lexsort((getattr(reports, last_key), reports.time_s, reports.received_s)))


def _radars(world: World, number: int, after_s: float, until_s: float) -> RadarReports:
    """Plots whose beam passed in the cycle."""
    middle_s = np.full(world.count, 0.5 * (after_s + until_s))
    position_deg, velocity_m_s = world.vessels.state(np.arange(world.count), middle_s)
    parts, radars = [], world.sensors.radars
    for r, truth in enumerate(truths_of("radars", radars.name, world.input.radar, world.input.radars)):
        rng, rows = np.random.default_rng([world.seed, RADAR, number, r]), world.seen[r]
        at_m = to_plane(position_deg[rows], radars.site_deg[r])
        first_s = world.plan.start_s - float(np.random.default_rng([world.seed, PHASE, RADAR, r]).random()) * radars.period_s[r]
        span = after_s, until_s, float(first_s), float(radars.period_s[r])
        row, beam_s = _beams(at_m, velocity_m_s[rows], *span)
        found = rng.random(len(row)) < truth.detection_probability
        row, beam_s = rows[row[found]], beam_s[found]
        at_m = to_plane(world.vessels.position(row, beam_s), radars.site_deg[r])
        distance = np.hypot(at_m[:, 0], at_m[:, 1])
        inside = distance <= radars.range_m[r]  # an absent vessel is NaN far
        distance, azimuth = distance[inside], np.arctan2(at_m[inside, 0], at_m[inside, 1])
        errors = rng.standard_normal((len(distance), 2)) * truth.noise_factor
        measured_m = distance + errors[:, 0] * radars.range_sigma_m[r] + truth.range_bias_m
        measured_deg = np.degrees(azimuth + errors[:, 1] * radars.azimuth_sigma_rad[r]) + truth.azimuth_bias_deg
        parts.append(_plots(world, r, truth, beam_s[inside], measured_m, measured_deg, row[inside]))
        parts.append(_clutter(world, r, truth, rng, *span))
    return RadarReports.join(parts)


def _beams(
    at_m: Floats, velocity_m_s: Floats, after_s: float, until_s: float, first_s: float, period_s: float
) -> tuple[Ints, Floats]:
    """Row and time of each pass of the beam in (after_s, until_s].

    Args: at_m, velocity_m_s: (M, 2) from the radar, in the middle of the span; first_s: when the beam pointed north.
    """
    middle_s = 0.5 * (after_s + until_s)
    azimuth = np.arctan2(at_m[:, 0], at_m[:, 1])
    turn = np.ceil((after_s - first_s) / period_s - azimuth / TURN_RAD) - 1.0
    rows, times = [], []
    for _ in range(int(np.ceil((until_s - after_s) / period_s)) + 2):
        now = azimuth
        for _ in range(BEAM_ROUNDS):
            time_s = first_s + (turn + now / TURN_RAD) * period_s
            there = at_m + (time_s - middle_s)[:, None] * velocity_m_s
            now = azimuth + wrap_rad(np.arctan2(there[:, 0], there[:, 1]) - azimuth)
        time_s = first_s + (turn + now / TURN_RAD) * period_s
        passed = np.flatnonzero((time_s > after_s) & (time_s <= until_s))
        rows.append(passed)
        times.append(time_s[passed])
        turn = turn + 1.0
    return np.concatenate(rows), np.concatenate(times)


def _clutter(
    world: World,
    r: int,
    truth: RadarTruth,
    rng: np.random.Generator,
    after_s: float,
    until_s: float,
    first_s: float,
    period_s: float,
) -> RadarReports:
    """False plots, uniform over the disc of the radar's range."""
    reach_m = float(world.sensors.radars.range_m[r])
    count = rng.poisson(truth.clutter_per_m2 * np.pi * reach_m**2 * (until_s - after_s) / period_s)
    beam_s = until_s - (until_s - after_s) * rng.random(count)
    distance = np.sqrt(rng.random(count)) * reach_m
    return _plots(world, r, truth, beam_s, distance, 360.0 * (beam_s - first_s) / period_s, np.full(count, -1, np.int64))


def _plots(
    world: World, r: int, truth: RadarTruth, beam_s: Floats, range_m: Floats, azimuth_deg: Floats, origin: Ints
) -> RadarReports:
    return RadarReports(
        sensor=np.full(len(beam_s), r, np.int64),
        time_s=beam_s + truth.time_bias_s,
        received_s=beam_s + truth.latency_s,
        range_m=np.maximum(range_m, 0.0),
        azimuth_deg=azimuth_deg % 360.0,
        site_deg=np.tile(world.sensors.radars.site_deg[r], (len(beam_s), 1)),
        origin=origin,
    )


def _ais(world: World, due_s: Floats, until_s: float, rng: np.random.Generator) -> tuple[Floats, AisReports]:
    """The times of the next reports, and the reports that were sent until a time."""
    truth, senders = world.input.ais, world.senders
    due_s, sent = due_s.copy(), [(np.zeros(0, np.int64), np.zeros(0))]
    who = np.flatnonzero(due_s <= until_s)
    while len(who):
        sent.append((who, due_s[who]))
        due_s[who] += _ais_interval(world, who, due_s[who])
        who = who[due_s[who] <= until_s]
    who, time_s = (np.concatenate(part) for part in zip(*sent, strict=True))
    position, velocity = world.vessels.state(senders.row[who], time_s)
    draws, lost, delay = rng.standard_normal((len(who), 4)), rng.random(len(who)), rng.exponential(1.0, len(who))
    received = np.isfinite(position[:, 0]) & (lost >= truth.loss) & (world.heard[who] > 0)
    position = offset_deg(position, truth.position_sigma_m * draws[:, :2])
    velocity = velocity + truth.velocity_sigma_kn * KNOT_M_S * draws[:, 2:]
    sog = np.hypot(velocity[:, 0], velocity[:, 1]) / KNOT_M_S
    cog = np.degrees(np.arctan2(velocity[:, 0], velocity[:, 1])) % 360.0
    if truth.wire_steps:
        position = np.round(position / simulated_ais.POSITION_STEP_DEG) * simulated_ais.POSITION_STEP_DEG
        sog = np.round(sog / simulated_ais.SOG_STEP_KN) * simulated_ais.SOG_STEP_KN
        cog = np.round(cog / simulated_ais.COG_STEP_DEG) * simulated_ais.COG_STEP_DEG % 360.0
    return due_s, AisReports(
        time_s=np.floor(time_s) if truth.whole_seconds else time_s,
        received_s=time_s + truth.latency_s + truth.latency_spread_s * delay,
        mmsi=senders.mmsi[who],
        position_deg=position,
        sog_kn=np.minimum(sog, simulated_ais.SOG_MOST_KN),
        cog_deg=cog,
        class_b=senders.class_b[who],
        origin=senders.row[who],
    ).take(received)


def _ais_interval(world: World, who: Ints, time_s: Floats) -> Floats:
    """Seconds to the next report of these transponders. Source: Recommendation ITU-R M.1371-5 (2014), annex 1, tables 1 and 2."""
    truth, senders = world.input.ais, world.senders
    if truth.intervals == "fixed":
        return np.full(len(who), truth.interval_s)
    _, now = world.vessels.state(senders.row[who], time_s)
    _, before = world.vessels.state(senders.row[who], time_s - 1.0)
    knots = np.hypot(now[:, 0], now[:, 1]) / KNOT_M_S
    turned = np.arctan2(now[:, 0] * before[:, 1] - now[:, 1] * before[:, 0], (now * before).sum(axis=1))
    turning, class_b = np.abs(turned) > simulated_ais.TURNING_RAD_S, senders.class_b[who]
    by_class = []
    for table in (simulated_ais.CLASS_A, simulated_ais.CLASS_B):
        limits, steady, in_turn = (np.array(part) for part in zip(*table, strict=True))
        step = np.minimum(np.searchsorted(limits, knots, side="right"), len(limits) - 1)
        by_class.append(np.where(turning, in_turn[step], steady[step]))
    anchored = (knots < simulated_ais.AT_ANCHOR_KN) & ~class_b
    return np.where(anchored, simulated_ais.ANCHORED_S, np.where(class_b, by_class[1], by_class[0]))


def _bearings(world: World, number: int, after_s: float, until_s: float) -> BearingReports:
    """Bearings that were measured in the cycle; all of a sensor at one instant."""
    sonars, parts = world.sensors.sonars, []
    for r, truth in enumerate(truths_of("sonars", sonars.name, world.input.sonar, world.input.sonars)):
        rng, rows = np.random.default_rng([world.seed, SONAR, number, r]), world.audible[r]
        interval_s = float(sonars.interval_s[r])
        first_s = world.plan.start_s + float(np.random.default_rng([world.seed, PHASE, SONAR, r]).random()) * interval_s
        from_number, to_number = (int(np.floor((s - first_s) / interval_s)) + 1 for s in (after_s, until_s))
        for time in first_s + interval_s * np.arange(max(from_number, 0), to_number):
            time_s = np.full(len(rows), time)
            at_m = to_plane(world.vessels.position(rows, time_s), sonars.site_deg[r])
            bearing = np.degrees(np.arctan2(at_m[:, 0], at_m[:, 1]))
            arc_deg = float(sonars.arc_to_deg[r] - sonars.arc_from_deg[r])
            in_arc = (bearing - sonars.arc_from_deg[r]) % 360.0 <= (arc_deg % 360.0 if abs(arc_deg) < 360.0 else 360.0)
            errors, missed = rng.standard_normal(len(rows)) * truth.noise_factor, rng.random(len(rows)) < truth.miss_probability
            heard = in_arc & ~missed & (np.hypot(at_m[:, 0], at_m[:, 1]) <= sonars.range_m[r])
            measured = bearing + errors * np.degrees(sonars.bearing_sigma_rad[r]) + truth.bias_deg
            parts.append(
                BearingReports(
                    sensor=np.full(len(rows), r, np.int64),
                    time_s=time_s,
                    received_s=time_s + truth.latency_s,
                    bearing_deg=np.nan_to_num(measured) % 360.0,
                    contact=rows + 1,
                    site_deg=np.tile(sonars.site_deg[r], (len(rows), 1)),
                    signature=np.full(len(rows), -1, np.int64),
                    origin=rows,
                ).take(heard)
            )
    return BearingReports.join(parts)
