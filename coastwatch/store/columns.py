"""Batches as columns of plain values, in the order of the tables' columns. Absent is None; text and numbers are Python's own."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from coastwatch.batches import Array, BearingAssociations, BearingTracks, Floats, Ints, Picture, Spots
from coastwatch.geodesy import ECCENTRICITY2, KNOT_M_S

if TYPE_CHECKING:  # to read a database needs no stage of the pipeline, which are slow to import
    from coastwatch.pipeline import Cycle

Column = Sequence[Any]
UPPER = np.triu_indices(4)


def plain(values: Array) -> Column:
    """Python values; NaN is None."""
    if values.dtype.kind != "f" or not np.isnan(values).any():
        return values.tolist()  # type: ignore[no-any-return]
    return [None if x != x else x for x in values.tolist()]


def named(values: Ints) -> Column:
    """Python integers; a negative one, which names nothing, is None."""
    return [None if x < 0 else x for x in values.tolist()]


def speed_and_course(velocity_m_s: Floats) -> tuple[Floats, Floats]:
    """Knots, and degrees true in [0, 360), NaN for what stands still. Args: velocity_m_s: (V, 2) east, north."""
    east, north = velocity_m_s[:, 0], velocity_m_s[:, 1]
    course = np.degrees(np.arctan2(east, north)) % 360.0
    course[course >= 360.0] = 0.0
    speed = np.hypot(east, north)
    return speed / KNOT_M_S, np.where(speed > 0.0, course, np.nan)


def ellipse(covariance: Floats) -> tuple[Floats, Floats, Floats]:
    """1-sigma half axes in metres, and the direction of the longer one in degrees clockwise from north, [0, 180).

    Args: covariance: (V, 2, 2) or more, of east, north.
    """
    east, both, north = covariance[:, 0, 0], covariance[:, 0, 1], covariance[:, 1, 1]
    mean, half = 0.5 * (east + north), np.hypot(0.5 * (east - north), both)
    direction = np.degrees(0.5 * np.arctan2(2.0 * both, north - east)) % 180.0
    direction[direction >= 180.0] = 0.0
    return np.sqrt(np.maximum(mean + half, 0.0)), np.sqrt(np.maximum(mean - half, 0.0)), direction


def packed(covariance: Floats) -> Column:
    """Ten little-endian float64 a row, the upper triangle row by row; None where any is NaN. Args: covariance: (V, 4, 4)."""
    if not len(covariance):
        return []
    upper = np.ascontiguousarray(covariance[:, UPPER[0], UPPER[1]], "<f8")
    rows: list[Any] = upper.view("V80").ravel().tolist()
    return [None if absent else row for row, absent in zip(rows, np.isnan(upper).any(1).tolist(), strict=True)]


def unpacked(blobs: Sequence[bytes | None]) -> Floats:
    """(V, 4, 4) covariances of `packed` rows; NaN where there is none."""
    out = np.full((len(blobs), 4, 4), np.nan)
    for row, blob in enumerate(blobs):
        if blob is not None:
            out[row][UPPER] = np.frombuffer(blob, "<f8")
    lower = np.tril_indices(4, -1)
    out[:, lower[0], lower[1]] = out[:, lower[1], lower[0]]
    return out


def motion(picture: Picture) -> list[Column]:
    """Latitude, longitude, SOG, COG and the ellipse: what the picture and its history have in common."""
    columns = (*picture.position_deg.T, *speed_and_course(picture.velocity_m_s), *ellipse(picture.covariance))
    return [plain(column) for column in columns]


def vessels(run_id: int, picture: Picture, sources: Column, moving: list[Column]) -> list[Column]:
    """Columns of table `vessel`. Args: sources: text a vessel; moving: from `motion`."""
    ids = picture.vessel_id.tolist()
    when = [plain(picture.time_s), *moving, plain(picture.since_s), plain(picture.updated_s)]
    return [[run_id] * len(ids), ids, *when, named(picture.mmsi), picture.flags.tolist(), sources, packed(picture.covariance)]


def history(run_id: int, cycle: int, picture: Picture, moving: list[Column]) -> list[Column]:
    """Columns of table `history`."""
    ids = picture.vessel_id.tolist()
    last = [plain(picture.updated_s), named(picture.mmsi), picture.flags.tolist()]
    return [[run_id] * len(ids), [cycle] * len(ids), ids, *moving, *last, [None] * len(ids), [False] * len(ids)]


def memberships(cycle: Cycle) -> Ints:
    """(L, 3) vessel, source, track, sorted: the members of the picture and the bearing tracks that were given to a vessel."""
    members, bearings, found = cycle.members, cycle.bearing_tracks, cycle.bearing_associations
    rows = np.concatenate(
        [
            np.stack([members.vessel_id, members.source, members.track_id], 1),
            np.stack(
                [
                    cycle.picture.vessel_id[found.vessel_row],
                    bearings.source[found.bearing_row],
                    bearings.track_id[found.bearing_row],
                ],
                1,
            ),
        ]
    )
    return rows[np.lexsort(rows.T[::-1])]


def source_texts(vessel_id: Ints, members: Ints, names: Sequence[str]) -> Column:
    """Names of the sources of each vessel, "guanabara,ais", each once, by their number.

    Args: vessel_id: (V,) sorted; members: (L, 3) vessel, source, track, sorted.
    """
    fresh = np.ones(len(members), bool)
    fresh[1:] = (members[1:, :2] != members[:-1, :2]).any(1)
    vessel, source = members[fresh, 0], members[fresh, 1]
    row = np.searchsorted(vessel_id, vessel)
    known = np.array([*names, *(f",{name}" for name in names)], object)
    text = np.full(len(vessel_id) + 1, "", object)
    rank = np.arange(len(vessel)) - np.searchsorted(vessel, vessel)
    for k in range(int(rank.max(initial=-1)) + 1):
        here = rank == k
        text[row[here]] = text[row[here]] + known[source[here] + (len(names) if k else 0)]
    return text[:-1].tolist()  # type: ignore[no-any-return]


def associations(run_id: int, number: int, cycle: Cycle, members: Ints) -> list[Column]:
    """Columns of table `association`, in key order."""
    tracks, found = cycle.tracks, cycle.associations
    ends = [a for row in (found.first, found.second) for a in (tracks.source[row], tracks.track_id[row])]
    vessel = _vessel_of(np.stack(ends[:2], 1), members)
    order = np.lexsort((*ends[::-1], vessel))
    columns = [plain(a[order]) for a in (vessel, *ends, found.statistic)]
    return [[run_id] * len(order), [number] * len(order), *columns]


def _vessel_of(wanted: Ints, members: Ints) -> Ints:
    """The vessel of each (source, track) in (A, 2); -1 where none has it. Joined by sorting: neither number has a bound."""
    rows = np.concatenate([members[:, 1:], wanted])
    order = np.lexsort(rows.T[::-1])
    fresh = np.ones(len(rows), bool)
    fresh[1:] = (rows[order][1:] != rows[order][:-1]).any(1)
    group = np.empty(len(rows), np.int64)
    group[order] = np.cumsum(fresh) - 1
    vessel = np.full(len(rows), -1, np.int64)
    vessel[group[: len(members)]] = members[:, 0]
    return vessel[group[len(members) :]]


def bearing_associations(
    run_id: int, number: int, tracks: BearingTracks, found: BearingAssociations, picture: Picture
) -> list[Column]:
    """Columns of table `bearing_association`, in key order."""
    vessel, row = picture.vessel_id[found.vessel_row], found.bearing_row
    order = np.lexsort((tracks.track_id[row], tracks.source[row], vessel))
    row = row[order]
    bearing = np.degrees(tracks.bearing_rad[row]) % 360.0
    columns = [plain(a) for a in (vessel[order], tracks.source[row], tracks.track_id[row], found.statistic[order], bearing)]
    return [[run_id] * len(row), [number] * len(row), *columns]


def bearing_tracks(run_id: int, tracks: BearingTracks, found: BearingAssociations, picture: Picture) -> list[Column]:
    """Columns of table `bearing_track`."""
    vessel = np.full(len(tracks), -1, np.int64)
    vessel[found.bearing_row] = picture.vessel_id[found.vessel_row]
    where = (np.degrees(tracks.bearing_rad) % 360.0, np.degrees(tracks.rate_rad_s), *tracks.site_deg.T)
    numbers = [tracks.source.tolist(), tracks.track_id.tolist()]
    return [[run_id] * len(tracks), *numbers, *(plain(a) for a in where), named(vessel), plain(tracks.updated_s)]


def spots(run_id: int, cycle: int, found: Spots) -> list[Column]:
    """Columns of table `spot`."""
    x, y, z = found.centre_m.T
    latitude = np.degrees(np.arctan2(z, (1.0 - ECCENTRICITY2) * np.hypot(x, y)))
    count = len(found.centre_m)
    sizes = [np.bincount(of, minlength=count).tolist() for of in (found.spot, found.halo_spot)]
    places = [plain(latitude), plain(np.degrees(np.arctan2(y, x)))]
    return [[run_id] * count, [cycle] * count, list(range(count)), *places, *sizes]
