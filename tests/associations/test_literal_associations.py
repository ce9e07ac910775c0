"""The failure modes of eq. 7 as it stands, beside what the default makes of the same water; and the scores of all candidate pairs."""

import copy
from dataclasses import replace

import numpy as np
import pytest
from pydantic import ValidationError
from scipy import stats
from test_associations import Water, crowd, f1, pair_of, quiet, run

from coastwatch.associations import (
    AssociationInput,
    Candidates,
    WindowedCovariance,
    WindowedCovarianceLiteral,
    step_with_candidates,
)
from coastwatch.geodesy import difference_m
from coastwatch.server.checkpoint import save
from coastwatch.spots import KMeansSpots
from coastwatch.stage import serial

pytestmark = pytest.mark.contract

NEAREST = WindowedCovarianceLiteral()
WIDE = WindowedCovarianceLiteral(confidence=0.9999, one_to_one=True)
HOTELLING = WindowedCovarianceLiteral(confidence=0.999, one_to_one=True, threshold="hotelling")
SAMPLING = 0.018  # five standard deviations of a share of 20,000 draws
SETTLED = 10  # cycles, the window of the methods above


def water_with(correlation, seed=4):
    water = crowd(seed)
    water.correlation = correlation
    return water


def mean_f1(method, water, cycles=30, **kwargs):
    return np.mean([f1(t, found) for t, found in run(method, water, cycles, **kwargs)[SETTLED:]])


@pytest.mark.parametrize("p", [1, 2, 3, 4])
def test_four_differences_or_fewer_have_a_singular_covariance_and_are_refused(p):
    with pytest.raises(ValidationError, match="greater than or equal to 5"):
        WindowedCovarianceLiteral(window=p)


def test_limits_are_the_quantiles_of_the_two_distributions():
    assert NEAREST.limit() == pytest.approx(9.4877, abs=1e-4)  # chi-square, 4 degrees of freedom, from any table
    assert HOTELLING.limit() == pytest.approx(4.0 * 9.0 / 6.0 * stats.f.ppf(0.999, 4, 6))


@pytest.mark.parametrize(("p", "passes"), [(5, 0.504), (6, 0.746), (8, 0.912), (10, 0.953), (20, 0.965)])
def test_independent_differences_pass_the_chi_square_test_from_ten_on(p, passes):
    """The newest difference is in its own covariance, which bounds x: from p = 10 on chi-square is right, Hotelling too wide."""
    method = WindowedCovarianceLiteral(window=p)
    delta = np.random.default_rng([12, p]).normal(size=(20_000, p, 4))
    centred = delta - delta.mean(1, keepdims=True)
    phi = np.einsum("npi,npj->nij", centred, centred) / (p - 1)
    x = np.einsum("ni,nij,nj->n", delta[:, -1], np.linalg.inv(phi), delta[:, -1])
    assert (x < method.limit()).mean() == pytest.approx(passes, abs=SAMPLING)
    assert (x < method.model_copy(update={"threshold": "hotelling"}).limit()).mean() > 0.97


def test_the_more_alike_errors_are_from_cycle_to_cycle_the_more_true_pairs_are_refused():
    """Errors AR(1) with 0, 0.8 and 0.95; measured 97, 56 and 9 %."""
    literal = [mean_f1(NEAREST, water_with(c)) for c in (0.0, 0.8, 0.95)]
    assert literal[0] > 0.95
    assert 0.4 < literal[1] < 0.7
    assert literal[2] < 0.2
    assert mean_f1(HOTELLING, water_with(0.95)) < 0.95
    assert mean_f1(WindowedCovariance(), water_with(0.95)) >= 0.99


def test_a_constant_registration_bias_parts_nearly_all_pairs():
    """The mean is taken off the window but not off the difference. Measured 0.3, 3 and 69 %."""
    bias_m = (30.0, -20.0)
    assert mean_f1(NEAREST, crowd(6), bias_m=bias_m) < 0.05
    assert mean_f1(WIDE, crowd(6), bias_m=bias_m) < 0.1
    assert mean_f1(HOTELLING, crowd(6), bias_m=bias_m) < 0.85
    assert mean_f1(WindowedCovariance(), crowd(6), bias_m=bias_m) >= 0.99


def velocity_of_noise(tracks, cycle):
    """The sources know positions alone: what they say of the velocity is noise."""
    rng = np.random.default_rng([cycle, 8])
    covariance = tracks.covariance.copy()
    covariance[:, 2:, 2:] = 25.0 * np.eye(2)
    return replace(tracks, velocity_m_s=rng.normal(0.0, 0.5, tracks.velocity_m_s.shape), covariance=covariance)


