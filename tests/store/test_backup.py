"""Copies taken while a run writes, brought back elsewhere; and what is old, deleted at once."""

from __future__ import annotations

import resource
import threading
from pathlib import Path
from types import SimpleNamespace

import pytest
import store_world as world
from sqlalchemy import text

from coastwatch import store as kept
from coastwatch.errors import StoreError
from coastwatch.operators.cli import main
from coastwatch.scenario import StoreSettings
from coastwatch.store import Store
from coastwatch.store.schema import opening
from coastwatch.store.schema.database import reading, writing
from coastwatch.store.schema.migrate import check

pytestmark = pytest.mark.contract

DAY_S = 86_400.0


def test_a_copy_that_is_taken_while_a_run_writes_has_whole_cycles_and_is_restored(tmp_path: Path) -> None:
    path, copy, back = tmp_path / "live.db", tmp_path / "copy.db", tmp_path / "back.db"
    done, begun = threading.Event(), threading.Event()
    with kept.open_store(str(path)) as store:
        run = world.begin(store)

        def write() -> None:
            number = 0
            while not done.is_set():
                world.write(store, run, number, 300)
                number += 1
                if number == 3:
                    begun.set()

        writer = threading.Thread(target=write)
        writer.start()
        try:
            assert begun.wait(30.0)
            with kept.open_store(str(path), create=False) as other:
                kept.backup(other, copy)
                with pytest.raises(FileExistsError, match="is there already"):
                    kept.backup(other, copy)
        finally:
            done.set()
            writer.join()
        cycles = kept.run(store, run)["cycles_stored"]
    assert check(str(copy)) == []
    kept.restore(copy, str(back))
    assert check(str(back)) == []
    with kept.open_store(str(back), create=False) as store:
        stored = kept.run(store, run)["cycles_stored"]
        assert 3 <= stored < cycles
        assert len(kept.picture(store, run).rows) == len(world.picture_of(stored - 1, 300).vessel_id)
        world.write(store, run, stored, 300)
    with pytest.raises(FileExistsError, match="is there already"):
        kept.restore(copy, str(back))
    assert [found.name for found in tmp_path.iterdir() if found.name.endswith(".part")] == []


def test_a_copy_without_room_is_named_and_nothing_of_it_is_left(tmp_path: Path) -> None:
    with kept.open_store(str(tmp_path / "x.db")) as store:
        run = world.begin(store)
        for number in range(3):
            world.write(store, run, number)
        before = resource.getrlimit(resource.RLIMIT_FSIZE)
        resource.setrlimit(resource.RLIMIT_FSIZE, (50_000, before[1]))
        try:
            with pytest.raises(
                StoreError, match=r"^(disk full|file cannot grow|cannot be written): \S+/copy\.db: .*; no copy is left$"
            ):
                kept.backup(store, tmp_path / "copy.db")
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert list(tmp_path.glob("copy*")) == []


def test_damage_is_not_restored(tmp_path: Path) -> None:
    path, copy = tmp_path / "x.db", tmp_path / "copy.db"
    with kept.open_store(str(path)) as store:
        run = world.begin(store)
        for number in range(3):
            world.write(store, run, number)
        kept.backup(store, copy)
    whole = copy.read_bytes()
    middle = len(whole) // 2
    copy.write_bytes(whole[:middle] + bytes(40_000) + whole[middle + 40_000 :])
    with pytest.raises(StoreError, match="damaged"):
        kept.restore(copy, str(tmp_path / "back.db"))
    assert not (tmp_path / "back.db").exists()


def test_copies_in_a_folder_are_named_by_their_time_and_the_oldest_go(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, folder = tmp_path / "watch.db", tmp_path / "copies"
    folder.mkdir()
    with kept.open_store(str(path)) as store:
        world.begin(store)
    for name in ("watch-20250101T000000Z.db", "watch-20250102T000000Z.db", "other-20250101T000000Z.db"):
        (folder / name).write_text("")
    assert main(["db", "backup", str(folder), "--db", str(path), "--keep", "2"]) == 0
    names = sorted(found.name for found in folder.iterdir())
    assert names[:2] == ["other-20250101T000000Z.db", "watch-20250102T000000Z.db"]
    assert len(names) == 3
    assert check(str(folder / names[2])) == []
    assert "deleted" in capsys.readouterr().out


def count(store: Store, query: str) -> int:
    with reading(store) as connection:
        return int(connection.execute(text(query)).scalar_one())


def test_what_is_old_goes_and_the_rest_is_whole(url: str) -> None:
    keep = StoreSettings(recording=True, history_max_s=21.0)
    with kept.open_store(url) as store:
        old, run = world.begin(store), world.begin(store)
        for number in range(30):
            world.write(store, old if number < 2 else run, number if number < 2 else number - 2, keep=keep)
        kept.finish_run(store, old, "finished")
        kept.note_change(store, kept.Change(0.0, "ana", "operator", "::1", "POST", "/api/v1/x", 200, "{}"))
        assert kept.prune(store, DAY_S).runs == []
        assert count(store, "SELECT count(*) FROM cycle") == 30
        done = kept.prune(store, 10 * world.PERIOD_S, ["recording"])
        assert (done.runs, done.rows) == ([], {"recording": 17})
        with writing(store) as connection:
            connection.execute(text(f"UPDATE run SET finished_utc = '2020-01-01T00:00:00Z' WHERE id = {old}"))
        done = kept.prune(store, DAY_S)
        assert (done.runs, sum(done.rows.values())) == ([old], 0)
        done = kept.prune(store, 10 * world.PERIOD_S)
        assert done.rows["history"] > 0
        assert done.rows["details"] > 0
        assert count(store, "SELECT min(number) FROM cycle WHERE history_from IS NOT NULL") == 17
        assert count(store, "SELECT min(cycle) FROM association") == 17
        assert len(kept.picture(store, run, world.instant_s(17)).rows) == len(world.picture_of(17, 30).vessel_id)
        with pytest.raises(StoreError, match="its first kept cycle is at"):
            kept.picture(store, run, world.instant_s(16))
        world.write(store, run, 28, keep=keep)
        assert kept.changes(store, 9)[1] == 1
        assert kept.prune(store, DAY_S, ["audit"]).rows == {"audit": 1}
    assert check(url) == []


def test_a_copy_leaves_room_for_the_database_beside_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, copy = tmp_path / "watch.db", tmp_path / "copy.db"
    with kept.open_store(str(path)) as store:
        world.write(store, world.begin(store), 0)
        free = opening.RESERVE_BYTES
        monkeypatch.setattr(opening.shutil, "disk_usage", lambda _: SimpleNamespace(free=free))
        with pytest.raises(
            StoreError, match=r"disk full: .*copy.db: 100.0 MB free in .* MB that stay for the database; no copy"
        ):
            kept.backup(store, copy)
        assert list(tmp_path.glob("copy*")) == []
        free += 50_000_000
        assert kept.backup(store, copy) > 0
