"""The rows of the picture and of its members, each written once where it stays. Scalar code compiled by numba.

Columns of vessels, here: time, position, velocity, covariance, since, updated, mmsi, flags, origin.
"""

from __future__ import annotations

import math

from coastwatch.kernels.geometry.ellipsoid import DEGREE, SHORTEST_DEGREE, add_enu_offset, wrap_degrees
from coastwatch.kernels.identity.identity_votes import of_slot
from coastwatch.kernels.jit import jit
from coastwatch.kernels.prefetch import fetch

AHEAD = 16  # rows: memory is asked for those of so many on
RADAR, AIS = 0, 1


@jit
def _group(come, at):  # type: ignore[no-untyped-def]
    """The group of a row; negative where there is none."""
    return come[at] if at < len(come) else -1


@jit
def _ask(come, at, start, row):  # type: ignore[no-untyped-def]
    """Asks memory, in steps, for where the tracks of rows far on are told."""
    g = _group(come, at + 2 * AHEAD)
    if g >= 0:
        fetch(start, g)
    g = _group(come, at + AHEAD)
    if g >= 0:
        fetch(row, start[g])


@jit
def _copy(given, g, out, r):  # type: ignore[no-untyped-def]
    """Time, position, velocity and covariance of one row into another."""
    out[0][r] = given[0][g]
    out[1][r, 0], out[1][r, 1] = given[1][g, 0], given[1][g, 1]
    out[2][r, 0], out[2][r, 1] = given[2][g, 0], given[2][g, 1]
    for i in range(4):
        for j in range(4):
            out[3][r, i, j] = given[3][g, i, j]


@jit
def may_meet(low, high, position, velocity, time, now, near, place, order, out):  # type: ignore[no-untyped-def]
    """Which of rows low to high may, moved on in straight motion, be within so many metres of a place; few are that are not.

    Args: position, velocity, time: (F, ...) of the rows; now: s; near: m; place: (M, 2) degrees; order: (M,) of them by latitude.
    out: (F,) written.
    """
    for r in range(low, high):
        lat, lon = position[r, 0], position[r, 1]
        speed = math.sqrt(velocity[r, 0] * velocity[r, 0] + velocity[r, 1] * velocity[r, 1])
        most = (near + 1.01 * speed * abs(now - time[r]) + 10.0) / SHORTEST_DEGREE
        low_k, high_k = 0, len(order)
        while low_k < high_k:
            middle = (low_k + high_k) // 2
            if place[order[middle], 0] < lat - most:
                low_k = middle + 1
            else:
                high_k = middle
        out[r] = False
        around = math.cos(min(abs(lat) + most, 90.0) * DEGREE)
        while low_k < len(order) and place[order[low_k], 0] <= lat + most and not out[r]:
            apart = abs(wrap_degrees(place[order[low_k], 1] - lon))
            out[r] = apart * around * (2.0 / math.pi) <= most  # a chord is no shorter than that part of its arc
            low_k += 1


@jit
def _enter(source, track_id, begin, end, to_track, to_source):  # type: ignore[no-untyped-def]
    """One member more of rows begin to end, which are sorted by source, then track."""
    k = end
    while k > begin and (to_source[k - 1] > source or (to_source[k - 1] == source and to_track[k - 1] > track_id)):
        to_track[k], to_source[k] = to_track[k - 1], to_source[k - 1]
        k -= 1
    to_track[k], to_source[k] = track_id, source


@jit
def summed_up(begin, end, row, tracks):  # type: ignore[no-untyped-def]
    """What the tracks of a vessel say of it: since, updated, mmsi and origin; the last of those with an MMSI names it."""
    started, updated, mmsi, origin = tracks
    since, newest, name, of, of_named = math.inf, -math.inf, -1, -1, -1
    for k in range(begin, end):
        n = row[k]
        since, newest = min(since, started[n]), max(newest, updated[n])
        if mmsi[n] >= 0:
            name, of_named = mmsi[n], origin[n]
        else:
            of = max(of, origin[n])
    return since, newest, name, of_named if name >= 0 else of


@jit
def _ask_rows(come, at, start, row, fused, tracks):  # type: ignore[no-untyped-def]
    """Asks memory for what `present` will make row `at` of."""
    _ask(come, at, start, row)
    g = _group(come, at)
    if g < 0:
        return
    fetch(fused[0], g)
    fetch(fused[1], g)
    fetch(fused[2], g)
    fetch(fused[3], g)
    for k in range(start[g], start[g + 1]):
        fetch(tracks[0], row[k])
        fetch(tracks[1], row[k])
        fetch(tracks[2], row[k])
        fetch(tracks[3], row[k])


