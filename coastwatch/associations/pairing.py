"""Which pairs of tracks a spot looks at, and how accepted pairs become vessels."""

from __future__ import annotations

import numpy as np

from coastwatch.batches import Floats, Ints, Octants, Spots, Tracks
from coastwatch.stage import Groups, Shared


def rows_of_spots(spots: Spots) -> Groups:
    """A group a spot with its rows: members as they are, halo rows as -1 - row, so that one array says both."""
    from coastwatch.kernels.sorting import by_key, joined

    count = len(spots.centre_m)
    halo = np.searchsorted(spots.halo_spot, np.arange(count + 1)).astype(np.int64)
    return Groups(*joined(*by_key(spots.spot, count), -1 - spots.halo_row, halo))


def by_octant(octants: Octants) -> Groups:
    """A group an octant that has pairs: their indices."""
    order = np.argsort(octants.octant, kind="stable")
    edge = np.flatnonzero(np.diff(octants.octant[order])) + 1
    ends = [len(order)] if len(order) else []
    return Groups(order.astype(np.int64), np.concatenate([[0], edge, ends]).astype(np.int64))


def gated_pairs(arrays: Shared, rows: Ints, gate_m: float) -> tuple[Ints, Ints]:
    """Pairs of tracks of different sources within the gate that this spot owns: it owns a pair whose lower source is its member.

    Args:
        arrays: `point_m` (N, 3) Earth-centred, `source` (N,).
        rows: (R,) members, and halo as -1 - row.
    Returns: (A,) and (A,) rows of tracks, the first of the lower source; sorted.
    """
    from scipy.spatial import cKDTree

    member = rows[rows >= 0]
    every = np.where(rows >= 0, rows, -1 - rows)
    if len(member) == 0 or len(every) < 2:
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    points, source = arrays["point_m"], arrays["source"]
    found = cKDTree(points[member]).sparse_distance_matrix(cKDTree(points[every]), gate_m, output_type="ndarray")
    first, second = member[found["i"]], every[found["j"]]
    keep = source[first] < source[second]
    first, second = first[keep], second[keep]
    order = np.lexsort((second, first))
    return first[order].astype(np.int64), second[order].astype(np.int64)


def one_to_one(tracks: Tracks, first: Ints, second: Ints, gain: Floats) -> Ints:
    """Rows of the pairs of the best one-to-one assignment: a track has at most one partner in each other source.

    Args: first, second: (A,) rows of tracks, pairs each once; gain: (A,), pairs without a positive gain are never chosen.
    Returns: (B,) indices into the pairs, sorted.
    """
    from coastwatch.kernels.assignment import assign

    sources = int(tracks.source.max(initial=0)) + 1
    left = first * sources + tracks.source[second]
    right = second * sources + tracks.source[first]
    return np.flatnonzero(assign(left, right, gain)).astype(np.int64)


def vessels(tracks: Tracks, first: Ints, second: Ints, gain: Floats) -> tuple[Ints, Ints]:
    """A vessel for every track, no vessel with two tracks of one source, and the pairs that stand.

    Connected pairs are one vessel. Where that would put two tracks of one source together the pairs of that component are
    taken in order of gain and one that would break the rule is left out.
    Args: first, second, gain: (A,). Returns: (N,) vessel of each track, numbered by first track row; (B,) indices of pairs kept.
    """
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    count = len(tracks)
    kept = np.arange(len(first))
    graph = coo_matrix((np.ones(len(first), np.int8), (first, second)), shape=(count, count))
    label = np.asarray(connected_components(graph, directed=False)[1], np.int64)
    sources = int(tracks.source.max(initial=0)) + 1
    key, size = np.unique(label * sources + tracks.source, return_counts=True)
    broken = np.unique(key[size > 1] // sources)
    if len(broken):
        conflicted = np.isin(label[first], broken)
        kept = np.concatenate([kept[~conflicted], _without_conflict(tracks, first, second, gain, kept[conflicted])])
        kept = np.sort(kept)
        graph = coo_matrix((np.ones(len(kept), np.int8), (first[kept], second[kept])), shape=(count, count))
        label = np.asarray(connected_components(graph, directed=False)[1], np.int64)
    return _by_first_row(label), kept.astype(np.int64)


def _by_first_row(label: Ints) -> Ints:
    _, at, inverse = np.unique(label, return_index=True, return_inverse=True)
    rank = np.empty(len(at), np.int64)
    rank[np.argsort(at, kind="stable")] = np.arange(len(at))
    return rank[inverse]


def _without_conflict(tracks: Tracks, first: Ints, second: Ints, gain: Floats, pairs: Ints) -> Ints:
    """Greedy merge of the few pairs of conflicted components; a Python loop over those alone."""
    order = pairs[np.lexsort((tracks.track_id[second[pairs]], tracks.track_id[first[pairs]], -gain[pairs]))]
    group: dict[int, int] = {}
    held: dict[int, set[int]] = {}
    members: dict[int, list[int]] = {}
    keep = []
    for p in order.tolist():
        a, b = int(first[p]), int(second[p])
        for row in (a, b):
            if row not in group:
                group[row], held[row], members[row] = row, {int(tracks.source[row])}, [row]
        ga, gb = group[a], group[b]
        if ga != gb and held[ga] & held[gb]:
            continue
        keep.append(p)
        if ga != gb:
            held[ga] |= held.pop(gb)
            for row in members.pop(gb):
                group[row] = ga
                members[ga].append(row)
    return np.array(keep, np.int64)
