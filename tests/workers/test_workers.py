"""Mapping work over threads or processes gives what one processor gives."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, strategies as st

from coastwatch.batches import TrackReports, Tracks
from coastwatch.batches.plain_data import TreeError, classes_in, from_tree, to_tree
from coastwatch.kernels.threads import blocks
from coastwatch.stage import Groups, serial
from coastwatch.workers import ThreadedRegions, open_workers, processors
from coastwatch.workers.costs import Costs, deal
from coastwatch.workers.processes import Processes
from coastwatch.workers.remote_regions import RemoteRegions
from coastwatch.workers.shared_memory import Publisher, Reader, receive, send

pytestmark = pytest.mark.contract


def squares(settings, arrays, spots):
    """Work for the test: something of the rows, something of the settings, results of uneven length."""
    value = arrays["value"][spots.row] * settings
    return spots.row[value > 0.0], value[value > 0.0]


def of_a_tuple(settings, arrays, spots):
    """Work that reads a tuple of arrays."""
    return spots.row, sum(entry[spots.row] for entry in arrays["parts"])


def refuse_to_write(settings, arrays, spots):
    arrays["value"][0] = 1.0
    return (spots.row,)


def spun_out(settings, arrays, spots):
    """Work whose results take longer to read than to make."""
    return np.repeat(spots.row, settings), np.repeat(arrays["value"][spots.row], settings)


def die_where_told(settings, arrays, spots):
    """Work that kills the process that it runs in, once, but never the one that `settings` names."""
    where, parent = settings
    if os.getpid() != parent and 17 in spots.row:
        Path(where).write_text(Path(where).read_text() + "died\n")
        os.kill(os.getpid(), signal.SIGKILL)
    return (spots.row, arrays["value"][spots.row])


@pytest.fixture(scope="module")
def pool():
    with Processes(2) as made:
        yield made


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
    here, there = in_order(serial(work, settings, arrays, spots)), in_order(pool(work, settings, arrays, spots))
    assert all(x.tobytes() == y.tobytes() and x.dtype == y.dtype for x, y in zip(here, there, strict=True))
    return len(here[0])


@pytest.mark.parametrize("count", [0, 1, 2, 7, 40])
def test_same_results(pool, count):
    for seed in (1, 2, 1):
        assert same(squares, 1.5, *problem(seed, count), pool) > 100 or count < 7


def test_shared_memory_grows_with_the_arrays(pool):
    for size in (10, 3_000_000, 20):
        value = np.arange(size, dtype=float) + 1.0
        assert same(squares, 1.0, {"value": value}, groups(np.arange(size), [size // 2, size - size // 2]), pool) == size


def test_large_results_and_tuples_of_arrays(pool):
    value, spots = np.arange(40.0), groups(np.arange(40), [5] * 8)
    assert same(spun_out, 20_000, {"value": value}, spots, pool) == 800_000
    parts = tuple(np.random.default_rng([4, k]).normal(0.0, 1.0, 1000) for k in range(5))
    assert same(of_a_tuple, None, {"parts": parts}, groups(np.arange(1000), [10, 500, 490]), pool) == 1000


def test_more_than_the_machine_has_is_refused_with_how_much_that_is(monkeypatch):
    monkeypatch.setattr("shutil.disk_usage", lambda path: SimpleNamespace(free=1000))
    with pytest.raises(OSError, match=r"shared memory: got 1000 bytes in /dev/shm, needed \d+; .*workers.method = threads"):
        Publisher().publish({"value": np.zeros(1000)})


RECORDS = np.zeros(3, np.dtype([("mmsi", np.int64), ("class_b", np.bool_), ("lat", np.float64)]))
VALUE = {
    "parts": (np.arange(5.0), RECORDS),
    "strided": np.arange(24).reshape(2, 3, 4)[:, ::2, ::-1],
    "fortran": np.asfortranarray(np.arange(6.0).reshape(2, 3)),
    "empty": np.zeros((0, 4)),
    "names": np.array(["one", "zwölf"]),
}


def test_arrays_go_through_shared_memory_to_the_bit():
    publisher, reader = Publisher(), Reader()
    for size in (10, 100_000, 3):
        given = {**VALUE, "sized": np.arange(float(size))}
        views = reader.views(publisher.publish(given))
        assert views.keys() == given.keys()
        for name, array in given.items():
            for one, view in zip(*(v if isinstance(v, tuple) else (v,) for v in (array, views[name])), strict=True):
                assert (view.dtype, view.shape) == (one.dtype, one.shape)
                assert view.tobytes() == one.tobytes()
        del one, view, views
    publisher.close()
    publisher.close()


def test_plain_data_goes_through_shared_memory_and_is_not_shared_afterwards():
    publisher, reader = Publisher(), Reader()
    for count in (0, 3, 2000, 5):
        batch = TrackReports.join([TrackReports.empty()] + [reports(k) for k in range(count)])
        value = (batch, np.arange(3), 2.5, ("north", None), {"k": [np.float64(1.0)]})
        got, *rest = receive(send(value, publisher), reader)
        send((np.full(10_000, np.nan),), publisher)  # the next value overwrites the memory
        assert isinstance(got, TrackReports)
        assert got.time_s.tolist() == list(range(count))
        assert rest[0].tolist() == [0, 1, 2]
        assert rest[1:] == list(value[2:])
        got.time_s[:] = 0.0
    with pytest.raises(TypeError, match=r"got a types.SimpleNamespace, needed .* or a declared dataclass"):
        send(SimpleNamespace(), publisher)
    tree, arrays = to_tree(batch, classes_in(TrackReports))
    with pytest.raises(TreeError, match=r"names the class coastwatch.batches.reports.TrackReports"):
        from_tree(tree, arrays, classes_in(Tracks))
    publisher.close()


def reports(time_s):
    """One state of a track."""
    one = np.array([time_s])
    at, covariance = np.zeros((1, 2)), np.zeros((1, 4, 4))
    return TrackReports(one, one, one.astype(float), one.astype(float), at, at, covariance, one)


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
    assert deaths.read_text().startswith("died\n")
    assert pool.lost == 1
    for _ in range(2):
        assert same(squares, 1.5, *problem(1, 7), pool) > 100


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_processes_end_when_their_parent_is_killed():
    code = (
        "import os, time; from coastwatch.workers.processes import new_pool; pool = new_pool(1); "
        "print(pool.submit(os.getpid).result(), flush=True); time.sleep(600)"
    )
    parent = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    child = Path(f"/proc/{int(parent.stdout.readline())}/stat")
    assert alive(child)
    parent.kill()
    parent.communicate()
    until = time.monotonic() + 60.0
    while alive(child):
        assert time.monotonic() < until
        time.sleep(0.05)


def alive(stat):
    """Whether a process is there, and not only waits to be reaped."""
    try:
        return stat.read_text("utf-8").rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


def test_one_processor_is_this_process_and_threads_leave_the_chunk_whole():
    for method, count in (("processes", 1), ("threads", 2), ("auto", 2), ("auto", 0)):
        with open_workers(method, count) as workers:
            assert workers.spots is serial
            assert isinstance(workers.regions, ThreadedRegions)
            assert len(blocks(10**6, 1)) == (1 if processors(count) == 1 else 4 * processors(count))
    with open_workers("processes", 2) as workers:
        assert isinstance(workers.spots, Processes)
        assert workers.spots.count == 2  # they begin with the first work: test_same_results
        assert isinstance(workers.regions, RemoteRegions)
    assert len(blocks(10**6, 1)) == 1
    with pytest.raises(ValueError, match="needed at least 2"):
        Processes(1)


@given(st.lists(st.integers(0, 1000), max_size=60), st.integers(1, 9))
def test_every_spot_is_dealt_once_and_no_chunk_is_far_above_its_share(costs, parts):
    dealt = deal(np.array(costs, float), parts)
    assert sorted(k for chunk in dealt for k in chunk.tolist()) == list(range(len(costs)))
    loads = [np.array(costs)[chunk].sum() for chunk in dealt]
    assert all(len(chunk) for chunk in dealt)
    assert loads == sorted(loads, reverse=True)
    assert max(loads, default=0) <= sum(costs) / parts + max(costs, default=0)


def test_measured_costs_even_out_the_chunks():
    rng = np.random.default_rng([8, 0])
    sizes, rate = rng.integers(50, 400, 200), rng.lognormal(0.0, 1.0, 200) * 1e-6
    spots, costs = groups(np.zeros(sizes.sum(), np.int64), sizes), Costs()
    worst = []
    for _ in range(60):
        expected = costs.expected(spots)
        dealt = deal(expected, 8)
        seconds = np.array([(rate * sizes)[chunk].sum() for chunk in dealt])
        costs.learn(expected, dealt, seconds)
        worst.append(seconds.max() / seconds.mean())
    assert np.mean(worst[-10:]) < 1.0 + 0.5 * (worst[0] - 1.0)
    assert expected.sum() == pytest.approx(seconds.sum(), rel=0.1)
    assert (costs.expected(groups(np.zeros(3, np.int64), [1, 2])) == [1.0, 2.0]).all()


def test_groups_taken_and_by_key():
    made = Groups.by_key(np.array([2, 0, 2, 3]), 4)
    assert [made.of(k).tolist() for k in range(4)] == [[1], [], [0, 2], [3]]
    some = made.take([2, 1, 3])
    assert (some.row.tolist(), some.start.tolist()) == ([0, 2, 3], [0, 2, 2, 3])
    assert len(made.take([])) == 0
