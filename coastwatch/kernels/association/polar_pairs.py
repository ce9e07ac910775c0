"""Pairs of a radar's plots and vessels of about the same range and azimuth, and how the two differ. Scalar code, compiled by numba."""

import math

import numpy as np

from coastwatch.kernels.geometry.ellipsoid import enu_rotation, to_enu
from coastwatch.kernels.jit import jit
from coastwatch.kernels.tables.counting_sort import counting_sort

RING = 250.0  # m, width of the cells in range
SECTORS = 36  # cells of a ring
TURN = 2.0 * math.pi


@jit
def sweeps(radar, time, site, count):  # type: ignore[no-untyped-def]
    """The oldest and the newest plot of each radar, -1 for none, and how far its antenna is from that at the oldest, at most.

    Args: radar: (M,) 0 to count - 1; time: (M,); site: (M, 2) m. Returns: (R,), (R,), (R,) m.
    """
    oldest, newest, shift = np.full(count, -1, np.int64), np.full(count, -1, np.int64), np.zeros(count)
    for m in range(len(radar)):
        r = radar[m]
        if oldest[r] < 0 or time[m] < time[oldest[r]]:
            oldest[r] = m
        if newest[r] < 0 or time[m] > time[newest[r]]:
            newest[r] = m
    for m in range(len(radar)):
        there = oldest[radar[m]]
        east, north = site[m, 0] - site[there, 0], site[m, 1] - site[there, 1]
        if east != 0.0 or north != 0.0:
            shift[radar[m]] = max(shift[radar[m]], math.sqrt(east * east + north * north))
    return oldest, newest, shift


@jit
def near_pairs(radar, distance, azimuth, radar_of_vessel, vessels, search):  # type: ignore[no-untyped-def]
    """Plot and vessel of all pairs of one radar that differ by no more than the search of the vessel. (A,), (A,), sorted by vessel

    Vessels stand in all polar cells that their search reaches, so a plot is compared with the vessels of its own cell alone.
    Args: radar, distance, azimuth: (M,) of plots; radar_of_vessel: (V,); vessels: (V, 2) range, azimuth seen from there; search: (V, 2)
    m, rad, to each side.
    """
    rings = 1
    for v in range(len(vessels)):
        rings = max(rings, int((vessels[v, 0] + search[v, 0]) / RING) + 1)
    last = 0
    for v in range(len(vessels)):
        last = max(last, radar_of_vessel[v])
    start, entry = _vessels_in_cells(radar_of_vessel, vessels, search, rings, last + 1)
    plots, found, count = np.empty(1024, np.int64), np.empty(1024, np.int64), 0
    for m in range(len(radar)):
        ring = int(max(distance[m], 0.0) / RING)
        if radar[m] > last or ring >= rings:
            continue
        cell = (radar[m] * rings + ring) * SECTORS + int(
            (azimuth[m] / TURN - math.floor(azimuth[m] / TURN)) * SECTORS
        ) % SECTORS
        for k in range(start[cell], start[cell + 1]):
            v = entry[k]
            if abs(distance[m] - vessels[v, 0]) > search[v, 0] or abs(_wrapped(azimuth[m] - vessels[v, 1])) > search[v, 1]:
                continue
            if count == len(plots):
                plots, found = np.append(plots, np.empty_like(plots)), np.append(found, np.empty_like(found))
            plots[count], found[count] = m, v
            count += 1
    _, order = counting_sort(found[:count], len(vessels))
    return plots[order], found[order]


