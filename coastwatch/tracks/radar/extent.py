"""Size and axis of ships from the second moments of their echoes, and pieces of one hull joined to one plot.

Source: section 7 of the specification of radar images; a line of scatterers of length L has the second moment L^2 / 12.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from coastwatch.batches import Bools, Floats, Ints, Plots
from coastwatch.geodesy import KNOT_M_S, wrap_rad

MOST_WEIGHT = 10  # plots after which a newer one counts a tenth
LEAST_PLOTS = 5  # in the mean, before a size is given
LENGTH_OF_MOMENT = 12.0
WIDER, BEYOND_M = 1.15, 15.0  # a piece is inside so much more of the half axes, and so much beyond
UNDER_WAY_M_S = KNOT_M_S  # a slower ship has an axis, but no heading
LONGEST_M = 460.0  # no ship is longer
IN_LINE_RAD, ALIKE_M_S = np.radians(30.0), 1.5  # of two ends of one ship
LEAST_PART, MOST_PART = (
    0.3,
    0.75,
)  # of the length of a hull: what is shorter may be another vessel, what is longer measures the hull
OF_PART = (
    0.25  # weight of the size of a part beside that of a whole hull: a hull measured too long still shrinks, in a minute or two
)
GLINT = 0.1  # share of the second moment that is in the variance of a plot, as in `plots.video`


class Echoes(NamedTuple):
    """Size and axis of ships by their echoes. (N,) NaN: not known."""

    length_m: Floats
    width_m: Floats
    axis_deg: Floats  # clockwise from north: 0 to 360 by the course over 1 kn, else 0 to 180


class Hulls(NamedTuple):
    """Confirmed tracks of known length."""

    time_s: Floats  # (N,) of the states
    state: Floats  # (N, 4) east, north, east rate, north rate in the plane
    extent: Floats  # (N, 3) m2
    radar_s: Floats  # (N, R) newest plot of each radar
    plots: Ints  # (N,) in the extent, as of `averaged`


def averaged(extent: Floats, count: Ints, slots: Ints, new: Floats) -> None:
    """Put the second moments of plots into the means of tracks, in place: each as one of so many, the newest at least a tenth.

    Args: extent: (S, 3) m2, count: (S,) plots in it, of every slot; slots: (M,) each once; new: (M, 3), NaN: not measured.
    """
    measured = np.isfinite(new[:, 0])
    if not measured.any():
        return
    slots, new = slots[measured], new[measured]
    extent[slots] = np.where(count[slots, None] > 0, extent[slots], 0.0)
    count[slots] = np.minimum(count[slots] + 1, MOST_WEIGHT)
    extent[slots] += (new - extent[slots]) / count[slots, None]


def axes(extent: Floats) -> tuple[Floats, Floats, Floats]:
    """Length and width in metres, 0 where the moment is below 0, and the angle of the long axis clockwise from north, rad. (N,)

    Args: extent: (N, 3) m2.
    """
    east, both, north = extent.T
    half, root = 0.5 * (east + north), np.hypot(0.5 * (east - north), both)
    length, width = (np.sqrt(LENGTH_OF_MOMENT * np.maximum(value, 0.0)) for value in (half + root, half - root))
    return length, width, 0.5 * np.arctan2(2.0 * both, north - east)


def echoes_of(extent: Floats, beam_m: Floats, velocity_m_s: Floats) -> Echoes:
    """Size and axis of ships that are longer than the beam is wide, and no longer than the longest ship.

    Args: extent: (N, 3) m2, NaN: not known; beam_m: (N,) width of the beam at each; velocity_m_s: (N, 2) east, north.
    """
    length, width, angle = axes(extent)
    speed, course = np.hypot(velocity_m_s[:, 0], velocity_m_s[:, 1]), np.arctan2(velocity_m_s[:, 0], velocity_m_s[:, 1])
    backwards = np.abs(wrap_rad(angle - course)) > 0.5 * np.pi
    turned = np.where(speed > UNDER_WAY_M_S, np.degrees(angle) + np.where(backwards, 180.0, 0.0), np.degrees(angle) % 180.0)
    known = (length > beam_m) & (length <= LONGEST_M)  # not where either is not a number
    return Echoes(
        np.where(known, length, np.nan),
        np.where(known & (width > 0.0), width, np.nan),
        np.where(known, turned % 360.0, np.nan),
    )


def joined(plots: Plots, hulls: Hulls, period_s: Floats) -> tuple[Plots, Floats]:
    """The plots, with the pieces that one radar saw of one hull in one look as one plot, and how far each hull moves by growing.

    (M'), M' <= M; (N, 2) m. The middle of a hull moves as its other end comes into sight. That is no velocity of the ship.
    A piece in several hulls is of the longest. Weights, moments and positions add up. Pieces that together are longer than the longest
    ship stay apart. A piece is left out where the track took a plot of this look before: the end of a cycle cut the hull. What is shorter
    than its hull is a part of it, e.g. because a nearer ship hides the rest: the hull is where it was, if the part is inside.
    Args: plots: (M); hulls: (N); period_s: (R,) seconds of one turn of each radar.
    """
    growth_m = np.zeros((len(hulls.time_s), 2))
    measured = np.flatnonzero(np.isfinite(plots.extent[:, 0]) & (plots.weight > 0.0))
    if not len(measured) or not len(hulls.time_s):
        return plots, growth_m
    row, hull = _inside(plots, measured, hulls)
    if not len(row):
        return plots, growth_m
    late = plots.time_s[row] - hulls.radar_s[hull, plots.sensor[row]] < 0.5 * period_s[plots.sensor[row]]
    keep = np.ones(len(plots), np.bool_)
    keep[row[late]] = False
    row, hull = row[~late], hull[~late]
    if not len(row):
        return plots.take(keep), growth_m
    order = np.lexsort((plots.time_s[row], plots.sensor[row], hull))
    row, hull = row[order], hull[order]
    radar, time_s = plots.sensor[row], plots.time_s[row]
    first = np.ones(len(row), np.bool_)
    first[1:] = (hull[1:] != hull[:-1]) | (radar[1:] != radar[:-1]) | (np.diff(time_s) > 0.5 * period_s[radar[1:]])
    group = np.cumsum(first) - 1
    together = _sums(plots.take(row), group, first)
    fits = axes(together.extent)[0] <= LONGEST_M
    keep[row[~first & fits[group]]] = False
    whole = replace(plots, **{name: getattr(plots, name).copy() for name in SUMMED})
    together, grown_m = _parts_of_hulls(together, _ends(plots.take(row), hulls, hull, first), hulls, hull[first])
    for name in SUMMED:
        getattr(whole, name)[row[first][fits]] = getattr(together, name)[fits]
    np.add.at(growth_m, hull[first][fits], grown_m[fits])
    return whole.take(keep), growth_m


def ends_of_one(hulls: Hulls, time_s: float) -> tuple[Ints, Ints]:
    """Pairs of tracks that are the ends of one ship under way: in line with their course, end to end, of one velocity. (A,), (A,)

    An end is in one pair at most. Ships that follow each other keep more distance than the 15 m and 0.15 lengths that are allowed
    between the ends; ships in berths may not, so that what is at rest is left as it is.
    """
    moving = np.flatnonzero(np.hypot(hulls.state[:, 2], hulls.state[:, 3]) > UNDER_WAY_M_S)
    if len(moving) < 2:
        return moving[:0], moving[:0]
    from scipy.spatial import cKDTree

    length = axes(hulls.extent)[0]
    at_m = hulls.state[:, :2] + (time_s - hulls.time_s)[:, None] * hulls.state[:, 2:]
    pairs = cKDTree(at_m[moving]).query_pairs(LONGEST_M, output_type="ndarray")
    one, other = moving[pairs].reshape(-1, 2).T
    off_m = at_m[other] - at_m[one]
    apart, line = np.hypot(off_m[:, 0], off_m[:, 1]), np.arctan2(off_m[:, 0], off_m[:, 1])
    half = 0.5 * (length[one] + length[other])
    fits = (apart <= WIDER * half + BEYOND_M) & (apart + half <= LONGEST_M)
    both = hulls.state[one, 2:] + hulls.state[other, 2:]
    fits &= np.abs(np.sin(np.arctan2(both[:, 0], both[:, 1]) - line)) <= np.sin(IN_LINE_RAD)
    velocity = hulls.state[one, 2:] - hulls.state[other, 2:]
    fits &= np.hypot(velocity[:, 0], velocity[:, 1]) <= ALIKE_M_S
    one, other = one[fits], other[fits]
    order = np.lexsort((other, one))
    one, other, taken, kept = one[order], other[order], set[int](), list[int]()
    for k, (first, second) in enumerate(zip(one.tolist(), other.tolist(), strict=True)):  # few: ships in pieces
        if first not in taken and second not in taken:
            taken |= {first, second}
            kept.append(k)
    return one[kept], other[kept]


def as_one_ship(hulls: Hulls, one: Ints, other: Ints, time_s: float) -> tuple[Floats, Floats]:
    """How far the middle of each pair is from the first of it, and the second moments of both as one. (A, 2) m, (A, 3) m2"""
    length = axes(hulls.extent)[0]
    at_m = hulls.state[:, :2] + (time_s - hulls.time_s)[:, None] * hulls.state[:, 2:]
    share = (length[other] / (length[one] + length[other]))[:, None]
    off_m = at_m[other] - at_m[one]
    outer = np.column_stack([off_m[:, 0] ** 2, off_m[:, 0] * off_m[:, 1], off_m[:, 1] ** 2])
    extent = (1.0 - share) * hulls.extent[one] + share * hulls.extent[other] + share * (1.0 - share) * outer
    return share * off_m, extent


SUMMED = ("time_s", "position_m", "covariance", "range_m", "azimuth_rad", "extent", "weight")


def _inside(plots: Plots, measured: Ints, hulls: Hulls) -> tuple[Ints, Ints]:
    """The plots that are in a hull, and the longest hull that each is in. (K,), (K,) Args: measured: rows of plots."""
    from scipy.spatial import cKDTree  # here: only a run with video needs its 40 MB

    length, width, angle = axes(hulls.extent)
    half_m = WIDER * 0.5 * np.column_stack([length, width]) + BEYOND_M
    latest_s = float(plots.time_s[measured].max())
    speed = np.hypot(hulls.state[:, 2], hulls.state[:, 3])
    span_s = latest_s - float(plots.time_s[measured].min())
    at_m = hulls.state[:, :2] + (latest_s - hulls.time_s)[:, None] * hulls.state[:, 2:]
    reach_m = half_m[:, 0] + speed * span_s
    near = cKDTree(plots.position_m[measured]).sparse_distance_matrix(
        cKDTree(at_m), float(reach_m.max()), output_type="ndarray"
    )
    row, hull = measured[near["i"]], np.asarray(near["j"])
    off_m = plots.position_m[row] - _middle(plots.take(row), hulls, hull)
    sine, cosine = np.sin(angle[hull]), np.cos(angle[hull])
    along, across = off_m[:, 0] * sine + off_m[:, 1] * cosine, off_m[:, 0] * cosine - off_m[:, 1] * sine
    inside: Bools = (along / half_m[hull, 0]) ** 2 + (across / half_m[hull, 1]) ** 2 <= 1.0
    row, hull = row[inside], hull[inside]
    order = np.lexsort((hull, -length[hull], row))
    row, hull = row[order], hull[order]
    best = np.ones(len(row), np.bool_)
    best[1:] = row[1:] != row[:-1]
    return row[best], hull[best]


def _ends(pieces: Plots, hulls: Hulls, hull: Ints, first: Bools) -> tuple[Floats, Floats]:
    """Where the pieces of each hull begin and end along it, from its predicted middle on. (G,), (G,) m Args: as of `_sums`; hull: (K,)."""
    ahead = _ahead(hulls, hull)
    off_m = ((pieces.position_m - _middle(pieces, hulls, hull)) * ahead).sum(axis=1)
    moments = pieces.extent[:, [0, 1, 1, 2]].reshape(-1, 2, 2)
    half_m = 0.5 * np.sqrt(LENGTH_OF_MOMENT * np.maximum(np.einsum("ki,kij,kj->k", ahead, moments, ahead), 0.0))
    start = np.flatnonzero(first)
    return np.minimum.reduceat(off_m - half_m, start), np.maximum.reduceat(off_m + half_m, start)


def _parts_of_hulls(plots: Plots, ends: tuple[Floats, Floats], hulls: Hulls, hull: Ints) -> tuple[Plots, Floats]:
    """Plots of which each is all that was seen of its hull, moved along it to where its middle may be, nearest to the prediction. (G)

    Also how far each hull moves by growing, (G, 2) m. What is longer than its hull is one that was seen in part before: the hull was
    anywhere inside it. By as much as its length grows with this plot its middle comes nearer to that of the plot.

    The middle is between the ends of what is seen, but for half of the hidden length to each side, and as uncertain along the hull.
    So a ship that brakes while it is hidden in part goes on until the part leaves the hull. A part says little of the size. What is
    shorter than `LEAST_PART` of the hull may be another vessel, and is not moved.
    Args: ends: as of `_ends`; hull: (G,) of each plot.
    """
    length, ahead = axes(hulls.extent[hull])[0], _ahead(hulls, hull)
    seen = ends[1] - ends[0]
    is_longer = seen >= WIDER * length
    is_part = seen > LEAST_PART * length
    at_m = ((plots.position_m - _middle(plots, hulls, hull)) * ahead).sum(axis=1)
    middle_m = 0.5 * (ends[0] + ends[1])
    share = 1.0 / np.minimum(hulls.plots[hull] + 1, MOST_WEIGHT)
    grows = np.where(is_longer, 0.5 * (np.sqrt(length**2 + share * (seen**2 - length**2)) - length), 0.0)
    grown_m = np.clip(middle_m, -grows, grows)
    slack = np.where(is_part, np.maximum(0.5 * np.where(is_longer, seen - length, length - seen) - grows, 0.0), 0.0)
    to_m = middle_m - np.clip(middle_m - grown_m, -slack, slack)
    before = plots.position_m - plots.site_m
    after = before + np.where(is_part, to_m - at_m, 0.0)[:, None] * ahead
    turned = np.arctan2(after[:, 0], after[:, 1]) - np.arctan2(before[:, 0], before[:, 1])
    little = (is_part & (seen < MOST_PART * length))[:, None]
    moved = replace(
        plots,
        position_m=plots.site_m + after,
        covariance=plots.covariance + (slack**2 / 3.0)[:, None, None] * (ahead[:, :, None] * ahead[:, None, :]),
        range_m=plots.range_m + np.hypot(after[:, 0], after[:, 1]) - np.hypot(before[:, 0], before[:, 1]),
        azimuth_rad=plots.azimuth_rad + wrap_rad(turned),
        extent=np.where(little, hulls.extent[hull] + OF_PART * (plots.extent - hulls.extent[hull]), plots.extent),
    )
    return moved, grown_m[:, None] * ahead


def _ahead(hulls: Hulls, hull: Ints) -> Floats:
    """The direction of the long axis of these hulls, east and north. (K, 2)"""
    angle = axes(hulls.extent[hull])[2]
    return np.column_stack([np.sin(angle), np.cos(angle)])


def _middle(plots: Plots, hulls: Hulls, hull: Ints) -> Floats:
    """The predicted middle of the hull of each plot at its time. (K, 2) m"""
    return np.asarray(hulls.state[hull, :2] + (plots.time_s - hulls.time_s[hull])[:, None] * hulls.state[hull, 2:])


def _sums(pieces: Plots, group: Ints, first: Bools) -> Plots:
    """One plot for each group of pieces. Args: group: (K,) increasing from 0; first: (K,) which piece is the first of its group."""
    share = pieces.weight / np.bincount(group, pieces.weight)[group]

    def mean(values: Floats) -> Floats:
        weighed = values * share.reshape(-1, *[1] * (values.ndim - 1))
        return np.asarray(np.add.reduceat(weighed, np.flatnonzero(first)))

    turned = wrap_rad(pieces.azimuth_rad - pieces.azimuth_rad[first][group])
    middle = mean(pieces.position_m)
    off_m = pieces.position_m - middle[group]
    outer = mean(off_m[:, :, None] * off_m[:, None, :])
    apart = np.column_stack([outer[:, 0, 0], outer[:, 0, 1], outer[:, 1, 1]])
    return replace(
        pieces.take(first),
        time_s=mean(pieces.time_s),
        position_m=middle,
        covariance=mean(pieces.covariance) + GLINT * outer,
        range_m=mean(pieces.range_m),
        azimuth_rad=pieces.azimuth_rad[first] + mean(turned),
        extent=mean(pieces.extent) + apart,
        weight=np.bincount(group, pieces.weight).astype(np.float64),
    )
