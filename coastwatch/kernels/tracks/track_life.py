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


class LifeRules(NamedTuple):
    """When a track is confirmed, and when it ends; the fields are settings of `coastwatch.tracks.track_management`."""

    confirm_hits: int
    confirm_looks: int
    delete_misses: int
    misses_per_hit: float
    look_slack: float
    coast: float


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
def looks(position, since, radars, slack):  # type: ignore[no-untyped-def]
    """How often radars have looked at a position since a time: the looks of all that cover it. The k-th is over after k + slack turns."""
    count = 0
    for r in range(len(radars.range)):
        east, north = position[0] - radars.site[r, 0], position[1] - radars.site[r, 1]
        turns = math.floor((radars.newest[r] - since) / radars.period[r] - slack)
        if turns > 0.0 and east * east + north * north <= radars.range[r] * radars.range[r]:
            count += int(turns)
    return count


@jit
def confirm_and_find_lost(life, estimates, rows, radars, rules, time):  # type: ignore[no-untyped-def]
    """Confirm the tracks with enough hits, in place, and find those to delete: without enough hits, or lost. (N,)

    A single plot lives for one look (two plots in two looks begin a track), a tentative track for `confirm_looks`.
    Args: life: TrackLife; estimates: Estimates; rows: (N,) slots; radars: RadarColumns; rules: LifeRules; time: now.
    """
    lost = np.zeros(len(rows), np.bool_)
    for k in range(len(rows)):
        n = rows[k]
        if life.hits[n] >= rules.confirm_hits:
            life.status[n] = CONFIRMED
        updated = estimates.time[n]
        position = predicted_position(estimates, n, max(time, updated))
        if life.status[n] == CONFIRMED:
            allowed = min(rules.delete_misses, math.ceil(rules.misses_per_hit * life.hits[n]))
            lost[k] = looks(position, updated, radars, rules.look_slack) >= allowed
        else:
            tries = 2 if life.status[n] == SINGLE else rules.confirm_looks
            lost[k] = 1 + looks(position, life.started[n], radars, rules.look_slack) >= tries
        lost[k] |= time - updated > rules.coast
    return lost
