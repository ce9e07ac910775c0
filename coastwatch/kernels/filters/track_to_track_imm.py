"""A bank of models a vessel that takes its tracks for measurements: carried over, predicted, updated and shown vessel by vessel.

Scalar code compiled by numba, arguments as in `fusing`; the filter is that of `imm`.
"""

from __future__ import annotations

import numpy as np

from coastwatch.kernels.filters.imm import SIZE, moments, predict_row, room_to_predict, room_to_update, update_row
from coastwatch.kernels.fusion.covariance_intersection import alone, ask, known
from coastwatch.kernels.geometry.ellipsoid import add_enu_offset, enu_offset
from coastwatch.kernels.jit import jit


@jit
def _fill(a, out):  # type: ignore[no-untyped-def]
    """A symmetric matrix as ten numbers into the upper left of another."""
    out[0, 0], out[1, 1], out[2, 2], out[3, 3] = a[0], a[2], a[5], a[9]
    out[1, 0], out[2, 0], out[2, 1], out[3, 0], out[3, 1], out[3, 2] = a[1], a[3], a[4], a[6], a[7], a[8]
    out[0, 1], out[0, 2], out[1, 2], out[0, 3], out[1, 3], out[2, 3] = a[1], a[3], a[4], a[6], a[7], a[8]


@jit
def _begin(tracks, n, sigma, turn_variance, state, spread, mode):  # type: ignore[no-untyped-def]
    """A bank at a track, into the last three."""
    models = len(mode)
    for m in range(models):
        for i in range(SIZE):
            state[m, i] = 0.0
            for j in range(SIZE):
                spread[m, i, j] = 0.0
        state[m, 2], state[m, 3] = tracks[1][n, 0], tracks[1][n, 1]
        _fill(known(tracks, n, sigma), spread[m])
        spread[m, 4, 4] = turn_variance
        mode[m] = 1.0 / models


@jit
def _measure(tracks, n, sigma, inflation, place, z, r):  # type: ignore[no-untyped-def]
    """A track as a measurement from a place (lat, lon), its covariance taken `inflation` times, into the last two."""
    position, velocity = tracks[0], tracks[1]
    z[0], z[1] = enu_offset(position[n, 0], position[n, 1], place[0], place[1])
    z[2], z[3] = velocity[n, 0], velocity[n, 1]
    a, s = known(tracks, n, sigma), inflation
    _fill((s * a[0], s * a[1], s * a[2], s * a[3], s * a[4], s * a[5], s * a[6], s * a[7], s * a[8], s * a[9]), r)


@jit
def _former(begin, end, row, was):  # type: ignore[no-untyped-def]
    """The filter that the first of these tracks that was in one was in, -1 where none."""
    for k in range(begin, end):
        if was[row[k]] >= 0:
            return was[row[k]]
    return -1


@jit
def filtered(low, high, start, row, tracks, sigma, was, before, dt, models, turn_variance, inflation, after, out):  # type: ignore[no-untyped-def]
    """Vessels low to high by the filters of their tracks; a vessel of one track is that track, its filter goes on besides.

    Args:
        row: in the order in which tracks are taken; was: (N,) the filter of the last cycle that each track was in, -1 where none.
        before, after: anchor (F, 2), state (F, J, 5), covariance (F, J, 5, 5) and mode (F, J) of the last cycle; of this: written.
        dt: s between the two; models: kind, noise, turn_noise, turn_sigma, sojourn, (J,) each.
    """
    anchor, state, spread, mode = after
    predicting, updating = room_to_predict(mode.shape[1]), room_to_update(mode.shape[1])
    z, r, mean, total = np.zeros(4), np.zeros((4, 4)), np.zeros(SIZE), np.zeros((SIZE, SIZE))
    for v in range(low, high):
        begin, end = start[v], start[v + 1]
        ask(tracks, row, begin, end)
        lat, lon = tracks[0][row[begin], 0], tracks[0][row[begin], 1]
        place = lat, lon
        anchor[v, 0], anchor[v, 1] = lat, lon
        f = _former(begin, end, row, was)
        if f < 0:
            _begin(tracks, row[begin], sigma, turn_variance, state[v], spread[v], mode[v])
        else:
            predict_row(before[1][f], before[2][f], before[3][f], dt, models, predicting, state[v], spread[v], mode[v])
            east, north = enu_offset(before[0][f, 0], before[0][f, 1], place[0], place[1])
            for m in range(mode.shape[1]):
                state[v, m, 0] += east
                state[v, m, 1] += north
        for k in range(begin, end):
            _measure(tracks, row[k], sigma, inflation, place, z, r)
            update_row(state[v], spread[v], mode[v], z, r, 4, updating, state[v], spread[v], mode[v])
        if end - begin == 1:
            alone(tracks, row[begin], sigma, out, v)
            continue
        moments(state[v], spread[v], mode[v], mean, total)
        out[0][v, 0], out[0][v, 1] = add_enu_offset(lat, lon, mean[0], mean[1])
        out[1][v, 0], out[1][v, 1] = mean[2], mean[3]
        for i in range(4):
            for j in range(4):
                out[2][v, i, j] = total[i, j]
