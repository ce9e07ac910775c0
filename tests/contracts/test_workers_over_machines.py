"""Work over machines: windows that are kept by those who need them, spots that change hands, a machine that is lost."""

import os
import pickle
import sys
import time
import warnings
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from test_associations import crowd

from coastwatch.associations import WindowedCovariance
from coastwatch.kernels.tables.subset import cut, rows_of
from coastwatch.spots import KMeansSpots
from coastwatch.stage import CUT, Groups, in_turn
from coastwatch.workers.owners import UNEVEN, owners
from coastwatch.workers.windows import Holder, Part

WINDOW = 5
EACH = {"num_cpus": 1, "object_store_memory": 80 * 2**20}  # node of the cluster
PATIENCE_S = 40.0  # until a lost actor has been noticed and replaced


def of_windows(settings, arrays, spots):
    """Work for the test: for each member something of its window and of its neighbours' in the group, in an order of rows."""
    rank, ring, chain, length = (arrays[name] for name in ("rank", "ring", "chain", "length"))

    def window(place):
        older = [ring[-1 - age][chain[place, age - 1]] for age in range(1, length[place])]
        return np.sum([ring[-1][place], *older], axis=0) * settings

    row, value = [], []
    for k in range(len(spots)):
        every = spots.of(k)
        places = rank[np.where(every >= 0, every, -1 - every)]
        neighbours = sum(window(p)[0] for p in places[np.argsort(arrays["row"][places])])
        for place in places[every >= 0]:
            row.append(arrays["row"][place])
            value.append(window(place)[1] + neighbours + arrays["state"][place].sum())
    return np.array(row, np.int64), np.array(value)


class Sea:
    """Tracks that come and go, ranked anew in each cycle, with their windows, and spots with a halo."""

    def __init__(self, seed, count=120, spots=7):
        self.rng, self.spots, self.next_id = np.random.default_rng([seed, 0]), spots, count
        self.ids, self.before, self.ring = np.arange(count), {}, ()

    def cycle(self):
        rng = self.rng
        alive = self.ids[rng.random(len(self.ids)) > 0.05]
        self.ids = np.concatenate([alive, np.arange(self.next_id, self.next_id + rng.integers(0, 12))])
        self.next_id += 12
        n = len(self.ids)
        row = rng.permutation(n).astype(np.int32)  # of each rank
        rank = np.empty(n, np.int32)
        rank[row] = np.arange(n)
        chain, length = np.zeros((n, WINDOW - 1), np.int32), np.ones(n, np.int32)
        now = {}
        for place, r in enumerate(row):
            places = [place, *self.before.get(self.ids[r], [])][:WINDOW]
            now[self.ids[r]], length[place] = places, len(places)
            chain[place, : len(places) - 1] = places[1:]
        self.before = now
        self.ring = (*self.ring, rng.normal(0.0, 1.0, (n, 3)))[-WINDOW:]
        state = rng.normal(0.0, 1.0, (n, 2, 3)).astype(np.float32)
        arrays = {"rank": rank, "row": row, "state": state, "ring": self.ring, "chain": chain, "length": length}
        spot = self.ids % self.spots
        groups = [np.concatenate([np.flatnonzero(spot == k), -1 - rng.choice(n, 4, replace=False)]) for k in range(self.spots)]
        groups = [rows[(rows >= 0) | ~np.isin(-1 - rows, rows)] for rows in groups]
        start = np.cumsum([0, *(len(rows) for rows in groups)])
        return {**arrays, "unlike": np.ones(3)}, Groups(np.concatenate(groups), start)


def in_order(parts):
    row, value = (np.concatenate([part[k] for part in parts]) for k in range(2))
    order = np.argsort(row)
    return row[order].tobytes(), value[order].tobytes()


