"""Tracks as the association kernels read them: in an order in which neighbours stand together, in few wide rows."""

from __future__ import annotations

import math

from coastwatch.geodesy import ECCENTRICITY2
from coastwatch.kernels.association.history import EAST_RATE, ENTRY_BYTES, NORTH_RATE, RATE_VARIANCE, VARIANCE, fetch
from coastwatch.kernels.geometry.ellipsoid import DEGREE, SEMI_MAJOR, sine_cosine
from coastwatch.kernels.jit import jit

COLUMNS = 16  # of a record; 0 to 9: covariance, lower triangle row by row
BIAS = 10  # to 12: the registration term, likewise
NORTH, EAST, ROUGH = 13, 14, 15  # metres a degree here; relative error of a difference within the gate by these
LEAST_ERROR = 1e-4  # part of ROUGH besides what meridians that converge make of it
AHEAD = (
    10  # rows whose places are asked for while one is worked on: the order of tracks has nothing to do with that of their rows
)


@jit
def _ask(i, point, entry, record):  # type: ignore[no-untyped-def]
    fetch(record.ctypes.data + 128 * i)  # type: ignore[call-arg]
    fetch(record.ctypes.data + 128 * i + 64)
    fetch(entry.ctypes.data + ENTRY_BYTES * i)
    fetch(point.ctypes.data + 32 * i)


@jit
def _shape(r, covariance, report, mmsi, velocity_variance, share, i, record):  # type: ignore[no-untyped-def]
    """The covariance, or where it is not all finite that of one report, and the registration term of a row into the record of track i."""
    check = 0.0
    for j in range(4):
        for k in range(4):
            check += 0.0 * covariance[r, j, k]
    q = 0
    for j in range(4):
        for k in range(j + 1):
            record[i, q] = covariance[r, j, k] if check == 0.0 else 0.0
            q += 1
    if check != 0.0:
        record[i, 0], record[i, 1], record[i, 2] = report[r, 0, 0], report[r, 1, 0], report[r, 1, 1]
        record[i, 5] = record[i, 9] = velocity_variance
    radar = mmsi[r] < 0
    record[i, BIAS] = share * report[r, 0, 0] if radar else 0.0
    record[i, BIAS + 1] = share * report[r, 1, 0] if radar else 0.0
    record[i, BIAS + 2] = share * report[r, 1, 1] if radar else 0.0


@jit
def facts(  # type: ignore[no-untyped-def]
    low,
    high,
    rank,
    position,
    velocity,
    covariance,
    report,
    mmsi,
    source,
    velocity_variance,
    share,
    gate,
    point,
    entry,
    single,
    record,
):
    """What is known of the tracks of rows low to high, each written where its rank says.

    Rows are read one after the other and written anywhere, because a processor waits for what it reads and not for what it writes.

    Args:
        rank: (N,). position, velocity, covariance, report, mmsi, source: of the tracks, C-contiguous.
        velocity_variance: a axis, of a track without covariance; share: of a radar's report that is the registration term; gate: in metres.
        point: (N, 4) Earth-centred, and the source; entry: (N, rings.COLUMNS) of the ring; single: the same of
        `rings.singles`; record: (N, COLUMNS).
    """
    for r in range(low, high):
        _ask(rank[min(r + AHEAD, len(rank) - 1)], point, entry, record)
        i = rank[r]
        sp, cp = sine_cosine(position[r, 0])
        sl, cl = sine_cosine(position[r, 1])
        w2 = 1.0 - ECCENTRICITY2 * sp * sp
        across = SEMI_MAJOR / math.sqrt(w2)
        point[i, 0], point[i, 1], point[i, 2], point[i, 3] = (
            across * cp * cl,
            across * cp * sl,
            across * (1.0 - ECCENTRICITY2) * sp,
            source[r],
        )
        record[i, EAST], record[i, NORTH] = across * cp * DEGREE, across * (1.0 - ECCENTRICITY2) / w2 * DEGREE
        record[i, ROUGH] = LEAST_ERROR + gate / SEMI_MAJOR * abs(sp) / max(cp, LEAST_ERROR)
        _shape(r, covariance, report, mmsi, velocity_variance, share, i, record)
        entry[i, 0], entry[i, 1] = position[r, 0], position[r, 1]
        single[i, EAST_RATE], single[i, NORTH_RATE] = velocity[r, 0], velocity[r, 1]
        single[i, VARIANCE], single[i, RATE_VARIANCE] = record[i, 0] + record[i, 2], record[i, 5] + record[i, 9]


@jit
def come_from(low, high, rank, previous, rank_before, out):  # type: ignore[no-untyped-def]
    """The rank that each track, by its rank now, had at the last cycle; -1 for none.

    Args: low, high: rows; rank: (N,) of rows; previous: (N,) rows at the last cycle, -1 for none; rank_before: of those.
    """
    for r in range(low, high):
        out[rank[r]] = rank_before[previous[r]] if previous[r] >= 0 else -1


@jit
def carried(low, high, before, chain_before, length_before, chain, length):  # type: ignore[no-untyped-def]
    """Where the entries of tracks low to high stand in the arrays of the last cycles, and how many there are.

    Args: before: of `come_from`; chain_before, length_before: what this said at the last cycle. Writes: chain: (N, W - 1), the last cycle
    first; length: (N,).
    """
    window = chain.shape[1] + 1
    for i in range(low, high):
        at = before[i]
        length[i] = min(length_before[at] + 1, window) if at >= 0 else 1
        if window > 1:
            chain[i, 0] = max(at, 0)
        for k in range(1, window - 1):
            chain[i, k] = chain_before[at, k - 1] if at >= 0 else 0
