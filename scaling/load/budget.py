"""What was decided wrongly, and where: decisions of association by kind of water and by age of the tracks, and of bearings."""

from __future__ import annotations

import numpy as np

from coastwatch.batches import Floats, Ints, SourceKind, Tracks
from coastwatch.geodesy import earth_centred
from coastwatch.pipeline import Cycle
from coastwatch.scores.confusion import Confusion, bearing_association, decisions
from scaling.load.national import World
from scaling.load.waters import Water

YOUNG_S = 30.0  # a track is young for so long
ALL, YOUNG, BEARINGS = "all", "young", "bearings"
WATERS = tuple(kind.name.lower() for kind in Water)


def budget_of(world: World, cycle: Cycle, kinds: Ints) -> dict[str, Confusion]:
    """Counts of a cycle: all decisions, those of each water, those on young tracks, and those on bearings.

    Args: kinds: SourceKind of each source. A decision is young if the radar track is, or its true AIS track.
    """
    tracks = cycle.tracks
    made = decisions(tracks, cycle.associations, kinds)
    water = world.water_of(tracks.origin[made.row])
    age_s = np.minimum(cycle.time_s - tracks.started_s[made.row], _partner_age_s(tracks, made.row, kinds, cycle.time_s))
    out = {ALL: made.counted(), YOUNG: made.take(age_s < YOUNG_S).counted()}
    out |= {name: made.take(water == kind).counted() for kind, name in enumerate(WATERS)}
    return out | {BEARINGS: bearing_association(cycle.bearing_tracks, cycle.picture, cycle.bearing_associations)}


def _partner_age_s(tracks: Tracks, rows: Ints, kinds: Ints, time_s: float) -> Floats:
    """How old the AIS track of the vessel of each of these rows is, inf where it has none."""
    ais = np.flatnonzero(kinds[tracks.source] == SourceKind.AIS)
    if not len(ais):
        return np.full(len(rows), np.inf)
    ais = ais[np.argsort(tracks.origin[ais], kind="stable")]
    mate = ais[np.minimum(np.searchsorted(tracks.origin[ais], tracks.origin[rows]), len(ais) - 1)]
    return np.where(tracks.origin[mate] == tracks.origin[rows], time_s - tracks.started_s[mate], np.inf)


def pairs_within(tracks: Tracks, gate_m: float) -> int:
    """How many pairs of tracks of different sources are no farther apart than a gate: those that an association has to test."""
    from scipy.spatial import cKDTree

    points = earth_centred(tracks.position_deg)
    order = np.argsort(tracks.source, kind="stable")
    parts = np.split(order, np.flatnonzero(np.diff(tracks.source[order])) + 1)
    every, same = (cKDTree(points), [cKDTree(points[rows]) for rows in parts])
    return int((every.count_neighbors(every, gate_m) - sum(tree.count_neighbors(tree, gate_m) for tree in same)) // 2)
