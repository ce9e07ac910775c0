"""Track loss, tracking percentage, initiation, false tracks and passages through a shadow, by hand."""

from __future__ import annotations

import numpy as np
import pytest

from coastwatch.scores.track_loss import (
    initiation_scores,
    kept,
    kept_instants,
    lost_from_start,
    path_scores,
    shadow_scores,
)

pytestmark = pytest.mark.oracle

LIMIT_M, FOR_GOOD = 15.0, 10.0


def line(*east, north=0.0):
    """A path along a line of latitude; None: absent."""
    return np.array([(np.nan, np.nan) if e is None else (e, north) for e in east], float)


@pytest.mark.parametrize(
    ("error_m", "count"),
    [
        ([], 0),
        ([1, 2, 15, 3], 4),
        ([1, 20, 2, 3], 4),  # it comes back
        ([1, 20, 30, 40], 1),  # it does not
        ([1, 20, 2, 30, 40], 1),  # one instant within the limit is a crossing
        ([1, 20, 30, 2], 4),  # but not at the last instant
        ([1, 20, 151, 2, 3], 1),  # too far off
        ([40, 2, 3, 4], 4),  # it begins outside
        ([1, 20, 2, 3, 20, 30, 30], 4),  # back, and later lost
    ],
)
def test_a_path_counts_until_it_leaves_for_good(error_m, count):
    assert kept_instants(np.array(error_m, float), LIMIT_M, FOR_GOOD) == count


def test_loss_tracking_and_deviation_of_three_tracks_and_two_targets():
    """The first target is tracked throughout; the second loses its track, and gets another for the last two instants of five."""
    true = np.stack([line(0, 10, 20, 30, 40), line(0, 10, 20, 30, 40, north=500.0)])
    paths = np.stack(
        [
            line(3, 13, 23, 33, 43),
            line(0, 10, 60, None, None, north=500.0),
            line(None, None, None, 30, 44, north=500.0),
            line(None, None, 0, 0, None, north=-300.0),
        ]
    )
    found = kept(paths, true, LIMIT_M, FOR_GOOD)
    assert found.target.tolist() == [0, 1, 1, -1]
    assert found.instants.tolist() == [5, 2, 2, 0]
    assert lost_from_start(paths, true, LIMIT_M, FOR_GOOD).tolist() == [False, True]
    scores = path_scores(paths, true, LIMIT_M, FOR_GOOD)
    assert scores == pytest.approx(
        {"loss": 0.5, "tracking": 0.5 * (1.0 + 4.0 / 5.0), "rmsd_m": (3.0 + 0.0 + np.sqrt(8.0)) / 3.0, "false_tracks": 1}
    )


def test_a_track_that_ends_with_its_target_is_not_lost_and_one_that_ends_before_is():
    true = np.stack([line(0, 10, 20, None), line(0, 10, 20, 30, north=500.0), line(0, 10, 20, 30, north=900.0)])
    paths = np.stack([line(0, 10, 20, None), line(0, 10, 20, None, north=500.0)])
    assert lost_from_start(paths, true, LIMIT_M, FOR_GOOD).tolist() == [False, True, True]


def test_the_target_of_a_track_is_the_one_from_which_it_deviates_least():
    true = np.stack([line(0, 0, 0, 0), line(0, 0, 0, 0, north=10.0)])
    assert kept(line(0, 0, 0, 0, north=7.0)[None], true, LIMIT_M, FOR_GOOD).target.tolist() == [1]


def test_nothing_is_scored_where_nothing_is():
    none, true = np.zeros((0, 4, 2)), line(0, 0, 0, 0)[None]
    assert path_scores(none, true, LIMIT_M, FOR_GOOD) == {"loss": 1.0, "tracking": 0.0, "rmsd_m": None, "false_tracks": 0}
    assert path_scores(none, none, LIMIT_M, FOR_GOOD)["tracking"] is None
    assert set(initiation_scores(none, none, LIMIT_M, 2.5).values()) == {None}
    assert initiation_scores(none, true, LIMIT_M, 2.5)["t80_s"] == 7.5


def test_a_target_has_begun_with_the_first_track_at_it_and_other_tracks_are_false():
    """Four of five targets have begun at the third instant; two false tracks, of which one lives at the end."""
    true = np.stack([line(0, 0, 0, 0, 0, north=100.0 * k) for k in range(5)])
    begins = [(0, 0), (0, 1), (1, 2), (2, 3), (3, 3)]  # instant, target: the last is a second track of the fourth
    paths = [line(*[None] * t, *[5.0] * (5 - t), north=100.0 * k) for t, k in begins]
    paths += [line(None, 90, 90, None, None), line(None, None, 0, 90, 90, north=450.0), line(*[None] * 5)]
    scores = initiation_scores(np.stack(paths), true, LIMIT_M, 2.5)
    assert scores == pytest.approx(
        {"begun": 0.8, "t80_s": 5.0, "false_begun": 2, "false_alive": 1.0, "false_alive_end": 1, "cost_s": 10.0}
    )


def test_a_passage_through_a_shadow_is_held_and_keeps_its_id():
    """Hidden at the instants 2 and 3. The first target is held at one of them and keeps its track; the second gets a new one."""
    true = np.stack([line(*[0] * 7), line(*[0] * 7, north=500.0), line(*[0] * 7, north=900.0)])
    hidden = np.zeros((3, 7), bool)
    hidden[:2, 2:4] = True
    paths = np.stack(
        [
            line(0, 0, 40, 60, 0, 0, 0),
            line(0, 0, None, None, None, None, None, north=500.0),
            line(*[None] * 5, 0, 0, north=500.0),
        ]
    )
    assert shadow_scores(paths, true, hidden, 50.0, 2) == {"held": 0.25, "same_id": 0.5, "passages": 2}
    assert shadow_scores(paths, true, hidden[:, ::-1] & False, 50.0, 2)["held"] is None
    assert shadow_scores(paths[:0], true, hidden, 50.0, 2) == {"held": 0.0, "same_id": None, "passages": 0}