@jit
def present(low, high, come, start, row, fused, tracks, chosen, past, out):  # type: ignore[no-untyped-def]
    """Rows low to high of vessels with tracks.

    Args:
        come: (R,) the group of each row, negative: nothing is written; start, row: the tracks of each group; fused: time, position,
        velocity and covariance (V, ...) of each group; tracks: started, updated, mmsi, origin (N,).
        chosen: (V,) the slot of each group, negative where it has none; past: since and mmsi of the shown and the hidden.
        out: the nine columns (R, ...).
    """
    for r in range(low, high):
        _ask_rows(come, r + AHEAD, start, row, fused, tracks)
        g = come[r]
        if g < 0:
            continue
        _copy(fused, g, out, r)
        since, newest, name, of = summed_up(start[g], start[g + 1], row, tracks)
        if chosen[g] >= 0:
            since = min(of_slot(past[0], chosen[g], since), since)
            name = name if name >= 0 else of_slot(past[1], chosen[g], name)
        out[4][r], out[5][r], out[6][r], out[7][r], out[8][r] = since, newest, name, 0, of


@jit
def _ask_members(come, at, start, row, tracks):  # type: ignore[no-untyped-def]
    """Asks memory for what `members` will make row `at` of."""
    _ask(come, at, start, row)
    g = _group(come, at)
    if g >= 0:
        for k in range(start[g], start[g + 1]):
            fetch(tracks[0], row[k])
            fetch(tracks[1], row[k])


@jit
def members(low, high, come, begin, vessel_id, start, row, tracks, kinds, out, pairs):  # type: ignore[no-untyped-def]
    """The tracks of rows low to high, sorted by source, then track, and who is one vessel with whom.

    Args:
        come, start, row: as in `present`; begin: (R + 1,) of each row's tracks; vessel_id: (R,); tracks: track_id and source (N,);
        kinds: of each source.
        out: vessel_id, track_id, source (N,); pairs: seen_by (R,) 1 for radar and 2 for AIS, mate (N,) all -1: the first radar track in
        the vessel of an AIS track, and paired (N,) all False: whether a radar track is such a mate. Written.
    """
    seen_by, mate, paired = pairs
    for r in range(low, high):
        _ask_members(come, r + AHEAD, start, row, tracks)
        g, seen_by[r] = come[r], 0
        if g < 0:
            continue
        radar = -1
        for k in range(start[g], start[g + 1]):
            n, at = row[k], begin[r] + k - start[g]
            _enter(tracks[1][n], tracks[0][n], begin[r], at, out[1], out[2])
            out[0][at] = vessel_id[r]
            kind = kinds[tracks[1][n]]
            seen_by[r] |= 1 << kind
            if kind == RADAR and radar < 0:
                radar = n
        if radar >= 0 and seen_by[r] >> AIS & 1:
            paired[radar] = True
            for k in range(start[g], start[g + 1]):
                if kinds[tracks[1][row[k]]] == AIS:
                    mate[row[k]] = radar


@jit
def _copy_all(ids, given, n, out_ids, out, r):  # type: ignore[no-untyped-def]
    """One row into another."""
    _copy(given, n, out, r)
    out_ids[r], out[4][r], out[5][r] = ids[n], given[4][n], given[5][n]
    out[6][r], out[7][r], out[8][r] = given[6][n], given[7][n], given[8][n]


@jit
def recalled_rows(slots, shown, hidden, out):  # type: ignore[no-untyped-def]
    """The rows of these slots of the shown and, after them, the hidden. Args: shown, hidden, out: ids and the nine columns; written."""
    for r in range(len(slots)):
        later = slots[r] - len(shown[0])
        if later < 0:
            _copy_all(shown[0], shown[1], slots[r], out[0], out[1], r)
        else:
            _copy_all(hidden[0], hidden[1], later, out[0], out[1], r)


@jit
def _grow(p, n, dt, power, out, r):  # type: ignore[no-untyped-def]
    """A covariance after dt in straight motion, with white acceleration of density `power`."""
    for i in range(2):
        for j in range(2):
            own = power if i == j else 0.0
            pv, vp, vv = p[n, i, j + 2], p[n, i + 2, j], p[n, i + 2, j + 2]
            out[r, i, j] = p[n, i, j] + dt * (pv + vp) + dt * dt * (vv + own * dt / 3.0)
            out[r, i, j + 2] = pv + dt * vv + 0.5 * own * dt * dt
            out[r, i + 2, j] = vp + dt * vv + 0.5 * own * dt * dt
            out[r, i + 2, j + 2] = vv + own * dt


@jit
def coasting(low, high, given, of, to, now, power, flag, out):  # type: ignore[no-untyped-def]
    """Rows to[low:high] of `out`: rows of[low:high] of the nine columns `given`, moved on to the time `now` in straight motion."""
    for k in range(low, high):
        n, r = of[k], to[k]
        dt = now - given[0][n]
        lat, lon = given[1][n, 0], given[1][n, 1]
        out[1][r, 0], out[1][r, 1] = add_enu_offset(lat, lon, dt * given[2][n, 0], dt * given[2][n, 1])
        out[2][r, 0], out[2][r, 1] = given[2][n, 0], given[2][n, 1]
        _grow(given[3], n, dt, power, out[3], r)
        out[0][r], out[4][r], out[5][r] = now, given[4][n], given[5][n]
        out[6][r], out[7][r], out[8][r] = given[6][n], flag, given[8][n]
