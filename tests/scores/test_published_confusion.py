"""The metrics that follow from the confusion matrices that the paper publishes.

Source: P. Rangel et al., Enhancing Performance and Reliability in Maritime Target Fusion Through a Context-Driven Approach,
Tables I to IV (shared/seeds/003_bc8935950490c5c9.txt).
"""

from __future__ import annotations

import pytest

from coastwatch.scores.confusion import Confusion

pytestmark = pytest.mark.golden

AVERAGED = 3e-4  # the paper averages the metrics of ten runs, and the counts apart from them
POSITION_TRACKS = Confusion(tp=7980, fn=38, fp=38, tn=6884)  # Table I
BEARING_TRACKS = Confusion(tp=1747, fn=79, fp=214, tn=112)  # Table III


@pytest.mark.parametrize(
    ("counts", "accuracy", "precision", "recall", "f1"),
    [
        (POSITION_TRACKS, 0.9948, 0.9953, 0.9953, 0.9953),  # Table II
        (BEARING_TRACKS, 0.8641, 0.8909, 0.9567, 0.9226),  # Table IV
    ],
)
def test_published_metrics(counts, accuracy, precision, recall, f1):
    got = counts.as_dict()
    for name, value in (("accuracy", accuracy), ("precision", precision), ("recall", recall), ("f1", f1)):
        assert got[name] == pytest.approx(value, abs=AVERAGED)


def test_always_associating_scores_as_well_which_is_why_specificity_is_reported():
    """The decisions of Table III, each answered with a partner and the right one wherever there is one."""
    always = Confusion(tp=BEARING_TRACKS.tp + BEARING_TRACKS.fn, fp=BEARING_TRACKS.fp + BEARING_TRACKS.tn).as_dict()
    assert always["f1"] == pytest.approx(0.918, abs=5e-4)
    assert always["specificity"] == always["mcc"] == 0.0
    assert BEARING_TRACKS.as_dict()["specificity"] == pytest.approx(0.34, abs=5e-3)
