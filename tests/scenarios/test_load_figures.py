"""What the commands of scaling/load say: decisions against a slow count, pairs, exponents, slopes, and that each command runs."""

from __future__ import annotations

import json
import sys
from contextlib import nullcontext
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from coastwatch import pipeline
from coastwatch.batches import Ints, SourceKind
from coastwatch.geodesy import difference_m
from coastwatch.pipeline import Cycle
from coastwatch.scores.confusion import Confusion
from coastwatch.stage import in_turn
from scaling.load import cycle as cycle_command
from scaling.load import national, ramp, soak
from scaling.load.budget import ALL, BEARINGS, WATERS, YOUNG, YOUNG_S, budget_of, pairs_within
from scaling.load.processes import family, memory_bytes, processor_s
from scaling.load.running import Load, measured

TRACKS, CYCLES = 2000, 6
WRONG = 150  # tracks that are given another vessel


@cache
def last_cycle() -> tuple[national.World, Cycle, Ints]:
    """A cycle with wrong decisions in it: some tracks change vessels among each other, some are left alone."""
    world = national.lay_world(TRACKS, 5)
    scenario = national.scenario_of(world, {})
    sensors = scenario.sensors()
    state, memory = national.first(world), pipeline.start_centre(scenario)
    for number in range(CYCLES):
        state, received = national.receive(world, state, sensors)
        now = world.time_s(number)
        memory, cycle = pipeline.fuse(scenario, sensors, memory, received, now, in_turn, lambda stage: nullcontext())
    rng = np.random.default_rng([5, 1])
    vessel = cycle.associations.vessel.copy()
    some = rng.permutation(len(vessel))[: 2 * WRONG]
    vessel[some[:WRONG]] = vessel[np.roll(some[:WRONG], 1)]
    vessel[some[WRONG:]] = vessel.max() + 1 + np.arange(WRONG)
    return world, replace(cycle, associations=replace(cycle.associations, vessel=vessel)), sensors.source_kinds


def counted(world: national.World, cycle: Cycle, kinds: Ints, part: str) -> Confusion:
    """The decisions of a part, one radar track after the other."""
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
        mate, mine = ais.get(origin[k]), chosen.get(label[k], [])
        ages = [cycle.time_s - t.started_s[row] for row in (k, mate) if row is not None]
        water = WATERS[int(world.places.water[origin[k] % len(world.places)])]
        if part not in (ALL, water) and not (part == YOUNG and min(ages) < YOUNG_S):
            continue
        right = mate is not None and mate in mine
        wrong = any(row != mate for row in mine)
        missed, none = mate is not None and not right, mate is None and not wrong
        total += Confusion(int(right), int(missed), int(wrong), int(none))
    return total


@pytest.mark.parametrize("part", [ALL, YOUNG, *WATERS])
def test_decisions_are_those_of_a_slow_count(part: str) -> None:
    world, cycle, kinds = last_cycle()
    told = budget_of(world, cycle, kinds)
    assert told[part] == counted(world, cycle, kinds, part)
    assert told[ALL].fn > WRONG // 4
    assert told[ALL].fp > 10


def test_the_waters_make_up_the_whole() -> None:
    told = budget_of(*last_cycle())
    assert sum((told[water] for water in WATERS), Confusion()) == told[ALL]
    assert told[BEARINGS].tp > 30


def test_pairs_are_those_of_different_sources_within_the_gate() -> None:
    tracks = last_cycle()[1].tracks.take(np.arange(0, TRACKS - 50, 3))
    metres = difference_m(tracks.position_deg[:, None], tracks.position_deg[None, :])
    near = np.hypot(metres[..., 0], metres[..., 1]) <= 1000.0
    wanted = int((near & (tracks.source[:, None] < tracks.source[None, :])).sum())
    assert pairs_within(tracks, 1000.0) == pytest.approx(wanted, abs=2)  # a pair at the gate may fall to either side
    assert wanted > 500


