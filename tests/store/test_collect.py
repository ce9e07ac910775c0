"""Rows as arrays: the same by the compiled aggregate as by tuples, whatever is in them; what is told beside a picture as well."""

from __future__ import annotations

from typing import Any

import numba  # noqa: F401 - the compiled way is taken only where numba is loaded
import numpy as np
import past_world
import pytest
import store_world as world
from sqlalchemy import insert, select, text

from coastwatch import store as kept
from coastwatch.store import Store, boxed, collect, told
from coastwatch.store.opening import reading, writing
from coastwatch.store.tables import VesselStatic

S = VesselStatic
QUERY = select(S.mmsi, S.name, S.call_sign, S.ship_type, S.length_m, S.updated_s).where(S.run_id == 1)


def named(store: Store, count: int, name: str = "SHIP") -> None:
    """Static data with holes in it."""
    rows = [
        {
            "run_id": 1,
            "mmsi": k + 1,
            "name": None if k % 3 == 0 else f"{name} {k}",
            "call_sign": "" if k % 4 == 0 else f"C{k}",
            "ship_type": None if k % 5 == 0 else k,
            "length_m": None if k % 7 == 0 else k / 7.0,
            "updated_s": 1.75e9 + k / 3.0,
        }
        for k in range(count)
    ]
    with writing(store) as connection:
        connection.execute(insert(VesselStatic), rows)


def same(one: list[Any], two: list[Any]) -> bool:
    return all(
        a.dtype.kind == b.dtype.kind and (a.tolist() == b.tolist() or np.array_equal(a, b, equal_nan=True))
        for a, b in zip(one, two, strict=True)
    )


@pytest.mark.parametrize("most", [500, 3, 0])
def test_arrays_are_what_tuples_are(url: str, most: int, monkeypatch: pytest.MonkeyPatch) -> None:
    with kept.open_store(url) as store:
        world.begin(store)
        named(store, 500)
        with reading(store) as connection:
            native = collect.collected(connection, QUERY, most)
            monkeypatch.setattr(collect, "_state", lambda connection: None)
            usual = collect.collected(connection, QUERY, most)
            assert ("collect" in connection.info) == (connection.dialect.name == "sqlite")
        order = [np.argsort(columns[0]) for columns in (native, usual)]
        assert same([c[order[0]] for c in native], [c[order[1]] for c in usual])
        assert [c.dtype.kind for c in native] == ["i", "S", "S", "i", "f", "f"]
        assert (native[3][order[0]][0], native[1][order[0]][0]) == (-1, b"")
        assert np.isnan(native[4][order[0]][0])


def test_a_text_that_is_longer_than_its_column_is_not_cut(url: str) -> None:
    """Neither database of ours would hold one that long but SQLite."""
    name = "A" * 60 if url.startswith("sqlite") else "A"
    with kept.open_store(url) as store:
        world.begin(store)
        named(store, 5, name)
        with reading(store) as connection:
            found = collect.collected(connection, QUERY, 10)
        assert sorted(found[1].tolist()) == sorted([b"", f"{name} 1".encode(), f"{name} 2".encode(), b"", f"{name} 4".encode()])


def test_no_rows(url: str) -> None:
    with kept.open_store(url) as store, reading(store) as connection:
        assert [len(column) for column in collect.collected(connection, QUERY, 10)] == [0] * 6


def test_the_aggregate_is_of_one_connection_and_not_for_views(tmp_path: Any) -> None:
    with kept.open_store(str(tmp_path / "x.db")) as store:
        world.begin(store)
        named(store, 40)
        with reading(store) as one, reading(store) as two:
            assert len(collect.collected(one, QUERY, 10)[0]) == len(collect.collected(two, QUERY, 100)[0]) == 40
        with writing(store) as connection:
            collect.collected(connection, QUERY, 10)
            connection.execute(text("CREATE VIEW spy AS SELECT coastwatch_collect(mmsi) FROM vessel_static"))
            with pytest.raises(Exception, match="unsafe use"):
                connection.execute(text("SELECT * FROM spy")).all()


@pytest.mark.parametrize("at", [None, 7, 19])
def test_what_is_told_of_many_is_what_is_told_of_few(url: str, at: int | None, monkeypatch: pytest.MonkeyPatch) -> None:
    """Names, stays and sources are asked for by name, or read as a whole; by compiled code, or without it."""
    with kept.open_store(url) as store:
        run = world.begin(store)
        past_world.write(store, run, past_world.pictures(15, 20))
        when = None if at is None else world.instant_s(at)
        few = kept.picture(store, run, when)
        assert {len(row) for row in few.rows} == {len(few.columns)}
        assert any(few.column("name"))
        monkeypatch.setattr(told, "FEW", 3)
        assert kept.picture(store, run, when) == few
        for module in (told, collect):
            monkeypatch.setattr(module, "loaded", lambda: False)
        monkeypatch.setattr("coastwatch.store.pictures.loaded", lambda: False)
        monkeypatch.setattr(boxed, "MOST", 0)
        assert kept.picture(store, run, when) == few
        assert kept.picture(store, run, when, columns=("sources", "vessel_id")).columns == ("sources", "vessel_id")
        with pytest.raises(kept.StoreError, match="columns: got colour, needed some of vessel_id"):
            kept.picture(store, run, when, columns=("colour",))
