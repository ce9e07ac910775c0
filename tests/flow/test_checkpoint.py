"""Checkpoints: what is saved comes back to the bit, and a foreign one is refused with one sentence before anything of it runs."""

from __future__ import annotations

import io
import json
import pickle
import sqlite3
from collections.abc import Callable
from contextlib import closing, nullcontext, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from run_world import run, small, url

from coastwatch.batches import Members, Unproven
from coastwatch.cycle import run_cycle, start_run
from coastwatch.operators.cli import main
from coastwatch.registration.information import Estimate
from coastwatch.scenario import load_scenario
from coastwatch.scenario.model import StoreSettings
from coastwatch.server.checkpoint import CheckpointError, CheckpointSchedule, load, save
from coastwatch.stage import NoMemory, serial

pytestmark = pytest.mark.contract

RAN: list[str] = []


class Payload:
    """An object whose pickle runs code when it is read."""

    def __reduce__(self) -> tuple[Any, ...]:
        return RAN.append, ("the payload",)


def npz(tree: str, **arrays: np.ndarray) -> bytes:
    out = io.BytesIO()
    np.savez(out, tree=np.frombuffer(tree.encode(), np.uint8), **arrays)
    return out.getvalue()


def of_class(name: str, **fields: object) -> bytes:
    return npz(json.dumps({"class": name, "fields": fields}))


def objects() -> np.ndarray:
    return np.array([Payload()])


