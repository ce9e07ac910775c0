"""A database filled with the history of a national picture, as the writer of cycles would have left it, without the fusion before it.

Vessels move as in the national picture (coasts, ports, lanes, fleets), stay for hours, and are seen with errors that last 20 s. Points
are those of the bounded-error rule itself, in the order of cycles. Associations, spots and timings are left out.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace

import numpy as np
from sqlalchemy import Connection, insert as insert_one

from coastwatch import store
from coastwatch.batches import Array, Floats, Ints, Picture
from coastwatch.geodesy import scale_m_deg, wrap_deg
from coastwatch.stage import Plan
from coastwatch.store import history_rule
from coastwatch.store.rows import Categorical, NullableId, insert
from coastwatch.store.schema.database import writing
from coastwatch.store.schema.tables import CYCLE, MEMBER, MEMBER_HISTORY, PRESENCE, VESSEL, VESSEL_STATIC
from coastwatch.store.write.to_rows import vessel_rows
from coastwatch.store.write.write_cycle import write_history
from scaling.load.national import World, build_world, scenario_of
from scaling.load.national.coasts import to_geodetic
from scaling.load.national.traffic import true_motion

STAYS_LONGER = 8.0  # than in the national picture, where a vessel is seen for 30 to 90 minutes
STRIDE = 4  # cycles between two evaluations of the true motion; positions between them are interpolated
POSITION_M, VELOCITY_M_S, CORRELATION_S = 4.0, 0.15, 20.0  # standard deviations and time constant of the picture's errors
AIS_SHARE = 0.78  # of vessels have an MMSI
TOGETHER = 20  # cycles per transaction


@dataclass
class _Stays:
    """The vessel of each slot now, and all stays so far."""

    number: Ints  # id of the vessel of each slot, 0 for none
    came: Ints  # cycle
    since_s: Floats
    mmsi: Ints
    generation: Ints  # of the vessel of each slot
    next_number: int = 1
    ended: list[tuple[Ints, Ints, Ints, Floats]] = field(
        default_factory=list
    )  # vessel id, first cycle, last cycle, time of the first


def fill(url: str, points: int, vessels: int, seed: int, say: Callable[[str], None]) -> int:
    """Fill an empty database with about so many points; returns the number of cycles."""
    world = build_world(round(vessels * 1.5), seed)
    world = replace(world, slots=replace(world.slots, lifetime_s=world.slots.lifetime_s * STAYS_LONGER))
    scenario = scenario_of(world, {})
    sensors, plan = scenario.sensors(), Plan(start_s=world.time_s(0), period_s=world.period_s, cycles=10**6)
    with store.open_store(url) as kept:
        run_id = store.begin_run(
            kept, scenario="national", title="History", seed=seed, version="0", settings=scenario.model_dump(mode="json"),
            sensors=sensors, plan=plan,
        )  # fmt: skip
        bound = history_rule.Bound(scenario.store.history_error_m, scenario.store.history_max_s)
        stays, number, written = _nobody(len(world.slots)), 0, 0
        held, picture = history_rule.no_points(), Picture.empty()
        pictures = _pictures(world, stays, seed)
        while written < points:
            with writing(kept) as connection:
                for _ in range(TOGETHER):
                    time_s, picture = next(pictures)
                    held, added = history_rule.extend(held, bound, number, time_s, time_s - world.period_s, picture)
                    connection.execute(insert_one(CYCLE), [_cycle(run_id, number, time_s, len(picture), added)])
                    write_history(connection, run_id, number - 1, number, added)
                    written, number = written + added.points, number + 1
            if number % (10 * TOGETHER) == 0:
                say(f"{number} cycles, {written / 1e6:.1f} M points, {written / number:.0f} a cycle")
        with writing(kept) as connection:
            _rest(connection, run_id, stays, picture, number)
        store.finish_run(kept, run_id, "finished")
    return number


def _nobody(slots: int) -> _Stays:
    """The stays before the first cycle: every slot is empty."""
    none = np.zeros(slots, np.int64)
    return _Stays(none, none.copy(), np.zeros(slots), none - 1, none - 1)


def _pictures(world: World, stays: _Stays, seed: int) -> Iterator[tuple[float, Picture]]:
    """Time and picture of each cycle; updates the stays."""
    rng = np.random.default_rng([seed, 71])
    count, cycle = len(world.slots), 0
    error = rng.normal(0.0, 1.0, (count, 4))
    keep = np.exp(-world.period_s / CORRELATION_S)
    covariance = np.broadcast_to(np.diag([POSITION_M**2] * 2 + [VELOCITY_M_S**2] * 2), (count, 4, 4))
    after = _true_state(world, 0)
    while True:
        before, after = after, _true_state(world, cycle + STRIDE)
        for step in range(STRIDE):
            error = keep * error + np.sqrt(1.0 - keep**2) * rng.normal(0.0, 1.0, (count, 4))
            position, velocity = _interpolate(before, after, step / STRIDE)
            slots = _update_stays(stays, before[2], before[3], cycle, world.time_s(cycle), rng)
            yield world.time_s(cycle), _picture(stays, slots, position, velocity, error, covariance, world.time_s(cycle))
            cycle += 1


_TrueState = tuple[Floats, Floats, Ints, Array]
"""Latitude and longitude (P, 2), velocity (P, 2), generation (P,), and whether the vessel is present (P,)."""


def _true_state(world: World, cycle: int) -> _TrueState:
    """The true state of the vessel of every slot at a cycle."""
    rows = np.arange(len(world.slots))
    true = true_motion(world.slots, world.coasts, rows, np.full(len(rows), world.elapsed_s(cycle)))
    shore = true.along_m, true.offshore_m, true.along_m_s, true.offshore_m_s
    position, velocity = to_geodetic(world.coasts, world.slots.coast, *shore)
    return position, velocity, true.generation, true.present


def _interpolate(before: _TrueState, after: _TrueState, share: float) -> tuple[Floats, Floats]:
    """Positions and velocities between two states, linear; a slot whose vessel is replaced stays at the first state."""
    replaced = np.abs(after[0] - before[0]).max(1) > 0.1  # degrees
    step = np.where(replaced[:, None], 0.0, after[0] - before[0])
    return before[0] + share * step, before[1] + share * np.where(replaced[:, None], 0.0, after[1] - before[1])


def _update_stays(stays: _Stays, generation: Ints, present: Array, cycle: int, time_s: float, rng: np.random.Generator) -> Ints:
    """The slots with a vessel, in order of vessel id. Ends the stays of vessels that left and begins those of new ones."""
    changed = (generation != stays.generation) | (present != (stays.number > 0))
    left = np.flatnonzero(changed & (stays.number > 0))
    if len(left):
        ended = (stays.number[left], stays.came[left], np.full(len(left), cycle - 1), stays.since_s[left])
        stays.ended.append(ended)
        stays.number[left] = 0
    new = np.flatnonzero(changed & present)
    stays.generation[changed] = generation[changed]
    stays.number[new] = stays.next_number + np.arange(len(new))
    stays.next_number += len(new)
    stays.came[new], stays.since_s[new] = cycle, time_s
    stays.mmsi[new] = np.where(rng.random(len(new)) < AIS_SHARE, 200_000_000 + stays.number[new], -1)
    occupied = np.flatnonzero(stays.number > 0)
    return occupied[np.argsort(stays.number[occupied], kind="stable")]


def _picture(
    stays: _Stays, slots: Ints, position: Floats, velocity: Floats, error: Floats, covariance: Floats, time_s: float
) -> Picture:
    """The picture of the vessels of these slots, with errors. Args: error: (P, 4) in standard deviations."""
    true, off = position[slots], error[slots]
    north, east = scale_m_deg(true[:, 0])
    latitude = true[:, 0] + POSITION_M * off[:, 0] / north
    longitude = wrap_deg(true[:, 1] + POSITION_M * off[:, 1] / east)
    seen, zeros = np.full(len(slots), time_s), np.zeros(len(slots), np.int64)
    return Picture(
        stays.number[slots], seen, np.stack([latitude, longitude], 1), velocity[slots] + VELOCITY_M_S * off[:, 2:],
        covariance[: len(slots)], stays.since_s[slots], seen - 1.0, stays.mmsi[slots], zeros, zeros - 1,
    )  # fmt: skip


def _cycle(run_id: int, number: int, time_s: float, vessels: int, added: history_rule.Added) -> dict[str, object]:
    none = dict.fromkeys(("tracks", "pairs", "bearing_pairs", "reports"), 0)
    points = {"history_from": added.first_cycle, "history_points": added.points, "associations_kept": False}
    return {"run_id": run_id, "number": number, "time_s": time_s, "vessels": vessels, "picture_kept": True, **none, **points}


def _rest(connection: Connection, run_id: int, stays: _Stays, picture: Picture, cycles: int) -> None:
    """The stays of vessels and of their tracks, the current picture, and names."""
    here = np.flatnonzero(stays.number > 0)
    open_ = (stays.number[here], stays.came[here], np.full(len(here), -1), stays.since_s[here])
    vessel, first, last, since = (np.concatenate(parts) for parts in zip(*stays.ended, open_, strict=True))
    order = np.argsort(vessel, kind="stable")
    vessel, first, last, since = vessel[order], first[order], last[order], since[order]
    insert(connection, PRESENCE, [run_id, vessel, first, NullableId(last), since])
    row = np.repeat(np.arange(len(vessel)), 1 + (vessel % 5 < 3))
    again = np.append(False, row[1:] == row[:-1])
    source = np.where(again, 2, vessel[row] % 2)
    rows = [vessel[row], source, 10 * vessel[row] + again]
    insert(connection, MEMBER_HISTORY, [run_id, *rows, first[row], NullableId(last[row])])
    now = last[row] < 0
    insert(connection, MEMBER, [run_id, *(column[now] for column in rows)])
    named = np.unique(picture.mmsi[picture.mmsi >= 0])
    names, signs = (
        Categorical(np.arange(len(named)), [f"{word}{mmsi % 10**6}" for mmsi in named.tolist()]) for word in ("SHIP ", "S")
    )
    size = np.full(len(named), 80.0)
    insert(connection, VESSEL_STATIC, [run_id, named, names, signs, NullableId(named % 90), size, size / 6.0, size])
    sources = Categorical(picture.vessel_id % 2, ["region-0,ais", "region-1"])
    insert(connection, VESSEL, vessel_rows(run_id, picture, sources, np.full(len(picture), np.nan)))
