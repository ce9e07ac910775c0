"""What an AIS report measures, and to which track it went, one report after the other against arrays of numpy."""

import numpy as np
import pytest

from coastwatch.geodesy import difference_m, offset_deg
from coastwatch.kernels.filters.ais_plausibility import nearest_tracks
from coastwatch.kernels.filters.ais_records import REPORT
from coastwatch.kernels.filters.ais_tracker import measured
from coastwatch.tracks import AisFilter
from coastwatch.tracks.ais.out_of_sequence import SLOTS

pytestmark = pytest.mark.oracle

NOW_S = 1e9
ROUNDING = 1e-12  # of a covariance: cos c^2 against 1 - sin c^2
RULES = AisFilter().kernel_settings().rules


def some(seed, vessels=60, most=5):
    """Reports sorted by MMSI, and tracks of about the same vessels, of some several."""
    rng = np.random.default_rng([seed, 9])
    number = 235_000_000 + np.sort(rng.choice(200, vessels, replace=False))
    home = offset_deg(np.tile([60.0, 179.999], (200, 1)), rng.uniform(-20e3, 20e3, (200, 2)))
    mmsi = np.repeat(number, rng.integers(0, SLOTS + 1, vessels))
    place = offset_deg(home[mmsi - 235_000_000], rng.normal(0.0, 300.0, (len(mmsi), 2)))
    tracks = mmsi, NOW_S - rng.uniform(0.0, 9.0, len(mmsi)), place, rng.uniform(-15.0, 15.0, (len(mmsi), 2))
    rows = np.zeros(150, REPORT)
    rows["mmsi"] = 235_000_000 + np.sort(rng.integers(0, 200, 150))
    at = offset_deg(home[rows["mmsi"] - 235_000_000], rng.normal(0.0, 300.0, (150, 2)))
    rows["lat"], rows["lon"], rows["time"] = at[:, 0], at[:, 1], NOW_S - rng.uniform(0.0, 12.0, 150)
    rows["sog"] = np.where(rng.random(150) < 0.2, np.nan, rng.choice([0.0, 0.1, 3.0, 9.0], 150))
    rows["ee"] = rows["nn"] = rng.choice([11.0, 100.0], 150)
    rows["jitter"] = 0.5
    rows["cog"] = np.where(rng.random(150) < 0.3, np.nan, rng.uniform(0.0, 2.0 * np.pi, 150))
    return rows, tracks


def test_the_nearest_track_of_the_vessel():
    for seed in range(20):
        rows, tracks = some(seed)
        got = nearest_tracks(rows, tracks, NOW_S, RULES)
        np.testing.assert_array_equal(got, by_search(rows, tracks, NOW_S, RULES))
    assert {-1} < set(got.tolist())


def test_velocity_and_covariance():
    rows, _ = some(1)
    (velocity, covariance), expected = measured(rows, RULES), by_arrays(rows, RULES)
    np.testing.assert_allclose(velocity, expected[0], rtol=ROUNDING, atol=ROUNDING)
    np.testing.assert_allclose(covariance, expected[1], rtol=ROUNDING, atol=1e-10)
    assert 0 < np.isnan(velocity[:, 0]).sum() < len(rows)


def test_no_report_and_no_track():
    rows, tracks = some(2)
    none = tuple(values[:0] for values in tracks)
    assert (nearest_tracks(rows, none, NOW_S, RULES) == -1).all()
    assert len(nearest_tracks(rows[:0], tracks, NOW_S, RULES)) == 0
    assert measured(rows[:0], RULES)[1].shape == (0, 4, 4)


def by_search(fresh, tracks, time_s, rules):
    """The row of the track that each report updated, -1 for a report that fits no track. (M,)"""
    best, least = np.full(len(fresh), -1, np.int64), np.full(len(fresh), np.inf)
    number, updated, place, speed = tracks
    mmsi = np.ascontiguousarray(fresh["mmsi"])
    first, position = np.searchsorted(number, mmsi), np.column_stack([fresh["lat"], fresh["lon"]])
    for k in range(SLOTS if len(number) else 0):
        row = np.minimum(first + k, len(number) - 1)
        gap = difference_m(position, place[row])
        gap -= speed[row] * (fresh["time"] - time_s)[:, None]
        miss = np.hypot(gap[:, 0], gap[:, 1])
        tolerance = 8.0 * np.sqrt(fresh["ee"]) + rules["max_speed"] * (rules["stamp"] + 3.0 * fresh["jitter"])
        radius = rules["max_speed"] * np.abs(updated[row] - fresh["time"]) + tolerance
        nearer = (first + k < len(number)) & (number[row] == mmsi) & (miss <= radius) & (miss < least)
        best[nearer], least[nearer] = row[nearer], miss[nearer]
    return best


def by_arrays(reports, rules):
    """Velocity east and north, and the covariance of position and velocity, as the AIS kernel takes them. (M, 2), (M, 4, 4)"""
    n, speed, course = len(reports), reports["sog"], reports["cog"]
    heading = ~np.isnan(course)
    still = ~heading & (speed < rules["still_speed"])
    along = np.column_stack([np.sin(course), np.cos(course)])
    velocity = np.where(heading[:, None], speed[:, None] * along, np.where(still, 0.0, np.nan)[:, None])
    across = speed**2 * rules["cog_variance"] + rules["sog_variance"] / (1.0 + (speed / rules["polar_speed"]) ** 2)
    outer = along[:, :, None] * along[:, None, :]
    eye = np.eye(2)
    moving = rules["sog_variance"] * outer + across[:, None, None] * (eye - outer)
    resting = (rules["sog_variance"] + 0.5 * speed**2)[:, None, None] * eye
    covariance = np.full((n, 4, 4), np.nan)
    late = np.where(heading & ~np.isnan(speed), speed * reports["jitter"], 0.0) ** 2
    covariance[:, :2, :2] = reports["ee"][:, None, None] * eye
    covariance[:, :2, :2] += np.where(late[:, None, None] > 0.0, late[:, None, None] * outer, 0.0)
    known = np.isfinite(velocity[:, 0])
    covariance[known, 2:, 2:] = np.where(heading[:, None, None], moving, resting)[known]
    covariance[known, :2, 2:] = covariance[known, 2:, :2] = 0.0
    return velocity, covariance
