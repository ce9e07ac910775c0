"""Figures of the load commands: decisions and pairs against a slow count, exponents, slopes, baselines; each command runs."""

from __future__ import annotations

import json
import sys
from contextlib import nullcontext
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from coastwatch.batches import Ints, SourceKind
from coastwatch.centre import Cycle, run_centre, start_centre
from coastwatch.geodesy import difference_m
from coastwatch.scores.confusion import Confusion
from coastwatch.stage import serial
from scaling.load import baseline, national, queries, ramp, soak
from scaling.load import cycle as cycle_command
from scaling.load.chain import command as chain_command
from scaling.load.chain.run import Load as ChainLoad
from scaling.load.chain.run import run_cycles as run_chain_cycles
from scaling.load.chain.world import Size, build_world
from scaling.load.processes import memory_bytes, process_tree, processor_s
from scaling.load.run import ALL, BEARINGS, TRAFFIC, YOUNG, YOUNG_S, Load, decision_counts, pairs_within_gate, run_cycles

pytestmark = pytest.mark.contract

TRACKS, CYCLES = 2000, 6
WRONG = 150  # tracks whose association is made wrong, of each kind


@cache
def last_cycle() -> tuple[national.World, Cycle, Ints]:
    """A cycle with wrong associations: some tracks exchange vessels, others are left alone."""
    world = national.build_world(TRACKS, 5)
    scenario = national.scenario_of(world, {})
    sensors = scenario.sensors()
    state, memory = national.initial_state(world), start_centre(scenario)
    for number in range(CYCLES):
        state, received = national.next_cycle(world, state, sensors)
        now = world.time_s(number)
        memory, cycle = run_centre(scenario, sensors, memory, received, now, serial, lambda stage: nullcontext())
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


@pytest.mark.parametrize("part", [ALL, YOUNG, *TRAFFIC])
def test_decisions_equal_a_slow_count(part: str) -> None:
    world, cycle, kinds = last_cycle()
    counts = decision_counts(world, cycle, kinds)
    assert counts[part] == counted_slowly(world, cycle, kinds, part)
    assert counts[ALL].fn > WRONG // 4
    assert counts[ALL].fp > 10


def test_the_kinds_of_traffic_make_up_the_whole() -> None:
    counts = decision_counts(*last_cycle())
    assert sum((counts[kind] for kind in TRAFFIC), Confusion()) == counts[ALL]
    assert counts[BEARINGS].tp > 30


def test_pairs_are_those_of_different_sources_within_the_gate() -> None:
    tracks = last_cycle()[1].tracks.take(np.arange(0, TRACKS - 50, 3))
    metres = difference_m(tracks.position_deg[:, None], tracks.position_deg[None, :])
    near = np.hypot(metres[..., 0], metres[..., 1]) <= 1000.0
    wanted = int((near & (tracks.source[:, None] < tracks.source[None, :])).sum())
    assert pairs_within_gate(tracks, 1000.0) == pytest.approx(wanted, abs=2)  # a pair at the gate may fall to either side
    assert wanted > 500


def test_memory_and_time_of_all_processes_are_read() -> None:
    now, peak = memory_bytes()
    assert len(process_tree()) >= 1
    assert 50e6 < now < 1.05 * peak
    begun = processor_s()
    np.linalg.inv(np.eye(400) + 0.001)
    assert processor_s() > begun


def test_a_cycle_of_the_load_is_the_same_for_any_workers() -> None:
    """Decisions, pairs and vessels; bit for bit they are compared in tests/workers/test_workers.py."""
    alone, together = (list(run_cycles(Load(1000, 2, 1, workers=workers))) for workers in (1, 2))
    for a, b in zip(alone, together, strict=True):
        assert (a.tracks, a.vessels, a.pairs_within_gate, a.decisions) == (
            b.tracks,
            b.vessels,
            b.pairs_within_gate,
            b.decisions,
        )
    assert [bool(a.decisions) for a in alone] == [False, True, True]
    assert alone[-1].pairs_within_gate > 1000


