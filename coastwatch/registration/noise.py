"""Noise of radars: by how much plots scatter about AIS vessels more than the radar states.

The scatter of each vessel is taken about its own mean, so a bias, an antenna far from the echo and an AIS that is off teach nothing.
Of the vessels the weighted median counts: cloned or drifting AIS, and plots of a neighbour, are few.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coastwatch import kernels
from coastwatch.batches import Batch, Bools, Floats, Ints, Measurements, column
from coastwatch.geodesy import difference_m, offset_deg
from coastwatch.registration.inputs import RegistrationInput
from coastwatch.registration.references import References, summed_by_vessel

LEAST_COUNT = 0.5  # plots: a vessel with less left of them is dropped
LEAST_FREEDOM = 4.0  # plots of a vessel less one, from which its scatter counts
DOUBT = 2.0  # standard deviations of the estimate that are taken off: few vessels change nothing
AS_STATED = 1.1  # a smaller factor is none
MOST = 5.0  # greatest factor
OUTLIER = 5.0  # times the noise: a plot farther off counts as if it were there


@dataclass(frozen=True, eq=False)
class PlotScatter(Batch):
    """Sums over the plots of each radar and AIS vessel, sorted by both. Residuals are in units of what is stated; old ones count less."""

    radar: Ints = column(np.int64, "N")
    track_id: Ints = column(np.int64, "N")
    count: Floats = column(np.float64, "N")
    residual: Floats = column(np.float64, "N", 2)  # along and across the beam
    square: Floats = column(np.float64, "N", 2)


def scattered(
    scatter: PlotScatter, given: RegistrationInput, references: References, alarmed: Bools, keep: float
) -> PlotScatter:
    """The sums with the plots of this cycle that are in a vessel of the picture with one AIS track, a reference without alarm.

    Args: alarmed: (N,) of the AIS tracks; keep: factor of the former sums.
    """
    old = PlotScatter(
        scatter.radar, scatter.track_id, keep * scatter.count, keep * scatter.residual, keep * scatter.square
    ).take(keep * scatter.count > LEAST_COUNT)
    m, row = _plots_of_vessels(given, references, alarmed)
    if not len(m):
        return old
    ais = given.ais_tracks.take(row)
    place = offset_deg(ais.position_deg, ais.velocity_m_s * (m.time_s - ais.time_s)[:, None])
    beam, off = difference_m(m.position_deg, m.site_deg), difference_m(m.position_deg, place)
    along = beam / np.maximum(np.hypot(beam[:, 0], beam[:, 1]), 1.0)[:, None]
    axes = np.stack([along, np.column_stack([-along[:, 1], along[:, 0]])], axis=1)
    factor = given.corrections.noise_factor[m.sensor]
    stated, known = (np.einsum("mai,mij,maj->ma", axes, c[:, :2, :2], axes) for c in (m.covariance, ais.known_covariance(1.0)))
    with np.errstate(divide="ignore", invalid="ignore"):  # of a plot on the site of its radar
        residual = np.einsum("mai,mi->ma", axes, off) / np.sqrt(stated / factor**2 + known)
    residual = np.clip(residual, -OUTLIER * factor, OUTLIER * factor)
    sound = np.isfinite(residual).all(axis=1)
    new = PlotScatter(m.sensor, ais.track_id, np.ones(len(m)), residual, residual**2).take(sound)
    return summed_by_vessel(PlotScatter.join([old, new]))


def noise_factors(scatter: PlotScatter, radars: int, least_vessels: int) -> Floats:
    """By how many times each radar errs more than it states, along and across the beam; 1: no more. (R, 2)

    The cube root of a variance is nearly Gaussian. Taken is the weighted median over vessels less `DOUBT` standard deviations.
    Args: least_vessels: of a radar; fewer say nothing.
    Source: E. B. Wilson, M. M. Hilferty, The distribution of chi-square, PNAS 17, 1931.
    """
    out = np.ones((radars, 2))
    some = scatter.take(scatter.count - 1.0 >= LEAST_FREEDOM)
    freedom = some.count - 1.0
    variance = np.maximum(some.square - some.residual**2 / some.count[:, None], 0.0) / freedom[:, None]
    root = np.cbrt(variance) / (1.0 - 2.0 / (9.0 * freedom))[:, None]
    for r in np.unique(some.radar).tolist():
        mine = np.flatnonzero(some.radar == r)
        if len(mine) < least_vessels:
            continue
        sigma = np.sqrt(np.pi / 2.0) * np.sqrt(2.0 / 9.0 / freedom[mine].sum())
        for axis in range(2):
            order = mine[np.argsort(root[mine, axis], kind="stable")]
            weight = np.cumsum(freedom[order])
            middle = root[order[np.searchsorted(weight, 0.5 * weight[-1])], axis]
            factor = max(middle * (1.0 - DOUBT * sigma), 0.0) ** 1.5
            out[r, axis] = min(factor, MOST) if factor >= AS_STATED else 1.0
    return out


def _plots_of_vessels(given: RegistrationInput, references: References, alarmed: Bools) -> tuple[Measurements, Ints]:
    """The plots of this cycle in vessels with one AIS track, a reference without alarm; and the row of that track. (M), (M,)"""
    members, index_of = given.members, kernels.tables.match_ids.index_of
    row = index_of(given.ais_tracks.track_id, members.track_id)
    of_ais = np.flatnonzero(row >= 0)
    vessel, first, count = np.unique(members.vessel_id[of_ais], return_index=True, return_counts=True)
    ais = row[of_ais[first]].astype(np.int64)
    good = (count == 1) & ~alarmed[ais] & np.isin(given.ais_tracks.track_id[ais], references.track_id)
    ais = np.where(good, ais, -1)
    plots = given.measurements.take(np.flatnonzero(given.measurements.sensor >= 0))
    member = index_of(members.track_id, plots.track_id)
    at = kernels.tables.lookup.find(vessel, np.append(members.vessel_id, -1)[member])
    of_plot = np.where((member >= 0) & (at >= 0), np.append(ais, -1)[at], -1)
    rows = np.flatnonzero(of_plot >= 0)
    return plots.take(rows), of_plot[rows]
