"""Are the covariances of tracks as large as their errors? One instant and one sample a vessel, so that samples are independent.

The normalised estimation error squared of position and velocity has mean 4 where the covariance is right. A bound is left by chance
once in a million, so red means wrong.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from nees_band import band

from coastwatch.batches import Floats, FusedTracks, Ints, SourceKind, Tracks, Truth
from coastwatch.centre import Cycle
from coastwatch.geodesy import difference_m
from coastwatch.kernels.tables.lookup import row_of
from coastwatch.scenario import load_scenario
from coastwatch.scores.nees import nees
from coastwatch.scores.rmse import whole_vessels
from coastwatch.server.run import run_scenario

pytestmark = pytest.mark.consistency

SEEDS = (2001, 2002)
CHANCE = 1e-6
DIMENSION = 4
MOSTLY = 0.99
ENOUGH = 400  # samples: the band is then 3.4 to 4.7 or narrower

ONE_STRAIGHT_MODEL = '[{kind = "straight", noise_m2_s3 = 1e-9, sojourn_s = 1e9, share = 1.0}]'
MODEL_IS_TRUE = (
    # the vessels keep their velocity and the wire rounds nothing,
    ("input.motion.process_noise", "none"),
    ("input.ais.wire_steps", "false"),
    # the filters believe in just that,
    ("tracks.motion.models", '[{kind = "straight", noise_m2_s3 = 1e-9, share = 1.0}]'),
    ("ais_tracks.models", ONE_STRAIGHT_MODEL),
    # and with no process noise in common the errors of two tracks of a vessel are independent
    ("fused_tracks.method", "convex"),
)
WHITE_NOISE_M2_S3 = 2.4e-4  # of the sea below: a kick of 0.0154 m/s an axis each second
ONE_MODEL_OF_THE_CENTRAL_FILTER = (
    # the velocities take a small step each second,
    ("input.motion.process_noise", "rw1"),
    ("input.motion.process_noise_fraction", "0.004"),
    ("input.ais.wire_steps", "false"),
    # the filter of plots and reports believes in that and in nothing else,
    ("fused_tracks.method", "central_imm"),
    ("fused_tracks.noise_m2_s3", f"[{WHITE_NOISE_M2_S3}, 1e-3, 1e-3, 1e-3]"),
    ("fused_tracks.share", "[1.0, 1e-9, 1e-9, 1e-9]"),
    ("fused_tracks.sojourn_s", "[1e15, 1e-3, 1e-3, 1e-3]"),
    ("fused_tracks.velocity_jump_m_s", "0.0"),
    # and in the radars
    ("fused_tracks.range_registration", "0.0"),
    ("fused_tracks.azimuth_registration", "0.0"),
)
CENTRAL = (("fused_tracks.method", "central_imm"),)
BASE = (("fused_tracks.method", "covariance_intersection"),)
THROUGH_PLOT_FUSION = (
    *BASE,
    ("tracks.plot_origin", "estimated"),
    ("input.radar.detection_probability", "0.9"),
    ("input.radar.clutter_per_m2", "5e-7"),
)
SOURCES = ("radar", "ais", "fused")


class Samples(NamedTuple):
    """NEES at the last instant of a run, one a vessel."""

    radar: Floats
    ais: Floats
    fused: Floats


@cache
def samples(settings: tuple[tuple[str, str], ...], folder: Path) -> Samples:
    """The samples of all seeds: vessels of two seas have nothing in common."""
    return Samples(*(np.concatenate(part) for part in zip(*(_of_one(settings, seed, folder) for seed in SEEDS), strict=True)))


def _of_one(settings: tuple[tuple[str, str], ...], seed: int, folder: Path) -> Samples:
    scenario = load_scenario("context-driven-1000", {"cycles": "1", **dict(settings)})  # after 120 s of warm-up
    last: dict[str, Cycle] = {}
    where = f"sqlite:///{folder / f'{seed}.db'}"
    run_scenario(scenario, seed=seed, database=where, restart=True, on_cycle=lambda cycle: last.update(cycle=cycle))
    sensors, cycle = scenario.sensors(), last["cycle"]
    recording = scenario.input.load(sensors, seed, scenario.plan())
    assert recording.truth is not None
    truth, kinds = recording.truth.at(cycle.time_s), sensors.source_kinds
    radar, ais = (
        cycle.tracks.take((kinds[cycle.tracks.source] == kind) & (cycle.tracks.origin >= 0))
        for kind in (SourceKind.RADAR, SourceKind.AIS)
    )
    whole, origin = whole_vessels(cycle.tracks, cycle.associations, kinds)
    return Samples(
        _nees(radar, radar.origin, truth), _nees(ais, ais.origin, truth), _nees(cycle.fused.take(whole), origin[whole], truth)
    )


def _nees(estimate: Tracks | FusedTracks, origin: Ints, truth: Truth) -> Floats:
    at = row_of(truth.vessel, origin)
    assert (at >= 0).all()
    vessel, times = np.unique(origin, return_counts=True)
    once = np.isin(origin, vessel[times == 1])  # a vessel with two tracks of a source is an error, which the scores count
    assert once.mean() > MOSTLY
    estimate, at = estimate.take(once), at[once]
    off = difference_m(estimate.position_deg, truth.position_deg[at])
    found = nees(np.column_stack([off, estimate.velocity_m_s - truth.velocity_m_s[at]]), estimate.covariance)
    assert np.isfinite(found).all()
    return found


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("nees")


@pytest.mark.parametrize("source", SOURCES)
def test_where_the_model_is_true_the_covariance_is_right(source: str, folder: Path) -> None:
    """Both sides are held. Measured: radar 4.04 of 993, AIS 3.95 of 1000, fused 3.85 of 519."""
    found = getattr(samples(MODEL_IS_TRUE, folder), source)
    low, high = band(len(found), DIMENSION, CHANCE)
    assert len(found) > ENOUGH
    assert low < found.mean() < high


@pytest.mark.parametrize("source", SOURCES)
def test_where_the_model_is_true_the_errors_are_spread_as_chi_square(source: str, folder: Path) -> None:
    """The mean could hide errors both too large and too small: the share within the 95 % ellipsoid is held too."""
    from scipy import stats

    found = getattr(samples(MODEL_IS_TRUE, folder), source)
    inside = int((found < stats.chi2.ppf(0.95, DIMENSION)).sum())
    low, high = stats.binom.ppf([0.5 * CHANCE, 1.0 - 0.5 * CHANCE], len(found), 0.95)
    assert low <= inside <= high


@pytest.mark.parametrize(
    "settings",
    [pytest.param(BASE, id="base"), pytest.param(THROUGH_PLOT_FUSION, id="through plot fusion")],
)
@pytest.mark.parametrize("source", SOURCES)
@pytest.mark.slow
def test_with_kicks_and_turns_to_reckon_with_no_covariance_is_too_small(
    source: str, settings: tuple[tuple[str, str], ...], folder: Path
) -> None:
    """Only the upper side is held: the filters keep room for turns and kicks that most vessels do not make in a given minute,
    and are known to be too careful. Measured: radar 2.77, AIS 2.87, fused 2.73; through plot fusion 2.92, 2.87, 2.72.
    """
    found = getattr(samples(settings, folder), source)
    assert len(found) > ENOUGH
    assert found.mean() < band(len(found), DIMENSION, CHANCE)[1]


@pytest.mark.slow
def test_the_filter_of_plots_and_reports_is_right_where_its_model_is_true(folder: Path) -> None:
    """Two minutes of plots and reports of two radars and AIS, one filter: mean and spread. Measured: 3.93 of 519, 95.6 % inside."""
    from scipy import stats

    found = samples(ONE_MODEL_OF_THE_CENTRAL_FILTER, folder).fused
    assert len(found) > ENOUGH
    low, high = band(len(found), DIMENSION, CHANCE)
    assert low < found.mean() < high
    inside = int((found < stats.chi2.ppf(0.95, DIMENSION)).sum())
    low, high = stats.binom.ppf([0.5 * CHANCE, 1.0 - 0.5 * CHANCE], len(found), 0.95)
    assert low <= inside <= high


@pytest.mark.slow
def test_the_filter_of_plots_and_reports_is_not_too_sure_in_the_base_case(folder: Path) -> None:
    """It is nearer to 4 than the intersection of tracks, from the same side. Measured: 3.56 and 2.73 of 519."""
    found = samples(CENTRAL, folder).fused
    most = band(len(found), DIMENSION, CHANCE)[1]
    assert samples(BASE, folder).fused.mean() < found.mean() < most


def test_a_covariance_that_is_too_small_or_too_large_would_be_seen(folder: Path) -> None:
    """The bands are narrow enough for errors of 15 % in the standard deviation, of either sign."""
    for found in samples(MODEL_IS_TRUE, folder):
        low, high = band(len(found), DIMENSION, CHANCE)
        assert low > 4.0 * 1.15**-2
        assert high < 4.0 * 1.15**2
