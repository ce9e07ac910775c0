"""Hits, looks and misses of radar tracks: what a plot changes, and which tracks end. Scalar code, compiled by numba.

A look is one turn of a radar that covers the track. Looks are counted from the newest plot of a radar: one that sends nothing has not
looked.
"""

import math
from typing import NamedTuple

import numpy as np

from coastwatch.kernels.jit import jit
from coastwatch.kernels.tracks.columns import CONFIRMED, SINGLE, TENTATIVE
from coastwatch.kernels.tracks.prediction import predicted_position

EXPERIENCE = 3.0  # looks, for each of which a radar that missed them counts less


class LifeRules(NamedTuple):
    """When a track is confirmed, and when it ends; the fields are settings of `coastwatch.tracks.radar.life`."""

    confirm_hits: int
    confirm_looks: int
    delete_misses: int
    misses_per_hit: float
    look_slack: float
    coast: float
    own_looks: bool  # each radar counts its own looks


@jit
def record(life, tracks, plots, columns):  # type: ignore[no-untyped-def]
    """Record that each of these tracks took a plot or message, in this order. In place.

    Args: life: TrackLife; tracks: (B,) slots, a track may come again; plots: (B,) rows of columns, PlotColumns.
    """
    for k in range(len(tracks)):
        n, m = tracks[k], plots[k]
        radar = columns.sensor[m]
        life.hits[n] += 1
        life.status[n] = max(life.status[n], TENTATIVE)
        if radar >= 0:
            life.radar_time[n, radar] = max(life.radar_time[n, radar], columns.time[m])
        for older in range(life.origins.shape[1] - 1, 0, -1):
            life.origins[n, older] = life.origins[n, older - 1]
        life.origins[n, 0] = columns.origin[m]


@jit
def _weight(life, n, own, since, period, slack):  # type: ignore[no-untyped-def]
    """What a look of a radar counts for a track, where each radar counts its own looks.

    Of a track that is not confirmed, only looks of radars that gave it a plot count. Then the share of looks in which the radar would
    have seen it, by the looks that the radar missed while others saw it.
    Args: own: time of the newest plot of the radar in the track, -inf for none; since: of the newest plot of any radar.
    """
    if life.status[n] != CONFIRMED:
        return 1.0 if own > -np.inf else 0.0
    missed = math.floor((since - max(own, life.started[n])) / period - slack)
    return EXPERIENCE / (EXPERIENCE + max(missed, 0.0))


@jit
def looks(life, n, position, since, radars, ours, rules):  # type: ignore[no-untyped-def]
    """How often radars have looked at a track since a time: the looks of all that cover it. The k-th is over after k + slack turns.

    Args: n: slot; ours: (R,) columns of the radars in life; rules: LifeRules.
    """
    count = 0.0
    for r in range(len(radars.range)):
        east, north = position[0] - radars.site[r, 0], position[1] - radars.site[r, 1]
        turns = math.floor((radars.newest[r] - since) / radars.period[r] - rules.look_slack)
        if turns > 0.0 and east * east + north * north <= radars.range[r] * radars.range[r]:
            own = life.radar_time[n, ours[r]]
            count += turns * _weight(life, n, own, since, radars.period[r], rules.look_slack) if rules.own_looks else turns
    return count


@jit
def confirm_and_find_lost(life, estimates, rows, radars, ours, rules, time):  # type: ignore[no-untyped-def]
    """Confirm the tracks with enough hits, in place, and find those to delete: without enough hits, or lost. (N,)

    A single plot lives for one look (two plots in two looks begin a track), a tentative track for `confirm_looks`.
    Args: life: TrackLife; estimates: Estimates; rows: (N,) slots; radars: RadarColumns; ours: (R,) their columns in life;
    rules: LifeRules; time: now.
    """
    lost = np.zeros(len(rows), np.bool_)
    for k in range(len(rows)):
        n = rows[k]
        if life.hits[n] >= rules.confirm_hits:
            life.status[n] = CONFIRMED
        updated = life.radar_time[n].max()  # a filter may be newer: it weighed a plot that is likely of another
        position = predicted_position(estimates, n, max(time, estimates.time[n]))
        if life.status[n] == CONFIRMED:
            allowed = min(rules.delete_misses, math.ceil(rules.misses_per_hit * life.hits[n]))
            lost[k] = looks(life, n, position, updated, radars, ours, rules) >= allowed
        else:
            tries = 2 if life.status[n] == SINGLE else rules.confirm_looks
            lost[k] = 1 + looks(life, n, position, life.started[n], radars, ours, rules) >= tries
        lost[k] |= time - updated > rules.coast
    return lost
