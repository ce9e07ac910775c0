"""Since when vessels are without AIS or radar where both see, and which AIS tracks have come apart from their radar tracks.

Scalar code compiled by numba. A cover is frame, head and entry of `cover`.
"""

from __future__ import annotations

import math

from coastwatch.kernels.geometry.cover import ask, in_range
from coastwatch.kernels.geometry.ellipsoid import enu_offset
from coastwatch.kernels.jit import jit

AHEAD = 16  # rows: memory is asked for the cells of those of so many on
RADAR_ALONE, AIS_ALONE, BOTH = 1, 2, 3  # of seen_by


@jit
def unseen(low, high, come, chosen, position, seen_by, heard, seen, before, times, out):  # type: ignore[no-untyped-def]
    """Rows low to high: since when each vessel has radar but no AIS where AIS is heard, or AIS but no radar where radars see.

    Args:
        come, chosen: as in `vessel_rows.present`; position: (R, 2); seen_by: (R,) of `vessel_rows.members`; heard, seen: covers.
        before: the two of the last cycle (S,), by slot; times: now, and after how long the two flags are set.
        out: since when (R,) twice, inf where it is not so, and flags (R,), to which the two of `times` are added.
    """
    now, dark, dark_flag, silent, silent_flag = times
    for r in range(low, high):
        if r + AHEAD < high:
            ask(position[r + AHEAD, 0], position[r + AHEAD, 1], (heard if seen_by[r + AHEAD] == RADAR_ALONE else seen)[1])
        out[0][r] = out[1][r] = math.inf
        slot = chosen[come[r]] if come[r] >= 0 else -1
        if seen_by[r] & BOTH == RADAR_ALONE and in_range(position[r, 0], position[r, 1], heard[0], heard[1], heard[2]):
            out[0][r] = min(before[0][slot], now) if 0 <= slot < len(before[0]) else now
        if seen_by[r] & BOTH == AIS_ALONE and in_range(position[r, 0], position[r, 1], seen[0], seen[1], seen[2]):
            out[1][r] = min(before[1][slot], now) if 0 <= slot < len(before[1]) else now
        if now - out[0][r] >= dark:
            out[2][r] |= dark_flag
        if now - out[1][r] >= silent:
            out[2][r] |= silent_flag


@jit
def _metres(position, a, b):  # type: ignore[no-untyped-def]
    """How far track a is from track b."""
    east, north = enu_offset(position[a, 0], position[a, 1], position[b, 0], position[b, 1])
    return math.sqrt(east * east + north * north)


@jit
def parted(low, high, at, to, before, paired, rows, place, position, seen, times, out):  # type: ignore[no-untyped-def]
    """Tracks low to high: since when each AIS track is one vessel with its mate, and since when it no longer is.

    A pair of the past is kept until either track ends, either has another partner, the AIS track is where no radar sees, the pair was too
    young to mean anything, or it has been apart for too long.
    Args:
        at: (N,) row of each track in the last cycle; to: (L,) the other way round; before: mate, paired since, parted since of the
        last cycle (L,); paired: (N,) whether a radar track is a mate now.
        rows: (N,) the picture's row of each track; place: (R, 2) of each row; position: (N, 2) of each track; seen: a cover.
        times: now, how long a pair must have been one, how long it is kept, from when on and from how many metres it is contradicted.
        out: mate (N,) of this cycle, -1 where none, to which pairs of the past are added; paired since, parted since, contradicted.
    """
    now, least, longest, after, metres = times
    for n in range(low, high):
        out[1][n] = out[2][n] = math.inf
        out[3][n] = False
        last = before[0][at[n]] if at[n] >= 0 else -1
        mate = to[last] if last >= 0 else -1
        if out[0][n] >= 0:
            out[1][n] = before[1][at[n]] if mate == out[0][n] else now
        elif mate >= 0 and not paired[mate]:
            since, begun = before[1][at[n]], min(before[2][at[n]], now)
            lat, lon = place[rows[n], 0], place[rows[n], 1]
            if begun - since >= least and now - begun <= longest and in_range(lat, lon, seen[0], seen[1], seen[2]):
                out[0][n], out[1][n], out[2][n] = mate, since, begun
                out[3][n] = now - begun >= after and _metres(position, n, mate) >= metres
