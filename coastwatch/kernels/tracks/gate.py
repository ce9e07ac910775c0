"""Which plots are in the gates of which tracks, by the combined estimates. Scalar code, compiled by numba.

No model of a filter is touched here: a track in a dense place has many plots near it, and takes one.
"""

import math

import numpy as np

from coastwatch.kernels.geometry import grid
from coastwatch.kernels.jit import jit
from coastwatch.kernels.tracks.columns import SINGLE, Candidates
from coastwatch.kernels.tracks.prediction import predicted_position, predicted_position_covariance

LOG_TWO_PI = math.log(2.0 * math.pi)


@jit
def _grid_near_plots(estimates, rows, plots, limit):  # type: ignore[no-untyped-def]
    """The grid of the tracks that may have a plot in their gates, and the slots of these tracks."""
    first, last = plots.time.min(), plots.time.max()
    middle, half = 0.5 * (first + last), 0.5 * (last - first)
    reach_e, reach_n = math.sqrt(limit * plots.covariance[:, 0, 0].max()), math.sqrt(limit * plots.covariance[:, 1, 1].max())
    low = plots.position[:, 0].min() - reach_e, plots.position[:, 1].min() - reach_n
    high = plots.position[:, 0].max() + reach_e, plots.position[:, 1].max() + reach_n
    slot, position = np.empty(len(rows), np.int64), np.empty((len(rows), 2))
    sigma, drift, count = np.empty(len(rows)), np.empty(len(rows)), 0
    for n in rows:
        east, north = predicted_position(estimates, n, middle)
        dt = max(abs(last - estimates.time[n]), abs(first - estimates.time[n]))
        speed2 = estimates.mean[n, 2] ** 2 + estimates.mean[n, 3] ** 2
        p = estimates.covariance[n]  # standard deviation along any axis, at most, at any time up to dt from its own
        widest = math.sqrt(p[0, 0] + p[1, 1]) + dt * math.sqrt(p[2, 2] + p[3, 3])
        sigma[count] = math.sqrt(widest * widest + estimates.noise[n] * dt * dt * dt / 3.0)
        drift[count] = half * math.sqrt(speed2)
        reach = math.sqrt(limit) * sigma[count] + drift[count]
        if low[0] - reach <= east <= high[0] + reach and low[1] - reach <= north <= high[1] + reach:
            slot[count], position[count, 0], position[count, 1] = n, east, north
            count += 1
    if count > 0:  # one plot far off must not make the cells large
        low = max(low[0], position[:count, 0].min()), max(low[1], position[:count, 1].min())
        high = min(high[0], position[:count, 0].max()), min(high[1], position[:count, 1].max())
    return grid.build(position[:count], sigma[:count], drift[:count], low, high), slot


@jit
def candidates(estimates, rows, plots, limit, late):  # type: ignore[no-untyped-def]
    """The pairs of a plot and a track inside the gate, sorted by plot, then in the order of the tracks: Candidates.

    Args: estimates: Estimates; rows: (N,) slots of the tracks; plots: PlotColumns; limit: squared Mahalanobis distance of the gate;
    late: a plot may be so much older than its track, s.
    """
    if len(plots.time) == 0 or len(rows) == 0:
        return Candidates(np.empty(0, np.int64), np.empty(0, np.int64), np.empty(0), np.empty(0))
    cells, slot = _grid_near_plots(estimates, rows, plots, limit)
    start, point = grid.near(cells, plots.position, plots.covariance, limit)
    plot, track = np.empty(len(point), np.int64), np.empty(len(point), np.int64)
    distance2, log_likelihood, count = np.empty(len(point)), np.empty(len(point)), 0
    for m in range(len(plots.time)):
        time, r = plots.time[m], plots.covariance[m]
        point[start[m] : start[m + 1]].sort()  # the order of the cells is of no matter
        for k in range(start[m], start[m + 1]):
            n = slot[point[k]]
            if time - estimates.time[n] < -late:
                continue
            east, north = predicted_position(estimates, n, time)
            ee, en, nn = predicted_position_covariance(estimates, n, time)
            ee, en, nn = ee + r[0, 0], en + r[1, 0], nn + r[1, 1]
            east, north, determinant = plots.position[m, 0] - east, plots.position[m, 1] - north, ee * nn - en * en
            square = (nn * east * east - 2.0 * en * east * north + ee * north * north) / determinant
            if square <= limit:
                plot[count], track[count], distance2[count] = m, n, square
                log_likelihood[count] = -0.5 * (square + math.log(determinant)) - LOG_TWO_PI
                count += 1
    return Candidates(plot[:count], track[:count], distance2[:count], log_likelihood[:count])


@jit
def reachable(pairs, estimates, status, plots, max_speed):  # type: ignore[no-untyped-def]
    """Whether a single plot can reach a plot at the greatest speed, within three standard deviations; True of other tracks. (A,)

    Args: pairs: Candidates; estimates: Estimates; status: (S,); plots: PlotColumns.
    """
    out = np.ones(len(pairs.plot), np.bool_)
    for a in range(len(pairs.plot)):
        m, n = pairs.plot[a], pairs.track[a]
        if status[n] == SINGLE:
            p, r = estimates.covariance[n], plots.covariance[m]
            east, north = plots.position[m, 0] - estimates.mean[n, 0], plots.position[m, 1] - estimates.mean[n, 1]
            slack = 3.0 * math.sqrt(p[0, 0] + p[1, 1] + r[0, 0] + r[1, 1])
            furthest = max_speed * abs(plots.time[m] - estimates.time[n]) + slack
            out[a] = east * east + north * north <= furthest * furthest
    return out