GOOD = save((Members.empty(), NoMemory(), {"late": 3}, np.arange(1000.0)))
FORMAT, DAMAGED, NAMES = "it is not in the format of this version", "it is damaged", "it names the class "
HOSTILE = {
    "a pickle": (pickle.dumps(Payload()), FORMAT),
    "nothing": (b"", FORMAT),
    "an array alone": (b"\x93NUMPY" + b"0" * 100, FORMAT),
    "an array of objects": (npz('{"array":0}', **{"0": objects()}), "allow_pickle=False"),
    "an array of objects that the tree does not use": (npz("1", **{"0": objects()}), "allow_pickle=False"),
    "records with objects": (npz('{"array":0}', **{"0": np.zeros(1, [("a", object)])}), "allow_pickle=False"),
    "a function": (of_class("os.system", command="true"), NAMES + "os.system"),
    "a function of ours": (of_class("coastwatch.server.run.run_scenario", scenario=None), NAMES),
    "a class outside of the stages": (of_class("coastwatch.server.run.RunResult", run_id=1), NAMES),
    "a class that a stage imports": (of_class("coastwatch.stage.BaseModel"), NAMES),
    "a class that is no dataclass": (of_class("coastwatch.tracks.radar.tracker.TableTracker", method="imm"), NAMES),
    "an unknown class of a stage": (of_class("coastwatch.tracks.radar.table.Backdoor"), NAMES),
    "a batch that no memory holds": (of_class("coastwatch.batches.yields.Tracks"), NAMES),
    "an unknown field": (of_class("coastwatch.stage.NoMemory", command="true"), "got the fields command, needed"),
    "a missing field": (of_class("coastwatch.server.checkpoint.Point", cycle=1), "needed cycle, memory, tally"),
    "a field of another type": (
        npz('{"class":"coastwatch.registration.references.References","fields":{"radar":1,"track_id":2}}'),
        "References.radar",
    ),
    "an unknown kind of part": (npz('{"call":"os.system"}'), "it has a part of unknown kind: call"),
    "an array that is missing": (npz('{"array":7}'), DAMAGED),
    "no tree": (GOOD.replace(b"tree.npy", b"trap.npy"), DAMAGED),
    "a tree too deep": (npz("[" * 100_000 + "]" * 100_000), DAMAGED),
    **{f"the first {size} bytes": (GOOD[:size], DAMAGED) for size in (10, 100, 1000, len(GOOD) // 2, len(GOOD) - 1)},
}


@pytest.mark.parametrize("kind", HOSTILE)
def test_a_hostile_checkpoint_is_refused_and_nothing_of_it_runs(kind: str) -> None:
    saved, reason = HOSTILE[kind]
    with pytest.raises(CheckpointError) as refused:
        load(saved)
    assert reason in str(refused.value)
    assert RAN == []


def test_a_field_that_is_newer_than_the_checkpoint_has_its_default() -> None:
    saved = of_class("coastwatch.batches.yields.Unproven", count=3)
    assert load(saved) == Unproven(3, 0.0)


def test_damage_anywhere_is_refused_or_harmless() -> None:
    for at in range(0, len(GOOD), 7):
        damaged = bytearray(GOOD)
        damaged[at] ^= 0x55
        with suppress(CheckpointError):
            load(bytes(damaged))


@dataclass
class Foreign:
    number: int


@pytest.mark.parametrize("value", [Foreign(1), {1, 2}, objects(), [Payload()], b"bytes", 1j])
def test_what_is_no_memory_is_not_saved(value: object) -> None:
    with pytest.raises((TypeError, ValueError)):
        save(value)


RECORDS = np.zeros(3, np.dtype([("mmsi", np.int64), ("class_b", np.bool_), ("lat", np.float64)]))
VALUES = [
    None,
    True,
    -(2**80),
    float("-inf"),
    5e-324,
    "ä\ud800",
    [],
    (),
    {},
    {1: "a", "b": (None, [2.5]), (3, 4): {}},
    np.float32(0.1),
    np.bool_(True),
    np.zeros((0, 4)),
    np.array(7),
    np.array(["one", "zwölf"]),
    np.array([b"x"]),
    np.asfortranarray(np.arange(6.0).reshape(2, 3)),
    np.arange(24).reshape(2, 3, 4)[:, ::2, ::-1],
    np.broadcast_to(np.nan, (5, 2)),
    RECORDS,
    NoMemory(),
    Members.empty(),
    Estimate(np.zeros((1, 3)), np.ones((1, 3)), np.ones(1, np.int64), np.full(1, 0.1)),
]


@pytest.mark.parametrize("value", VALUES, ids=lambda value: type(value).__name__)
def test_a_value_comes_back_to_the_bit(value: object) -> None:
    again = load(save(value))
    assert type(again) is type(value)
    assert save(again) == save(value)
    if isinstance(value, np.ndarray):
        assert (again.dtype, again.shape, again.tobytes()) == (value.dtype, value.shape, value.tobytes())
        assert again.flags.writeable
        assert not value.flags.f_contiguous or again.flags.f_contiguous
    elif not hasattr(value, "__dataclass_fields__") and not isinstance(value, Estimate):
        assert again == value


def test_not_a_number_comes_back() -> None:
    assert np.isnan(load(save(float("nan"))))


@pytest.fixture(scope="module")
def memory() -> bytes:
    """The memory of a run of some cycles."""
    scenario = load_scenario("context-driven-100", {"cycles": "6", "warmup_s": "0.0", "tracks.plot_origin": "estimated"})
    sensors, plan = scenario.sensors(), scenario.plan()
    recording, kept = scenario.input.load(sensors, 1, plan), start_run(scenario, sensors)
    for cycle in range(plan.cycles):
        reports = recording.reports.between(plan.instant_s(cycle - 1), plan.instant_s(cycle))
        kept, _ = run_cycle(scenario, sensors, kept, reports, plan.instant_s(cycle), serial, lambda _: nullcontext())
    return save(kept)


ROW_NUMBERS: dict[str, Callable[[Any], np.ndarray]] = {
    "KMeansMemory.spot": lambda m: m.centre.spots.spot,
    "History.slot": lambda m: m.centre.associations.history.slot,
    "History.free": lambda m: m.centre.associations.history.free,
    "History.length": lambda m: m.centre.associations.history.length,
    "VesselFilters.filter_of_track": lambda m: m.centre.fused_tracks.filter_of_track,
    "KnownTracks.vessel": lambda m: m.centre.picture.tracks.vessel,
    "KnownTracks.first_vessel": lambda m: m.centre.picture.tracks.first_vessel,
    "TrackPairs.ais": lambda m: m.centre.picture.flags.pairs.ais,
    "TrackPairs.radar": lambda m: m.centre.picture.flags.pairs.radar,
    "Table.live": lambda m: m.regions[0].tracks.table.live,
    "Table.free": lambda m: m.regions[0].tracks.table.free,
    "BearingMemory.sensor": lambda m: m.bearing_tracks.sensor,
    "Information.radar": lambda m: m.registration.information.radar,
}


@pytest.mark.parametrize("field", ROW_NUMBERS)
@pytest.mark.parametrize("number", [-2, 10**6])
def test_a_row_number_out_of_range_is_refused_with_its_field(field: str, number: int, memory: bytes) -> None:
    crafted = load(memory)
    column = ROW_NUMBERS[field](crafted)
    assert len(column)
    column[len(column) // 2] = number
    with pytest.raises(CheckpointError, match=f"it is damaged: {field}: got row numbers .*{number}.*, needed"):
        load(save(crafted))


def test_a_column_of_another_length_is_refused(memory: bytes) -> None:
    kept = load(memory)
    table = kept.regions[0].tracks.table
    narrow = replace(kept.regions[0].tracks, table=replace(table, radar_s=table.radar_s[:, :1], looked_s=table.looked_s[:, :1]))
    with pytest.raises(CheckpointError, match=r"it is damaged: Table\.radar_s: got 1 radars, needed 2"):
        load(save(narrow))
    history = kept.centre.associations.history
    for crafted in (replace(history, slot=history.slot[1:]), replace(history, length=history.length[1:])):
        with pytest.raises(CheckpointError, match=r"it is damaged: History\.(slot|length): got \d+ rows, needed \d+"):
            load(save(crafted))


def half_run(path: Path) -> None:
    def fail(cycle: object) -> None:
        seen.append(cycle)
        if len(seen) == 4:
            raise RuntimeError("mast down")

    seen: list[object] = []
    with pytest.raises(RuntimeError, match="mast down"):
        run(path, small(cycles="6", store__checkpoint_every="1"), on_cycle=fail)


UNREADABLE = {
    "a pickle": FORMAT,
    "a function": NAMES + "os.system",
    "an array of objects": DAMAGED,
}
"""Checkpoints of HOSTILE, and why a run does not resume from them."""


def test_a_run_does_not_resume_from_what_is_no_checkpoint(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "x.db"
    half_run(path)
    given = {"cycles": "6", "warmup_s": "0.0", "spots.count": "3", "store.checkpoint_every": "1"}
    words = [word for key, value in given.items() for word in ("--set", f"{key}={value}")]
    command = ["run", "context-driven-100", "--seed", "2001", "--db", url(path), *words]
    for saved, reason in (
        *((HOSTILE[kind][0], reason) for kind, reason in UNREADABLE.items()),
        (save({"cycle": 3}), "it holds a dict"),
    ):
        with closing(sqlite3.connect(path)) as raw, raw:
            raw.execute("DELETE FROM checkpoint WHERE piece > 0")
            raw.execute("UPDATE checkpoint SET memory = ?", (saved,))
        assert main([*command, "--resume"]) == 1
        (said,) = [line for line in capsys.readouterr().err.splitlines() if line.startswith("coastwatch: error: ")]
        assert said.startswith(f"coastwatch: error: run 1: its checkpoint cannot be read: {reason}")
        assert "--restart" in said
        assert RAN == []
    assert main([*command, "--restart"]) == 0


def cycles_saved(schedule: CheckpointSchedule, size: int, seconds: float, busy: tuple[int, ...] = ()) -> list[int]:
    """After which of 40 cycles a run saves, if each checkpoint has this size and takes so long. Args: busy: cycles with a busy writer."""
    found = []
    for cycle in range(40):
        if schedule.is_due(cycle, cycle not in busy):
            schedule.note(cycle, size, seconds)
            found.append(cycle)
    return found


def test_a_live_run_saves_as_often_as_clock_and_disk_allow_and_never_less_than_any_run() -> None:
    keep = StoreSettings(checkpoint_every=10, checkpoint_mb_s=32.0)
    usual = [0, 9, 19, 29, 39]
    assert cycles_saved(CheckpointSchedule(keep), 1, 0.0) == usual
    assert cycles_saved(CheckpointSchedule(keep, 3.0), 96_000_000, 0.3) == list(range(40))
    assert cycles_saved(CheckpointSchedule(keep, 3.0), 96_000_001, 0.0) == [*range(0, 9, 2), *range(9, 40, 2)]
    assert cycles_saved(CheckpointSchedule(keep, 3.0), 1, 0.85)[:5] == [0, 3, 6, 9, 12]
    assert cycles_saved(CheckpointSchedule(keep, 3.0), 2_000_000_000, 2.0) == usual
    assert cycles_saved(CheckpointSchedule(keep, 3.0), 1, 0.0, busy=(4, 5, 9)) == [k for k in range(40) if k not in (4, 5)]
