"""AisFilter: one MMSI in two places, outliers, loss and return, and vessels anywhere on Earth."""

import numpy as np
import pytest
from ais_world import HOME, PERIOD_S, START_S, run, sail, same

from coastwatch.geodesy import KNOT_M_S, difference_m, offset_deg
from coastwatch.tracks.ais.ais_filter import AisFilter

pytestmark = pytest.mark.contract


def test_a_first_report_is_a_track_at_once():
    row = sail(235000001, [START_S + 1.0])
    _, tracks, alarms = run(AisFilter(), row, 1)
    assert tracks.track_id.tolist() == [2 * 2**40]
    assert tracks.source.tolist() == [2]
    assert tracks.updated_s.tolist() == tracks.started_s.tolist() == [START_S + 1.0]
    assert tracks.time_s.tolist() == [START_S + PERIOD_S]
    assert tracks.mmsi.tolist() == [235000001]
    assert tracks.origin.tolist() == [1]
    assert not alarms.twice.any()
    assert not alarms.impossible_speed.any()
    assert np.linalg.eigvalsh(tracks.covariance[0]).min() > 0.0
    speedless = [(*row[0][:5], np.nan, np.nan)]
    _, wide, _ = run(AisFilter(), speedless, 1)
    assert wide.covariance[0, 2, 2] > 20.0 * tracks.covariance[0, 2, 2]


def test_an_outlier_raises_an_alarm_and_leaves_the_track_alone():
    rows = sail(235000001, START_S + 1.0 + np.arange(0.0, 120.0, 3.0))
    outlier = sail(235000001, [START_S + 31.5], HOME + np.array([0.0, 40.0]))
    seen, clean = [], []
    memory, _, _ = run(AisFilter(), rows + outlier, 40, outputs=seen)
    run(AisFilter(), rows, 40, outputs=clean)
    assert all(same(a, b) for (a, _), (b, _) in zip(seen, clean, strict=True))
    raised = [bool(alarms.impossible_speed[0]) for _, alarms in seen]
    assert not any(raised[:10])
    assert all(raised[10:30])  # 31.5 s and 60 s after
    assert not any(raised[31:])
    assert not any(alarms.twice.any() for _, alarms in seen)
    assert memory.refused == {"impossible speed": 1}


def test_one_mmsi_in_two_places_is_two_tracks_with_an_alarm():
    times = START_S + 1.0 + np.arange(0.0, 60.0, 3.0)
    rows = sail(235000001, times) + sail(235000001, times + 1.0, HOME + 0.2, course_deg=200.0, seed=3)
    outputs = []
    run(AisFilter(), rows, 20, outputs=outputs)
    assert [len(t) for t, _ in outputs] == [1] + [2] * 19
    tracks, alarms = outputs[-1]
    assert len(np.unique(tracks.track_id)) == 2
    assert alarms.twice.all()
    assert outputs[1][1].twice.tolist() == [True, True]
    assert np.hypot(*difference_m(tracks.position_deg[1], tracks.position_deg[0])) > 10e3
    assert {tuple(t.track_id) for t, _ in outputs[1:]} == {tuple(tracks.track_id)}


def test_a_jump_is_not_two_places():
    rows = sail(235000001, START_S + 1.0 + np.arange(0.0, 30.0, 3.0))
    rows += sail(235000001, START_S + 31.0 + np.arange(0.0, 30.0, 3.0), HOME + 0.3)
    _, tracks, alarms = run(AisFilter(), rows, 20)
    assert len(tracks) == 2
    assert not alarms.twice.any()
    assert alarms.impossible_speed.tolist() == [True, True]


@pytest.mark.parametrize(("uncertain", "apart", "twice"), [(True, 0.0, False), (False, 0.0, True), (True, 0.2, True)])
def test_reports_whose_own_second_says_that_they_are_late_are_of_their_vessel(uncertain, apart, twice):
    """A ship of 20 kn, of whose reports every third comes 23 s late with the time of reception."""
    times = START_S + 1.0 + np.arange(0.0, 60.0, 3.0)
    late = times[::3] + 1.0
    rows = sail(235000001, times)
    rows += [(t, t, *r[2:]) for t, r in zip(late, sail(235000001, late - 23.0, HOME + apart), strict=True)]
    error_s = dict.fromkeys(late.tolist(), 23.0) if uncertain else {}
    outputs = []
    run(AisFilter(), rows, 20, outputs=outputs, error_s=error_s)
    assert any(alarms.twice.any() for _, alarms in outputs) == twice
    assert any(alarms.impossible_speed.any() for _, alarms in outputs) == twice
    assert max(len(tracks) for tracks, _ in outputs) == (2 if twice else 1)


