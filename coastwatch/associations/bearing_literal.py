"""Bearing association as in the paper: sample covariance of the window, chi-square test, nearest neighbour."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from coastwatch import kernels
from coastwatch.associations.bearing_sensors import groups_by_octant
from coastwatch.associations.inputs import BearingAssociationInput
from coastwatch.batches import Array, BearingAssociations, BearingTracks, Floats, Ints
from coastwatch.geodesy import axes, earth_centred, wrap_rad
from coastwatch.kernels.association.history import History
from coastwatch.stage import Arrays, Groups, Method, Probability, by_group


@dataclass(frozen=True, eq=False)
class LiteralBearingMemory:
    tracks: History  # bearing, rate, latitude and longitude of the site
    vessels: History  # Earth-centred position and velocity


class BearingWindowedCovariance(Method):
    """Pairs whose newest difference of bearing and rate passes a chi-square test with the sample covariance of the last p.

    Of a paper, for comparison.

    Kept to reproduce the published figures; p and the confidence are not published. Each bearing track takes its nearest vessel
    (smallest statistic), even if another track takes it too, unless `one_to_one`. p <= 2 makes the covariance singular and is
    refused; a pair without p cycles of history is not tested. Statistic: x = Delta^T Phi^-1 Delta.
    Source: P. Rangel et al., Enhancing Performance and Reliability in Maritime Target Fusion Through a Context-Driven
    Approach, eq. 7, 10, 11 and section III-E (the bearing as measured, the rate from the last p bearings).
    """

    method: Literal["bearing_windowed_covariance"] = "bearing_windowed_covariance"
    window: Annotated[int, Field(ge=3, le=200)] = 5  # p, cycles
    confidence: Probability = 0.95  # that a true pair passes, if its errors were as the test assumes
    one_to_one: bool = False

    def init(self) -> LiteralBearingMemory:
        return LiteralBearingMemory(History.empty(self.window, np.float64, (4,)), History.empty(self.window, np.float64, (6,)))

    def limit(self) -> float:
        """The value that x must stay below: -2 ln(1 - confidence) is the chi-square quantile of 2 degrees of freedom."""
        return float(-2.0 * np.log1p(-self.confidence))

    def step(
        self, memory: LiteralBearingMemory, given: BearingAssociationInput
    ) -> tuple[LiteralBearingMemory, BearingAssociations]:
        """Which bearing track is which vessel at this cycle, sorted by bearing_row. The biases are 0: the paper knows none."""
        bearing_tracks, picture, octants = given.bearing_tracks, given.picture, given.octants
        reported = np.column_stack([*measured(bearing_tracks, self.window), bearing_tracks.site_deg])
        velocity = np.einsum("vij,vi->vj", axes(picture.position_deg)[:, :2], picture.velocity_m_s)
        state = np.column_stack([earth_centred(picture.position_deg), velocity])
        tracks, track_slot = _appended(memory.tracks, bearing_tracks.track_id, reported)
        vessels, vessel_slot = _appended(memory.vessels, picture.vessel_id, state)
        arrays = {
            "first_pair": np.searchsorted(octants.bearing_row, np.arange(len(bearing_tracks) + 1)),
            "track": track_slot,
            "vessel": vessel_slot[octants.vessel_row],
            "reported": tracks.values,
            "state": vessels.values,
            "track_length": tracks.length,
            "vessel_length": vessels.length,
            "columns": tracks.columns(np.arange(self.window)[::-1]),
        }
        parts = given.map_(accept_in_octants, self, arrays, groups_by_octant(octants))
        row = np.concatenate([np.zeros(0, np.int64), *(part[0] for part in parts)])
        x = np.concatenate([np.zeros(0), *(part[1] for part in parts)])[np.argsort(row, kind="stable")]
        row = np.sort(row)
        bearing_row, vessel_row = octants.bearing_row[row], octants.vessel_row[row]
        chosen = self._chosen(bearing_row, vessel_row, octants.octant[row] // 8 * len(picture), x)
        associations = BearingAssociations(
            bearing_row[chosen], vessel_row[chosen], x[chosen], np.zeros(len(given.sensors.sonars))
        )
        return LiteralBearingMemory(tracks, vessels), associations

    def _chosen(self, bearing_row: Ints, vessel_row: Ints, of_sonar: Ints, x: Floats) -> Array:
        if self.one_to_one:
            return np.asarray(kernels.association.assignment.assign(bearing_row, vessel_row + of_sonar, 2.0 * self.limit() - x))
        order = np.lexsort((vessel_row, x, bearing_row))
        return order[np.unique(bearing_row[order], return_index=True)[1]]


def accept_in_octants(settings: BearingWindowedCovariance, arrays: Arrays, octants: Groups) -> tuple[Array, ...]:
    """Pairs of the bearing tracks of these octants that pass: index of the pair, x."""
    return by_group(_accept_in_octant, settings, arrays, octants)


def _accept_in_octant(settings: BearingWindowedCovariance, arrays: Arrays, rows: Ints) -> tuple[Array, ...]:
    """Pairs of these bearing tracks that pass the test: index of the pair, x."""
    first, count = arrays["first_pair"][rows], np.diff(arrays["first_pair"])[rows]
    index = kernels.tables.groups.ranges(first, count)
    track, vessel = np.repeat(arrays["track"][rows], count), arrays["vessel"][index]
    full = (arrays["track_length"][track] == settings.window) & (arrays["vessel_length"][vessel] == settings.window)
    index, track, vessel = index[full], track[full], vessel[full]
    delta = differences(arrays["reported"][track][:, arrays["columns"]], arrays["state"][vessel][:, arrays["columns"]])
    whole = np.isfinite(delta).all(axis=(1, 2))
    index, delta = index[whole], delta[whole]
    x = sample_statistic(delta)
    keep = x < settings.limit()
    return index[keep], x[keep]


def _appended(history: History, ids: Ints, values: Floats) -> tuple[History, Array]:
    """The history with the values of this cycle, and the slot of each id. Slots do not depend on the order of the ids."""
    order = np.argsort(ids, kind="stable")
    history, sorted_slot = history.advanced(ids[order])
    slot = np.empty(len(ids), np.int64)
    slot[order] = sorted_slot
    history.values[slot, history.column] = values
    return history, slot


def measured(tracks: BearingTracks, bearings: int) -> tuple[Floats, Floats]:
    """The newest measured bearing, predicted to the time of the track, and the least-squares rate of the newest bearings.

    The filtered bearing of the track is not used: its errors are autocorrelated, so their sample covariance means nothing.
    Returns: (N,) and (N,); NaN for a track without that many bearings.
    """
    time, bearing = tracks.window_time_s[:, -bearings:], tracks.window_bearing_rad[:, -bearings:]
    if time.shape[1] < bearings:
        return np.full(len(tracks), np.nan), np.full(len(tracks), np.nan)
    t = time - time.mean(axis=1, keepdims=True)
    rate = (t * wrap_rad(bearing - bearing[:, -1:])).sum(1) / (t * t).sum(1)
    return wrap_rad(bearing[:, -1] + rate * (tracks.time_s - time[:, -1])), rate


def differences(reported: Floats, state: Floats) -> Floats:
    """Bearing and rate of tracks less those of vessels, seen from the site of the track.

    Args: reported: (A, p, 4) bearing, rate, site; state: (A, p, 6) Earth-centred position and velocity. Returns: (A, p, 2).
    """
    site = reported[:, :, 2:]
    plane = axes(site)[:, :, :2]
    off = np.einsum("apij,apj->api", plane, state[:, :, :3] - earth_centred(site))
    speed = np.einsum("apij,apj->api", plane, state[:, :, 3:])
    square = np.maximum((off**2).sum(2), 1.0)
    rate = (speed[:, :, 0] * off[:, :, 1] - speed[:, :, 1] * off[:, :, 0]) / square
    bearing = wrap_rad(reported[:, :, 0] - np.arctan2(off[:, :, 0], off[:, :, 1]))
    return np.stack([bearing, reported[:, :, 1] - rate], axis=2)


def sample_statistic(delta: Floats) -> Floats:
    """x = Delta^T Phi^-1 Delta of the newest difference, Phi the sample covariance of all; infinite where Phi is singular.

    Args: delta: (A, p, 2). Returns: (A,).
    """
    centred = delta - delta.mean(axis=1, keepdims=True)
    phi = np.einsum("api,apj->aij", centred, centred) / (delta.shape[1] - 1)
    det = phi[:, 0, 0] * phi[:, 1, 1] - phi[:, 0, 1] ** 2
    a, b = delta[:, -1, 0], delta[:, -1, 1]
    top = phi[:, 1, 1] * a * a - 2.0 * phi[:, 0, 1] * a * b + phi[:, 0, 0] * b * b
    return np.where(det > 0.0, top / np.where(det > 0.0, det, 1.0), np.inf)
