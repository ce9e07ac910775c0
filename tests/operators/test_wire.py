"""Frames: whatever a page missed or asked for, it draws every vessel where the server has it."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from page import DELTA, FULL, Page

from coastwatch.operators.api.hub import Subset, Viewer
from coastwatch.operators.api.wire import HEADER, METRES, RING, Encoder, Frame
from coastwatch.server.live_picture import OWN, LivePicture
from coastwatch.store import Table

pytestmark = pytest.mark.whole

PERIOD_S, START_S = 3.0, 1.75e9
QUANTUM_M = 0.02  # of position on the wire, 1e-7 deg, for rounding there and back
CYCLES = 60


def sea(seed: int = 1, vessels: int = 80) -> Iterator[LivePicture]:
    """Pictures of vessels round the antimeridian that wander, turn, come, leave and are not seen for a while."""
    g = np.random.default_rng(seed)
    ids, next_id = np.arange(1, vessels + 1), vessels + 1
    latitude, longitude = g.uniform(59, 60, vessels), g.uniform(179.5, 180.5, vessels)
    sog, cog = g.gamma(4, 3, vessels), g.uniform(0, 360, vessels)
    for cycle in range(CYCLES):
        n = len(ids)
        turn = g.random(n) < 0.05
        cog = (cog + np.where(turn, g.normal(0, 30, n), 0.0)) % 360
        way = sog * PERIOD_S * 1852 / 3600 / 111_120
        latitude = latitude + way * np.cos(np.radians(cog)) + g.normal(0, 2, n) / 111_120
        longitude = longitude + way * np.sin(np.radians(cog)) / np.cos(np.radians(latitude))
        time_s = START_S + PERIOD_S * cycle
        found = {name: np.zeros(n) for name in OWN} | {
            "vessel_id": ids,
            "latitude_deg": latitude,
            "longitude_deg": (longitude + 180) % 360 - 180,
            "sog_kn": np.where(ids % 7 == 0, np.nan, sog),
            "cog_deg": np.where(ids % 7 == 0, np.nan, cog),
            "flags": np.where(ids % 11 == 0, 128 + 1, 0),
            "mmsi": np.full(n, -1),
            "nav_status": np.full(n, -1),
            "time_s": np.full(n, time_s),
            "updated_s": time_s - g.uniform(0, 30, n),
            "major_m": g.uniform(5, 6, n),
            "minor_m": np.where(ids % 5 == 0, np.nan, 2.0),
        }
        own = Table(OWN, tuple(found[name] for name in OWN))
        yield LivePicture(1, cycle, time_s, own, (ids % 4).astype(np.uint8), np.zeros(n, np.int64), [""], {})
        stay = g.random(n) > 0.03
        come = int(g.integers(0, 4))
        ids = np.concatenate([ids[stay], np.arange(next_id, next_id + come)])
        next_id += come
        latitude, longitude, sog, cog = (
            np.concatenate([old[stay], new])
            for old, new in zip(
                (latitude, longitude, sog, cog),
                (g.uniform(59, 60, come), g.uniform(179.5, 180.5, come), g.gamma(4, 3, come), g.uniform(0, 360, come)),
                strict=True,
            )
        )


def apart_m(a: tuple[float, float], b: tuple[float, float]) -> float:
    east = (a[1] - b[1] + 180) % 360 - 180
    return float(np.hypot(a[0] - b[0], east * np.cos(np.radians(a[0]))) * 111_120)


def assert_same(page: Page, fresh: Page) -> None:
    """Both have the same vessels with the same columns, drawn in the same place."""
    assert page.ids.tolist() == fresh.ids.tolist()
    here, there = page.positions_deg(fresh.time_s), fresh.positions_deg(fresh.time_s)
    assert max(apart_m(here[k], there[k]) for k in there) < QUANTUM_M
    for name, column in fresh.columns.items():
        if name not in ("lon", "lat"):
            assert page.columns[name][page.ids != 0].tolist() == column[fresh.ids != 0].tolist(), name


def test_a_page_that_took_every_delta_equals_a_fresh_full_frame_and_draws_within_ten_metres() -> None:
    encoder, page, sent = Encoder(7), Page(), 0
    frames: deque[Frame] = deque(maxlen=RING + 1)
    viewer = Viewer(0, 0)
    for picture in sea():
        frames.append(encoder.frame(picture))
        kind = page.take(viewer.message(frames))
        assert kind == (FULL if picture.cycle == 0 else DELTA)
        sent += page.changed if kind == DELTA else 0
        fresh = Page()
        fresh.take(frames[-1].full())
        assert_same(page, fresh)
        drawn = page.positions_deg(picture.time_s)
        true = {
            int(i): (a, o)
            for i, a, o in zip(*(picture.array(c) for c in ("vessel_id", "latitude_deg", "longitude_deg")), strict=True)
        }
        assert drawn.keys() == true.keys()
        assert max(apart_m(drawn[k], true[k]) for k in true) < METRES + QUANTUM_M
    assert page.refused == 0
    assert sent < 0.5 * CYCLES * 80  # a delta leaves out those that were foretold
    number = int(next(i for i in page.ids if i and i % 11 == 0))
    assert page.vessel(number)["flag"] == 1 | 64
    assert page.vessel(int(next(i for i in page.ids if i and i % 5 == 0)))["minor"] == 255


def with_sizes(picture: LivePicture, turned: float) -> LivePicture:
    """Every third vessel has a size by radar. Args: turned: degrees by which all have turned."""
    ids = picture.array("vessel_id")
    sizes = {
        "echo_length_m": 200.0 + ids,
        "echo_width_m": np.where(ids % 2, np.nan, 30.0),
        "echo_axis_deg": (7.0 * ids + turned) % 360,
    }
    columns = {name: picture.array(name) for name in OWN} | {
        name: np.where(ids % 3, np.nan, values) for name, values in sizes.items()
    }
    return replace(picture, own=Table(OWN, tuple(columns[name] for name in OWN)))


def test_a_page_of_version_2_has_the_sizes_by_radar_and_one_of_version_1_the_frames_of_before() -> None:
    encoder, page, former = Encoder(7), Page(), Page()
    frames: deque[Frame] = deque(maxlen=RING + 1)
    viewer, old = Viewer(0, 0, version=2), Viewer(0, 0)
    for picture in (with_sizes(p, 90.0 * (p.cycle > 20)) for p in sea()):
        frames.append(encoder.frame(picture))
        page.take(viewer.message(frames))
        former.take(old.message(frames))
        fresh = Page()
        fresh.take(frames[-1].full(2))
        assert_same(page, fresh)
        for slot, number in enumerate(page.ids.tolist()):
            if not number:
                continue
            length, width, axis = (int(page.columns[name][slot]) for name in ("length", "width", "axis"))
            assert (length == 255) == bool(number % 3)
            assert former.columns["length"][slot] == 255
            if length != 255:
                assert 2 ** (length / 16) / 2 == pytest.approx(200.0 + number, rel=0.18)
                assert (width == 255) == bool(number % 2)
                assert abs((axis * 360 / 256 - 7.0 * number - 90.0 * (picture.cycle > 20) + 180) % 360 - 180) < 6.5
    plain = Encoder(7).frame(next(with_nothing(p) for p in sea()))
    assert len(plain.full(2)) == len(plain.full())


def with_nothing(picture: LivePicture) -> LivePicture:
    """No vessel has a size by radar."""
    none = np.full(len(picture), np.nan)
    columns = {name: none if name.startswith("echo") else picture.array(name) for name in OWN}
    return replace(picture, own=Table(OWN, tuple(columns[name] for name in OWN)))


@pytest.mark.parametrize("missed", [1, 5, RING, RING + 5])
def test_a_page_that_comes_back_takes_one_merged_delta_or_a_full_frame(missed: int) -> None:
    encoder, page = Encoder(7), Page()
    frames: deque[Frame] = deque(maxlen=RING + 1)
    viewer = Viewer(0, 0)
    for number, picture in enumerate(sea()):
        frames.append(encoder.frame(picture))
        if number < 5:
            page.take(viewer.message(frames))
        if number == 4 + missed:
            break
    again = Viewer(page.run, page.seq)
    assert page.take(again.message(frames)) == (DELTA if missed <= RING else FULL)
    fresh = Page()
    fresh.take(frames[-1].full())
    assert_same(page, fresh)


def test_a_delta_of_another_run_is_refused_and_another_run_starts_with_a_full_frame() -> None:
    pictures = list(sea())[:3]
    page, frames = Page(), deque([Encoder(7).frame(pictures[0])])
    page.take(Viewer(0, 0).message(frames))
    other = Encoder(8)
    restarted = deque([other.frame(pictures[1]), other.frame(pictures[2])])
    late = Viewer(8, 1)
    page.take(late.message(restarted))
    assert page.refused == 1
    assert page.take(Viewer(7, 1).message(restarted)) == FULL


def test_a_slot_is_free_for_another_vessel_one_frame_after_it_was_left() -> None:
    encoder, before = Encoder(7), np.zeros(0, np.uint32)
    used_again = 0
    for picture in sea():
        ids = encoder.frame(picture).ids
        both = min(len(ids), len(before))
        assert not ((ids[:both] != before[:both]) & (ids[:both] != 0) & (before[:both] != 0)).any()
        used_again += int(((ids[:both] != 0) & (before[:both] == 0)).sum())
        before = ids
    assert used_again > 10


def test_a_subset_is_a_frame_of_its_vessels_and_its_deltas_follow_them_in_and_out() -> None:
    encoder, page, subset = Encoder(7), Page(), Subset(bbox=(59.0, 179.8, 60.0, -179.9), kinds=1, min_sog=3.0)
    frames: deque[Frame] = deque(maxlen=RING + 1)
    viewer, seen = Viewer(0, 0, subset), set()
    for picture in sea():
        frame = encoder.frame(picture)
        frames.append(frame)
        page.take(viewer.message(frames))
        fresh = Page()
        fresh.take(frame.full())
        wanted = {
            i for i, (_, east) in fresh.positions_deg(frame.time_s).items()
            if (east % 360) >= 179.8 and (east % 360) <= 180.1 and i % 4 % 2 and 300 <= fresh.vessel(i)["sog"] < 65535
        }  # fmt: skip
        assert {int(i) for i in page.ids if i} == wanted
        seen |= wanted
    assert page.refused == 0
    assert 10 < len(seen) < 80


def test_no_vessel_and_no_change_are_frames_too() -> None:
    first = next(sea())
    encoder, empty = Encoder(7), first.take(np.zeros(0, np.int64))
    page, frames = Page(), deque([encoder.frame(empty)])
    viewer = Viewer(0, 0)
    page.take(viewer.message(frames))
    assert len(page.ids) == 0
    frames.append(encoder.frame(first))
    page.take(viewer.message(frames))
    assert len(page.ids) == 80
    frames.append(encoder.frame(first))
    assert len(viewer.message(frames)) == HEADER.size
    assert page.take(frames[-1].heartbeat()) == 5
