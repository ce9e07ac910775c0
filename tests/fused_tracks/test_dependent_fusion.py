"""Fusion of tracks whose errors share process noise: the methods against the textbook, and their figures against exact ones."""

from dataclasses import replace

import numpy as np
import pytest
from test_fused_tracks import KINDS, associated, tracks
from two_filters_textbook import Pair

from coastwatch.batches import Measurements
from coastwatch.fused_tracks import Convex, Dependent, FusionInput, PartialFeedback
from coastwatch.geodesy import difference_m, offset_deg
from coastwatch.kernels.fusion import cross_covariance
from coastwatch.reproduction import two_filters
from coastwatch.reproduction.two_filters import TwoFilters

pytestmark = pytest.mark.oracle

NOISE, RADAR_M2, AIS_M2, EVERY = 0.09, 60.0, 9.0, 5
ORIGIN = np.array([63.0, 10.0])
ROUNDING = 1e-6  # of positions in degrees and back
EXACT = {  # of the specification: noise, radar variance, anees of independent, rmse of dependent or feedback, and of Kalman
    "both every second": (TwoFilters(process_noise_m2_s3=0.5, radar_variance_m2=5.0), 5.829, 2.229, 2.180),
    "restless": (TwoFilters(process_noise_m2_s3=3.0, radar_variance_m2=1.0), 5.713, 2.154, 2.112),
    "AIS every 6 s": (
        TwoFilters(process_noise_m2_s3=0.5, radar_variance_m2=30.0, ais_variance_m2=10.0, ais_every=6, ais_messages=300,
                   scored_from=1, feedback=True), 5.888, 4.711, 4.690),
}  # fmt: skip
SELDOM = TwoFilters(process_noise_m2_s3=0.09, radar_variance_m2=60.0, ais_variance_m2=9.0, radar_every=2, ais_every=12,
                    ais_messages=60, scored_from=60, feedback=True)  # fmt: skip


def batch(state, covariance, time_s, updated_s):
    """A radar and an AIS track at these states, metres from ORIGIN."""
    made = tracks(np.array([0, 0]), np.array([0, 2]), time_s=time_s)
    east_north = np.array([s[:2] for s in state])
    place = offset_deg(np.broadcast_to(ORIGIN, (2, 2)), east_north)
    velocity = np.array([s[2:] for s in state])
    return replace(
        made, position_deg=place, velocity_m_s=velocity, covariance=np.array(covariance), updated_s=np.array(updated_s)
    )


def plot_of(z, time_s):
    covariance = np.full((1, 4, 4), np.nan)
    covariance[0, :2, :2] = RADAR_M2 * np.eye(2)
    return Measurements(
        np.array([0]), np.array([0]), np.array([time_s]), offset_deg(ORIGIN[None], z[None]), np.full((1, 2), np.nan), covariance,
        ORIGIN[None],
    )  # fmt: skip


def test_the_methods_are_the_textbooks_filters():
    """A plot each second but every third, an AIS report every fifth: all cases of a cycle, two predictions too."""
    rng, start = np.random.default_rng(7), np.diag([RADAR_M2, RADAR_M2, 9.0, 9.0])
    x = np.zeros(4)
    pair = Pair(rng.normal(0.0, 5.0, 4), start, rng.normal(0.0, 3.0, 4), 0.3 * start, NOISE)
    methods = Convex(), Dependent(noise_m2_s3=NOISE), PartialFeedback(noise_m2_s3=NOISE)
    memory, updated = [m.init() for m in methods], [0.0, 0.0]
    for k in range(40):
        plot = x[:2] + rng.normal(0.0, RADAR_M2**0.5, 2) if k and k % 3 else None
        report = x[:2] + rng.normal(0.0, AIS_M2**0.5, 2) if k and k % EVERY == 0 else None
        wanted = pair.step(plot, RADAR_M2, report, AIS_M2, first=k == 0)
        updated = [float(k) if plot is not None else updated[0], float(k) if report is not None else updated[1]]
        t = batch((pair.radar[0], pair.ais[0]), (pair.radar[1], pair.ais[1]), float(k), updated)
        measured = Measurements.empty() if plot is None else plot_of(plot, float(k))
        for n, (method, (mean, covariance)) in enumerate(zip(methods, wanted, strict=True)):
            memory[n], fused = method.step(memory[n], FusionInput(t, measured, associated(np.array([0, 0])), float(k), KINDS))
            found = [*difference_m(fused.position_deg[0], ORIGIN), *fused.velocity_m_s[0]]
            np.testing.assert_allclose(found, mean, atol=1e-4, err_msg=f"{method.method}, second {k}")
            np.testing.assert_allclose(fused.covariance[0], covariance, rtol=ROUNDING, atol=ROUNDING)
        np.testing.assert_allclose(pair.c_fed, pair.fed[1], rtol=1e-9, atol=1e-12)
    assert not np.allclose(wanted[0][1], wanted[1][1], rtol=0.01)


