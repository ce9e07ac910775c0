"""Scores of the whole set of targets, by hand: acquisition, completeness, OSPA over time, errors, identities."""

from __future__ import annotations

import numpy as np
import pytest
from test_scores_targets import tracks_at, truth_at

from coastwatch.batches import Tracks
from coastwatch.scores.targets import MultiTargetScores

pytestmark = pytest.mark.oracle

NONE = MultiTargetScores(cutoffs_m=(250.0, 500.0), near_m=250.0, start_s=100.0, settled_s=5.0, every_s=6.0)
TWO = [[0.0, 0.0], [2000.0, 0.0]]


def test_five_instants_of_two_targets():
    """None; one; both; both and a false one; one, and one that is 300 m off."""
    scores = NONE
    seen = [], [[3, 4]], [[3, 4], [2000, 0]], [[3, 4], [2000, 0], [0, 900]], [[0, 0], [2000, 300]]
    for k, places in enumerate(seen):
        scores = scores.seen(103.0 + 3.0 * k, truth_at(TWO), tracks_at(places))
    found = scores.as_dict()
    assert found["acquisition_s"] == pytest.approx(9.0)
    assert found["completeness"] == pytest.approx(1 / 5)
    assert found["completeness_after"] == pytest.approx(1 / 3)
    assert found["position_m"] == pytest.approx(np.sqrt(3 * 25.0 / 6), rel=1e-4)
    assert found["false_tracks"] == pytest.approx(2 / 5)
    assert found["false_tracks_settled"] == pytest.approx(2 / 4), "the first instant is within the first 5 s"
    assert (found["identities"], found["own_identities"]) == (3, 0)
    assert found["followed"] == {"0": pytest.approx(4 / 5), "1": pytest.approx(2 / 5)}
    by_hand = {
        c: [c, np.sqrt((25 + c * c) / 2), 5 / np.sqrt(2), np.sqrt((25 + c * c) / 3), min(c, 300.0) / np.sqrt(2)]
        for c in (250.0, 500.0)
    }
    for c, values in by_hand.items():
        assert found["ospa_m"][f"{c:g}"] == pytest.approx(np.mean(values), rel=1e-4)
        assert found["ospa_median_m"][f"{c:g}"] == pytest.approx(np.median(values), rel=1e-4)
        spans = {"0": np.mean(values[:2]), "6": np.mean(values[2:4]), "12": values[4]}
        assert found["ospa_over_time"][f"{c:g}"] == pytest.approx(spans, rel=1e-4)


def test_speed_and_course_have_their_own_errors():
    truth = truth_at([[0.0, 0.0]])
    truth.velocity_m_s[:] = [0.0, 5.0]
    tracks: Tracks = tracks_at([[0.0, 0.0]])
    tracks.velocity_m_s[:] = [6.0 * np.sin(np.radians(-10.0)), 6.0 * np.cos(np.radians(-10.0))]
    found = NONE.seen(103.0, truth, tracks).as_dict()
    assert found["speed_m_s"] == pytest.approx(1.0)
    assert found["course_deg"] == pytest.approx(10.0)
    assert found["velocity_m_s"] == pytest.approx(np.sqrt(61.0 - 60.0 * np.cos(np.radians(10.0))))


def test_nothing_is_none():
    assert NONE.as_dict()["completeness"] is None
    found = NONE.seen(103.0, truth_at(TWO), tracks_at([])).as_dict()
    assert (found["acquisition_s"], found["position_m"], found["nees"], found["completeness"]) == (None, None, None, 0.0)