@jit
def _vessels_in_cells(radar_of_vessel, vessels, search, rings, radars):  # type: ignore[no-untyped-def]
    """The vessels whose search reaches each cell: those of cell c are entry[start[c]:start[c + 1]]."""
    start = np.zeros(radars * rings * SECTORS + 2, np.int64)
    entry = np.empty(0, np.int64)
    for writes in (False, True):
        for v in range(len(vessels)):
            low = math.floor((vessels[v, 1] - search[v, 1]) / TURN * SECTORS)
            sectors = min(math.floor((vessels[v, 1] + search[v, 1]) / TURN * SECTORS) - low + 1, SECTORS)
            first = max(int((vessels[v, 0] - search[v, 0]) / RING), 0)
            for ring in range(first, int((vessels[v, 0] + search[v, 0]) / RING) + 1):
                for sector in range(low, low + sectors):
                    cell = (radar_of_vessel[v] * rings + ring) * SECTORS + sector % SECTORS
                    if writes:
                        entry[start[cell + 1]] = v
                        start[cell + 1] += 1
                    else:
                        start[cell + 2] += 1
        if not writes:
            for cell in range(2, len(start)):
                start[cell] += start[cell - 1]
            entry = np.empty(start[-1], np.int64)
    return start, entry


@jit
def differences(vessel, plots, vessels):  # type: ignore[no-untyped-def]
    """What pairs of a plot and a vessel differ by, seen from the radar. (A, 7)

    Columns: range m and azimuth rad of the plot less those of the vessel at the time of the plot; their rates by the motion of the
    vessel; the distance of the vessel; the variances of its position along and across the beam.
    Args: vessel: (A,) row of each pair in `vessels`; plots: time (A,), range (A,), azimuth (A,) and site (A, 2) of the antenna in
    latitude, longitude; vessels: time (V,), position (V, 2) latitude, longitude, velocity (V, 2), covariance (V, 4, 4) of both.
    """
    time, distance, azimuth, site = plots
    vessel_time, position, velocity, covariance = vessels
    out = np.empty((len(vessel), 7))
    east = north = east_rate = north_rate = 0.0
    pee = pen = pnn = vee = ven = vnn = 0.0
    for k in range(len(vessel)):
        v = vessel[k]
        if k == 0 or v != vessel[k - 1] or site[k, 0] != site[k - 1, 0] or site[k, 1] != site[k - 1, 1]:
            at, here = position[v], site[k]
            east, north, _ = to_enu(at[0], at[1], here[0], here[1])
            turn = enu_rotation(at[0], at[1], here[0], here[1])
            east_rate = turn[0] * velocity[v, 0] + turn[1] * velocity[v, 1]
            north_rate = turn[2] * velocity[v, 0] + turn[3] * velocity[v, 1]
            pee, pen, pnn = _turned(covariance[v, :2, :2], turn)
            vee, ven, vnn = _turned(covariance[v, 2:, 2:], turn)
        ahead = time[k] - vessel_time[v]
        x, y = east + east_rate * ahead, north + north_rate * ahead
        r = max(math.sqrt(x * x + y * y), 1.0)
        along_east, along_north = x / r, y / r
        across_east, across_north = along_north, -along_east  # clockwise
        # The vessel is moved by its velocity, so the error of the velocity grows with that time.
        ee, en, nn = pee + vee * ahead * ahead, pen + ven * ahead * ahead, pnn + vnn * ahead * ahead
        out[k, 0], out[k, 1] = distance[k] - r, _wrapped(azimuth[k] - math.atan2(x, y))
        out[k, 2] = east_rate * along_east + north_rate * along_north
        out[k, 3] = (east_rate * across_east + north_rate * across_north) / r
        out[k, 4] = r
        out[k, 5] = along_east * along_east * ee + 2.0 * along_east * along_north * en + along_north * along_north * nn
        out[k, 6] = across_east * across_east * ee + 2.0 * across_east * across_north * en + across_north * across_north * nn
    return out


@jit
def _turned(covariance, turn):  # type: ignore[no-untyped-def]
    """East, mixed and north entry of a 2 x 2 covariance in another plane. Args: turn: [[ee, en], [ne, nn]], row by row."""
    a, b, c, d = turn
    ee, en, nn = covariance[0, 0], covariance[0, 1], covariance[1, 1]
    mixed = a * c * ee + (a * d + b * c) * en + b * d * nn
    return a * a * ee + 2.0 * a * b * en + b * b * nn, mixed, c * c * ee + 2.0 * c * d * en + d * d * nn


@jit
def _wrapped(angle):  # type: ignore[no-untyped-def]
    """The angle in (-pi, pi]."""
    return -((-angle + math.pi) % TURN - math.pi)
