"""Errors of position, course and speed."""

from __future__ import annotations

import numpy as np
import pytest
from scores_world import AIS, KINDS, OTHER_RADAR, RADAR, fused, ints, joined, tracks, truth

from coastwatch.geodesy import KNOT_M_S, offset_deg
from coastwatch.kernels.tables.lookup import row_of
from coastwatch.scores.rmse import Errors, errors, fusion_errors, whole_vessels

pytestmark = pytest.mark.oracle

PLACE = np.array([-23.0, 179.9999])
METRES = 1e-6  # of offset_deg and difference_m, one the inverse of the other


def course(degrees, knots):
    angle = np.radians(degrees)
    return knots * KNOT_M_S * np.array([np.sin(angle), np.cos(angle)])


def test_errors_by_hand():
    there = np.tile(PLACE, (3, 1))
    off = offset_deg(there, np.array([[30.0, 40.0], [0.0, 0.0], [0.0, 5.0]]))  # 50 m, across the antimeridian
    said = np.array([course(2.0, 10.0), course(359.0, 8.0), course(90.0, 1.5)])
    true = np.array([course(358.0, 10.0), course(359.0, 5.0), course(270.0, 1.5)])
    got = errors(off, said, there, true)
    assert (got.count, got.course_count) == (3, 2)  # slower than 2 kn has no course
    figures = got.as_dict()
    assert figures["position_rmse_m"] == pytest.approx(np.sqrt((2500.0 + 25.0) / 3), abs=METRES)
    assert figures["course_rmse_deg"] == pytest.approx(np.sqrt((16.0 + 0.0) / 2))  # 2 and 358 are 4 apart
    assert figures["speed_rmse_kn"] == pytest.approx(np.sqrt(9.0 / 3))


def test_sums_over_cycles_are_those_of_all_rows():
    rng = np.random.default_rng([7, 1])
    there, said, true = PLACE + rng.normal(0, 1e-4, (50, 2)), rng.normal(0, 5, (50, 2)), rng.normal(0, 5, (50, 2))
    parts = [errors(there[s], said[s], np.tile(PLACE, (25, 1)), true[s]) for s in (slice(0, 25), slice(25, 50))]
    whole = errors(there, said, np.tile(PLACE, (50, 1)), true).as_dict()
    assert (parts[0] + parts[1]).as_dict() == pytest.approx(whole)


def test_nothing_has_no_error():
    assert Errors().as_dict() == {"position_rmse_m": None, "course_rmse_deg": None, "speed_rmse_kn": None}


def test_row_of():
    np.testing.assert_array_equal(row_of(ints(9, 4, 6), ints(4, 9, 5, -1, 6)), [1, 0, -1, -1, 2])
    np.testing.assert_array_equal(row_of(ints(), ints(3)), [-1])


def test_whole_vessels_have_radar_and_ais_of_one_true_vessel_only():
    source = [RADAR, AIS, RADAR, AIS, RADAR, OTHER_RADAR, AIS, RADAR, AIS, OTHER_RADAR, AIS]
    origin = [1, 1, 2, 3, 4, 4, 5, -1, -1, 6, 6]
    vessel = [0, 0, 1, 1, 2, 2, 3, 4, 4, 5, 5]
    whole, who = whole_vessels(tracks(source, origin), joined(vessel), KINDS)
    np.testing.assert_array_equal(whole, [True, False, False, False, False, True])
    assert who[0] == 1
    assert who[5] == 6


def test_only_rightly_fused_vessels_count_and_so_do_their_tracks():
    there = np.tile(PLACE, (2, 1))
    place = lambda east: offset_deg(PLACE, np.array([east, 0.0]))  # noqa: E731
    made = tracks(
        [RADAR, OTHER_RADAR, AIS, RADAR, AIS],
        [7, 7, 7, 8, 9],
        [place(8.0), place(6.0), place(1.0), place(99.0), place(99.0)],
    )
    said = fused([place(2.0), place(50.0)], np.zeros((2, 2)))
    got = fusion_errors(truth([7, 8], there, np.zeros((2, 2))), made, joined([0, 0, 0, 1, 1]), said, KINDS)
    np.testing.assert_array_equal(got.origin, [7])
    np.testing.assert_array_equal(got.row, [0])
    assert got.fused.as_dict()["position_rmse_m"] == pytest.approx(2.0, abs=METRES)
    assert got.radar.as_dict()["position_rmse_m"] == pytest.approx(np.sqrt(50.0), abs=METRES)
    assert got.ais.as_dict()["position_rmse_m"] == pytest.approx(1.0, abs=METRES)


def test_vessels_without_truth_do_not_count():
    made = tracks([RADAR, AIS], [7, 7])
    got = fusion_errors(truth([], [], []), made, joined([0, 0]), fused(np.zeros((1, 2)), np.zeros((1, 2))), KINDS)
    assert got.fused.count == got.radar.count == got.ais.count == 0


def test_no_track():
    got = fusion_errors(
        truth([7], [[0, 0]], [[0, 0]]), tracks([], []), joined([]), fused(np.zeros((0, 2)), np.zeros((0, 2))), KINDS
    )
    assert got.fused.count == 0
