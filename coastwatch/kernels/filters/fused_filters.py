"""The filters of vessels from cycle to cycle, around `kicked_imm`: which go on, what they are told, where they begin.

Scalar code compiled by numba, arguments as in `fusing`. A filter is a row of anchor (degrees), models (J, WIDTH), mode and time of its
newest measurement; east and north in it are metres from the anchor.
"""

from __future__ import annotations

import math

import numpy as np

from coastwatch.kernels.filters.velocity_jumps import SIZE
from coastwatch.kernels.fusion.covariance_intersection import alone
from coastwatch.kernels.geometry.ellipsoid import add_enu_offset, enu_offset
from coastwatch.kernels.jit import jit
from coastwatch.kernels.tables.counting_sort import counting_sort

RADAR, AIS = 0, 1
TURN = SIZE + 14  # of the numbers of a model: the variance of its turn rate


@jit
def former(at, filter_of, filters, heard_row, heard_time):  # type: ignore[no-untyped-def]
    """The filter of each track in the last cycle, -1 where none (N,); how many tracks of each filter live (F,); the newest that each track
    was told (N,), -inf where nothing.

    Args: at: (N,) row of each track in the last cycle; filter_of: (L,); heard_row, heard_time: (M,) track and time of each measurement.
    """
    was, alive = np.full(len(at), -1, np.int32), np.zeros(filters, np.int32)
    for n in range(len(at)):
        if at[n] >= 0 and filter_of[at[n]] >= 0:
            was[n] = filter_of[at[n]]
            alive[was[n]] += 1
    heard = np.full(len(at), -np.inf)
    for k in range(len(heard_row)):
        if heard_row[k] >= 0:
            heard[heard_row[k]] = max(heard[heard_row[k]], heard_time[k])
    return was, alive, heard


@jit
def going_on(low, high, start, row, was, alive, heard, updated, newest, out):  # type: ignore[no-untyped-def]
    """The filter with which each of the vessels low to high goes on, -1: with none. (V,)

    A filter goes on where all of its tracks that still live are, and no track of another filter: then nothing that it heard was of another
    vessel; and where it was told of all that its tracks were updated with: else it would starve.
    Args: was, alive, heard: of `former`; updated: (N,) of each track; newest: (F,) of each filter.
    """
    for v in range(low, high):
        of, here, told, last = -1, 0, -math.inf, -math.inf
        one = True
        for k in range(start[v], start[v + 1]):
            n = row[k]
            told, last = max(told, heard[n]), max(last, updated[n])
            if was[n] >= 0:
                one = one and (of < 0 or of == was[n])
                of, here = was[n], here + 1
        out[v] = of if one and of >= 0 and alive[of] == here and last <= max(told, newest[of]) else -1


@jit
def told(filter_of, heard_row, time, sensor, count):  # type: ignore[no-untyped-def]
    """The measurements of each filter in order of time, then sensor: begin (count + 1,) and order (M',).

    Args: filter_of: (N,) of each track; any but 0 to count - 1: is told nothing; heard_row: (M,) the track of each measurement.
    """
    mine = np.full(len(heard_row), count, np.int32)
    for m in range(len(heard_row)):
        if heard_row[m] >= 0 and 0 <= filter_of[heard_row[m]] < count:
            mine[m] = filter_of[heard_row[m]]
    begin, order = counting_sort(mine, count + 1)
    for f in range(count):
        for k in range(begin[f] + 1, begin[f + 1]):
            m, at = order[k], k
            while at > begin[f] and _later(order[at - 1], m, time, sensor):
                order[at] = order[at - 1]
                at -= 1
            order[at] = m
    return begin[: count + 1], order[: begin[count]]


@jit
def _later(a, b, time, sensor):  # type: ignore[no-untyped-def]
    return time[a] > time[b] or (time[a] == time[b] and sensor[a] > sensor[b])


@jit
def continued(low, high, of, before, after):  # type: ignore[no-untyped-def]
    """Filters of[low:high] of the last cycle into rows low to high of this one's."""
    for f in range(low, high):
        old = of[f]
        after[0][f, 0], after[0][f, 1] = before[0][old, 0], before[0][old, 1]
        for j in range(before[2].shape[1]):
            for k in range(before[1].shape[2]):
                after[1][f, j, k] = before[1][old, j, k]
            after[2][f, j] = before[2][old, j]
        after[3][f] = before[3][old]


