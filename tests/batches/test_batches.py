"""A batch refuses what does not fit and says what."""

import numpy as np
import pytest

from coastwatch.batches import (
    AisReports,
    AisStatics,
    Associations,
    BearingReports,
    FusedTracks,
    Members,
    RadarReports,
    RadarVideo,
    Reports,
    Trajectories,
    Videos,
)
from coastwatch.batches.limits import reports_within

pytestmark = pytest.mark.contract


def members(n):
    return Members(np.arange(n), np.arange(n) + 10, np.zeros(n, np.int64))


def test_wrong_length_names_the_field():
    with pytest.raises(ValueError, match=r"Members\.track_id: got shape \(2,\), needed \('L',\)"):
        Members(np.arange(3), np.arange(2), np.arange(3))


def test_wrong_dtype_names_the_field():
    with pytest.raises(TypeError, match=r"Members\.source: got dtype float64, needed int64"):
        Members(np.arange(3), np.arange(3), np.zeros(3))


def test_no_array_names_the_field():
    with pytest.raises(TypeError, match=r"Members\.vessel_id: got list, needed an array"):
        Members([1], np.arange(1), np.arange(1))


def test_take_join_and_empty():
    both = Members.join([members(2), members(3)])
    assert len(both) == 5
    assert both.take(np.array([4, 0])).track_id.tolist() == [12, 10]
    assert len(Members.join([])) == 0


def test_columns_without_values_take_no_memory():
    n = 1000
    velocity, covariance = np.ones((n, 2)), np.ones((n, 4, 4))
    fused = FusedTracks(np.full(n, 3.0), np.ones((n, 2)), velocity, covariance)
    empty = fused.without_values("time_s")
    assert len(empty) == n
    assert empty.time_s is fused.time_s
    for name in ("position_deg", "velocity_m_s", "covariance"):
        array = getattr(empty, name)
        assert np.isnan(array).all()
        assert array.shape == getattr(fused, name).shape
        assert array.strides == (0,) * array.ndim
    assert members(n).without_values("source").track_id.tolist() == [0] * n


def test_tracks_of_vessels_are_brought_together_once():
    none = np.zeros(0, np.int64)
    associations = Associations(none, none, np.zeros(0), np.array([1, 0, 1, 2, 0]))
    start, row = associations.by_vessel
    assert [row[start[v] : start[v + 1]].tolist() for v in range(3)] == [[1, 4], [0, 2], [3]]
    assert associations.by_vessel[1] is row
    assert Associations(none, none, np.zeros(0), none).by_vessel[0].tolist() == [0]


def test_reports_are_cut_by_arrival_each_once():
    n = 7
    times = np.array([0.0, 1.0, 3.0, 3.0, 4.0, 6.0, 9.0])
    ais = AisReports(times, times, np.arange(n), np.zeros((n, 2)), np.zeros(n), np.zeros(n), np.zeros(n, bool), np.arange(n))
    reports = Reports(RadarReports.empty(), ais, AisStatics.empty(), BearingReports.empty())
    cut = [reports.between(a, a + 3.0).ais.origin.tolist() for a in (-3.0, 0.0, 3.0, 6.0)]
    assert cut == [[0], [1, 2, 3], [4, 5], [6]]


def test_truth_between_samples():
    position = np.array([[[10.0, 20.0], [12.0, 20.0]], [[0.0, 0.0], [1.0, 1.0]]])
    truth = Trajectories(
        np.array([7, 8]),
        np.array([0.0, 4.0]),
        position,
        np.zeros((2, 2, 2)),
        np.array([[True, True], [True, False]]),
        np.zeros((2, 0)),
        np.zeros(2),
        np.zeros(2),
        np.zeros((2, 2)),
    )
    at = truth.at(3.0)
    assert at.vessel.tolist() == [7]
    np.testing.assert_allclose(at.position_deg, [[11.5, 20.0]])


def spokes(times, sensor=0, cells=4):
    n = len(times)
    time = np.array(times, float)
    return RadarVideo(sensor, 0.0, 10.0, time, time, np.zeros(n), np.zeros((n, 2)), np.zeros((n, cells), np.uint8))


def test_video_is_cut_and_merged_by_arrival():
    one, other = Videos((spokes([1.0, 2.0, 3.0]),)), Videos((spokes([0.5, 2.5], sensor=1, cells=6),))
    none = Reports()
    both = Reports.merged([Reports(none.radar, none.ais, none.statics, none.bearing, video=v) for v in (one, other)])
    assert len(both) == 5
    assert [part.sensor for part in both.video.parts] == [1, 0]
    cut = both.between(1.0, 2.5).video
    assert [part.time_s.tolist() for part in cut.parts] == [[2.5], [2.0]]
    assert len(both.between(3.0, 9.0)) == 0


def test_video_that_does_not_fit_is_refused_and_spokes_that_are_none_are_counted():
    with pytest.raises(ValueError, match=r"RadarVideo\.cell_m, first_m: got 0\.0"):
        RadarVideo(0, 0.0, 0.0, *(np.zeros(0),) * 3, np.zeros((0, 2)), np.zeros((0, 3), np.uint8))
    with pytest.raises(ValueError, match=r"RadarVideo\.level: got shape \(2, 3\)"):
        RadarVideo(0, 0.0, 1.0, *(np.zeros(1),) * 3, np.zeros((1, 2)), np.zeros((2, 3), np.uint8))
    none = Reports()
    bad = Reports(none.radar, none.ais, none.statics, none.bearing, video=Videos((spokes([1.0, np.nan, 3.0]),)))
    kept, counts = reports_within(bad)
    assert len(kept) == 2
    assert counts == {"video: time": 1}
