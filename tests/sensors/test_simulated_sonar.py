"""What simulated sensors of bearings report."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import binom
from simulated_world import LEVEL, START_S, assert_unit_normal, recorded, sensors

from coastwatch.batches import CLASS_OF_TYPE, CLASSES
from coastwatch.geodesy import NAUTICAL_MILE_M, to_plane, wrap_deg

pytestmark = pytest.mark.contract

CYCLES = 60


def heard(count=200, **settings):
    """The reports and where the vessels were then: the truth stands every 3 s, as the sonar listens."""
    made = recorded(count, CYCLES, motion={"process_noise": "none"}, **settings)
    return made.reports.bearing, made.truth


def true_relative(reports, truth):
    out = np.empty((len(reports), 2))
    for time in np.unique(reports.time_s):
        now, rows = truth.at(time), reports.time_s == time
        out[rows] = to_plane(now.position_deg[reports.origin[rows]], reports.site_deg[rows])
    return out


def test_noise_range_and_common_instants():
    reports, truth = heard()
    at = true_relative(reports, truth)
    bearing = np.degrees(np.arctan2(at[:, 0], at[:, 1]))
    assert_unit_normal(wrap_deg(reports.bearing_deg - bearing) / 1.0)
    assert np.hypot(at[:, 0], at[:, 1]).max() <= 4.0 * NAUTICAL_MILE_M + 1.0
    times = np.unique(reports.time_s)
    np.testing.assert_allclose(np.diff(times), 3.0)
    assert len(times) == CYCLES
    assert ((reports.bearing_deg >= 0.0) & (reports.bearing_deg < 360.0)).all()


@pytest.mark.parametrize(("first", "last"), [(90.0, 270.0), (300.0, 30.0), (0.0, 360.0), (45.0, 45.0)])
def test_arc(first, last):
    where = sensors(arc_from_deg=first, arc_to_deg=last)
    reports, _ = heard(where=where, sonar={"noise_factor": 0.0})
    width = (last - first) % 360.0 or 360.0
    assert ((reports.bearing_deg - first) % 360.0 <= width).all()
    whole, _ = heard(sonar={"noise_factor": 0.0})
    assert len(reports) / len(whole) == pytest.approx(width / 360.0, abs=0.12)


def test_bias_misses_and_latency():
    plain, _ = heard()
    reports, _ = heard(sonar={"bias_deg": 0.5, "miss_probability": 0.3, "latency_s": 1.0})
    low, high = binom.ppf([LEVEL / 2, 1 - LEVEL / 2], len(plain), 0.7)
    assert low - 200 <= len(reports) <= high  # what arrives after the end is cut off: one instant
    np.testing.assert_allclose(reports.received_s - reports.time_s, 1.0)
    key = {(o, t): b for o, t, b in zip(plain.origin, plain.time_s, plain.bearing_deg, strict=True)}
    off = [b - key[o, t] for o, t, b in zip(reports.origin, reports.time_s, reports.bearing_deg, strict=True)]
    np.testing.assert_allclose(wrap_deg(np.array(off)), 0.5, atol=1e-9)


def test_contacts_are_numbered_by_the_sensor():
    reports, _ = heard()
    pairs = np.unique(np.column_stack([reports.origin, reports.contact]), axis=0)
    assert len(pairs) == len(np.unique(reports.origin)) == len(np.unique(reports.contact))
    assert (reports.contact > 0).all()
    assert (pairs[:, 0] != pairs[:, 1]).any()
    nameless, _ = heard(sonar={"numbered": False})
    assert (nameless.contact == -1).all()
    np.testing.assert_array_equal(nameless.bearing_deg, reports.bearing_deg[np.lexsort((reports.origin, reports.received_s))])


def test_order_of_arrival_and_names():
    reports, _ = heard(sonars=[{"name": "sonar", "bias_deg": 3.0}])
    assert (np.diff(reports.received_s) >= 0.0).all()
    assert reports.received_s.min() > START_S
    with pytest.raises(ValueError, match=r"input\.sonars"):
        heard(sonars=[{"name": "radar"}])


def said_of(accuracy, habit, share=1.0, count=400):
    """Reports by a sonar that says classes, the true class of each, and the class that is sent of each vessel."""
    made = recorded(
        count,
        CYCLES,
        sonar={"signature_share": share, "signature_accuracy": accuracy, "signature_habit": habit},
        ais={"share": 1.0},
    )
    types = dict(zip(made.reports.statics.mmsi.tolist(), made.reports.statics.ship_type.tolist(), strict=True))
    ship = dict(zip(made.reports.ais.origin.tolist(), made.reports.ais.mmsi.tolist(), strict=True))
    reports = made.reports.bearing
    return reports, np.array([CLASS_OF_TYPE[types[ship[o]]] for o in reports.origin.tolist()])


def test_signatures_are_of_the_true_type_as_often_as_said():
    reports, true = said_of(0.6, 0.0, share=0.5)
    told = reports.signature >= 0
    low, high = binom.ppf([LEVEL / 2, 1 - LEVEL / 2], len(reports), 0.5)
    assert low <= told.sum() <= high
    low, high = binom.ppf([LEVEL / 2, 1 - LEVEL / 2], told.sum(), 0.6)
    assert low <= (reports.signature == true)[told].sum() <= high
    wrong = reports.signature[told & (reports.signature != true)]
    assert set(wrong.tolist()) == set(range(CLASSES))


def test_a_habit_is_kept_of_each_vessel():
    reports, true = said_of(0.6, 0.95)
    vessels = np.unique(reports.origin)
    right = np.array([(reports.signature == true)[reports.origin == v].mean() for v in vessels])
    assert ((right > 0.8) | (right < 0.2)).all()  # 0.95 + 0.05 * 0.6 or 0.05 * 0.6, of up to sixty looks
    low, high = binom.ppf([LEVEL / 2, 1 - LEVEL / 2], len(vessels), 0.6)
    assert low <= (right > 0.5).sum() <= high


def test_signatures_change_nothing_else():
    plain, _ = heard()
    reports, _ = heard(sonar={"signature_share": 0.5})
    assert (plain.signature == -1).all()
    np.testing.assert_array_equal(plain.bearing_deg, reports.bearing_deg)
    np.testing.assert_array_equal(plain.contact, reports.contact)