def test_memory_and_time_of_all_processes_are_read() -> None:
    now, peak = memory_bytes()
    assert len(family()) >= 1
    assert 50e6 < now < 1.05 * peak
    begun = processor_s()
    np.linalg.inv(np.eye(400) + 0.001)
    assert processor_s() > begun


def test_a_cycle_of_the_load_is_the_same_for_any_workers() -> None:
    """Decisions, pairs and vessels; bit for bit they are compared in tests/contracts/test_workers.py."""
    alone, together = (list(measured(Load(1000, 2, 1, workers=workers))) for workers in (1, 2))
    for a, b in zip(alone, together, strict=True):
        assert (a.tracks, a.vessels, a.pairs_tested, a.budget) == (b.tracks, b.vessels, b.pairs_tested, b.budget)
    assert [bool(a.budget) for a in alone] == [False, True, True]
    assert alone[-1].pairs_tested > 1000


def test_the_command_cycle_says_all_that_was_asked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    database = f"sqlite:///{tmp_path / 'load.db'}"
    said = ["cycle", "--tracks", "1000", "--cycles", "2", "--warmup", "2", "--store", database, "--json"]
    monkeypatch.setattr(sys, "argv", [*said, "--set", "associations.gate_m=800"])
    cycle_command.main()
    figures = json.loads(capsys.readouterr().out)
    assert figures["tracks"] == pytest.approx(1000, rel=0.06)
    assert {"alignment", "associations", "picture", "store"} <= set(figures["stages_s"])
    assert figures["cycle_s"]["median"] > figures["compute_s"]["median"] > 0.0
    assert figures["cycle_s"]["median"] >= 0.9 * figures["stages_s"]["store"]["median"] > 0.0
    assert figures["cycle_s"]["mean"] == pytest.approx(figures["cycle_s"]["median"])  # of two cycles
    assert figures["rows_written"] > figures["vessels"]
    assert figures["decisions"]["all"]["f1"] > 0.95
    assert figures["memory_mib"]["peak"] > 100.0
    assert "rows written a cycle" in cycle_command.text(figures)


def test_a_ramp_fits_the_power_of_its_costs() -> None:
    assert ramp.sizes(1000, 1_000_000, 1) == [1000, 10_000, 100_000, 1_000_000]
    every = [
        {
            "asked": {"tracks": n},
            "tracks": n,
            "compute_s": {"median": 1e-6 * n**1.5},
            "compute_cpu_s": 1e-6 * n,
            "stages_s": {"spots": {"median": 2.0 * n**0.5}},
        }
        for n in (1000, 10_000, 100_000)
    ]
    fitted = ramp.summary(every)
    assert fitted["exponent"] == pytest.approx({"compute_s": 1.5, "compute_cpu_s": 1.0, "stages_s.spots": 0.5})
    assert fitted["local"]["compute_s"] == pytest.approx([1.5, 1.5])


def test_a_slope_is_flat_within_its_error_or_a_hundredth() -> None:
    wobble = 100.0 + np.array([0.3, -0.3, 0.2, -0.2, 0.1, -0.1])
    assert soak.slope(wobble.tolist())["flat"]
    assert soak.slope((wobble + np.arange(6)).tolist())["a_minute"] == pytest.approx(0.95, abs=0.1)
    assert not soak.slope((wobble + np.arange(6)).tolist())["flat"]
    assert soak.slope([1.0, 2.0])["flat"] is None


def test_a_soak_of_a_minute_runs_with_a_console(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(sys, "argv", ["soak", "--tracks", "300", "--minutes", "1", "--json"])
    soak.main()
    figures = json.loads(capsys.readouterr().out)
    assert len(figures["minutes"]) == 1
    assert figures["minutes"][0]["rows"] > 20 * 150
    assert figures["minutes"][0]["wal_mib"] > 0.0
    assert figures["console"]["questions"] > 0
    assert "WAL" in soak.text(figures)
