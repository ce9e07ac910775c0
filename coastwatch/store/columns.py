"""Batches as columns of cells, in the order of the tables' columns."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from coastwatch.batches import BearingAssociations, BearingTracks, Bools, Floats, Ints, Picture, Spots
from coastwatch.geodesy import ECCENTRICITY2
from coastwatch.store.cells import Blobs, Column, Named, Texts

if TYPE_CHECKING:  # to read a database needs no stage of the pipeline, which are slow to import
    from coastwatch.pipeline import Cycle


SETS = 1024
"""Sets of sources for which there is room at first."""


class Motion(NamedTuple):
    """What is computed of each vessel of a picture: what `picture_rows.motion_rows` fills."""

    moving: Floats  # (V, 5) knots, course, half axes, direction
    upper: Floats  # (V, 10)
    known: Bools  # (V,)


def motion(velocity_m_s: Floats, covariance: Floats) -> Motion:
    """Speed, course, ellipse and half of the covariance of vessels. Args: (V, 2), (V, 4, 4)."""
    from coastwatch.kernels.tables.picture_rows import motion_rows

    count = len(velocity_m_s)
    made = Motion(np.empty((count, 5)), np.empty((count, 10)), np.empty(count, np.bool_))
    motion_rows(0, count, velocity_m_s, covariance, *made)
    return made


def vessels(run_id: int, picture: Picture, moved: Motion, sources: Texts) -> list[Column]:
    """Columns of table `vessel`. Args: moved: of the vessels of the picture."""
    when: list[Column] = [picture.time_s, *picture.position_deg.T, *moved.moving.T, picture.since_s, picture.updated_s]
    bytes_of = moved.upper.astype("<f8", copy=False).view(np.uint8)
    return [run_id, picture.vessel_id, *when, Named(picture.mmsi), picture.flags, sources, Blobs(bytes_of, moved.known)]


def memberships(cycle: Cycle) -> Ints:
    """(L, 3) vessel, source, track, sorted: the members of the picture and the bearing tracks that were given to a vessel."""
    from coastwatch.kernels.tables.sorted_rows import is_sorted, merge

    members, bearings, found = cycle.members, cycle.bearing_tracks, cycle.bearing_associations
    rows = np.stack([members.vessel_id, members.source, members.track_id], 1)
    if not is_sorted(rows):
        rows = rows[np.lexsort(rows.T[::-1])]
    vessel = cycle.picture.vessel_id[found.vessel_row]
    heard = np.stack([vessel, bearings.source[found.bearing_row], bearings.track_id[found.bearing_row]], 1)
    out = np.empty((len(rows) + len(heard), 3), np.int64)
    merge(rows, heard[np.lexsort(heard.T[::-1])], out)
    return out


def sources(vessel_id: Ints, members: Ints, names: Sequence[str]) -> Texts:
    """Names of the sources of each vessel, "guanabara,ais", each once, by their number: made once for each set of sources.

    Args: vessel_id: (V,) sorted; members: (L, 3) vessel, source, track, sorted.
    """
    from coastwatch.kernels.tables.picture_rows import source_sets

    code, count, room = np.empty(len(vessel_id), np.int64), -1, SETS
    while count < 0:
        parent, last = np.empty(room, np.int64), np.empty(room, np.int64)
        count, room = source_sets(vessel_id, members, code, parent, last), 8 * room
    texts = [""]
    for before, source in zip(parent[1:count].tolist(), last[1:count].tolist(), strict=True):
        texts.append(f"{texts[before]},{names[source]}" if before else names[source])
    return Texts(code, texts)


def associations(run_id: int, number: int, cycle: Cycle, members: Ints) -> list[Column]:
    """Columns of table `association`, in key order."""
    from coastwatch.kernels.tables.picture_rows import vessel_of
    from coastwatch.kernels.tables.sorted_rows import is_sorted

    tracks, found = cycle.tracks, cycle.associations
    ends = [a for row in (found.first, found.second) for a in (tracks.source[row], tracks.track_id[row])]
    vessel = np.empty(len(found.first), np.int64)
    vessel_of(members, ends[0], ends[1], vessel)
    key = np.stack([vessel, *ends], 1)
    order = np.argsort(vessel, kind="stable")
    if not is_sorted(key[order]):
        order = np.lexsort(key.T[::-1])
    return [run_id, number, *key[order].T, found.statistic[order]]


def bearing_associations(
    run_id: int, number: int, tracks: BearingTracks, found: BearingAssociations, picture: Picture
) -> list[Column]:
    """Columns of table `bearing_association`, in key order."""
    vessel, row = picture.vessel_id[found.vessel_row], found.bearing_row
    order = np.lexsort((tracks.track_id[row], tracks.source[row], vessel))
    row = row[order]
    bearing = np.degrees(tracks.bearing_rad[row]) % 360.0
    return [run_id, number, vessel[order], tracks.source[row], tracks.track_id[row], found.statistic[order], bearing]


def bearing_tracks(run_id: int, tracks: BearingTracks, found: BearingAssociations, picture: Picture) -> list[Column]:
    """Columns of table `bearing_track`."""
    vessel = np.full(len(tracks), -1, np.int64)
    vessel[found.bearing_row] = picture.vessel_id[found.vessel_row]
    where = (np.degrees(tracks.bearing_rad) % 360.0, np.degrees(tracks.rate_rad_s), *tracks.site_deg.T)
    return [run_id, tracks.source, tracks.track_id, *where, Named(vessel), tracks.updated_s]


def spots(run_id: int, cycle: int, found: Spots) -> list[Column]:
    """Columns of table `spot`."""
    x, y, z = found.centre_m.T
    latitude = np.degrees(np.arctan2(z, (1.0 - ECCENTRICITY2) * np.hypot(x, y)))
    count = len(found.centre_m)
    sizes = [np.bincount(of, minlength=count) for of in (found.spot, found.halo_spot)]
    return [run_id, cycle, np.arange(count), latitude, np.degrees(np.arctan2(y, x)), *sizes]
