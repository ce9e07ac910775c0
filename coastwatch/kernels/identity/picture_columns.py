"""Columns of the picture and of its members, from the groups of tracks that are its vessels.

The tracks of group g are row[start[g]:start[g + 1]] of `groups`, which is (start, row).
"""

from __future__ import annotations

import math

from coastwatch.kernels.jit import jit


@jit
def vessel_columns(first, last, group_of_row, groups, fused, tracks, past, out):  # type: ignore[no-untyped-def]
    """Rows first to last of the picture: the fused estimate of each group, and what its tracks say of the vessel.

    A vessel is there since its oldest track began, or since before. The last track with an MMSI names it, else its former name stays.
    Args:
        group_of_row: (R,) group of each row; -1: the vessel has no tracks, its row is not written.
        fused: time_s (V,), position, velocity (V, 2), covariance (V, 4, 4).
        tracks: started_s, updated_s, mmsi, origin (N,).
        past: vessel (R,) of the last cycle that the row continues, -1 if new; since_s, mmsi (K,) of those vessels.
        out: the four columns of `fused`, then since_s, updated_s, mmsi, origin: (R, ...) written.
    """
    start, row = groups
    time_s, position, velocity, covariance = fused
    started_s, updated_s, mmsi, origin = tracks
    vessel, since_s, former_mmsi = past
    out_time_s, out_position, out_velocity, out_covariance, out_since_s, out_updated_s, out_mmsi, out_origin = out
    for r in range(first, last):
        g = group_of_row[r]
        if g < 0:
            continue
        out_time_s[r] = time_s[g]
        for i in range(2):
            out_position[r, i], out_velocity[r, i] = position[g, i], velocity[g, i]
        for i in range(4):
            for j in range(4):
                out_covariance[r, i, j] = covariance[g, i, j]
        since, newest, name, origin_of_named, origin_of_others = math.inf, -math.inf, -1, -1, -1
        for k in range(start[g], start[g + 1]):
            n = row[k]
            since, newest = min(since, started_s[n]), max(newest, updated_s[n])
            if mmsi[n] >= 0:
                name, origin_of_named = mmsi[n], origin[n]
            else:
                origin_of_others = max(origin_of_others, origin[n])
        out_origin[r] = origin_of_named if name >= 0 else origin_of_others
        if vessel[r] >= 0:
            since = min(since, since_s[vessel[r]])
            name = name if name >= 0 else former_mmsi[vessel[r]]
        out_since_s[r], out_updated_s[r], out_mmsi[r] = since, newest, name


@jit
def members(first, last, group_of_row, member_start, groups, tracks, out):  # type: ignore[no-untyped-def]
    """The tracks of the vessels in rows first to last, sorted by source, then track id.

    Args:
        group_of_row: (R,) group of each row, -1 if the vessel has no tracks; member_start: (R + 1,) first member of each row.
        tracks, out: track_id, source (N,); `out` is written.
    """
    start, row = groups
    track_id, source = tracks
    out_track_id, out_source = out
    for r in range(first, last):
        g, begin = group_of_row[r], member_start[r]
        if g < 0:
            continue
        for k in range(start[g], start[g + 1]):
            n, at = row[k], begin + k - start[g]
            # Insertion sort: a vessel has few tracks, and they mostly come in order.
            while at > begin and (
                out_source[at - 1] > source[n] or (out_source[at - 1] == source[n] and out_track_id[at - 1] > track_id[n])
            ):
                out_track_id[at], out_source[at] = out_track_id[at - 1], out_source[at - 1]
                at -= 1
            out_track_id[at], out_source[at] = track_id[n], source[n]
