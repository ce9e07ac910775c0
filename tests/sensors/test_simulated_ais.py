"""What simulated AIS transmitters send and what of it arrives."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy.stats import binom
from simulated_world import CENTRE_DEG, LEVEL, START_S, assert_unit_normal, recorded, sensors

from coastwatch.batches import Stations
from coastwatch.batches.ais_codes import is_vessel
from coastwatch.geodesy import KNOT_M_S, NAUTICAL_MILE_M, difference_m, wrap_deg
from coastwatch.sensors.simulated.ais import AisTruth, transmit, transponders
from coastwatch.sensors.simulated.trajectories import VesselMotion, draw_motion

pytestmark = pytest.mark.contract

SPAN_S = 180.0
STEP = 1e-6  # of a quotient that should be whole


def sent(truth, count=200, seed=6, span_s=SPAN_S, stations=None, **motion):
    rng = np.random.default_rng([seed, 98])
    anchor = CENTRE_DEG + rng.uniform(-0.1, 0.1, (count, 2))
    sailed = draw_motion(VesselMotion(**motion), anchor, START_S, span_s, seed)
    who = transponders(truth, count, seed)
    reports = transmit(truth, who, stations or Stations.empty(), sailed.state, START_S, START_S + span_s, seed)
    return reports, sailed, who


def gaps(reports, origin):
    return np.diff(np.sort(reports.time_s[reports.origin == origin]))


def test_share_and_fixed_interval():
    reports, _, who = sent(AisTruth(share=0.35, interval_s=4.0))
    assert len(who.row) == 70
    assert len(np.unique(reports.origin)) == 70
    assert len(reports) == 70 * SPAN_S / 4.0
    for origin in who.row[:5]:
        np.testing.assert_allclose(gaps(reports, origin), 4.0)
    assert reports.time_s.min() < START_S + 0.5
    assert (np.diff(reports.received_s) >= 0.0).all()


def test_exactly_half_of_an_even_number_has_ais():
    for seed in range(5):
        assert len(transponders(AisTruth(), 100, seed).row) == 50


def test_noise_of_position_and_velocity():
    truth = AisTruth(wire_steps=False, position_sigma_m=5.0, velocity_sigma_kn=0.3, interval_s=6.0)
    reports, sailed, _ = sent(truth, speed_from_kn=3.0)
    position, velocity = sailed.state(reports.origin, reports.time_s)
    assert_unit_normal(difference_m(reports.position_deg, position) / 5.0)
    course = np.radians(reports.cog_deg)
    told = reports.sog_kn[:, None] * np.column_stack([np.sin(course), np.cos(course)])
    assert_unit_normal((told - velocity / KNOT_M_S) / 0.3)


def test_the_wire_rounds():
    reports, *_ = sent(AisTruth())
    for values, step in ((reports.position_deg * 60.0, 1e-4), (reports.sog_kn, 0.1), (reports.cog_deg, 0.1)):
        np.testing.assert_allclose(values / step, np.round(values / step), atol=1e-3)
    assert (reports.cog_deg < 360.0).all()
    assert (reports.sog_kn <= 102.2).all()
    smooth, *_ = sent(AisTruth(wire_steps=False))
    assert np.abs(difference_m(smooth.position_deg, reports.position_deg)).max() < 0.1
    assert np.abs(smooth.sog_kn - reports.sog_kn).max() < 0.05 + STEP
    assert np.abs(wrap_deg(smooth.cog_deg - reports.cog_deg)).max() < 0.05 + STEP


def test_whole_seconds_and_missing_velocity():
    reports, *_ = sent(AisTruth(whole_seconds=True, velocity_missing_share=0.25))
    np.testing.assert_array_equal(reports.time_s, np.floor(reports.time_s))
    assert (reports.received_s - reports.time_s).max() < 1.0
    missing = np.isnan(reports.sog_kn)
    np.testing.assert_array_equal(missing, np.isnan(reports.cog_deg))
    low, high = binom.ppf([LEVEL / 2, 1 - LEVEL / 2], len(reports), 0.25)
    assert low <= missing.sum() <= high


@pytest.mark.parametrize(
    ("class_b", "speed_kn", "turning", "interval_s"),
    [
        (0.0, 5.0, False, 10.0),
        (0.0, 5.0, True, 10.0 / 3.0),
        (0.0, 18.0, False, 6.0),
        (0.0, 18.0, True, 2.0),
        (0.0, 30.0, False, 2.0),
        (0.0, 0.0, False, 180.0),
        (1.0, 1.0, False, 180.0),
        (1.0, 8.0, True, 30.0),
        (1.0, 18.0, False, 15.0),
        (1.0, 30.0, False, 5.0),
    ],
)
def test_itu_intervals(class_b, speed_kn, turning, interval_s):
    motion = {"speed_from_kn": speed_kn, "speed_to_kn": max(speed_kn, 1e-9), "process_noise": "none"}
    turn = {"circular_weight": 1.0, "linear_weight": 0.0, "turn_rate_from_deg_s": 0.5} if turning else {}
    reports, *_ = sent(AisTruth(intervals="itu", class_b_share=class_b), count=20, span_s=1000.0, **motion, **turn)
    assert (reports.class_b == (class_b == 1.0)).all()
    for origin in np.unique(reports.origin):
        np.testing.assert_allclose(gaps(reports, origin), interval_s)
    first = np.array([reports.time_s[reports.origin == o].min() for o in np.unique(reports.origin)]) - START_S
    assert first.max() <= interval_s
    assert np.ptp(first) > 0.2 * interval_s


def test_loss_latency_and_order():
    reports, *_ = sent(AisTruth(loss=0.3, latency_s=2.0, latency_spread_s=5.0), span_s=600.0)
    whole, *_ = sent(AisTruth(), span_s=600.0)
    early = whole.time_s < START_S + 400.0  # 35 mean latencies before the end: nothing is cut off by it
    low, high = binom.ppf([LEVEL / 2, 1 - LEVEL / 2], early.sum(), 0.7)
    assert low <= (reports.time_s < START_S + 400.0).sum() <= high
    delay = reports.received_s - reports.time_s
    assert delay.min() >= 2.0
    assert delay[reports.time_s < START_S + 400.0].mean() == pytest.approx(7.0, rel=0.05)
    assert (np.diff(reports.received_s) >= 0.0).all()
    assert (np.diff(reports.time_s) < 0.0).any()
    assert reports.received_s.max() <= START_S + 600.0


def test_only_what_a_station_hears_arrives():
    reach = 3.0 * NAUTICAL_MILE_M
    station = Stations(np.array(["one"], "U32"), CENTRE_DEG[None], np.array([reach]))
    reports, sailed, _ = sent(AisTruth(), stations=station)
    everywhere, *_ = sent(AisTruth())
    position, _ = sailed.state(everywhere.origin, everywhere.time_s)
    near = np.hypot(*difference_m(position, CENTRE_DEG).T) <= reach
    assert 0 < len(reports) < len(everywhere)
    assert abs(int(near.sum()) - len(reports)) <= 3  # the two measures of distance differ by centimetres
    np.testing.assert_array_equal(np.unique(reports.origin), np.unique(everywhere.origin[near]))


def test_silent_vessels_fall_silent_and_come_back():
    reports, _, who = sent(AisTruth(silent_share=0.2, silent_from_s=60.0, silent_to_s=120.0))
    silent = who.row[who.silent]
    assert len(silent) == 20
    elapsed = reports.time_s[np.isin(reports.origin, silent)] - START_S
    assert not ((elapsed >= 60.0) & (elapsed < 120.0)).any()
    assert (elapsed < 60.0).any()
    assert (elapsed >= 120.0).any()
    others = reports.time_s[~np.isin(reports.origin, silent)] - START_S
    assert ((others >= 60.0) & (others < 120.0)).any()


def test_silenced_vessels_are_told_to_the_scores():
    made = recorded(60, ais={"silent_share": 0.5, "silent_from_s": 0.0})
    assert len(made.silenced) == 15
    assert not np.isin(made.reports.ais.origin, made.silenced).any()


def test_spoofing_vessels_drift_away():
    reports, sailed, who = sent(
        AisTruth(spoofing_share=0.1, spoofing_from_s=60.0, spoofing_drift_m_s=8.0, position_sigma_m=0.0)
    )
    position, _ = sailed.state(reports.origin, reports.time_s)
    off = np.hypot(*difference_m(reports.position_deg, position).T)
    spoofing = np.isin(reports.origin, who.row[who.spoofing])
    expected = 8.0 * np.maximum(reports.time_s - START_S - 60.0, 0.0)
    np.testing.assert_allclose(off[spoofing], expected[spoofing], atol=0.3)
    assert off[~spoofing].max() < 0.2
    assert spoofing.any()


def test_clones_send_under_the_number_of_another():
    reports, sailed, who = sent(AisTruth(cloned_share=0.1, cloned_from_s=90.0))
    clones = who.row[who.clone]
    assert len(clones) == 10
    assert np.isin(who.mmsi[who.clone], who.mmsi[~who.clone]).all()
    assert not np.isin(clones, who.row[~who.clone]).any()
    theirs = reports.take(np.isin(reports.origin, clones))
    assert (theirs.time_s - START_S).min() >= 90.0
    position, _ = sailed.state(theirs.origin, theirs.time_s)
    assert np.hypot(*difference_m(theirs.position_deg, position).T).max() < 30.0


def test_numbers_are_vessels_numbers_and_unique():
    who = transponders(AisTruth(share=1.0), 5000, 3)
    assert len(np.unique(who.mmsi)) == 5000
    assert is_vessel(who.mmsi).all()
    assert ((who.mmsi >= 200_000_000) & (who.mmsi < 800_000_000)).all()


def test_names_come_early_and_again():
    made = recorded(300, cycles=260, ais={"static_interval_s": 360.0})
    statics = made.reports.statics
    assert len(statics) == 150 * 3  # at most 30 s, 390 s and 750 s after the start of 780 s
    first = {m: statics.received_s[statics.mmsi == m].min() for m in np.unique(statics.mmsi)}
    assert max(first.values()) <= START_S + 30.0
    assert set(first) == set(np.unique(made.reports.ais.mmsi))
    assert (np.diff(statics.received_s) >= 0.0).all()
    one = statics.take(statics.mmsi == statics.mmsi[0])
    assert len(np.unique(one.name)) == len(np.unique(one.ship_type)) == 1
    assert (np.char.str_len(statics.name) > 0).all()
    assert len(np.unique(statics.name)) > 100
    assert (statics.length_m >= 3 * statics.beam_m).all()


def test_entering_vessels_are_not_heard_before():
    made = recorded(60, motion={"entering_share": 1.0}, ais={"share": 1.0})
    truth = made.truth
    ais = made.reports.ais
    step = np.searchsorted(truth.time_s, ais.time_s)
    assert truth.present[ais.origin, np.minimum(step, len(truth.time_s) - 1)].all()


def test_no_carrier_at_all():
    made = recorded(20, ais={"share": 0.0, "cloned_share": 1.0, "intervals": "itu"})
    assert len(made.reports.ais) == len(made.reports.statics) == 0
    whole = dataclasses.replace(sensors(), stations=Stations.empty())
    assert len(recorded(0, where=whole, ais={"intervals": "itu"}).reports.ais) == 0


def test_the_vessels_that_are_named_carry_ais_and_no_other():
    made = recorded(20, ais={"carried_by": [7, 3], "share": 0.5})
    assert set(np.unique(made.reports.ais.origin)) == {3, 7}
    with pytest.raises(ValueError, match="carried_by: got vessel 20, needed numbers below input"):
        transponders(AisTruth(carried_by=(1, 20)), 20, 1)