@given(st.integers(0, 10**6), st.integers(1, 3))
def test_holders_of_windows_give_what_the_coordinator_would(seed, hands):
    sea, rng = Sea(seed), np.random.default_rng([seed, 1])
    holders, given_ = [(Part(), Holder()) for _ in range(hands)], []
    owner = rng.integers(0, hands, sea.spots)
    for cycle in range(14):
        arrays, spots = sea.cycle()
        if cycle % 3 == 2:
            owner[rng.integers(sea.spots)] = rng.integers(hands)
        if cycle == 7:
            holders[0] = Part(), Holder()  # lost, and another one in its place
        if cycle == 10:
            continue  # a cycle done elsewhere
        parts = []
        for k, (part, holder) in enumerate(holders):
            sent = part.cut(arrays, spots.take(np.flatnonzero(owner == k)))
            given_.append(len(sent.given))
            assert "unlike" not in sent.arrays
            parts.append(holder.work(of_windows, 1.5, sent))
        assert in_order(parts) == in_order(in_turn(of_windows, 1.5, arrays, spots))
    assert 0 in given_ or hands > 1


def test_a_cycle_brings_one_entry_of_each_track_and_windows_only_to_who_lacks_them():
    sea, part = Sea(3), Part()
    sent = []
    for _ in range(6):
        arrays, spots = sea.cycle()
        sent.append(part.cut(arrays, spots))
    assert [s.anew for s in sent] == [True] + 5 * [False]
    assert all(len(s.given) == 0 and len(s.entry) == len(s.before) for s in sent)
    arrays, spots = sea.cycle()
    few = part.cut(arrays, spots.take([2]))
    assert len(few.entry) < len(arrays["rank"]) / 3
    arrays, spots = sea.cycle()
    more = part.cut(arrays, spots.take([2, 4]))
    assert 0 < len(more.given) < len(more.entry)


class Held:
    """A Spread over holders of windows, here."""

    def __init__(self, hands):
        self.holders, self.given = [(Part(), Holder()) for _ in range(hands)], []

    def __call__(self, work, settings, arrays, spots):
        if not set(CUT) <= set(arrays):
            pytest.skip("arrays of the association cannot be cut")
        parts = []
        for k, (part, holder) in enumerate(self.holders):
            sent = part.cut(arrays, spots.take(np.arange(k, len(spots), len(self.holders))))
            self.given.append(len(sent.given) / max(len(sent.entry), 1))
            parts.append(holder.work(work, settings, pickle.loads(pickle.dumps(sent))))
        return parts


def test_the_association_is_the_same_where_windows_are_held():
    water, method, spots = crowd(5, n=600, regions=2), WindowedCovariance(), KMeansSpots(count=9)
    spread, memories, spot_memory = Held(3), [method.init(), method.init()], spots.init()
    for cycle in range(25):
        tracks = water.tracks(cycle)
        tracks = tracks.take(np.random.default_rng([5, cycle]).random(len(tracks)) > 0.02)
        spot_memory, grouped = spots.step(spot_memory, tracks)
        memories[0], alone = method.step(memories[0], tracks, grouped, in_turn)
        memories[1], held = method.step(memories[1], tracks, grouped, spread)
        for field in fields(alone):
            one, other = getattr(alone, field.name), getattr(held, field.name)
            assert np.asarray(one).tobytes() == np.asarray(other).tobytes(), field.name
    assert len(alone.first) > 200
    assert 0.0 < np.mean(spread.given[9:]) < 0.3


@given(st.integers(0, 10**6), st.integers(0, 30), st.sampled_from([np.float64, np.int32, np.int8, np.bool_]))
def test_cut_rows(seed, count, dtype):
    rng = np.random.default_rng([seed, 0])
    array, rank = rng.integers(0, 2, (30, 3)).astype(dtype), rng.permutation(30).astype(np.int32)
    rows = rng.integers(0, 30, count)
    np.testing.assert_array_equal(rows_of(array, rows), array[rows])
    np.testing.assert_array_equal(rows_of(array[:, 0], rows), array[rows, 0])
    halo = rng.random(count) < 0.5
    ranks, place = cut(np.where(halo, -1 - rows, rows), rank)
    np.testing.assert_array_equal(ranks, np.unique(rank[rows]))
    assert (place[ranks] == np.arange(len(ranks))).all()
    assert (place >= 0).sum() == len(ranks)


