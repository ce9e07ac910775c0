"""Purity, switches of identity, longest time under one."""

from __future__ import annotations

from collections import Counter, defaultdict
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scores_world import ints

from coastwatch.scores.purity import Identities
from coastwatch.server.checkpoint import load, save

pytestmark = pytest.mark.oracle


def over(cycles):
    """The sums over cycles, each a list of (identity, origin)."""
    out = Identities.empty()
    for rows in cycles:
        out = out.seen(ints(*(r[0] for r in rows)), ints(*(r[1] for r in rows)))
    return out.as_dict()


def slowly(cycles):
    pairs, seen = defaultdict(Counter), defaultdict(list)
    for rows in cycles:
        now = defaultdict(set)
        for identity, origin in rows:
            pairs[identity][origin] += 1
            if origin >= 0:
                now[origin].add(identity)
        for origin, ids in now.items():
            seen[origin].append(ids)
    total = sum(sum(c.values()) for c in pairs.values())
    most = sum(max((n for o, n in c.items() if o >= 0), default=0) for c in pairs.values())
    switches = sum(not a & b for times in seen.values() for a, b in pairwise(times))
    shares = []
    for times in seen.values():
        longest = 0
        for identity in set().union(*times):
            run = 0
            for ids in times:
                run = run + 1 if identity in ids else 0
                longest = max(longest, run)
        shares.append(longest / len(times))
    return {
        "purity": most / total if total else None,
        "id_switches": switches,
        "longest_single_id": sum(shares) / len(shares) if shares else None,
    }


def test_a_steady_vessel():
    assert over([[(1, 7)]] * 5) == {"purity": 1.0, "id_switches": 0, "longest_single_id": 1.0}


def test_a_new_identity_is_a_switch():
    got = over([[(1, 7)], [(1, 7)], [(2, 7)], [(2, 7)], [(2, 7)]])
    assert got == {"purity": 1.0, "id_switches": 1, "longest_single_id": pytest.approx(3 / 5)}


def test_an_identity_that_changes_vessel_is_impure():
    got = over([[(1, 7), (2, 8)], [(1, 8), (2, 7)], [(1, 8), (2, 7)]])
    assert got == {"purity": pytest.approx(4 / 6), "id_switches": 2, "longest_single_id": pytest.approx(2 / 3)}


def test_a_gap_and_a_duplicate_break_nothing():
    got = over([[(1, 7), (2, 7)], [], [(2, 7), (3, -1)], [(2, 7)]])
    assert got == {"purity": pytest.approx(4 / 5), "id_switches": 0, "longest_single_id": 1.0}


def test_nothing():
    assert over([]) == over([[]]) == {"purity": None, "id_switches": 0, "longest_single_id": None}
    assert over([[(1, -1)]])["longest_single_id"] is None


rows = st.lists(st.tuples(st.integers(0, 5), st.integers(-1, 3)), max_size=6, unique_by=lambda r: r[0])


@given(st.lists(rows, max_size=8))
def test_as_one_by_one(cycles):
    got, want = over(cycles), slowly(cycles)
    assert got == {k: v if v is None else pytest.approx(v) for k, v in want.items()}


def test_sums_are_plain_data():
    one = Identities.empty().seen(ints(1, 2), ints(7, 8))
    again = load(save(one)).seen(ints(2, 1), ints(8, 9))
    assert again.as_dict() == one.seen(ints(2, 1), ints(8, 9)).as_dict()
    np.testing.assert_array_equal(one.vessel, [7, 8])
