"""Lanes, anchorages, moored rows, standing echoes, vessels that come into view and are lost, and antennas off the echo."""

from __future__ import annotations

import numpy as np
import pytest
from pydantic import ValidationError
from simulated_world import CENTRE_DEG, recorded, sensors

from coastwatch.batches import NavStatus
from coastwatch.geodesy import KNOT_M_S, NAUTICAL_MILE_M, to_plane
from coastwatch.sensors.simulated.ais import AisTruth
from coastwatch.sensors.simulated.harbour import Anchorages, Lanes, Row, StandingEchoes
from coastwatch.sensors.simulated.radar import RadarTruth
from coastwatch.sensors.simulated.trajectories import VesselMotion

pytestmark = pytest.mark.contract

STILL = VesselMotion(speed_from_kn=8.0, speed_to_kn=20.0, process_noise="none")
LAT, LON = CENTRE_DEG


def row(count=5, **more):
    return Row(latitude_deg=LAT, longitude_deg=LON, count=count, **more)


def test_vessels_in_lanes_go_both_ways_keep_to_the_right_and_turn_back():
    lanes = Lanes(share=1.0, count=1, length_nm=2.0, sway_m=0.0)
    truth = recorded(count=40, cycles=600, motion=STILL, lanes=lanes).truth
    speed = np.hypot(truth.velocity_m_s[..., 0], truth.velocity_m_s[..., 1])
    assert speed.min() > 7.9 * KNOT_M_S
    assert speed.std(axis=1).max() < 0.01, "each keeps its speed, in its half circles too"
    step = np.array([to_plane(truth.position_deg[v], CENTRE_DEG) for v in range(40)])
    moved = np.hypot(*np.diff(step, axis=1).transpose(2, 0, 1)) / 3.0
    assert moved.max() < 20.0 * KNOT_M_S + 0.1, "no jump where the lane ends"
    course = np.arctan2(truth.velocity_m_s[..., 0], truth.velocity_m_s[..., 1])
    along = np.abs(np.cos(course - course[0, 0])) > 0.999
    assert along.mean() > 0.7
    ways = np.sign(np.cos(course - course[0, 0]))[along]
    assert 0.2 < (ways > 0).mean() < 0.8
    assert len(np.unique(np.sign(np.cos(course - course[0, 0])[0]))) == 2, "the first vessel has turned back"
    ahead = np.array([np.sin(course[0, 0]), np.cos(course[0, 0])])
    right = step @ np.array([ahead[1], -ahead[0]])
    middle = 0.5 * (
        right[along & (np.cos(course - course[0, 0]) > 0)].mean() + right[along & (np.cos(course - course[0, 0]) < 0)].mean()
    )
    assert ((right[along] - middle) * ways > 0.0).mean() > 0.98
    span = step @ ahead
    assert np.ptp(span) < 2.0 * NAUTICAL_MILE_M + 800.0


def test_anchored_and_moored_vessels_lie_still_and_the_first_are_moored():
    truth = recorded(
        count=50,
        motion=STILL,
        moored=(row(6, bearing_deg=90.0, length_m=400.0, width_m=10.0),),
        anchorages=Anchorages(share=0.5),
    ).truth
    speed = np.hypot(truth.velocity_m_s[..., 0], truth.velocity_m_s[..., 1]).max(axis=1)
    assert (speed == 0.0).sum() == 6 + 22
    assert (speed[:6] == 0.0).all()
    at = to_plane(truth.position_deg[:6, 0], CENTRE_DEG)
    assert np.abs(at[:, 0]).max() <= 200.0
    assert np.abs(at[:, 1]).max() <= 5.1
    assert (truth.position_deg[:6, 0] == truth.position_deg[:6, -1]).all()


def test_each_vessel_of_an_anchorage_has_a_place_of_its_own():
    lie = Anchorages(share=1.0, count=2, berth_share=0.9)
    at = to_plane(recorded(count=80, cycles=1, anchorages=lie).truth.position_deg[:, 0], CENTRE_DEG)
    apart = np.linalg.norm(at[:, None] - at, axis=2) + 1e9 * np.eye(80)
    assert apart.min() > 68.9
    with pytest.raises(ValueError, match="got 40 vessels, needed about 39 at most"):
        recorded(count=40, cycles=1, anchorages=lie.model_copy(update={"count": 1, "berth_share": 1.0}))


def test_class_a_says_that_it_is_at_anchor():
    ais = recorded(count=60, anchorages=Anchorages(share=0.5), motion=STILL, ais=AisTruth(class_b_share=0.3)).reports.ais
    said = np.where(ais.class_b, -1, np.where(ais.sog_kn < 2.0, NavStatus.AT_ANCHOR, NavStatus.UNDER_WAY_USING_ENGINE))
    assert (ais.nav_status == said).all()
    assert len(np.unique(said)) == 3


