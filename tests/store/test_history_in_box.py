"""The past of a box: the same as from looking at everything."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import past_world
import pytest
import store_world as world
from past_world import BOXES, KEEP
from sqlalchemy import text

from coastwatch import store as kept
from coastwatch.errors import StoreError
from coastwatch.geodesy import difference_m, offset_deg
from coastwatch.store import Store
from coastwatch.store.bbox import inside, widened
from coastwatch.store.history_rule import dead_reckon
from coastwatch.store.read import picture_queries
from coastwatch.store.read.history_queries import points_in_box
from coastwatch.store.schema.database import reading
from coastwatch.store.schema.migrate import check

pytestmark = pytest.mark.contract

CYCLES = 40
EDGE_M = 0.01
"""A vessel so near the edge may be on either side, for the rounding of a straight line against the box."""

STEP_M = 6.0
"""What two vessels come nearer to each other in a fifth of a second, at 30 m/s."""

NAMES = ("vessel_id", "latitude_deg", "longitude_deg", "sog_kn", "cog_deg", "mmsi", "flags", "time_s", "major_m")


def filled(url: str, seed: int, jumps: float = 0.0, vessels: int = 60) -> tuple[Store, int]:
    store = kept.open_store(url)
    run = world.begin(store)
    past_world.write(store, run, past_world.pictures(seed, CYCLES, vessels, jumps))
    return store, run


def test_points_of_a_box_are_those_of_the_history(url: str) -> None:
    store, run = filled(url, 1)
    names = ("cycle", "vessel_id", "latitude_deg", "longitude_deg", "closing")
    shown = 0
    with store, reading(store) as connection:
        for bbox in (*BOXES, (-90.0, -180.0, 90.0, 180.0)):
            for first, last in ((0, CYCLES - 1), (17, 31), (CYCLES - 4, CYCLES - 1)):
                found = points_in_box(connection, run, first, last, bbox, names)
                every = text(f"SELECT {', '.join(names)} FROM history WHERE cycle BETWEEN {first} AND {last}")
                true = [row for row in connection.execute(every) if inside(np.array([row[2:4]]), bbox)[0]]
                assert sorted(zip(*(found[name].tolist() for name in names), strict=True)) == sorted(map(tuple, true))
                shown += len(true)
    assert shown > 100


def test_a_picture_in_a_box_is_part_of_the_whole_one(url: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also where vessels jump: one whose newest point is elsewhere is not shown where it was before."""
    store, run = filled(url, 3, jumps=0.05)
    shown = {picture_queries.FEW: 0, 5: 0}  # most vessels of which one is asked for after the other
    with store:
        for number in range(0, CYCLES, 7):
            whole = kept.picture(store, run, world.instant_s(number), columns=NAMES)
            place = np.stack([whole.array("latitude_deg"), whole.array("longitude_deg")], 1)
            for bbox in BOXES:
                wanted = [row for row, here in zip(whole.rows, inside(place, bbox), strict=True) if here]
                for most in shown:
                    monkeypatch.setattr(picture_queries, "FEW", most)
                    found = kept.picture(store, run, world.instant_s(number), bbox, NAMES)
                    assert found.rows == wanted
                    shown[most] += len(found)
    assert min(shown.values()) > 50


def test_traffic_is_what_pictures_show(url: str) -> None:
    store, run = filled(url, 4)
    with store:
        pictures = [kept.picture(store, run, world.instant_s(number)) for number in range(CYCLES)]
        for bbox in BOXES:
            for first, last in ((10, 30), (33, 33), (0, CYCLES - 1)):
                span = world.instant_s(first), world.instant_s(last)
                found = kept.traffic(store, run, bbox, *span)
                for number in range(first, last + 1):
                    _seen_in(found, pictures[number], bbox, world.instant_s(number))
                assert all(_was_in(dict(zip(found.columns, row, strict=True)), bbox, span) for row in found.rows)
        assert len(kept.traffic(store, run, BOXES[-1], world.START_S, world.instant_s(CYCLES))) == 0
        late = kept.traffic(store, run, BOXES[0], world.START_S, world.instant_s(CYCLES) + 1e6)
        assert late.array("to_s").max() == world.instant_s(CYCLES - 1)  # nobody saw what came after
        with pytest.raises(StoreError, match="holds nothing up to then"):
            kept.traffic(store, run, BOXES[0], 0.0, world.START_S - 100.0)


def _seen_in(traffic: kept.Table, picture: kept.Table, bbox: Any, time_s: float) -> None:
    """Every vessel well inside the box has a point from which it was there."""
    place = np.stack([picture.array("latitude_deg"), picture.array("longitude_deg")], 1)
    well_inside = inside(place, widened(bbox, -EDGE_M))
    there = (traffic.array("time_s") <= time_s) & (traffic.array("to_s") >= time_s)
    assert set(picture.array("vessel_id")[well_inside].tolist()) <= set(traffic.array("vessel_id")[there].tolist())


def _was_in(row: dict[str, Any], bbox: Any, span: tuple[float, float]) -> bool:
    """Whether the vessel was about there at some tenth of a second."""
    when = np.arange(max(row["time_s"], span[0]), min(row["to_s"], span[1]) + 0.05, 0.1)
    place = np.broadcast_to([row["latitude_deg"], row["longitude_deg"]], (len(when), 2))
    moved = moved_on(place, row, when - row["time_s"])
    return bool(inside(moved, widened(bbox, 3.0)).any())


