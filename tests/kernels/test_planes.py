"""Words come back bit for bit from their planes, whatever they are; rows stand along a curve; what is noise is left alone."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from coastwatch.kernels.geometry.curve import SIDE, _along, curve_order, extent
from coastwatch.kernels.tables.byte_planes import NOISE, QUIET, SAME, ZERO, join, split


def there_and_back(
    words: np.ndarray, base: np.ndarray, place: np.ndarray, based: bool
) -> tuple[np.ndarray, int, int, np.ndarray]:
    columns, rows = words.shape
    quiet, noise = np.zeros(8 * columns * max(rows, 1), np.uint8), np.zeros(8 * columns * rows, np.uint8)
    kind = np.full((columns, 8), 99, np.uint8)
    q, s = split(words, base, place, based, quiet, noise, kind)
    out = np.full_like(words, 7)
    join(quiet[:q].copy(), noise[:s].copy(), kind, base, place, based, out)
    return out, q, s, kind


@given(st.integers(0, 600), st.integers(0, 50), st.booleans(), st.integers(0, 10**6))
def test_words_come_back(rows: int, known: int, based: bool, seed: int) -> None:
    rng = np.random.default_rng([seed, 51])
    words = rng.integers(0, 2**64, (3, rows), dtype=np.uint64, endpoint=False)
    words[1] >>= np.uint64(rng.integers(0, 64))
    words[2] = np.uint64(rng.integers(0, 2**63))
    base = rng.integers(0, 2**64, (3, known), dtype=np.uint64, endpoint=False)
    place = rng.integers(-1, known, rows)
    out, *_ = there_and_back(words, base, place, based)
    assert np.array_equal(out, words)


def test_a_small_change_takes_few_bytes_and_noise_is_found() -> None:
    rng = np.random.default_rng([1, 52])
    base = np.stack([np.full(4096, 5), np.arange(4096), rng.integers(0, 2**63, 4096), rng.integers(0, 2**63, 4096)]).astype(
        np.uint64
    )
    change = np.stack([np.zeros(4096, int), np.full(4096, 3), rng.integers(-9, 9, 4096), rng.integers(-(2**15), 2**15, 4096)])
    words = base + change.astype(np.uint64)
    out, q, s, kind = there_and_back(words, base, np.arange(4096), True)
    assert np.array_equal(out, words)
    assert kind[:, 0].tolist() == [ZERO, SAME, QUIET, NOISE]
    assert kind[:, 1].tolist() == [ZERO, ZERO, ZERO, NOISE]
    assert (kind[:, 2:] == ZERO).all()
    assert (q, s) == (1 + 4096, 2 * 4096)


@pytest.mark.parametrize(("still", "as_what"), [(0.0, NOISE), (0.05, NOISE), (0.08, NOISE), (0.3, QUIET), (0.9, QUIET)])
def test_noise_of_which_little_is_zero_is_not_pressed(still: float, as_what: int) -> None:
    """As of covariances, where some vessels told nothing new."""
    rng = np.random.default_rng([1, 53])
    words = np.where(rng.random((1, 4096)) < still, 0, rng.integers(0, 256, (1, 4096))).astype(np.uint64)
    out, *_, kind = there_and_back(words, words, np.arange(4096), False)
    assert np.array_equal(out, words)
    assert kind[0].tolist() == [as_what] + [ZERO] * 7


def test_neighbours_on_the_curve_are_neighbours() -> None:
    cells = np.array([[_along(x, y) for x in range(SIDE)] for y in range(SIDE)])
    assert sorted(cells.ravel().tolist()) == list(range(SIDE * SIDE))
    way = np.empty((SIDE * SIDE, 2), int)
    way[cells.ravel()] = np.stack(np.divmod(np.arange(SIDE * SIDE), SIDE), 1)
    assert (np.abs(np.diff(way, axis=0)).sum(1) == 1).all()


@pytest.mark.parametrize("count", [0, 1, 2, 5000])
def test_the_order_has_every_row_once_and_keeps_places_together(count: int) -> None:
    rng = np.random.default_rng([count, 53])
    place = rng.uniform([-30.0, -50.0], [10.0, -40.0], (count, 2))
    place[: count // 100] = np.nan
    order = np.empty(count, np.int64)
    curve_order(place, order)
    assert sorted(order.tolist()) == list(range(count))
    step = np.hypot(*np.diff(place[order][count // 50 :], axis=0).T)
    assert count < 5000 or np.median(step) < 0.05 * np.median(np.hypot(*np.diff(place[count // 50 :], axis=0).T))


def test_the_extent_is_of_what_is_a_number() -> None:
    assert extent(np.array([[np.nan, 1.0], [2.0, 3.0], [1.0, np.nan]])) == (1.0, 1.0, 2.0, 3.0)
    assert np.isnan(extent(np.zeros((0, 2)))).all()