def test_three_tracks_that_share_noise_fuse_as_generalised_least_squares():
    t = tracks(np.array([0, 0, 0]), np.array([0, 1, 2]))
    method = Dependent(noise_m2_s3=0.5)
    memory, _ = method.step(method.init(), FusionInput(t, Measurements.empty(), associated(np.array([0, 0, 0])), 0.0, KINDS))
    later = replace(t, covariance=cross_covariance.predicted(t.covariance, np.full(3, 2.0), 0.5))
    _, fused = method.step(memory, FusionInput(later, Measurements.empty(), associated(np.array([0, 0, 0])), 2.0, KINDS))
    shared = cross_covariance.predicted(np.zeros((1, 4, 4)), np.array([2.0]), 0.5)[0]
    joint = np.tile(shared, (3, 3))
    for k in range(3):
        joint[4 * k : 4 * k + 4, 4 * k : 4 * k + 4] = later.covariance[k]
    g = np.tile(np.eye(4), (3, 1))
    np.testing.assert_allclose(fused.covariance[0], np.linalg.inv(g.T @ np.linalg.solve(joint, g)), rtol=1e-6)


def test_a_cross_covariance_that_cannot_be_counts_as_none():
    t = tracks(np.array([0, 0]), np.array([0, 2]))
    method = Dependent()
    memory, first = method.step(method.init(), FusionInput(t, Measurements.empty(), associated(np.array([0, 0])), 0.0, KINDS))
    wrong = replace(memory, cross=1e6 * np.ones((1, 4, 4)))
    _, fused = method.step(wrong, FusionInput(t, Measurements.empty(), associated(np.array([0, 0])), 0.0, KINDS))
    np.testing.assert_allclose(fused.covariance, first.covariance)


@pytest.mark.parametrize("case", EXACT)
def test_exact_figures_are_those_of_the_specification(case):
    settings, independent, second, kalman = EXACT[case]
    found = two_filters.exact(settings)
    assert found[0, 0] == pytest.approx(independent, abs=1e-3)
    assert found[1:, 0] == pytest.approx([4.0, 4.0], abs=1e-3)
    assert found[1:, 1] == pytest.approx([second, kalman], abs=1e-3)


def test_two_predictions_propagate_the_cross_covariance():
    left = SELDOM.model_copy(update={"propagated": False})
    assert two_filters.exact(SELDOM)[1, 0] == pytest.approx(4.0, abs=1e-3)
    assert two_filters.exact(left)[1, 0] > 4.7
    assert two_filters.exact(SELDOM)[1, 1] < 0.96 * two_filters.exact(left)[1, 1]


def test_simulated_runs_agree_with_the_exact_figures():
    """Seeds 0 to 99: within 3 standard errors of the mean of each figure, 3.5 for the largest of nine."""
    settings = EXACT["both every second"][0]
    runs = np.array([two_filters.run(settings, seed) for seed in range(100)])
    error = runs.std(0, ddof=1) / 10.0
    assert np.abs((runs.mean(0) - two_filters.exact(settings)) / error).max() < 3.5