@given(st.integers(0, 10**6), st.integers(1, 60), st.integers(1, 5))
def test_groups_change_hands_only_when_loads_are_uneven(seed, count, hands):
    rng = np.random.default_rng([seed, 0])
    expected, numbers = rng.lognormal(0.0, 1.0, count), 10 + np.arange(hands)
    first = owners(np.full(count, -1), expected, numbers, None)
    assert np.isin(first, numbers).all()
    loads = np.array([expected[first == hand].sum() for hand in numbers])
    assert loads.max() <= loads.mean() + expected.max()
    again = owners(first, expected * rng.uniform(0.99, 1.01, count), numbers, None)
    if loads.max() <= 1.07 * loads.mean():
        np.testing.assert_array_equal(again, first)
    drifted = expected * np.where(first == numbers[0], 1.5, 1.0)
    moved = owners(first, drifted, numbers, None)
    loads, before = (np.array([drifted[of == hand].sum() for hand in numbers]) for of in (moved, first))
    assert loads.max() <= before.max() + 1e-12
    assert loads.max() <= UNEVEN * loads.mean() or loads.max() - loads.min() <= 2.0 * drifted.max()
    left = owners(first, expected, numbers[: max(hands - 1, 1)], None)
    assert np.isin(left, numbers[: max(hands - 1, 1)]).all()


@pytest.fixture(scope="module")
def two_machines():
    """A Ray cluster of two nodes with a processor each; the coordinator is at the first."""
    pytest.importorskip("ray", reason="Ray is not installed")
    import ray
    from ray.cluster_utils import Cluster

    with pytest.MonkeyPatch.context() as patch, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        patch.setenv("PYTHONPATH", os.pathsep.join([str(Path(__file__).parent), *sys.path]))  # where actors find the work
        cluster = Cluster(initialize_head=True, head_node_args={"include_dashboard": False, **EACH})
        other = cluster.add_node(**EACH)
        ray.init(address=cluster.address, log_to_driver=False, logging_level="ERROR")
        try:
            yield cluster, other
        finally:
            ray.shutdown()
            cluster.shutdown()


@pytest.mark.slow
def test_a_machine_that_is_killed_costs_a_cycle_and_changes_no_bit(two_machines):
    import ray

    from coastwatch.workers.ray import Actors

    cluster, other = two_machines
    sea, hands = Sea(8, count=600, spots=12), []
    with Actors(2) as actors:
        places = [node for node, _ in ray.get([hand.actor.joined.remote() for hand in actors._hands])]
        assert len(set(places)) == 2
        assert sorted(hand.here for hand in actors._hands) == [False, True]
        for cycle in range(500):
            arrays, spots = sea.cycle()
            if cycle == 5:
                cluster.remove_node(other, allow_graceful=False)
            found = actors(of_windows, 1.5, arrays, spots)
            assert in_order(found) == in_order(in_turn(of_windows, 1.5, arrays, spots))
            hands.append(len(actors._at_hand()))
            if hands[-5:] == 5 * [1]:
                break
        assert hands[:5] == 5 * [2]
        assert hands[-5:] == 5 * [1]
        ray.kill(actors._at_hand()[0].actor)
        deadline, hands = time.monotonic() + PATIENCE_S, []
        while hands[-1:] != [1] or 0 not in hands:
            arrays, spots = sea.cycle()
            assert in_order(actors(of_windows, 1.5, arrays, spots)) == in_order(in_turn(of_windows, 1.5, arrays, spots))
            hands.append(len(actors._at_hand()))
            assert time.monotonic() < deadline
        with pytest.raises(KeyError, match="nothing"):
            actors(raising, 1.5, arrays, spots)


def raising(settings, arrays, spots):
    return (arrays["nothing"],)
