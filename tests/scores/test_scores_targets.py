"""Scores of the tracks of a few targets, by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from coastwatch.batches import Tracks, Truth
from coastwatch.geodesy import from_plane
from coastwatch.scores.targets import TargetScores

pytestmark = pytest.mark.oracle

ORIGIN_DEG = np.array([63.44, 10.4])


def truth_at(places):
    places = np.array(places, float).reshape(-1, 2)
    n = len(places)
    return Truth(np.arange(n), np.zeros(n), from_plane(places, ORIGIN_DEG), np.zeros((n, 2)))


def tracks_at(places, velocity=0.0):
    places = np.array(places, float).reshape(-1, 2)
    n, no = len(places), np.zeros(len(places), np.int64)
    spread = np.tile(np.diag([25.0, 25.0, 1.0, 1.0]), (n, 1, 1))
    each = np.arange(n), no, np.zeros(n), from_plane(places, ORIGIN_DEG), np.full((n, 2), velocity), spread, spread[:, :2, :2]
    return Tracks(*each, np.zeros(n), np.zeros(n), no, no)


def test_two_targets_two_tracks_of_which_one_is_far_then_none():
    scores = TargetScores(cutoff_m=200.0, near_m=100.0)
    scores = scores.seen(truth_at([[0, 0], [400, 0]]), tracks_at([[3, 4], [400, 150]], velocity=1.0), {0: 11})
    assert scores.as_dict() == pytest.approx(
        {
            "ospa_m": np.sqrt((5.0**2 + 150.0**2) / 2.0),
            "error_m": 5.0,
            "nees": 25.0 / 25.0 + 2.0,
            "probability": 0.5,
            "false_tracks": 1.0,
            "breaks": 0.0,
            "id_right": 0.0,
            "id_wrong": 0.0,
        },
        rel=1e-4,
    )
    scores = scores.seen(truth_at([[0, 0], [400, 0]]), tracks_at([]), {})
    found = scores.as_dict()
    assert found["ospa_m"] == pytest.approx((np.sqrt((25.0 + 150.0**2) / 2.0) + 200.0) / 2.0, rel=1e-4)
    assert found["breaks"] == 0.5
    assert found["probability"] == 0.25


def test_a_target_that_leaves_is_no_break_and_nothing_is_no_distance():
    scores = TargetScores(cutoff_m=200.0, near_m=100.0).seen(truth_at([[0, 0]]), tracks_at([[1, 0]]), {})
    scores = scores.seen(truth_at([]), tracks_at([]), {})
    assert scores.as_dict()["breaks"] == 0.0
    assert scores.as_dict()["ospa_m"] == pytest.approx(0.5, rel=1e-3)
    assert TargetScores(200.0, 100.0).as_dict()["ospa_m"] is None


def test_ids_that_tracks_hold():
    """Three targets send an MMSI: a track holds it, another's, none. The fourth sends none."""
    places = [[0, 0], [1000, 0], [2000, 0], [3000, 0]]
    tracks = replace(tracks_at(places), held_mmsi=np.array([10, 99, -1, 99]))
    found = TargetScores(200.0, 100.0).seen(truth_at(places), tracks, {0: 10, 1: 11, 2: 12}).as_dict()
    assert (found["id_right"], found["id_wrong"]) == (pytest.approx(1 / 3), pytest.approx(1 / 3))