def moved_on(place: np.ndarray, row: dict[str, Any], seconds: np.ndarray) -> np.ndarray:
    n = len(place)
    sog = np.full(n, np.nan if row["sog_kn"] is None else row["sog_kn"])
    cog = np.full(n, np.nan if row["cog_deg"] is None else row["cog_deg"])
    return dead_reckon(place, sog, cog, seconds)


def test_encounters_are_those_of_all_pairs(tmp_path: Path) -> None:
    """Against the distances of every two vessels every fifth of a second, from the traffic of the box."""
    store, run = filled(str(tmp_path / "x.db"), 5, vessels=200)
    met = 0
    with store:
        for bbox in (widened(BOXES[0], 2000.0), widened(BOXES[1], 2000.0)):
            span = world.instant_s(12), world.instant_s(26)
            found = kept.encounters(store, run, bbox, *span, within_m=300.0, min_sog_kn=2.0, count=10_000)
            pairs = {(row[0], row[1]): row[2] for row in found.rows}
            true = _closest(kept.traffic(store, run, widened(bbox, 2000.0), *span), bbox, span, 2.0)
            sure = {pair for pair, metres in true.items() if metres < 300.0 - STEP_M}
            assert sure <= pairs.keys() <= {pair for pair, metres in true.items() if metres < 300.0 + STEP_M}
            assert all(abs(pairs[pair] - true[pair]) < STEP_M for pair in sure)
            assert [row[2] for row in found.rows] == sorted(row[2] for row in found.rows)
            mmsi = {int(v): m for v, m in zip(*(found.column(name) for name in ("first_id", "first_mmsi")), strict=True)}
            assert all(m == (710_000_000 + v - 1 if v % 2 == 0 else None) for v, m in mmsi.items())
            met += len(pairs)
            few = kept.encounters(store, run, bbox, *span, within_m=300.0, min_sog_kn=2.0, count=3)
            assert few.rows == found.rows[:3]
    assert met > 8


def test_encounters_say_for_how_long_a_vessel_was_not_heard(tmp_path: Path) -> None:
    """Of two that pass each other in cycle 20 the second is not heard after cycle 5: its position there is predicted."""
    north_m, made = np.arange(CYCLES) - 20.0, []
    for number in range(CYCLES):
        place = offset_deg(
            np.tile(past_world.PLACES[0], (2, 1)), 10.0 * np.array([[5.0, north_m[number]], [0.0, -north_m[number]]])
        )
        velocity = np.array([[0.0, 10.0], [0.0, -10.0]]) / world.PERIOD_S
        picture = past_world.picture(np.arange(2), place, velocity, world.instant_s(number))
        made.append(replace(picture, updated_s=np.array([world.instant_s(number), world.instant_s(min(number, 5))])))
    with kept.open_store(str(tmp_path / "x.db")) as store:
        run = world.begin(store)
        past_world.write(store, run, made)
        found = kept.encounters(store, run, widened(BOXES[0], 2000.0), world.instant_s(0), world.instant_s(CYCLES - 1))
    (row,) = (dict(zip(found.columns, row, strict=True)) for row in found.rows)
    assert (row["first_id"], row["second_id"]) == (1, 2)
    assert abs(row["time_s"] - world.instant_s(20)) < 0.1
    assert (row["first_silent_s"], round(row["second_silent_s"], 3)) == (0.0, round(row["time_s"] - world.instant_s(5), 3))


def _closest(traffic: kept.Table, bbox: Any, span: tuple[float, float], min_sog: float) -> dict[tuple[int, int], float]:
    """Metres of the closest approach of each pair while both are in the box and one makes some speed."""
    out: dict[tuple[int, int], float] = {}
    rows = [dict(zip(traffic.columns, row, strict=True)) for row in traffic.rows]
    for when in np.append(np.arange(span[0], span[1], 0.2), span[1]):
        now = [row for row in rows if row["time_s"] <= when <= row["to_s"]]
        if not now:
            continue
        place = np.array([[row["latitude_deg"], row["longitude_deg"]] for row in now])
        sog, cog = (np.array([np.nan if row[name] is None else row[name] for row in now]) for name in ("sog_kn", "cog_deg"))
        place = dead_reckon(place, sog, cog, when - np.array([row["time_s"] for row in now]))
        metres = np.hypot(*np.moveaxis(difference_m(place[:, None], place[None]), -1, 0))
        here = inside(place, bbox)
        valid = here[:, None] & here[None] & ((sog[:, None] >= min_sog) | (sog[None] >= min_sog))
        for a, b in zip(*np.nonzero(valid & (metres < 320.0)), strict=True):
            one, two = now[a]["vessel_id"], now[b]["vessel_id"]
            if one < two:
                out[one, two] = min(out.get((one, two), np.inf), float(metres[a, b]))
    return out


def test_what_is_deleted_is_not_in_boxes_either(tmp_path: Path) -> None:
    url = str(tmp_path / "x.db")
    keep = KEEP.model_copy(update={"history_hours": 15 * world.PERIOD_S / 3600.0})
    with kept.open_store(url) as store:
        run = world.begin(store)
        past_world.write(store, run, past_world.pictures(6, CYCLES), keep=keep)
        with reading(store) as connection:
            first = connection.execute(text("SELECT min(cycle) FROM history")).scalar_one()
        assert 0 < first < CYCLES - 15
        for bbox in BOXES:
            whole = kept.picture(store, run, world.instant_s(30), columns=NAMES)
            place = np.stack([whole.array("latitude_deg"), whole.array("longitude_deg")], 1)
            found = kept.picture(store, run, world.instant_s(30), bbox, NAMES)
            assert found.rows == [row for row, here in zip(whole.rows, inside(place, bbox), strict=True) if here]
    assert check(url) == []