@jit
def _registration(plot, site, p00, p10, p11, shares):  # type: ignore[no-untyped-def]
    """What is added to the covariance of a plot's place: shares of its variance along and across the beam."""
    east, north = enu_offset(plot[0], plot[1], site[0], site[1])
    far = max(math.sqrt(east * east + north * north), 1.0)
    e, n = east / far, north / far
    along = shares[0] * (e * e * p00 + 2.0 * e * n * p10 + n * n * p11)
    across = shares[1] * (n * n * p00 - 2.0 * e * n * p10 + e * e * p11)
    return along * e * e + across * n * n, (along - across) * e * n, along * n * n + across * e * e


@jit
def expressed(low, high, which, start, row, source, kinds, begin, order, given, anchor, shares, z):  # type: ignore[no-untyped-def]
    """The measurements of filters low to high as `kicked_imm.absorb` takes them, into `z` (M, 10).

    Args:
        which: (F,) vessel of each filter; start, row, source, kinds: its tracks, the source of each and the kind of each source.
        begin, order: of `told`; given: place (M, 2), velocity, covariance (M, 4, 4), site and sensor of each measurement; anchor: (F, 2);
        shares: of a plot's variance along and across the beam that are added where AIS is in the vessel.
    """
    position, velocity, covariance, site, sensor = given
    for f in range(low, high):
        ais = False
        for k in range(start[which[f]], start[which[f] + 1]):
            ais = ais or kinds[source[row[k]]] == AIS
        lat, lon = anchor[f, 0], anchor[f, 1]
        for k in range(begin[f], begin[f + 1]):
            m, c = order[k], covariance[order[k]]
            z[m, 0], z[m, 1] = enu_offset(position[m, 0], position[m, 1], lat, lon)
            z[m, 2], z[m, 3] = velocity[m, 0], velocity[m, 1]
            z[m, 4], z[m, 5], z[m, 6] = c[0, 0], c[1, 0], c[1, 1]
            z[m, 7], z[m, 8], z[m, 9] = c[2, 2], c[3, 2], c[3, 3]
            if ais and sensor[m] >= 0:
                a, b, d = _registration(position[m], site[m], c[0, 0], c[1, 0], c[1, 1], shares)
                z[m, 4], z[m, 5], z[m, 6] = c[0, 0] + a, c[1, 0] + b, c[1, 1] + d


@jit
def shown(low, high, which, start, row, source, kinds, mean, spread, filters, out):  # type: ignore[no-untyped-def]
    """Anchors of filters low to high to where the vessels are; the vessels that are shown by them, into rows which[low:high] of `out`.

    A vessel of one track is shown by its filter where that is fed by a radar.
    Args: which, start, row, source, kinds: as in `expressed`; mean (F, 5), spread (F, 5, 5): of `kicked_imm.foresee`; filters: written.
    """
    anchor, models = filters[0], filters[1]
    for f in range(low, high):
        v = which[f]
        anchor[f, 0], anchor[f, 1] = add_enu_offset(anchor[f, 0], anchor[f, 1], mean[f, 0], mean[f, 1])
        for j in range(models.shape[1]):
            models[f, j, 0] -= mean[f, 0]
            models[f, j, 1] -= mean[f, 1]
        seen = start[v + 1] - start[v] > 1
        for k in range(start[v], start[v + 1]):
            seen = seen or kinds[source[row[k]]] == RADAR
        if seen:
            out[0][v, 0], out[0][v, 1] = anchor[f, 0], anchor[f, 1]
            out[1][v, 0], out[1][v, 1] = mean[f, 2], mean[f, 3]
            for a in range(4):
                for b in range(4):
                    out[2][v, a, b] = spread[f, a, b]


@jit
def begun(low, high, which, first, now, share, turn_variance, out, filters):  # type: ignore[no-untyped-def]
    """Filters first + low to first + high as they begin, at the estimates `out` of vessels which[low:high]."""
    anchor, models, mode, newest = filters
    for k in range(low, high):
        v, f = which[k], first + k
        anchor[f, 0], anchor[f, 1] = out[0][v, 0], out[0][v, 1]
        newest[f] = now
        for j in range(len(share)):
            mode[f, j] = share[j]
            for c in range(models.shape[2]):
                models[f, j, c] = 0.0
            models[f, j, 2], models[f, j, 3] = out[1][v, 0], out[1][v, 1]
            at = SIZE
            for a in range(4):
                for b in range(a + 1):
                    models[f, j, at] = out[2][v, a, b]
                    at += 1
            models[f, j, TURN] = turn_variance


@jit
def single(low, high, start, row, tracks, sigma, out):  # type: ignore[no-untyped-def]
    """The vessels low to high that have one track, as that track."""
    for v in range(low, high):
        if start[v + 1] - start[v] == 1:
            alone(tracks, row[start[v]], sigma, out, v)
