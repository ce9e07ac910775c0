"""Which pairs of tracks a spot looks at, and how accepted pairs become vessels."""

from __future__ import annotations

import numpy as np

from coastwatch import kernels
from coastwatch.batches import Floats, Ints, Spots, Tracks
from coastwatch.stage import Groups, Shared


def rows_of_spots(spots: Spots) -> Groups:
    """A group a spot with its rows: members as they are, halo rows as -1 - row, so that one array says both."""

    count = len(spots.centre_m)
    halo = np.searchsorted(spots.halo_spot, np.arange(count + 1)).astype(np.int64)
    return Groups(*kernels.tables.sorting.joined(*kernels.tables.sorting.by_key(spots.spot, count), -1 - spots.halo_row, halo))


def gated_pairs(arrays: Shared, rows: Ints, gate_m: float) -> tuple[Ints, Ints]:
    """Pairs of tracks of different sources within the gate that this spot owns: it owns a pair whose lower source is its member.

    Args:
        arrays: `rank` of rows; by rank `point` (N, 3) Earth-centred, `source` (N,).
        rows: (R,) members, and halo as -1 - row.
    Returns: (A,) and (A,) rows of tracks, the first of the lower source; sorted.
    """
    from scipy.spatial import cKDTree

    member = rows[rows >= 0]
    every = np.where(rows >= 0, rows, -1 - rows)
    if len(member) == 0 or len(every) < 2:
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    rank, points, source = arrays["rank"], arrays["point"], arrays["source"]
    found = cKDTree(points[rank[member]]).sparse_distance_matrix(cKDTree(points[rank[every]]), gate_m, output_type="ndarray")
    first, second = member[found["i"]], every[found["j"]]
    keep = source[rank[first]] < source[rank[second]]
    first, second = first[keep], second[keep]
    order = np.lexsort((second, first))
    return first[order].astype(np.int64), second[order].astype(np.int64)


def in_order(first: Ints, second: Ints, statistic: Floats, rows: int) -> tuple[Ints, Ints, Floats]:
    """The same pairs by first, then second: chunks of spots come in any order. Args: (A,); rows: N."""

    order = kernels.tables.groups.by_both(first, rows, second, rows)
    return first[order], second[order], statistic[order]


def one_to_one(tracks: Tracks, first: Ints, second: Ints, gain: Floats) -> Ints:
    """Rows of the pairs of the best one-to-one assignment: a track has at most one partner in each other source.

    Most pairs meet no other and are taken at once.
    Args: first, second: (A,) rows of tracks, pairs each once; gain: (A,), pairs without a positive gain are never chosen.
    Returns: (B,) indices into the pairs, sorted.
    """

    rows, source = len(tracks), tracks.source
    taken = kernels.tables.groups.alone(first, second, gain, rows)
    rest = np.flatnonzero((gain > 0.0) & ~taken)
    sources = int(source.max(initial=0)) + 1
    row, row_count = kernels.tables.groups.combined(first[rest], rows, source[second[rest]], sources)
    column, column_count = kernels.tables.groups.combined(second[rest], rows, source[first[rest]], sources)
    order = kernels.tables.groups.by_both(row, row_count, column, column_count)
    taken[rest[order]] = kernels.association.assignment.assign_numbered(
        row[order], column[order], gain[rest[order]], row_count, column_count
    )
    return np.flatnonzero(taken)


def vessels(tracks: Tracks, first: Ints, second: Ints, gain: Floats) -> tuple[Ints, Ints]:
    """A vessel for every track, no vessel with two tracks of one source, and the pairs that stand.

    Connected pairs are one vessel. Where that would put two tracks of one source together the pairs of that component are
    taken in order of gain and one that would break the rule is left out.
    Args: first, second, gain: (A,). Returns: (N,) vessel of each track, numbered by first track row; (B,) indices of pairs kept.
    """

    parent, following, twice = kernels.association.connected_components.joined(first, second, tracks.source)
    kept = np.ones(len(first), np.bool_)
    if twice.any():
        broken = np.flatnonzero(kernels.association.connected_components.told_of(parent, twice, first))
        order = broken[np.lexsort((tracks.track_id[second[broken]], tracks.track_id[first[broken]], -gain[broken]))]
        kept[order] = kernels.association.connected_components.joined_without_sharing(
            first[order], second[order], tracks.source, parent, following
        )
    return kernels.association.connected_components.numbered(parent), np.flatnonzero(kept).astype(np.int64)