def test_five_places_are_more_than_an_mmsi_may_have():
    rows = [r for k in range(7) for r in sail(235000001, START_S + 1.0 + 0.1 * k + np.arange(0.0, 60.0, 3.0), HOME + 0.2 * k)]
    memory, tracks, _ = run(AisFilter(), rows, 20)
    assert len(tracks) == 4
    assert len(np.unique(tracks.track_id)) == 4
    assert memory.refused["crowded"] > 0


def test_a_silent_vessel_is_predicted_then_dropped_and_comes_back_under_its_id():
    method = AisFilter()
    times = START_S + 1.0 + np.concatenate([np.arange(0.0, 60.0, 3.0), np.arange(600.0, 660.0, 3.0)])
    outputs = []
    run(method, sail(235000001, times), 220, outputs=outputs)
    seen = np.array([len(t) for t, _ in outputs], bool)
    patience_s = method.patience_s + method.patience_intervals * method.interval_moving_s
    last = int((58.0 + patience_s) // PERIOD_S)
    assert seen[:last].all()
    assert not seen[last:200].any()
    assert seen[200:].all()
    assert {int(i) for t, _ in outputs for i in t.track_id} == {2 * 2**40}
    spread = [t.covariance[0, 0, 0] for t, _ in outputs[20:last]]
    assert (np.diff(spread) > 0.0).all()
    assert outputs[-1][0].started_s[0] == times[0]


def test_after_return_s_an_mmsi_is_another_vessel():
    method = AisFilter(return_s=300.0)
    times = START_S + 1.0 + np.concatenate([np.arange(0.0, 60.0, 3.0), np.arange(600.0, 660.0, 3.0)])
    memory, tracks, _ = run(method, sail(235000001, times), 220)
    assert tracks.track_id.tolist() == [2 * 2**40 + 1]
    assert len(memory.now.tracks) == 1


def test_a_vessel_at_anchor_is_waited_for():
    times = START_S + 1.0 + np.arange(0.0, 1000.0, 180.0)
    outputs = []
    run(AisFilter(), sail(235000001, times, speed_kn=0.0), 400, outputs=outputs)
    assert all(len(t) == 1 for t, _ in outputs)


@pytest.mark.parametrize("start", [(84.0, 179.99), (-84.0, -179.99), (0.0, 179.999), (60.0, 0.0), (89.5, 12.0)])
@pytest.mark.parametrize("course_deg", [90.0, 270.0, 20.0])
def test_any_place_on_earth(start, course_deg):
    """30 kn for 40 minutes, past re-anchoring and the antimeridian, on a rhumb line no longer than the filter's memory."""
    speed = 30.0 * KNOT_M_S
    times = START_S + 1.0 + np.arange(0.0, 1600.0, 10.0)
    course = np.radians(course_deg)
    place, places = np.array(start), []
    for _ in times:
        places.append(place)
        place = offset_deg(place, 10.0 * speed * np.array([np.sin(course), np.cos(course)]))
    rows = [(t, t, 235000001, p[0], p[1], 30.0, course_deg) for t, p in zip(times, places, strict=True)]
    memory, tracks, alarms = run(AisFilter(), rows, int(1600.0 / PERIOD_S) + 1)
    ahead = (tracks.time_s[0] - times[-1]) * speed * np.array([np.sin(course), np.cos(course)])
    # A rhumb line at 89.5 degrees turns by 0.2 degrees a second; elsewhere the plane is right to a metre.
    assert np.hypot(*difference_m(tracks.position_deg[0], offset_deg(places[-1], ahead))) < (8.0 if start[0] > 85.0 else 1.0)
    east, north = tracks.velocity_m_s[0]
    assert np.hypot(east - speed * np.sin(course), north - speed * np.cos(course)) < (1.0 if start[0] > 85.0 else 0.15)
    assert len(tracks) == 1
    assert memory.refused == {}
    assert not alarms.impossible_speed.any()
