"""AIS tracks whose messages are in a radar track already: they are associated with it, and no stage may use them a second time."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from coastwatch import kernels
from coastwatch.associations.inputs import AssociationInput
from coastwatch.associations.pairing import associations_of
from coastwatch.batches import Associations, Bools, Ints, SourceKind, Spots, Tracks, VesselBearings
from coastwatch.geodesy import difference_m
from coastwatch.stage import MemoryT, Running

LEAST_LOG_ODDS = math.log(0.98 / 0.02)  # that an id is that of the track which holds it


@dataclass(frozen=True, eq=False)
class MergedAis:
    """Pairs of an AIS track and the radar track that holds its messages; the AIS tracks each once."""

    ais: Ints  # (B,) row
    holder: Ints  # (B,) row
    count: int  # of all tracks, N

    @property
    def others(self) -> Ints:
        """Rows of all tracks but these AIS tracks."""
        free = np.ones(self.count, np.bool_)
        free[self.ais] = False
        return np.flatnonzero(free)

    def spots_of_others(self, spots: Spots) -> Spots:
        """The spots of `others`. Args: spots: of all tracks."""
        others, row = self.others, np.full(self.count, -1)
        row[others] = np.arange(len(others))
        halo = row[spots.halo_row]
        return Spots(spots.centre_m, spots.spot[others], spots.halo_spot[halo >= 0], halo[halo >= 0])

    def joined_to(self, associations: Associations, tracks: Tracks, kinds: Ints) -> Associations:
        """Associations of all tracks. A holder has no other AIS track.

        The statistic of an AIS track and its holder is 0 where it is a distance, else `LEAST_LOG_ODDS`.
        Args: associations: those of `others`; kinds: as of `find_merged_ais`.
        """
        is_distance = associations.statistic_is_distance
        others, is_holder = self.others, np.zeros(self.count, np.bool_)
        is_holder[self.holder] = True
        is_ais = kinds[tracks.source] == SourceKind.AIS
        one, other = others[associations.first], others[associations.second]
        free = ~(is_holder[one] & is_ais[other] | is_holder[other] & is_ais[one])
        first = np.concatenate([one[free], np.minimum(self.ais, self.holder)])
        second = np.concatenate([other[free], np.maximum(self.ais, self.holder)])
        certain = np.full(len(self.ais), 0.0 if is_distance else LEAST_LOG_ODDS)
        statistic = np.concatenate([associations.statistic[free], certain])
        better = -associations.statistic[free] if is_distance else associations.statistic[free]
        gain = np.concatenate([better, np.full(len(self.ais), np.inf)])
        order = np.lexsort((second, first))
        first, second, statistic, gain = first[order], second[order], statistic[order], gain[order]
        return associations_of(tracks, first, second, statistic, gain, is_distance=is_distance, counts=associations)


def associate(
    method: Running[MemoryT, AssociationInput, Associations], gate_m: float, every: AssociationInput, kinds: Ints
) -> tuple[MemoryT, Associations]:
    """The memory after a cycle, and associations of all tracks. The method does not compare AIS tracks that are held.

    Args: gate_m: of the method; kinds: SourceKind of each source.
    """
    merged = find_merged_ais(every.tracks, kinds, gate_m)
    if not len(merged.ais):
        return method.next(every)
    others = AssociationInput(every.tracks.take(merged.others), merged.spots_of_others(every.spots), every.map_)
    after, associations = method.next(others)
    return after, merged.joined_to(associations, every.tracks, kinds)


def find_merged_ais(tracks: Tracks, kinds: Ints, gate_m: float) -> MergedAis:
    """Which AIS tracks are held by which radar tracks: of the MMSI that the radar track reports, the nearest to it inside a gate.

    Two tracks of one MMSI, or two radar tracks that hold one, are paired by distance.
    Args: kinds: SourceKind of each source.
    """
    holder = np.flatnonzero(tracks.held_mmsi >= 0)
    ais = np.flatnonzero(kinds[tracks.source] == SourceKind.AIS) if len(holder) else holder
    order = np.argsort(tracks.mmsi[ais], kind="stable")
    ais = ais[order]
    low, high = (np.searchsorted(tracks.mmsi[ais], tracks.held_mmsi[holder], side) for side in ("left", "right"))
    row = np.repeat(np.arange(len(holder)), high - low)
    place = kernels.tables.groups.ranges(low, high - low)
    distance_m = np.hypot(*difference_m(tracks.position_deg[ais[place]], tracks.position_deg[holder[row]]).T)
    chosen = kernels.association.assignment.assign(row, place, gate_m - distance_m)
    chosen &= distance_m < gate_m
    return MergedAis(ais[place[chosen]], holder[row[chosen]], len(tracks))


def counted_once(
    tracks: Tracks, associations: Associations, bearings: VesselBearings, kinds: Ints
) -> tuple[Tracks, Associations, VesselBearings]:
    """The tracks that are fused, their associations, and bearings of their vessels: no AIS message twice.

    A vessel with an AIS track, and a radar track that holds its messages, is that radar track as it is, without the others. Of two
    such radar tracks, of two regions, the one with less variance stands for the vessel.
    """
    holder = np.flatnonzero(tracks.held_mmsi >= 0)
    if not len(holder):
        return tracks, associations, bearings
    count = int(associations.vessel.max(initial=-1)) + 1
    has_ais, is_held = np.zeros(count, np.bool_), np.zeros(count, np.bool_)
    has_ais[associations.vessel[kinds[tracks.source] == SourceKind.AIS]] = True
    holder = holder[has_ais[associations.vessel[holder]]]
    variance = tracks.covariance[holder, 0, 0] + tracks.covariance[holder, 1, 1]
    holder = holder[np.lexsort((holder, variance, associations.vessel[holder]))]
    vessel, best = np.unique(associations.vessel[holder], return_index=True)
    is_held[vessel] = True
    counted: Bools = ~is_held[associations.vessel]
    counted[holder[best]] = True
    row = np.cumsum(counted) - 1
    kept = counted[associations.first] & counted[associations.second]
    fused = replace(
        associations,
        first=row[associations.first[kept]],
        second=row[associations.second[kept]],
        statistic=associations.statistic[kept],
        vessel=associations.vessel[counted],
    )
    lost = bearings.vessel >= count
    return tracks.take(counted), fused, bearings.take(lost | ~np.append(is_held, False)[np.minimum(bearings.vessel, count)])
