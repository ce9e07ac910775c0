"""Bearings by vessel: which vessel of this cycle the bearings are of, by the associations of the cycle before."""

from __future__ import annotations

import numpy as np

from coastwatch import kernels
from coastwatch.batches import (
    Associations,
    BearingAssociations,
    BearingMembers,
    BearingTracks,
    FusedTracks,
    HeldVessels,
    Members,
    Picture,
    Sensors,
    Tracks,
    VesselBearings,
)
from coastwatch.geodesy import wrap_rad
from coastwatch.kernels.tables.groups import ranges


def bearing_members(
    associations: BearingAssociations, bearing_tracks: BearingTracks, picture: Picture, members: Members, sensors: Sensors
) -> BearingMembers:
    """The associated bearing tracks with the tracks of their vessels, at the end of a cycle."""
    if len(associations.probability) == 0:
        return BearingMembers.empty()
    vessel_id = picture.vessel_id[associations.vessel_row]
    sensor = bearing_tracks.source[associations.bearing_row] - sensors.sonar_source(0)
    first = np.searchsorted(members.vessel_id, vessel_id)
    count = np.searchsorted(members.vessel_id, vessel_id, side="right") - first
    rows = np.maximum(count, 1)
    pair = np.repeat(np.arange(len(vessel_id)), rows)
    member = np.append(members.track_id, -1)[np.where(count[pair] > 0, ranges(first, rows), -1)]
    return BearingMembers(
        bearing_tracks.track_id[associations.bearing_row][pair],
        vessel_id[pair],
        member,
        associations.probability[pair],
        associations.sensor_bias_rad[sensor][pair],
        associations.sensor_bias_sigma_rad[sensor][pair],
    )


def vessel_bearings(
    before: BearingMembers, bearing_tracks: BearingTracks, tracks: Tracks, associations: Associations
) -> VesselBearings:
    """The bearings of this cycle with the vessels that their tracks were of, as far as these tracks go on.

    A vessel is where the first of its tracks is that goes on. Args: before: of the last cycle; associations: of `tracks`.
    """
    index_of = kernels.tables.match_ids.index_of
    row_of_member = index_of(tracks.track_id, before.track_id)
    row_of_bearing = index_of(bearing_tracks.track_id, before.bearing_track_id)
    order = np.lexsort((row_of_member < 0, before.bearing_track_id))
    _, first = np.unique(before.bearing_track_id[order], return_index=True)
    chosen = order[first]
    chosen = chosen[row_of_bearing[chosen] >= 0]
    chosen = chosen[np.argsort(before.vessel_id[chosen], kind="stable")]
    one, bearing = before.take(chosen), bearing_tracks.take(row_of_bearing[chosen])
    row = row_of_member[chosen].astype(np.int64)
    vessel, lost = np.append(associations.vessel, -1)[row], np.flatnonzero(row < 0)
    _, number = np.unique(one.vessel_id[lost], return_inverse=True)
    vessel[lost] = int(associations.vessel.max(initial=-1)) + 1 + number  # new numbers after the last, by id
    return VesselBearings(
        vessel,
        one.vessel_id,
        one.track_id,
        one.probability,
        bearing.updated_s,
        bearing.measured_s,
        np.asarray(wrap_rad(bearing.measured_rad - one.bias_rad)),
        bearing.measured_variance,
        one.bias_sigma_rad**2,
        bearing.measured_site_deg,
    )


def bearing_only_vessels(bearings: VesselBearings, fused: FusedTracks, vessels: int) -> tuple[FusedTracks, HeldVessels]:
    """The estimates of vessels with tracks, and those of vessels that only bearings hold. Args: vessels: V, those with tracks."""
    if len(fused) == vessels:
        return fused, HeldVessels.empty()
    lost = bearings.vessel >= vessels
    number, first = np.unique(bearings.vessel[lost], return_index=True)
    vessel_id, updated_s = bearings.vessel_id[lost][first], np.full(len(number), -np.inf)
    np.maximum.at(updated_s, bearings.vessel[lost] - vessels, bearings.updated_s[lost])
    e = fused.take(number)
    has_position = np.isfinite(e.position_deg[:, 0])
    held = HeldVessels(vessel_id, e.time_s, e.position_deg, e.velocity_m_s, e.covariance, updated_s)
    return fused.take(np.arange(vessels)), held.take(has_position)
