"""Counting of decisions."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scores_world import AIS, KINDS, OTHER_RADAR, RADAR, bearing_tracks, ints, joined, picture, tracks

from coastwatch.batches import BearingAssociations
from coastwatch.scores.confusion import Confusion, association, bearing_association, count_decisions

pytestmark = pytest.mark.oracle


def decided(source, origin, vessel):
    return association(tracks(source, origin), joined(vessel), KINDS)


@pytest.mark.parametrize(
    ("source", "origin", "vessel", "counts"),
    [
        ([RADAR, AIS], [7, 7], [0, 0], (1, 0, 0, 0)),  # right
        ([RADAR, AIS], [7, 7], [0, 1], (0, 1, 0, 0)),  # missed
        ([RADAR, AIS], [7, 8], [0, 0], (0, 0, 1, 0)),  # wrong, none exists
        ([RADAR, AIS], [7, 8], [0, 1], (0, 0, 0, 1)),  # none exists, none chosen
        ([RADAR, AIS, AIS], [7, 7, 8], [0, 1, 0], (0, 1, 1, 0)),  # a swap counts twice
        ([RADAR, RADAR, AIS, AIS], [7, 8, 7, 8], [0, 1, 1, 0], (0, 2, 2, 0)),  # a pair of swaps
        ([RADAR, OTHER_RADAR, AIS], [7, 7, 7], [0, 0, 0], (2, 0, 0, 0)),  # two regions, each a decision
        ([RADAR, RADAR, AIS], [7, 7, 7], [0, 1, 0], (1, 1, 0, 0)),  # a duplicate is a decision too
        ([RADAR, AIS], [-1, 7], [0, 1], (0, 0, 0, 1)),  # clutter has no partner
        ([RADAR, AIS], [-1, 7], [0, 0], (0, 0, 1, 0)),
        ([RADAR, AIS], [-1, -1], [0, 0], (0, 0, 1, 0)),  # nobody and nobody are not the same
        ([RADAR, OTHER_RADAR], [7, 7], [0, 0], (0, 0, 0, 2)),  # radars alone decide for no AIS
        ([AIS], [7], [0], (0, 0, 0, 0)),  # AIS decides nothing
        ([RADAR, AIS, AIS], [7, 7, 9], [0, 0, 0], (1, 0, 1, 0)),  # the right one and a wrong one
        ([], [], [], (0, 0, 0, 0)),
    ],
)
def test_decisions_by_hand(source, origin, vessel, counts):
    got = decided(source, origin, vessel)
    assert (got.tp, got.fn, got.fp, got.tn) == counts


def slowly(source, origin, vessel):
    tp = fn = fp = tn = 0
    ais = [i for i, s in enumerate(source) if s == AIS]
    for i in (i for i, s in enumerate(source) if s != AIS):
        exists = origin[i] >= 0 and any(origin[j] == origin[i] for j in ais)
        chosen = [j for j in ais if vessel[j] == vessel[i]]
        right = exists and any(origin[j] == origin[i] for j in chosen)
        wrong = any(not exists or origin[j] != origin[i] for j in chosen)
        tp, fn, fp = tp + right, fn + (exists and not right), fp + wrong
        tn += not exists and not chosen
    return Confusion(tp, fn, fp, tn)


@given(st.lists(st.tuples(st.integers(0, 2), st.integers(-1, 4), st.integers(0, 4)), max_size=12))
def test_decisions_as_one_by_one(rows):
    source, origin = [r[0] for r in rows], [r[1] for r in rows]
    vessel = np.unique([r[2] for r in rows], return_inverse=True)[1] if rows else []
    assert decided(source, origin, vessel) == slowly(source, origin, list(vessel))


def test_figures():
    got = Confusion(tp=6, fn=1, fp=2, tn=3).as_dict()
    assert got["accuracy"] == pytest.approx(9 / 12)
    assert got["precision"] == pytest.approx(6 / 8)
    assert got["recall"] == pytest.approx(6 / 7)
    assert got["f1"] == pytest.approx(12 / 15)
    assert got["specificity"] == pytest.approx(3 / 5)
    assert got["mcc"] == pytest.approx((18 - 2) / np.sqrt(8 * 7 * 5 * 4))


def test_nothing_over_nothing_is_zero():
    figures = Confusion().as_dict()
    assert set(figures.values()) == {0}
    assert Confusion(tp=3).as_dict()["mcc"] == 0.0
    assert Confusion(tp=10**6, tn=10**6).as_dict()["mcc"] == pytest.approx(1.0)  # no overflow


def test_sums():
    assert Confusion(1, 2, 3, 4) + Confusion(10, 20, 30, 40) == Confusion(11, 22, 33, 44)
    flags = np.array([True, True, False, False])
    assert count_decisions(flags, flags, ~flags) == Confusion(tp=2, fn=0, fp=2, tn=0)


@pytest.mark.parametrize(
    ("heard", "there", "pairs", "counts"),
    [
        ([5], [5], [(0, 0)], (1, 0, 0, 0)),
        ([5], [5], [], (0, 1, 0, 0)),
        ([5], [5, 6], [(0, 1)], (0, 1, 1, 0)),
        ([5], [6], [(0, 0)], (0, 0, 1, 0)),
        ([5], [6], [], (0, 0, 0, 1)),
        ([-1], [-1], [(0, 0)], (0, 0, 1, 0)),
        ([5, 6, 7], [7, 6, -1], [(0, 2), (1, 1)], (1, 1, 1, 0)),
    ],
)
def test_bearing_decisions_by_hand(heard, there, pairs, counts):
    bearing, vessel = (ints(*(p[k] for p in pairs)) for k in (0, 1))
    chosen = BearingAssociations(bearing, vessel, np.zeros(len(pairs)), np.zeros(1))
    got = bearing_association(bearing_tracks(heard), picture(there), chosen)
    assert (got.tp, got.fn, got.fp, got.tn) == counts