def test_other_vessels_are_what_they_were():
    plain, harbour = recorded(count=30).truth, recorded(count=30, moored=(row(4),)).truth
    assert np.array_equal(plain.position_deg[4:], harbour.position_deg[4:])
    assert np.array_equal(
        recorded(count=30).reports.radar.range_m, recorded(count=30, standing=StandingEchoes()).reports.radar.range_m
    )


def test_standing_echoes_are_seen_where_they_stand_as_often_as_asked():
    truths = StandingEchoes(rows=(row(10, length_m=0.0, width_m=0.0),), detection_from=0.5, detection_to=0.5)
    plots = recorded(count=0, cycles=200, standing=truths, where=sensors("near")).reports.radar
    assert (plots.origin == -1).all()
    mine = plots.sensor == 0
    assert mine.sum() == pytest.approx(0.5 * 10 * 600.0 / 4.0, rel=0.1)
    assert plots.range_m[mine].mean() == pytest.approx(2.0 * NAUTICAL_MILE_M, abs=5.0)
    assert plots.azimuth_deg[mine].mean() == pytest.approx(90.0, abs=0.1)
    assert len(recorded(count=0, cycles=20, standing=StandingEchoes(count=100, clustered_share=0.6)).reports.radar) > 500


def test_vessels_come_into_view_and_are_lost_again():
    truth = RadarTruth(visible_share=0.4, visible_s=60.0, unseen=(3, 5))
    plots = recorded(count=60, cycles=600, radar=truth, where=sensors("far"), motion=STILL).reports.radar
    whole = recorded(count=60, cycles=600, where=sensors("far"), motion=STILL).reports.radar
    assert len(plots) / len(whole) == pytest.approx(0.4 * 58 / 60, abs=0.06)
    assert not np.isin([3, 5], plots.origin).any()
    one = np.sort(plots.time_s[(plots.origin == plots.origin[0]) & (plots.sensor == plots.sensor[0])])
    gaps = np.diff(one)
    assert (gaps < 5.0).mean() > 0.8, "in pieces: mostly one turn after the other"
    assert gaps.max() > 30.0
    with pytest.raises(ValueError, match="unseen: got vessel 60, needed numbers below"):
        recorded(count=60, radar=RadarTruth(unseen=(60,)))


def test_the_azimuth_bias_steps_when_asked():
    truth = RadarTruth(azimuth_bias_deg=1.0, azimuth_step_deg=4.0, azimuth_step_s=60.0)
    plain, stepped = recorded(cycles=40).reports.radar, recorded(cycles=40, radar=truth).reports.radar
    off = (stepped.azimuth_deg - plain.azimuth_deg) % 360.0
    late = plain.time_s - plain.time_s.min() > 62.0
    assert off[late] == pytest.approx(5.0)
    assert off[plain.time_s - plain.time_s.min() < 58.0] == pytest.approx(1.0)


def test_the_antenna_stands_before_the_echo_along_the_course():
    lanes = Lanes(share=1.0, sway_m=0.0, length_nm=50.0)
    exact = {"position_sigma_m": 0.0, "velocity_sigma_kn": 0.0, "wire_steps": False}
    plain, off = (
        recorded(count=60, motion=STILL, lanes=lanes, ais=AisTruth(antenna_sigma_m=sigma, **exact)).reports.ais
        for sigma in (0.0, 20.0)
    )
    away = np.array([to_plane(b, a) for a, b in zip(plain.position_deg, off.position_deg, strict=True)])
    course = np.radians(plain.cog_deg)
    ahead, aside = (
        (away * np.column_stack([np.sin(course), np.cos(course)])).sum(1),
        (away * np.column_stack([np.cos(course), -np.sin(course)])).sum(1),
    )
    assert np.abs(aside).max() < 0.1
    of_vessel = np.array([ahead[plain.origin == v].mean() for v in np.unique(plain.origin)])
    assert np.std(of_vessel) == pytest.approx(20.0, rel=0.5)
    assert max(np.ptp(ahead[plain.origin == v]) for v in np.unique(plain.origin)) < 0.5


def test_what_cannot_be_is_refused():
    with pytest.raises(ValidationError, match=r"detection_from: got 0\.9"):
        StandingEchoes(detection_from=0.9, detection_to=0.1)
    with pytest.raises(ValueError, match=r"input\.moored: got 9 vessels, needed at most input\.count = 5"):
        recorded(count=5, moored=(row(9),))
    with pytest.raises(ValueError, match=r"lanes\.share"):
        recorded(count=5, lanes=Lanes(share=0.7), anchorages=Anchorages(share=0.7))