def test_drift_swells_the_covariance_until_a_ship_171_m_off_is_accepted():
    """Two ships close in on one line at 12 m/s, are 171 m apart at the end, and the window has seen 324 m of drift."""
    water = [[0.0, 0.0], [0.0, 171.0 + 20 * 3.0 * 12.0]], [[0.0, 0.0], [0.0, -12.0]]
    accepted = []
    for seed in range(10):
        out = [run(m, pair_of(*water, seed), 21, look=velocity_of_noise) for m in (WIDE, HOTELLING, WindowedCovariance())]
        tracks = out[0][-1][0]
        assert np.hypot(*difference_m(tracks.position_deg[1], tracks.position_deg[0])) > 140.0
        accepted.append([len(cycles[-1][1].first) for cycles in out])
    wide, hotelling, default = np.sum(accepted, axis=0)
    assert wide >= 7
    assert hotelling == 10
    assert default == 0


@pytest.mark.parametrize("apart_m", [20.0, 50.0, 100.0])
def test_parallel_ships_are_missed_rather_than_swapped(apart_m):
    both = np.array([True, True])
    water = [[0.0, 0.0], [apart_m, 0.0]], [[0.0, 5.0], [0.0, 5.0]], [both, both]
    right, wrong = 0, 0
    for tracks, found in run(NEAREST, Water(7, *water), 40)[SETTLED:]:
        same = tracks.origin[found.first] == tracks.origin[found.second]
        right, wrong = right + int(same.sum()), wrong + int((~same).sum())
    assert right < 45  # of 60
    assert wrong <= 1
    assert mean_f1(HOTELLING, Water(7, *water)) >= 0.95


def test_a_parallel_stranger_at_a_constant_distance_is_refused():
    for apart_m in (50.0, 100.0):
        out = run(WIDE, pair_of([[0.0, 0.0], [apart_m, 0.0]], [[0.0, 5.0], [0.0, 5.0]]), 40)
        assert sum(len(found.first) for _, found in out) == 0


@pytest.mark.parametrize("method", [NEAREST, WIDE, HOTELLING])
def test_a_pair_a_few_metres_apart_within_a_centimetre_is_always_refused(method):
    one = np.array([True])
    out = run(method, Water(8, [[0.0, 0.0]], [[0.0, 0.0]], [one, one]), 40, look=quiet)
    assert sum(len(found.first) for _, found in out) == 0


@pytest.mark.parametrize("method", [WindowedCovariance(), NEAREST, HOTELLING], ids=lambda m: m.method)
def test_candidates_are_all_pairs_and_the_step_is_the_same(method):
    water, spots = crowd(13, n=80), KMeansSpots(count=3)
    memory, spot_memory = method.init(), spots.init()
    for cycle in range(14):
        tracks = water.tracks(cycle)
        spot_memory, s = spots.step(spot_memory, tracks)
        plain_memory, plain = method.step(copy.deepcopy(memory), AssociationInput(tracks, s, serial))
        memory, found, candidates = step_with_candidates(method, memory, AssociationInput(tracks, s))
        assert save(memory) == save(plain_memory)
        for name in ("first", "second", "statistic", "vessel"):
            np.testing.assert_array_equal(getattr(found, name), getattr(plain, name))
    assert isinstance(candidates, Candidates)
    pairs = list(zip(candidates.first.tolist(), candidates.second.tolist(), strict=True))
    assert pairs == sorted(set(pairs))
    apart = difference_m(tracks.position_deg[:, None], tracks.position_deg[None])
    near = (np.hypot(apart[..., 0], apart[..., 1]) < method.gate_m) & (tracks.source[:, None] < tracks.source[None])
    assert set(pairs) == set(zip(*(x.tolist() for x in np.nonzero(near)), strict=True))
    score = dict(zip(pairs, candidates.score.tolist(), strict=True))
    sign = -1.0 if method.method == "windowed_covariance_literal" else 1.0
    for a, b, statistic in zip(found.first.tolist(), found.second.tolist(), found.statistic.tolist(), strict=True):
        assert score[(a, b)] == sign * statistic
    same = tracks.origin[candidates.first] == tracks.origin[candidates.second]
    assert np.median(candidates.score[same]) > np.quantile(candidates.score[~same], 0.99)
