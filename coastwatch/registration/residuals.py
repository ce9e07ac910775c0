"""Tracking, first part: which plots may be echoes of their vessel, with what probability, and their equations."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coastwatch import kernels
from coastwatch.batches import Batch, Floats, Ints, Tracks, column
from coastwatch.registration.information import Equations, Estimate
from coastwatch.registration.inputs import RegistrationInput
from coastwatch.registration.polar import Pairs, PolarMeasurements
from coastwatch.registration.references import summed_by_vessel

GATE_SIGMAS, GATE_M = 4.0, 100.0  # half widths of the gate about the estimate: of the azimuth noise, and in range
AZIMUTH_OFFSET = 0.2  # of the azimuth noise: standard deviation of what plots near one vessel have in common, wrong ones too
PRIOR_ECHOES, PRIOR_PAIRS = 1.0, 5.0  # that the share of each vessel begins with
SCALE_AT_M = 10_000.0
LEAST_PAIRS = 0.02  # a share of fewer is dropped


@dataclass(frozen=True, eq=False)
class EchoShares(Batch):
    """How many plots in the gate of each vessel were its echoes, sorted by radar, then vessel. Old ones are forgotten.

    A vessel without an echo of its own but with a quay nearby has a small share, and counts less and less.
    """

    radar: Ints = column(np.int64, "N")
    track_id: Ints = column(np.int64, "N")
    pairs: Floats = column(np.float64, "N")
    echoes: Floats = column(np.float64, "N")  # sum of the probabilities


def plot_equations(
    given: RegistrationInput,
    measured: PolarMeasurements,
    pairs: Pairs,
    vessels: Tracks,
    reference: Ints,
    shares: EchoShares,
    estimate: Estimate,
    offset_sigma_m: Floats,
) -> tuple[EchoShares, Equations]:
    """The shares with the pairs of this cycle, and two equations for each pair in the gate of its radar.

    The probability that a plot is the vessel's echo is that of a Gaussian about the estimate against an even density over the gate.
    Args: pairs: of radars whose bias is known; vessels: (V); reference: (V,) whose equations share an offset; estimate: (R, 6);
    offset_sigma_m: (V,) between AIS position and echo, per axis.
    Source: A. P. Dempster, N. M. Laird, D. B. Rubin, Maximum likelihood from incomplete data via the EM algorithm, 1977 (mixtures).
    """
    pairs = pairs.take(np.lexsort((measured.azimuth_rad[pairs.plot], measured.time_s[pairs.plot], pairs.vessel)))
    radars, r, lag_s = given.sensors.radars, pairs.radar, given.corrections.time_lag_s
    range_noise, azimuth_noise = radars.range_sigma_m[r], radars.azimuth_sigma_rad[r]
    lag_change = estimate.mean[r, 2] - lag_s[r]
    lag_sigma = estimate.sigma[r, 2]
    by_site = site_and_scale_differences(measured.azimuth_rad[pairs.plot] - pairs.azimuth_rad, pairs.distance_m)
    by_range, by_azimuth = (by_site * estimate.mean[r, None, 3:]).sum(axis=2).T
    range_residual = pairs.range_m - estimate.mean[r, 1] + pairs.range_rate_m_s * lag_change - by_range
    azimuth_residual = pairs.azimuth_rad - estimate.mean[r, 0] + pairs.azimuth_rate_rad_s * lag_change - by_azimuth
    inside = (np.abs(azimuth_residual) <= GATE_SIGMAS * azimuth_noise) & (np.abs(range_residual) <= GATE_M)
    # So near that a lag or an error of AIS would move the echo out of the gate:
    inside &= np.abs(pairs.azimuth_rate_rad_s) < azimuth_noise
    inside &= pairs.across_variance_m2 < (azimuth_noise * pairs.distance_m) ** 2

    p, r = pairs.take(inside), r[inside]
    offset_sigma = offset_sigma_m[p.vessel]
    range_variance = range_noise[inside] ** 2 + p.range_variance_m2
    azimuth_variance = azimuth_noise[inside] ** 2 + p.across_variance_m2 / p.distance_m**2
    range_total_variance = range_variance + offset_sigma**2 + np.minimum(estimate.sigma[r, 1], offset_sigma) ** 2
    range_total_variance = range_total_variance + (p.range_rate_m_s * lag_sigma[inside]) ** 2
    azimuth_total_variance = azimuth_variance + (offset_sigma / p.distance_m) ** 2
    azimuth_total_variance = azimuth_total_variance + (p.azimuth_rate_rad_s * lag_sigma[inside]) ** 2
    azimuth_total_variance = azimuth_total_variance + np.minimum(estimate.sigma[r, 0] ** 2, azimuth_variance)
    distance2 = range_residual[inside] ** 2 / range_total_variance + azimuth_residual[inside] ** 2 / azimuth_total_variance
    gaussian = np.exp(-0.5 * distance2) / (2.0 * np.pi * np.sqrt(range_total_variance * azimuth_total_variance))
    even = 1.0 / (4.0 * GATE_SIGMAS * azimuth_noise[inside] * GATE_M)
    track_id = vessels.track_id[p.vessel]
    echo_share = _echo_share(shares, r, track_id)
    probability = echo_share * gaussian / (echo_share * gaussian + (1.0 - echo_share) * even)

    n, zero, lag = len(p), np.zeros(len(p)), lag_s[r]
    range_sigma, azimuth_sigma = np.sqrt(range_variance), np.sqrt(azimuth_variance)
    site = by_site[inside] * site_and_scale_units(range_noise[inside])[:, None, :]
    along = np.column_stack([zero, range_noise[inside], -p.range_rate_m_s, site[:, 0]]) / range_sigma[:, None]
    across = np.column_stack([azimuth_noise[inside], zero, -p.azimuth_rate_rad_s, site[:, 1]]) / azimuth_sigma[:, None]
    along_offset = np.column_stack([offset_sigma / range_sigma, zero])
    across_sigma = np.hypot(offset_sigma / p.distance_m, AZIMUTH_OFFSET * azimuth_noise[inside])
    across_offset = np.column_stack([zero, across_sigma / azimuth_sigma])
    equations = Equations(
        radar=np.concatenate([r, r]),
        reference=np.tile(reference[p.vessel], 2),
        design=np.concatenate([along, across]),
        offset=np.concatenate([along_offset, across_offset]).reshape(2 * n, 2),
        value=np.concatenate(
            [(p.range_m - p.range_rate_m_s * lag) / range_sigma, (p.azimuth_rad - p.azimuth_rate_rad_s * lag) / azimuth_sigma]
        ),
        weight=np.tile(probability, 2),
    )
    new = EchoShares(r, track_id, np.ones(n), probability)
    return summed_by_vessel(EchoShares.join([shares, new])), equations


def site_and_scale_differences(azimuth_rad: Floats, distance_m: Floats) -> Floats:
    """How range and azimuth change with the errors of the site, stated less true, and of the scale, for some vessels. (A, 2, 3)

    A radar that is said to stand east of its place has vessels in the east too far away. Rows: range, azimuth in rad; columns: of one
    metre east, of one north, and of a scale that doubles the range.
    """
    east, north, distance_m = np.sin(azimuth_rad), np.cos(azimuth_rad), np.maximum(distance_m, 1.0)
    along = np.column_stack([east, north, distance_m])
    across = np.column_stack([north / distance_m, -east / distance_m, np.zeros(len(east))])
    return np.stack([along, across], axis=1)


def site_and_scale_units(range_sigma_m: Floats) -> Floats:
    """Units in which these errors are estimated: of the size of the range noise, the scale at 10 km. (A, 3)"""
    return np.column_stack([range_sigma_m, range_sigma_m, range_sigma_m / SCALE_AT_M])


def forgotten(shares: EchoShares, keep: Floats) -> EchoShares:
    """The shares with what is old counting less. Args: keep: (R,) factor of the sums of each radar."""
    factor = keep[shares.radar]
    old = EchoShares(shares.radar, shares.track_id, shares.pairs * factor, shares.echoes * factor)
    return old.take(old.pairs > LEAST_PAIRS)


def _echo_share(shares: EchoShares, radar: Ints, track_id: Ints) -> Floats:
    """The share of echoes among the plots in the gate of each radar and vessel."""
    pairs, echoes = np.zeros(len(radar)), np.zeros(len(radar))
    for r in np.unique(radar).tolist():
        mine, asked = np.flatnonzero(shares.radar == r), np.flatnonzero(radar == r)
        at = kernels.tables.lookup.find(shares.track_id[mine], track_id[asked])
        has_pairs = at >= 0
        pairs[asked[has_pairs]] = shares.pairs[mine[at[has_pairs]]]
        echoes[asked[has_pairs]] = shares.echoes[mine[at[has_pairs]]]
    return (echoes + PRIOR_ECHOES) / (pairs + PRIOR_PAIRS)
