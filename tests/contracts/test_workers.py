"""Spreading work over threads or processes gives what one processor gives, bit for bit."""

import os
import signal
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from coastwatch.kernels.tables.dealing import deal
from coastwatch.kernels.threads import blocks
from coastwatch.stage import Groups, in_turn, room_of
from coastwatch.workers import processors, spread_over
from coastwatch.workers.blocks import Attached, Blocks, Ground, new_block
from coastwatch.workers.costs import Costs, along, chunks
from coastwatch.workers.processes import Processes


def squares(settings, arrays, spots):
    """Work for the test: something of the rows, something of the settings, results of uneven length."""
    value = arrays["value"][spots.row] * settings
    return spots.row[value > 0.0], value[value > 0.0]


def of_a_ring(settings, arrays, spots):
    """Work that reads a tuple of arrays."""
    return spots.row, sum(entry[spots.row] for entry in arrays["ring"])


def refuse_to_write(settings, arrays, spots):
    arrays["value"][0] = 1.0
    return (spots.row,)


def spun_out(settings, arrays, spots):
    """Work whose results take longer to read than to make."""
    return np.repeat(spots.row, settings), np.repeat(arrays["value"][spots.row], settings)


def mapped(settings, arrays, spots):
    """Work that says which of the blocks that `settings` names the process that it runs in has in its memory."""
    maps = Path("/proc/self/maps").read_text()
    return (np.repeat([[name in maps for name in settings]], len(spots), 0),)


def die_where_told(settings, arrays, spots):
    """Work that kills the process that it runs in, once, but never the one that `settings` names."""
    where, parent = settings
    if os.getpid() != parent and 17 in spots.row:
        Path(where).write_text(Path(where).read_text() + "died\n")
        os.kill(os.getpid(), signal.SIGKILL)
    return (spots.row, arrays["value"][spots.row])


@pytest.fixture(scope="module")
def pool():
    with Processes(2) as spread:
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


def same(work, settings, arrays, spots, pool):
    here, there = in_order(in_turn(work, settings, arrays, spots)), in_order(pool(work, settings, arrays, spots))
    assert all(x.tobytes() == y.tobytes() and x.dtype == y.dtype for x, y in zip(here, there, strict=True))
    return len(here[0])


@pytest.mark.parametrize("count", [0, 1, 2, 7, 40])
def test_same_results(pool, count):
    for seed in (1, 2, 1):
        assert same(squares, 1.5, *problem(seed, count), pool) > 100 or count < 7


