"""Encounters against all pairs of pieces; the newest rows against sorting."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from coastwatch.kernels.geometry.encounters import FROM, TO, closest, encounters, slot_entries
from coastwatch.kernels.tables.latest_per_id import SPREAD, newest_rows

NORTH, EAST = 111_000.0, 71_000.0
SPAN_S = 300.0


def sailing(seed: int, vessels: int) -> tuple[np.ndarray, np.ndarray]:
    """Pieces of vessels that turn now and then, and their vessels."""
    rng = np.random.default_rng([seed, 91])
    pieces, vessel = [], []
    for k in range(vessels):
        place, begun = np.array([50.0, 1.0]) + rng.normal(0.0, 0.01, 2), 0.0
        fast = rng.uniform(2.0, 15.0) if k % 3 else 0.0
        while begun < SPAN_S:
            course, lasts = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(5.0, 150.0)
            rate = fast * np.array([np.cos(course) / NORTH, np.sin(course) / EAST])
            pieces.append([begun, min(begun + lasts, SPAN_S), *place, *rate, NORTH, EAST])
            vessel.append(k)
            place, begun = place + rate * lasts, begun + lasts
    return np.array(pieces).reshape(-1, 8), np.array(vessel, np.int64)


@given(st.integers(0, 10**6), st.integers(0, 25), st.sampled_from([5.0, 20.0, 400.0]), st.sampled_from([50.0, 500.0]))
def test_encounters_are_all_that_there_are(seed: int, vessels: int, slot: float, within: float) -> None:
    pieces, vessel = sailing(seed, vessels)
    moves = np.hypot(pieces[:, 4] * NORTH, pieces[:, 5] * EAST) > 1.0
    first, piece = slot_entries(pieces, 0.0, slot)
    out, both = np.empty((200_000, 2)), np.empty((200_000, 2), np.int64)
    count = encounters(pieces, vessel, moves, first, piece, 0.0, slot, within, EAST, out, both)
    found: dict[tuple[int, int], float] = {}
    for (metres, _), (a, b) in zip(out[:count], both[:count], strict=True):
        pair = tuple(sorted((int(vessel[a]), int(vessel[b]))))
        found[pair] = min(found.get(pair, np.inf), metres)
    wanted: dict[tuple[int, int], float] = {}
    for a in range(len(pieces)):
        for b in range(a):
            since, until = max(pieces[a, FROM], pieces[b, FROM]), min(pieces[a, TO], pieces[b, TO])
            if vessel[a] != vessel[b] and (moves[a] or moves[b]) and since <= until:
                metres, _ = closest(pieces[a], pieces[b], since, until)
                if metres <= within:
                    pair = tuple(sorted((int(vessel[a]), int(vessel[b]))))
                    wanted[pair] = min(wanted.get(pair, np.inf), metres)
    assert found.keys() == wanted.keys()
    assert all(found[pair] == pytest.approx(wanted[pair], abs=1e-5) for pair in wanted)


def test_the_closest_approach_of_a_crossing() -> None:
    """One goes north at 10 m/s, the other east at 10 m/s from 1 km west and 200 m north: 800 / sqrt(2) m after 60 s."""
    one = np.array([0.0, 600.0, 50.0, 1.0, 10.0 / NORTH, 0.0, NORTH, EAST])
    two = np.array([0.0, 600.0, 50.0 + 200.0 / NORTH, 1.0 - 1000.0 / EAST, 0.0, 10.0 / EAST, NORTH, EAST])
    metres, time_s = closest(one, two, 0.0, 600.0)
    assert metres == pytest.approx(800.0 / np.sqrt(2.0), rel=1e-6)
    assert time_s == pytest.approx(60.0)
    assert closest(one, two, 0.0, 30.0)[1] == 30.0


def test_more_encounters_than_room_are_counted() -> None:
    pieces, vessel = sailing(1, 25)
    first, piece = slot_entries(pieces, 0.0, 20.0)
    moves = np.ones(len(pieces), bool)
    counts = []
    for room in (3, 100_000):
        out, both = np.full((room, 2), -1.0), np.full((room, 2), -1)
        counts.append(encounters(pieces, vessel, moves, first, piece, 0.0, 20.0, 500.0, EAST, out, both))
        assert (out[: min(counts[-1], room)] >= 0.0).all()
    assert counts[0] == counts[1] > 3


@given(st.lists(st.tuples(st.integers(0, 20), st.integers(0, 5)), max_size=60), st.sampled_from([1, 10**9]))
def test_the_newest_row_of_each_number(rows: list[tuple[int, int]], apart: int) -> None:
    rows = [(number * apart, when) for number, when in rows]
    number, when = (np.array([row[k] for row in rows], np.int64) for k in range(2))
    out = np.empty(len(rows), np.int64)
    count = newest_rows(number, when, out)
    wanted = {n: max((w, row) for row, (other, w) in enumerate(rows) if other == n)[1] for n, _ in rows}
    assert {int(number[row]): int(row) for row in out[:count]} == wanted
    came = list(dict.fromkeys(number.tolist()))
    close = not rows or max(came) - min(came) < SPREAD * len(rows)
    assert (sorted(came) if close else came) == number[out[:count]].tolist()
