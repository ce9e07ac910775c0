"""Spreading work over processes gives what one process gives, bit for bit."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from coastwatch.stage import Groups, in_turn
from coastwatch.workers import spread_over
from coastwatch.workers.processes import Processes, deal


def squares(settings, arrays, spots):
    """Work for the test: something of the rows, something of the settings, results of uneven length."""
    value = arrays["value"][spots.row] * settings
    return spots.row[value > 0.0], value[value > 0.0]


def refuse_to_write(settings, arrays, spots):
    arrays["value"][0] = 1.0
    return (spots.row,)


@pytest.fixture(scope="module")
def pool():
    with spread_over(2) as spread:
        yield spread


def problem(seed, count):
    rng = np.random.default_rng([seed, 0])
    value = rng.normal(0.0, 1.0, 5000)
    size = rng.integers(0, 400, count)
    return {"value": value, "other": rng.integers(0, 9, (3, 7))}, groups(rng.integers(0, 5000, size.sum()), size)


def groups(rows, size):
    return Groups(rows, np.concatenate([[0], np.cumsum(size)]).astype(np.int64))


def in_order(parts):
    """Rows and what was said of them, in an order that does not depend on the chunks."""
    row, value = (np.concatenate(column) for column in zip(*parts, strict=True))
    order = np.lexsort((value, row))
    return row[order], value[order]


@pytest.mark.parametrize("count", [0, 1, 2, 7, 40])
def test_same_results(pool, count):
    for seed in (1, 2):
        arrays, spots = problem(seed, count)
        here, there = in_order(in_turn(squares, 1.5, arrays, spots)), in_order(pool(squares, 1.5, arrays, spots))
        assert all(x.tobytes() == y.tobytes() and x.dtype == y.dtype for x, y in zip(here, there, strict=True))
        assert count < 7 or len(here[0]) > 100


def test_the_block_grows_with_the_arrays(pool):
    for size in (10, 3_000_000, 20):
        value = np.arange(size, dtype=float) + 1.0
        got = in_order(pool(squares, 1.0, {"value": value}, groups(np.arange(10), [5, 5])))
        np.testing.assert_array_equal(got[1], value[:10])


def test_shared_arrays_are_read_only(pool):
    arrays, spots = problem(3, 4)
    with pytest.raises(ValueError, match="read-only"):
        pool(refuse_to_write, 1.0, arrays, spots)


def test_one_worker_is_this_process():
    with spread_over(1) as spread:
        assert spread is in_turn
    with pytest.raises(ValueError, match="needed at least 2"):
        Processes(1)


@given(st.lists(st.integers(0, 1000), max_size=60), st.integers(1, 9))
def test_every_spot_is_dealt_once_and_no_chunk_is_far_above_its_share(costs, parts):
    lists = deal(costs, parts)
    assert sorted(k for part in lists for k in part) == list(range(len(costs)))
    loads = [sum(costs[k] for k in part) for part in lists]
    if costs:
        assert max(loads) <= sum(costs) / min(parts, len(costs)) + max(costs)