def test_the_command_cycle_prints_its_figures_and_conditions(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    database = f"sqlite:///{tmp_path / 'load.db'}"
    words = ["cycle", "--tracks", "1000", "--cycles", "2", "--warmup", "2", "--store", database, "--json"]
    monkeypatch.setattr(sys, "argv", [*words, "--set", "associations.gate_m=800"])
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
    printed = cycle_command.text(figures).splitlines()
    assert printed[1].endswith("no plots; non-default settings: fused_tracks.method=convex associations.gate_m=800")
    assert any("rows written a cycle" in line for line in printed)


def test_a_ramp_fits_the_exponents_of_its_costs() -> None:
    assert ramp.sizes(1000, 1_000_000, 1) == [1000, 10_000, 100_000, 1_000_000]
    every = [
        {
            "load": {"tracks": n},
            "tracks": n,
            "compute_s": {"median": 1e-6 * n**1.5},
            "compute_cpu_s": 1e-6 * n,
            "stages_s": {"spots": {"median": 2.0 * n**0.5}},
        }
        for n in (1000, 10_000, 100_000)
    ]
    fitted = ramp.exponents(every)
    assert fitted["exponent"] == pytest.approx({"compute_s": 1.5, "compute_cpu_s": 1.0, "stages_s.spots": 0.5})
    assert fitted["local"]["compute_s"] == pytest.approx([1.5, 1.5])


def test_a_ramp_prints_its_conditions_first() -> None:
    compute = {"median": 0.1, "p99": 0.2, "share_of_period": 0.03}
    run = {
        "date": "2026-11-22T12:00Z",
        "machine": {"processors": 2, "processor": "A", "load": 0.5},
        "conditions": national.conditions({"workers.method": "serial"}),
        "tracks": 1000,
        "compute_s": compute,
        "compute_cpu_s": 0.1,
        "pairs_within_gate": 10,
        "memory_mib": {"peak": 300.0},
        "decisions": {"all": {"f1": 1.0}},
    }
    lines = ramp.text([run], {"local": {"compute_s": []}, "fitted_from": 10_000, "exponent": {}}).splitlines()
    assert lines[0] == "# 2026-11-22T12:00Z, 2 x A, load 0.5"
    assert lines[1].endswith("no plots; non-default settings: fused_tracks.method=convex workers.method=serial")


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
    printed = soak.text(figures).splitlines()
    assert printed[1].endswith("no plots; non-default settings: fused_tracks.method=convex")
    assert "WAL" in printed[3]


def test_a_baseline_is_run_in_turns_and_compared(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    runs: list[Path] = []
    seconds = {"this": iter([0.2, 0.3, 0.2]), "other": iter([0.1, 0.1, 0.4])}

    def figures(checkout: Path, arguments: list[str], module: str) -> dict[str, object]:
        runs.append(checkout)
        assert module == "scaling.load.cycle"
        assert arguments[:2] == ["--tracks", "50"]
        assert arguments[-3:] == ["--set", "associations.gate_m=800", "--no-score"]
        s = next(seconds["this" if checkout == baseline.CHECKOUT else "other"])
        return {"compute_s": {"median": s}, "compute_cpu_s": 3.0 * s, "stages_s": {"spots": {"median": 0.5 * s}}}

    other = baseline.CHECKOUT / "tests"
    monkeypatch.setattr(baseline, "figures", figures)
    monkeypatch.setattr(baseline, "python_of", lambda checkout: Path(sys.executable))
    words = f"cycle --tracks 50 --set associations.gate_m=800 --baseline {other} --turns 3"
    monkeypatch.setattr(sys, "argv", words.split())
    cycle_command.main()
    assert runs == [baseline.CHECKOUT, other, other, baseline.CHECKOUT, baseline.CHECKOUT, other]
    out = capsys.readouterr().out
    assert "fused_tracks.method=convex associations.gate_m=800" in out
    assert out.count("ratio 2.000") == 3
    assert "\nspots" in out


@pytest.mark.parametrize("there", [True, False])
def test_queries_delete_only_a_database_that_they_made(there: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    database, measured = tmp_path / "watch.db", []
    if there:
        database.write_text("of somebody else", "utf-8")
    monkeypatch.setattr(queries, "fill", lambda url, *_: Path(url.removeprefix("sqlite:///")).touch())
    monkeypatch.setattr(queries, "_measure", lambda url, options: measured.append(database.exists()))
    monkeypatch.setattr(sys, "argv", ["queries", "--database", str(database)])
    queries.main()
    assert measured == [True]
    assert database.exists() == there


@pytest.mark.slow
def test_a_checkout_can_be_its_own_baseline(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    words = f"cycle --tracks 500 --cycles 3 --warmup 3 --turns 1 --json --baseline {baseline.CHECKOUT}"
    monkeypatch.setattr(sys, "argv", words.split())
    cycle_command.main()
    figures = json.loads(capsys.readouterr().out)
    for cost in ("compute_wall_s", "compute_cpu_s"):
        assert figures["ratio"][cost] == figures[cost]["this"][0] / figures[cost]["baseline"][0] > 0.0


def test_cycles_with_the_writer_behind_are_counted_and_the_store_is_measured_in_the_others() -> None:
    load = Load(50, 4, 1, store="sqlite://")
    made = list(run_cycles(replace(load, store="none")))
    given = [{}, {"store": 2.0}, {}, {"store": 4.0}, {}]
    cycles = [
        replace(c, times=replace(c.times, stages_s={**c.times.stages_s, **more})) for c, more in zip(made, given, strict=True)
    ]
    figures = cycle_command.figures_of(load, cycles)
    assert figures["writer_behind_cycles"] == 2
    assert figures["stages_s"]["store"]["median"] == 3.0
    assert "writer behind in 2 of 4 cycles" in cycle_command.text(figures)


def test_the_chain_counts_them_too() -> None:
    size = Size(60, 3)
    load = ChainLoad(size, 1, score=False)
    made = list(run_chain_cycles(load, build_world(size, {}, 1)))
    cycles = [
        replace(c, times=replace(c.times, stages_s={**c.times.stages_s, **more}))
        for c, more in zip(made, ({}, {"store": 2.0}, {}), strict=True)
    ]
    figures = chain_command.figures_of(replace(load, store="sqlite://"), cycles, 3.0, "threads")
    assert figures["writer_behind_cycles"] == 1
    assert figures["stages_s"]["store"]["median"] == 2.0
    assert "writer behind in 1 of 2 cycles" in chain_command.text(figures)
