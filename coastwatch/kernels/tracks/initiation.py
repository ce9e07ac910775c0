"""How tracks begin by M plots in N looks: two plots, then a filter that takes the nearest plot of each look. Compiled by numba.

Source: F. Heymann et al., Validation of Radar Image Tracking Algorithms with Simulated Data, section 3.2.1.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from coastwatch.kernels.arrays import Floats
from coastwatch.kernels.filters.unscented import COURSE, measured, predict, turn_round, wrapped
from coastwatch.kernels.jit import jit
from coastwatch.kernels.tables.copies import copy_into
from coastwatch.kernels.tracks.polar_update import NEAR, SIGMAS, squared

LEAST_DT = 0.1  # between two plots of one vessel


class StartRules(NamedTuple):
    """How plots become preliminary tracks, and these take plots."""

    gate: float  # squared distance of a plot from a preliminary track
    max_speed: float  # between the first two plots
    half: float  # of a turn: between two plots of a vessel there is more
    acceleration: float  # deviation, of a step, of preliminary tracks in velocities
    noise: Floats  # (2,) variance a second of course and speed, of those in course and speed
    in_course: bool  # they are in course and speed


@jit
def pair_tentative(time, position, variance, plots, free, rules):  # type: ignore[no-untyped-def]
    """The free plot that follows each tentative track, relatively nearest by the speed gate, -1: none. (Z,)

    Args: time, position, variance: (Z,), (Z, 2), (Z, 2) of single plots: m2, and m2 across the beam; plots: PolarPlots; free: (M,),
    written; rules: StartRules.
    """
    out = np.full(len(time), -1)
    for z in range(len(time)):
        least = 1.0
        for m in range(len(plots.time)):
            dt = plots.time[m] - time[z]
            if not free[m] or dt <= rules.half:
                continue
            off = math.hypot(plots.position[m, 0] - position[z, 0], plots.position[m, 1] - position[z, 1])
            slack = 3.0 * (math.sqrt(variance[z, 0] + plots.variance[m, 0]) + math.sqrt(variance[z, 1]))
            share = off / (rules.max_speed * max(dt, LEAST_DT) + slack)
            if share < least:
                least, out[z] = share, m
        if out[z] >= 0:
            free[out[z]] = False
    return out


@jit
def update_preliminary(tracks, looked, order, plots, free, site, rules):  # type: ignore[no-untyped-def]
    """Give each preliminary track the nearest free plot in its gate, and update it, in place. Returns: the plot of each, -1: none. (P,)

    Args: tracks: time (P,), state (P, 4), covariance (P, 4, 4); looked: (P,) time of the last look; order: (P,) who chooses first;
    plots: PolarPlots; free: (M,), written; site: (2,); rules: StartRules.
    """
    time, state, covariance = tracks
    out = np.full(len(time), -1)
    for n in order:
        x, p, best = state[n], covariance[n], rules.gate
        ve, vn = x[2], x[3]
        if rules.in_course:
            ve, vn = x[3] * math.sin(x[COURSE]), x[3] * math.cos(x[COURSE])
        reach = NEAR + SIGMAS * math.sqrt(max(p[0, 0], p[1, 1]))
        for m in range(len(plots.time)):
            dt = plots.time[m] - time[n]
            off = math.hypot(plots.position[m, 0] - x[0] - dt * ve, plots.position[m, 1] - x[1] - dt * vn)
            if free[m] and plots.time[m] - looked[n] > rules.half and off < reach:
                square = _step(x.copy(), p.copy(), m, dt, plots, (site, rules, False))
                if square < best:
                    best, out[n] = square, m
        if out[n] >= 0:
            m = out[n]
            free[m] = False
            _step(x, p, m, plots.time[m] - time[n], plots, (site, rules, True))
            time[n] = max(time[n], plots.time[m])
    return out


@jit
def _step(x, p, m, dt, plots, how):  # type: ignore[no-untyped-def]
    """Predict a preliminary track to a plot and, if asked, update it, in place. Returns: the squared distance.

    Args: how: site, rules, whether it is asked.
    """
    site, rules, updates = how
    predicted, spread, cross = np.empty(2), np.empty((2, 2)), np.empty((4, 2))
    if rules.in_course:
        predict(0, x, p, dt, rules.noise)
        measured(4, x, p, site, predicted, spread, cross)
        u, v, square, i00, i01, i11, _ = squared(plots.polar[m], plots.variance[m], predicted, spread)
    else:
        _predict_straight(x, p, max(dt, 0.0), rules.acceleration)
        copy_into(predicted, x[:2])
        copy_into(cross, p[:, :2])
        sin, cos = math.sin(plots.polar[m, 1]), math.cos(plots.polar[m, 1])
        along, across = plots.variance[m, 0], plots.polar[m, 0] ** 2 * plots.variance[m, 1]
        ee, nn = p[0, 0] + along * sin * sin + across * cos * cos, p[1, 1] + along * cos * cos + across * sin * sin
        en = p[0, 1] + (along - across) * sin * cos
        determinant = ee * nn - en * en
        i00, i01, i11 = nn / determinant, -en / determinant, ee / determinant
        u, v = plots.position[m, 0] - x[0], plots.position[m, 1] - x[1]
        square = i00 * u * u + 2.0 * i01 * u * v + i11 * v * v
    if updates:
        f, g = i00 * u + i01 * v, i01 * u + i11 * v
        gain = np.empty((4, 2))
        for i in range(4):
            gain[i, 0], gain[i, 1] = cross[i, 0] * i00 + cross[i, 1] * i01, cross[i, 0] * i01 + cross[i, 1] * i11
        for i in range(4):
            x[i] += cross[i, 0] * f + cross[i, 1] * g
            for j in range(4):
                p[i, j] -= gain[i, 0] * cross[j, 0] + gain[i, 1] * cross[j, 1]
        if rules.in_course:
            x[COURSE] = wrapped(x[COURSE])
            turn_round(x, p, 4)
    return square


@jit
def _predict_straight(x, p, dt, acceleration):  # type: ignore[no-untyped-def]
    """Predict east, north and their rates with white acceleration of a step, in place."""
    for k in range(2):
        x[k] += dt * x[k + 2]
        for j in range(4):
            p[k, j] += dt * p[k + 2, j]
    for k in range(2):
        for j in range(4):
            p[j, k] += dt * p[j, k + 2]
    a2 = acceleration * acceleration
    for k in range(2):
        p[k, k] += a2 * dt**4 / 4.0
        p[k, k + 2] += a2 * dt**3 / 2.0
        p[k + 2, k] += a2 * dt**3 / 2.0
        p[k + 2, k + 2] += a2 * dt * dt
