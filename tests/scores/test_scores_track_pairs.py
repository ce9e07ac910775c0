"""Scores of pairs of tracks, OSPA(2) and the interval of a mean over runs, against calculations by hand."""

import numpy as np
import pytest

from coastwatch.batches import Associations, Tracks, Truth
from coastwatch.geodesy import offset_deg
from coastwatch.scores.ospa import ospa2
from coastwatch.scores.track_pairs import PairScores, TruePairs

pytestmark = pytest.mark.oracle

KINDS = np.array([0, 1], np.int64)
LOST_M = 100.0
ORIGIN = np.array([60.0, 5.0])


def tracks(source, origin, east_m):
    n = len(source)
    where = offset_deg(np.broadcast_to(ORIGIN, (n, 2)), np.column_stack([east_m, np.zeros(n)]))
    zero, ids = np.zeros(n), np.arange(n)
    return Tracks(ids, np.array(source), zero, where, np.zeros((n, 2)), np.tile(np.eye(4), (n, 1, 1)), np.tile(np.eye(2), (n, 1, 1)),
                  zero, zero, np.where(np.array(source) == 1, ids, -1), np.array(origin))  # fmt: skip


def truth(vessel, east_m):
    n = len(vessel)
    where = offset_deg(np.broadcast_to(ORIGIN, (n, 2)), np.column_stack([east_m, np.zeros(n)]))
    return Truth(np.array(vessel, np.int64), np.zeros(n), where, np.zeros((n, 2)))


def pairs(t, *chosen):
    first, second = (np.array([p[k] for p in chosen], np.int64) for k in (0, 1))
    return Associations(first, second, np.zeros(len(first)), np.arange(len(t)))


def test_pairs_are_counted_as_by_hand():
    """Radar tracks of vessels 0, 1, clutter and the gone vessel 7; AIS tracks of 0 and 1. Radar track 1 is 150 m off: lost, at first."""
    where = truth([0, 1], [0.0, 1000.0])
    source, origin = [0, 0, 0, 0, 1, 1], [0, 1, -1, 7, 0, 1]
    lost = tracks(source, origin, [10.0, 1150.0, 500.0, 0.0, 0.0, 1000.0])
    scores = PairScores().seen(TruePairs.of(lost, where, KINDS, LOST_M), pairs(lost))
    assert (scores.tp, scores.fn, scores.fp, scores.tn) == (0, 0, 0, 5), "vessel 0 waits: its miss does not count; 1 is lost"
    assert (scores.waited, scores.wanted, scores.found) == (1, {0}, set())
    scores = scores.seen(TruePairs.of(lost, where, KINDS, LOST_M), pairs(lost, (0, 4), (1, 5), (3, 5)))
    assert (scores.tp, scores.fn, scores.fp, scores.tn) == (1, 0, 1, 9), (
        "a lost track is wrong; that of a gone vessel is not scored"
    )
    near = tracks(source, origin, [10.0, 1010.0, 500.0, 0.0, 0.0, 1000.0])
    scores = scores.seen(TruePairs.of(near, where, KINDS, LOST_M), pairs(near, (0, 5)))
    assert (scores.tp, scores.fn, scores.fp, scores.tn) == (1, 1, 2, 12), "vessel 0 has begun: its miss counts; 1 waits"
    assert (scores.waited, scores.wanted, scores.found) == (2, {0, 1}, {0})
    figures = scores.as_dict(2.0)
    assert figures["tpr"] == 0.5
    assert figures["fpr"] == 2 / 14
    assert figures["wrong_per_1000"] == pytest.approx(2000 / 3)
    assert figures["initialisation_s"] == 2.0


def test_nothing_to_count_is_none():
    assert PairScores().as_dict(1.0)["tpr"] is None
    assert PairScores().seen(TruePairs.of(Tracks.empty(), truth([], []), KINDS, LOST_M), pairs([])) == PairScores()


def test_ospa2_is_that_by_hand():
    """One track 3 m off for two instants and absent for one; one true vessel of all three; another estimate of nobody."""
    absent = [np.nan, np.nan]
    true = np.array([[[0.0, 0.0], [10.0, 0.0], [20.0, 0.0]]])
    one = [[0.0, 3.0], [10.0, 3.0], absent]
    base = (3.0 + 3.0 + 100.0) / 3.0
    assert ospa2(np.array([one]), true, 100.0, 2.0) == pytest.approx(base)
    assert ospa2(np.array([one, [[500.0, 0.0], absent, absent]]), true, 100.0, 2.0) == pytest.approx(
        ((base**2 + 100.0**2) / 2) ** 0.5
    )
    assert ospa2(np.zeros((0, 3, 2)), true, 100.0, 2.0) == 100.0
    assert ospa2(np.full((2, 3, 2), np.nan), np.zeros((0, 3, 2)), 100.0, 2.0) == 0.0
