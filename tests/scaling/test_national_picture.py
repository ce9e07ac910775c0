"""The national picture of scaling/load has the seed and shares that its README states, and its decisions are counted right."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest

from coastwatch.batches import Ints, SourceKind
from coastwatch.centre import Cycle, Received, run_centre, start_centre
from coastwatch.scores.confusion import Confusion
from coastwatch.stage import serial
from scaling.load import national
from scaling.load.national.traffic import SHARES, Traffic
from scaling.load.run import ALL, BEARINGS, TRAFFIC, YOUNG, YOUNG_S, decision_counts

pytestmark = pytest.mark.contract

TRACKS, CYCLES = 2000, 6
WRONG = 150  # tracks whose association is made wrong, of each kind
WITHIN = 0.05  # sizes are rounded to whole ports and regions


def first_cycles(seed: int, cycles: int = 1) -> tuple[national.World, list[Received]]:
    world = national.build_world(TRACKS, seed)
    sensors, state = national.scenario_of(world, {}).sensors(), national.initial_state(world)
    every = []
    for _ in range(cycles):
        state, received = national.next_cycle(world, state, sensors)
        every.append(received)
    return world, every


def test_a_seed_gives_the_same_bits_and_the_shares_are_as_stated() -> None:
    world, (received,) = first_cycles(1)
    got, again, other = received.tracks, first_cycles(1)[1][0].tracks, first_cycles(2)[1][0].tracks
    assert np.array_equal(got.position_deg, again.position_deg)
    assert not np.array_equal(got.position_deg[:100], other.position_deg[:100])
    radar, ais = (np.unique(got.origin[(got.mmsi < 0) == of_radar]) for of_radar in (True, False))
    vessels = np.union1d(radar, ais)
    assert len(got) == pytest.approx(TRACKS, rel=WITHIN)
    assert (got.mmsi < 0).mean() == pytest.approx(0.5, abs=WITHIN / 2)
    assert len(np.intersect1d(radar, ais)) / len(vessels) == pytest.approx(0.5, abs=WITHIN)
    kinds = np.bincount(world.traffic_of(vessels), minlength=len(Traffic)) / len(vessels)
    assert kinds == pytest.approx(np.array(SHARES), abs=0.01)


def wrong_cycle() -> tuple[national.World, Cycle, Ints]:
    """A cycle with wrong associations: some tracks exchange vessels, others are left alone."""
    world, every = first_cycles(5, CYCLES)
    scenario = national.scenario_of(world, {})
    sensors, memory = scenario.sensors(), start_centre(scenario)
    for number, received in enumerate(every):
        memory, cycle = run_centre(scenario, sensors, memory, received, world.time_s(number), serial, lambda _: nullcontext())
    rng = np.random.default_rng([5, 1])
    vessel = cycle.associations.vessel.copy()
    some = rng.permutation(len(vessel))[: 2 * WRONG]
    vessel[some[:WRONG]] = vessel[np.roll(some[:WRONG], 1)]
    vessel[some[WRONG:]] = vessel.max() + 1 + np.arange(WRONG)
    return world, replace(cycle, associations=replace(cycle.associations, vessel=vessel)), sensors.source_kinds


def counted_slowly(world: national.World, cycle: Cycle, kinds: Ints, part: str) -> Confusion:
    """The decisions of a part, counted one radar track after the other."""
    t, label = cycle.tracks, cycle.associations.vessel.tolist()
    kind, origin = kinds[t.source].tolist(), t.origin.tolist()
    ais = {origin[k]: k for k in range(len(t)) if kind[k] == SourceKind.AIS}
    chosen: dict[int, list[int]] = {}
    for k in ais.values():
        chosen.setdefault(label[k], []).append(k)
    total = Confusion()
    for k in range(len(t)):
        if kind[k] != SourceKind.RADAR:
            continue
        partner, associated = ais.get(origin[k]), chosen.get(label[k], [])
        ages = [cycle.time_s - t.started_s[row] for row in (k, partner) if row is not None]
        kind_of_traffic = TRAFFIC[int(world.slots.kind[origin[k] % len(world.slots)])]
        if part not in (ALL, kind_of_traffic) and not (part == YOUNG and min(ages) < YOUNG_S):
            continue
        right = partner is not None and partner in associated
        wrong = any(row != partner for row in associated)
        missed, none = partner is not None and not right, partner is None and not wrong
        total += Confusion(int(right), int(missed), int(wrong), int(none))
    return total


def test_decisions_equal_a_slow_count() -> None:
    world, cycle, kinds = wrong_cycle()
    counts = decision_counts(world, cycle, kinds)
    for part in (ALL, YOUNG, *TRAFFIC):
        assert counts[part] == counted_slowly(world, cycle, kinds, part), part
    assert counts[ALL].fn > WRONG // 4
    assert counts[ALL].fp > 10
    assert counts[BEARINGS].tp > 30
    assert sum((counts[kind] for kind in TRAFFIC), Confusion()) == counts[ALL]
