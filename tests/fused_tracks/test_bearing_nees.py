"""Are the covariances of vessels right that have plots and bearings, and of those that only bearings hold?

The motion is that of the filter's model, one sample a vessel, 400 vessels. The bands are left by chance once in a million.
"""

import numpy as np
import pytest
from nees_band import band

from coastwatch.batches import Associations, Measurements, Tracks, VesselBearings
from coastwatch.fused_tracks import CentralImm, FusionInput
from coastwatch.geodesy import difference_m, offset_deg, wrap_rad
from coastwatch.scores.nees import nees

pytestmark = pytest.mark.consistency

SITE = np.array([58.0, 10.0])
VESSELS, PERIOD_S, SIGMA_RAD, PLOT_M = 400, 3.0, np.radians(1.0), 30.0
NOISE_M2_S3 = 1e-3
CHANCE, DIMENSION = 1e-6, 4
KINDS = np.array([0, 1, 2])
METHOD = CentralImm(
    noise_m2_s3=(NOISE_M2_S3, 1e-3, 1e-3, 1e-3),
    share=(1.0, 1e-9, 1e-9, 1e-9),
    sojourn_s=(1e15, 1e-3, 1e-3, 1e-3),
    velocity_jump_m_s=0.0,
    bearing_floor_m=0.0,
    bearing_gate_sigmas=10.0,
)


def moved(rng, state):
    """The states (V, 4) after a cycle of white acceleration."""
    f, q = np.eye(4), np.zeros((4, 4))
    for k in (0, 1):
        f[k, k + 2] = PERIOD_S
        q[k, k], q[k, k + 2] = PERIOD_S**3 / 3.0, PERIOD_S**2 / 2.0
        q[k + 2, k], q[k + 2, k + 2] = PERIOD_S**2 / 2.0, PERIOD_S
    return state @ f.T + rng.multivariate_normal(np.zeros(4), NOISE_M2_S3 * q, len(state))


def samples(seed, with_plots, without, bias_rad=0.0):
    """NEES of all vessels after cycles with plots and bearings, and then cycles with bearings alone."""
    rng = np.random.default_rng([seed, 77])
    number, none, unknown = np.arange(VESSELS), np.zeros(0, np.int64), np.full(VESSELS, -1)
    angle, distance = rng.uniform(0.0, 2.0 * np.pi, VESSELS), rng.uniform(2000.0, 6000.0, VESSELS)
    state = np.column_stack([distance * np.sin(angle), distance * np.cos(angle), rng.normal(0.0, 3.0, (VESSELS, 2))])
    site, memory = np.tile(SITE, (VESSELS, 1)), METHOD.init()
    start = np.diag([50.0**2, 50.0**2, 1.0, 1.0])
    first = state + rng.multivariate_normal(np.zeros(4), start, VESSELS)
    for cycle in range(with_plots + without):
        time_s, stamp = PERIOD_S * cycle, np.full(VESSELS, PERIOD_S * cycle)
        state = moved(rng, state) if cycle else state
        said = np.arctan2(state[:, 0], state[:, 1]) + rng.normal(0.0, SIGMA_RAD, VESSELS) + bias_rad
        plot = offset_deg(site, state[:, :2] + rng.normal(0.0, PLOT_M, (VESSELS, 2)))
        zero, certain = np.zeros(VESSELS), np.ones(VESSELS)
        report = np.tile(np.eye(2) * PLOT_M**2, (VESSELS, 1, 1))
        covariance = np.tile(start, (VESSELS, 1, 1))
        tracks = Tracks(
            number,
            0 * number,
            stamp,
            offset_deg(site, first[:, :2]),
            first[:, 2:],
            covariance,
            report,
            stamp,
            zero,
            unknown,
            number,
        )
        full = np.full((VESSELS, 4, 4), np.nan)
        full[:, :2, :2] = report
        measured = Measurements(number, 0 * number, stamp, plot, np.full((VESSELS, 2), np.nan), full, site)
        groups = Associations(none, none, zero[:0], number)
        if cycle >= with_plots:
            tracks, measured = tracks.take(none), measured.take(none)
            groups = Associations(none, none, zero[:0], none)
        variance = np.full(VESSELS, SIGMA_RAD**2)
        bearings = VesselBearings(number, number, number, certain, stamp, stamp, wrap_rad(said), variance, zero, site)
        memory, fused = METHOD.step(memory, FusionInput(tracks, measured, groups, time_s, KINDS, bearings))
    off = difference_m(fused.position_deg, offset_deg(site, state[:, :2]))
    return nees(np.column_stack([off, fused.velocity_m_s - state[:, 2:]]), fused.covariance)


@pytest.mark.parametrize(("with_plots", "without"), [(20, 0), (15, 20)])
def test_where_the_model_is_true_the_covariance_is_right(with_plots, without):
    found = np.concatenate([samples(seed, with_plots, without) for seed in (1, 2)])
    low, high = band(len(found), DIMENSION, CHANCE)
    assert low < found.mean() < high


def test_a_bias_that_nobody_knows_would_be_seen():
    assert samples(1, 15, 20, bias_rad=np.radians(1.0)).mean() > band(VESSELS, DIMENSION, CHANCE)[1]
