"""Do the tracks of the national picture err as they say? One sample a track at one instant; a bound is left by chance once in a million."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from nees_band import band

from coastwatch.batches import Floats, SourceKind, Tracks
from coastwatch.geodesy import difference_m
from coastwatch.scores.nees import nees
from scaling.load import national

pytestmark = pytest.mark.consistency

CHANCE, DIMENSION, TRACKS = 1e-6, 4, 6000
CYCLES = (0, 12)  # fresh tracks, and errors that have lasted


@cache
def received() -> dict[int, Tracks]:
    """Tracks by cycle."""
    world = national.build_world(TRACKS, 3)
    sensors, state, out = national.scenario_of(world, {}).sensors(), national.initial_state(world), {}
    for number in range(max(CYCLES) + 1):
        state, got = national.next_cycle(world, state, sensors)
        out[number] = got.tracks
    return out


def errors(tracks: Tracks) -> Floats:
    """East, north, east rate, north rate of each track at its own time. (N, 4)"""
    true = national.truth(national.build_world(TRACKS, 3), tracks.origin, tracks.time_s)
    assert np.array_equal(true.vessel, tracks.origin)
    return np.column_stack([difference_m(tracks.position_deg, true.position_deg), tracks.velocity_m_s - true.velocity_m_s])


@pytest.mark.parametrize("cycle", CYCLES)
@pytest.mark.parametrize("kind", [SourceKind.RADAR, SourceKind.AIS])
def test_the_covariance_is_right(cycle: int, kind: SourceKind) -> None:
    tracks = received()[cycle]
    told = np.isfinite(tracks.covariance).all(axis=(1, 2))
    tracks = tracks.take(told & ((tracks.mmsi >= 0) == (kind == SourceKind.AIS)))
    found = nees(errors(tracks), tracks.covariance)
    low, high = band(len(found), DIMENSION, CHANCE)
    assert len(found) > 2000
    assert low < found.mean() < high


def test_a_track_without_covariance_errs_as_its_reports_say() -> None:
    tracks = received()[max(CYCLES)]
    tracks = tracks.take(~np.isfinite(tracks.covariance).all(axis=(1, 2)))
    found = nees(errors(tracks)[:, :2], tracks.report_covariance)
    low, high = band(len(found), 2, CHANCE)
    assert (tracks.mmsi >= 0).all()
    assert low < found.mean() < high


def test_errors_last() -> None:
    """From cycle 8 to 12 a share exp(-t / memory) of an error is left: with 12 s, and memories of 10 to 20 s, 0.3 to 0.55."""
    before, after = received()[8], received()[12]
    common, first, second = np.intersect1d(before.track_id, after.track_id, return_indices=True)
    radar = after.mmsi[second] < 0
    then, now = errors(before)[first[radar], 0], errors(after)[second[radar], 0]
    assert len(common) > 5000
    assert 0.36 < np.corrcoef(then, now)[0, 1] < 0.52
