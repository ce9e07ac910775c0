"""AisDeadReckoning: the newest report and nothing else, where `ais_filter` would filter."""

import numpy as np
import pytest
from ais_world import HOME, PERIOD_S, SENSORS, START_S, fleet, reports, run, sail, same

from coastwatch.geodesy import KNOT_M_S, difference_m, offset_deg
from coastwatch.tracks import AisDeadReckoning, AisFilter, AisInput

pytestmark = pytest.mark.contract

ROUNDING_M = 1e-6


def test_position_is_the_newest_report_moved_by_its_speed_and_course():
    every = reports(fleet())
    method = AisDeadReckoning()
    _, (tracks, alarms, _) = method.step(method.init(), AisInput(every, START_S + 60.0, SENSORS))
    for k, mmsi in enumerate(tracks.mmsi):
        own = every.take(every.mmsi == mmsi)
        newest = own.take([int(np.argmax(own.time_s))])
        course, speed = np.radians(newest.cog_deg[0]), newest.sog_kn[0] * KNOT_M_S
        velocity = speed * np.array([np.sin(course), np.cos(course)])
        there = offset_deg(newest.position_deg[0], velocity * (START_S + 60.0 - newest.time_s[0]))
        assert np.hypot(*difference_m(tracks.position_deg[k], there)) < ROUNDING_M
        np.testing.assert_allclose(tracks.velocity_m_s[k], velocity, atol=1e-9)
    assert np.isnan(tracks.covariance).all()
    np.testing.assert_allclose(tracks.report_covariance, np.tile(3.33**2 * np.eye(2), (12, 1, 1)), rtol=1e-3)
    assert alarms.mmsi.tolist() == tracks.mmsi.tolist()


def test_not_aligned_is_the_report_where_it_was_made():
    rows = sail(235000001, START_S + 1.0 + np.arange(0.0, 30.0, 3.0))
    _, tracks, _ = run(AisDeadReckoning(aligned=False), rows, 10)
    assert tracks.position_deg[0].tolist() == [rows[-1][3], rows[-1][4]]


def test_a_late_report_older_than_the_newest_changes_no_track():
    rows = sail(235000001, START_S + 1.0 + np.arange(0.0, 30.0, 3.0))
    late = sail(235000001, [START_S + 14.5], delay=[5.5], seed=7)
    seen, clean = [], []
    run(AisDeadReckoning(), rows + late, 10, outputs=seen)
    run(AisDeadReckoning(), rows, 10, outputs=clean)
    for (a, _), (b, _) in zip(seen, clean, strict=True):
        assert same(a, b)


def test_vessels_alarms_and_silence_are_those_of_the_filter():
    """One MMSI in two places, an outlier, and a vessel that falls silent: the same rows under the same ids."""
    times = START_S + 1.0 + np.arange(0.0, 60.0, 3.0)
    rows = sail(235000001, times) + sail(235000001, times + 1.0, HOME + 0.2, course_deg=200.0, seed=3)
    rows += sail(235000002, times[:5], HOME + 0.4) + sail(235000003, times, HOME - 0.4)
    rows += sail(235000003, [START_S + 31.5], HOME + np.array([0.0, 40.0]))
    raw, filtered = [], []
    memory, _, _ = run(AisDeadReckoning(), rows, 60, outputs=raw)
    other, _, _ = run(AisFilter(), rows, 60, outputs=filtered)
    for (a, alarms), (b, expected) in zip(raw, filtered, strict=True):
        assert a.track_id.tolist() == b.track_id.tolist()
        assert a.updated_s.tobytes() == b.updated_s.tobytes()
        assert same(alarms, expected)
    assert memory.refused == other.refused
    assert max(len(t) for t, _ in raw) == 4
    assert len(raw[-1][0]) < 4


@pytest.mark.parametrize(("sog", "cog"), [(np.nan, 10.0), (9.0, np.nan), (102.3, 10.0)])
def test_a_report_without_speed_or_course_stays_where_it_was(sog, cog):
    rows = [(*r[:5], sog, cog) for r in sail(235000001, [START_S + 1.0])]
    _, tracks, _ = run(AisDeadReckoning(), rows, 3)
    assert np.hypot(*difference_m(tracks.position_deg[0], np.array(rows[0][3:5]))) < ROUNDING_M
    assert tracks.velocity_m_s[0].tolist() == [0.0, 0.0]
    assert tracks.time_s[0] == START_S + 3 * PERIOD_S