def test_blocks_grow_with_the_arrays_and_rooms_with_the_results(pool):
    for size in (10, 3_000_000, 20):
        value = np.arange(size, dtype=float) + 1.0
        assert same(squares, 1.0, {"value": value}, groups(np.arange(size), [size // 2, size - size // 2]), pool) == size


def test_what_a_process_finds_is_read_while_it_is_at_its_next_chunk(pool):
    value, spots = np.arange(40.0), groups(np.arange(40), [5] * 8)
    for _ in range(4):
        assert same(spun_out, 20_000, {"value": value}, spots, pool) == 800_000


def test_a_ring_is_laid_once_and_read_for_cycles(pool):
    rng = np.random.default_rng([4, 0])
    ring = tuple(rng.normal(0.0, 1.0, 1000) for _ in range(5))
    for _ in range(8):
        assert same(of_a_ring, None, {"ring": ring}, groups(np.arange(1000), [10, 500, 490]), pool) == 1000
        ring = (*ring[1:], rng.normal(0.0, 1.0, 1000 + rng.integers(0, 300)))


def test_what_is_the_object_of_the_last_cycle_is_not_copied_again():
    ground = Ground()
    kept, blocks_, seen = np.arange(100.0), Blocks(ground), Attached(related=True)
    first = blocks_.publish({"kept": kept, "ring": (np.ones(3), np.ones(70))})
    arrays = seen.arrays(first)
    assert (arrays["kept"] == kept).all()
    assert not arrays["kept"].flags.writeable
    del arrays
    kept[0] = 7.0  # which nobody may do; it shows that the block was left as it was
    second = blocks_.publish({"kept": kept, "ring": (np.zeros(2), np.zeros(50))})
    arrays = seen.arrays(second)
    assert second["kept"] == first["kept"]
    assert arrays["kept"][0] == 0.0
    assert {p.block for p in second["ring"]} == {p.block for p in first["ring"]}
    assert [len(entry) for entry in arrays["ring"]] == [2, 50]
    del arrays
    seen.keep([])
    blocks_.close()
    ground.close()


def test_what_is_made_in_a_room_is_not_copied_and_lives_as_long_as_anybody_has_it(pool):
    ground = Ground()
    room = room_of(pool)((7, 3), np.int32)
    assert (room.shape, room.dtype) == ((7, 3), np.int32)
    assert room_of(in_turn) is np.empty
    made = ground.room(1000)
    made[:] = np.arange(1000.0)
    part, blocks_, seen = made[100:].reshape(300, 3), Blocks(ground), Attached(related=True)
    del made
    places = blocks_.publish({"part": part})
    assert places["part"].offset == 800
    part[0, 0] = -1.0  # before anybody reads it; it shows that both are one
    assert (seen.arrays(places)["part"] == part).all()
    other = ground.room(1000)
    assert not np.shares_memory(other, part)
    block = places["part"].block
    del part
    assert blocks_.publish({"copied": np.zeros(900)})["copied"].block == block
    seen.keep([])
    left = ground.room(5)
    left[:] = 1.0
    blocks_.close()
    ground.close()
    assert left.sum() == 5.0
    with pytest.raises(FileNotFoundError):
        seen.block(block)


@pytest.mark.skipif(not Path("/proc/self/maps").exists(), reason="asks the system what a process has in its memory")
def test_a_process_keeps_a_block_in_its_memory_for_as_long_as_there_is_one():
    spots = groups(np.arange(40), [5] * 8)
    with Processes(2) as pool:
        first, other = pool.room(5000), pool.room(6000)
        blocks_ = [pool._ground.place(array).block for array in (first, other)]

        def has(array):
            parts = pool(mapped, blocks_, {"value": array}, spots)
            return np.concatenate([part[0] for part in parts]).min(axis=0).tolist()

        assert has(first)[0]
        assert has(other) == [True, True]
        assert has(np.arange(3.0)) == [True, True]
        del first
        assert not has(pool.room(100_000))[0]  # in place of the block that fell free
        assert has(other)[1]


def test_more_than_the_machine_has_is_refused_with_how_much_that_is():
    with pytest.raises(OSError, match=r"shared memory: got \d+ bytes in /dev/shm, needed \d+; .*workers.method = threads"):
        new_block(1 << 45)


def test_shared_arrays_are_read_only_and_what_work_raises_is_raised_here(pool):
    arrays, spots = problem(3, 4)
    with pytest.raises(ValueError, match="read-only"):
        pool(refuse_to_write, 1.0, arrays, spots)
    assert same(squares, 1.0, arrays, spots, pool) > 0


def test_a_lost_process_is_made_good_and_replaced(pool, tmp_path):
    deaths = tmp_path / "deaths"
    deaths.write_text("")
    value, spots = np.arange(40.0), groups(np.arange(40), [5] * 8)
    assert same(die_where_told, (str(deaths), os.getpid()), {"value": value}, spots, pool) == 40
    assert deaths.read_text() == "died\n"
    for hand in pool._hands:
        os.kill(hand.process.pid, signal.SIGKILL)
        hand.process.join()
    for _ in range(2):
        assert same(squares, 1.5, *problem(1, 7), pool) > 100


def test_one_processor_is_this_process_and_threads_leave_the_chunk_whole():
    for method, count in (("processes", 1), ("threads", 2), ("auto", 2), ("auto", 0)):
        with spread_over(method, count) as spread:
            assert spread is in_turn
            assert len(blocks(10**6, 1)) == (1 if processors(count) == 1 else 4 * processors(count))
    with spread_over("processes", 2) as spread:
        assert isinstance(spread, Processes)
        assert same(squares, 1.5, *problem(1, 7), spread) > 100
    assert len(blocks(10**6, 1)) == 1
    with pytest.raises(ValueError, match="needed at least 2"):
        Processes(1)


@given(st.lists(st.integers(0, 1000), max_size=60), st.integers(1, 9))
def test_every_spot_is_dealt_once_and_no_chunk_is_far_above_its_share(costs, parts):
    part = deal(np.array(costs, float), parts)
    loads = np.bincount(part, costs, parts)
    assert ((part >= 0) & (part < parts)).all()
    assert loads.max() <= sum(costs) / parts + max(costs, default=0)


@given(st.lists(st.integers(0, 1000), min_size=1, max_size=60), st.integers(1, 9))
def test_chunks_hold_every_group_once_and_the_costliest_comes_first(sizes, count):
    expected = Costs().expected(groups(np.zeros(sum(sizes), np.int64), sizes))
    part, dealt = chunks(expected, count, None)
    assert sorted(np.concatenate(dealt).tolist()) == list(range(len(sizes)))
    assert all((part[chunk] == k).all() and len(chunk) for k, chunk in enumerate(dealt))
    loads = [expected[chunk].sum() for chunk in dealt]
    assert loads == sorted(loads, reverse=True)


@given(st.lists(st.floats(0.01, 1.0), min_size=1, max_size=60), st.integers(1, 9), st.randoms())
def test_chunks_of_neighbours_are_in_order_and_about_as_costly(costs, count, random):
    expected, order = np.array(costs), np.array(random.sample(range(len(costs)), len(costs)))
    part, dealt = chunks(expected, count, order)
    assert sorted(np.concatenate(dealt).tolist()) == list(range(len(costs)))
    assert all((part[chunk] == k).all() and len(chunk) for k, chunk in enumerate(dealt))
    assert np.count_nonzero(np.diff(part[order])) == len(dealt) - 1
    assert max(expected[chunk].sum() for chunk in dealt) <= expected.sum() / min(count, len(costs)) + expected.max() + 1e-9


def test_groups_along_an_axis():
    rank, point = np.array([2, 0, 1, 3]), np.array([[0.0, 5.0, 1.0], [1.0, -7.0, 1.0], [0.0, 9.0, 1.0], [0.0, 0.0, 0.0]])
    spots = groups(np.array([0, 1, -3, 2, 3]), [1, 0, 2, 1, 1, 0])  # at 9, (5), 5, -7, 0
    order = along({"rank": rank, "point": point}, spots)
    assert [k for k in order if np.diff(spots.start)[k]] == [3, 4, 2, 0]
    assert along({"rank": rank}, spots) is None


@pytest.mark.parametrize("order", [None, np.arange(200)], ids=["dealt", "neighbours"])
def test_measured_costs_even_out_the_chunks(order):
    rng = np.random.default_rng([8, 0])
    sizes, rate = rng.integers(50, 400, 200), rng.lognormal(0.0, 1.0, 200) * 1e-6
    spots, costs = groups(np.zeros(sizes.sum(), np.int64), sizes), Costs()
    worst = []
    for _ in range(60):
        expected = costs.expected(spots)
        part = chunks(expected, 8, order)[0]
        seconds = np.bincount(part, rate * sizes)
        costs.learn(expected, part, seconds)
        worst.append(seconds.max() / seconds.mean())
    assert np.mean(worst[-10:]) < 1.0 + 0.5 * (worst[0] - 1.0)
    assert expected.sum() == pytest.approx(seconds.sum(), rel=0.1)
    assert (costs.expected(groups(np.zeros(3, np.int64), [1, 2])) == [1.0, 2.0]).all()
