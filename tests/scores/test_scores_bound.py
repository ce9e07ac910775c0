"""The physical bound: equal to the textbook filter, consistent, and below what other filters reach."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest
from nees_band import band
from simulated_world import START_S, recorded

from coastwatch.batches import Noise, RadarReports, Trajectories
from coastwatch.geodesy import KNOT_M_S, difference_m, to_plane, turn
from coastwatch.scores.bound import bound
from coastwatch.scores.nees import nees
from coastwatch.sensors.simulated.harbour import Lanes

pytestmark = pytest.mark.oracle

INSTANTS = START_S + 3.0 * np.arange(21, 61)
STEPS_APART = 20  # instants between two errors that count as independent: a minute
PLANES_M = 0.01  # the slow one adds in one plane, the fast one goes over the Earth: centimetres at 10 km, weighted down
TURNING = {"circular_weight": 1.0, "linear_weight": 0.0}


def run(count=60, cycles=60, **settings):
    made = recorded(count, cycles, ais={"share": 1.0, **settings.pop("ais", {})}, **settings)
    return made, bound(made.truth, made.reports.radar, made.reports.ais, made.noise, INSTANTS)


def misses(made, best):
    return difference_m(best.position_deg, made.truth.position_deg[:, 21:61]), best.velocity_m_s - made.truth.velocity_m_s[
        :, 21:61
    ]


def rms(off):
    return float(np.sqrt((off**2).sum(-1).mean()))


def textbook(made, v):
    """One vessel, one event at a time, straight motion, in the plane at its first true position."""
    truth, noise, r, a = made.truth, made.noise, made.reports.radar, made.reports.ais
    origin = truth.position_deg[v, 0]
    events = [(t, 2, None, None) for t in truth.kick_s[v] if np.isfinite(t)] + [(t, 3, None, None) for t in INSTANTS]
    for i in np.flatnonzero(r.origin == v):
        angle = np.radians(r.azimuth_deg[i])
        said = turn(r.site_deg[i], origin) @ [np.sin(angle), np.cos(angle)]
        far = r.range_m[i] * np.exp(0.5 * noise.azimuth_sigma_rad[r.sensor[i]] ** 2)
        at = turn(r.site_deg[i], origin) @ to_plane(truth.at(r.time_s[i]).position_deg[v], r.site_deg[i])
        along, d = at / np.linalg.norm(at), np.linalg.norm(at)
        spread = np.column_stack([along, [-along[1], along[0]]])
        sigma = np.diag([noise.range_sigma_m[r.sensor[i]], d * noise.azimuth_sigma_rad[r.sensor[i]]]) ** 2
        events.append((r.time_s[i], 0, to_plane(r.site_deg[i], origin) + far * said, spread @ sigma @ spread.T))
    for i in np.flatnonzero(a.origin == v):
        course = np.radians(a.cog_deg[i])
        events.append((a.time_s[i], 0, to_plane(a.position_deg[i], origin), noise.ais_position_sigma_m**2 * np.eye(2)))
        velocity = a.sog_kn[i] * KNOT_M_S * np.array([np.sin(course), np.cos(course)])
        events.append((a.time_s[i], 1, velocity, noise.ais_velocity_sigma_m_s**2 * np.eye(2)))
    x, p, last, out = np.zeros(4), np.diag([1e8, 1e8, 100.0, 100.0]), min(e[0] for e in events), []
    for t, kind, z, cov in sorted(events, key=lambda e: (e[0], e[1])):
        f = np.eye(4)
        f[0, 2] = f[1, 3] = t - last
        x, p, last = f @ x, f @ p @ f.T, t
        if kind in (0, 1):
            h = np.eye(4)[2 * kind : 2 * kind + 2]
            gain = p @ h.T @ np.linalg.inv(h @ p @ h.T + cov)
            x, p = x + gain @ (z - h @ x), p - gain @ h @ p
        elif kind == 2:
            p = p + np.diag([0.0, 0.0, 1.0, 1.0]) * truth.kick_m_s[v] ** 2
        else:
            out.append(x[:2])
    return np.array(out), origin


def test_equals_the_textbook_filter():
    made, best = run(4, motion={"process_noise_fraction": 0.2})
    for v in range(4):
        slow, origin = textbook(made, v)
        np.testing.assert_allclose(to_plane(best.position_deg[v], origin), slow, atol=PLANES_M)


@pytest.mark.parametrize(
    "motion",
    [
        {},
        {"process_noise": "rw1", "process_noise_fraction": 0.3},
        {"process_noise": "ou"},
        TURNING,
        {"process_noise": "ou", **TURNING},
        {"accelerated_weight": 1.0, "linear_weight": 0.0},
    ],
    ids=str,
)
def test_covariance_is_as_large_as_the_errors(motion):
    made, best = run(300, motion=motion)
    off = np.concatenate(misses(made, best), axis=-1)[:, ::STEPS_APART]
    values = nees(off.reshape(-1, 4), best.covariance[:, ::STEPS_APART].reshape(-1, 4, 4))
    low, high = band(len(values), 4, 1e-6)
    assert low < values.mean() < high


def test_biases_are_known_to_the_bound():
    wrong = {
        "range_bias_m": 50.0,
        "azimuth_bias_deg": 1.0,
        "time_bias_s": 2.0,
        "noise_factor": 2.0,
        "site_error_m": [60.0, 0.0],
    }
    made, best = run(150, radar=wrong, ais={"interval_s": 30.0})
    off = np.concatenate(misses(made, best), axis=-1)[:, ::STEPS_APART]
    values = nees(off.reshape(-1, 4), best.covariance[:, ::STEPS_APART].reshape(-1, 4, 4))
    low, high = band(len(values), 4, 1e-6)
    assert low < values.mean() < high


@pytest.mark.parametrize("factor", [0.3, 3.0])
@pytest.mark.parametrize("what", ["kick_m_s", "ais_position_sigma_m", "azimuth_sigma_rad"])
def test_no_filter_with_another_model_is_better(what, factor):
    made, best = run(300, ais={"interval_s": 10.0})
    truth, noise = made.truth, made.noise
    if what == "kick_m_s":
        truth = replace(truth, kick_m_s=factor * truth.kick_m_s)
    else:
        noise = replace(noise, **{what: factor * getattr(noise, what)})
    other = bound(truth, made.reports.radar, made.reports.ais, noise, INSTANTS)
    known, wrong = np.concatenate(misses(made, best), axis=-1), np.concatenate(misses(made, other), axis=-1)
    weight = np.linalg.inv(best.covariance)
    loss = [np.einsum("vti,vtij,vtj->", off, weight, off) for off in (known, wrong)]
    assert loss[0] < loss[1]


def test_below_raw_reports_and_every_sensor_helps():
    made, best = run(200)
    alone = bound(made.truth, RadarReports.empty(), made.reports.ais, made.noise, INSTANTS)
    blind = bound(made.truth, made.reports.radar, made.reports.ais.take(slice(0, 0)), made.noise, INSTANTS)
    errors = [rms(misses(made, b)[0]) for b in (best, alone)]
    assert errors[0] < errors[1] < 3.33 * np.sqrt(2.0)
    seen = np.bincount(made.reports.radar.origin, minlength=200) > 60
    both, radar = (b.covariance[seen][..., :2, :2].trace(axis1=2, axis2=3) for b in (best, blind))
    assert (both < radar).all()


def test_lies_do_not_count():
    honest, best = run(100, ais={})
    spoofed, still = run(100, ais={"spoofing_share": 1.0, "spoofing_from_s": 60.0, "spoofing_drift_m_s": 50.0})
    assert rms(misses(spoofed, still)[0]) < 3.0 * rms(misses(honest, best)[0]) + 10.0
    assert np.abs(misses(spoofed, still)[0]).max() < 200.0


def test_vessels_that_stop_have_no_bound():
    made, best = run(40, motion={"stopping_share": 0.5})
    stops = np.isnan(made.truth.kick_m_s)
    assert stops.sum() == 20
    assert np.isnan(best.position_deg[stops]).all()
    assert np.isfinite(best.position_deg[~stops]).all()


def test_no_vessel_no_report():
    made, best = run(0)
    assert best.position_deg.shape == (0, 40, 2)
    one, _ = run(1)
    few = Trajectories(**{f.name: getattr(one.truth, f.name) for f in fields(one.truth)})
    noise = Noise(np.ones(2), np.ones(2), np.zeros(2), np.zeros(2), np.zeros(2), np.zeros((2, 2)), 1.0, 1.0)
    nothing = bound(few, RadarReports.empty(), made.reports.ais, noise, INSTANTS)
    assert (nothing.covariance[..., 0, 0] > 1e7).all()


def test_vessels_that_sway_in_lanes_have_no_bound_and_the_others_keep_theirs():
    made, best = run(60, lanes=Lanes(share=0.7, sway_m=25.0))
    unbound = np.isnan(best.position_deg).all(axis=(1, 2))
    assert unbound.sum() == 42
    assert (np.isfinite(best.position_deg).all(axis=(1, 2)) == ~unbound).all()
    assert np.isnan(best.covariance[unbound]).all()
    (position, _), (of_plain, _) = misses(made, best), misses(*run(60))
    assert rms(position[~unbound]) < 1.2 * rms(of_plain[~unbound]), "the ones with a bound are not in lanes"
    assert np.isnan(run(20, lanes=Lanes(share=1.0))[1].position_deg).all()
