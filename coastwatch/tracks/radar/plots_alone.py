"""Filters of plots alone beside those of tracks that also take AIS messages, and which tracks leave their messages.

A track whose association is guided by AIS is reported by this second filter, so that its errors stay independent of AIS. Where the two
filters contradict each other, the messages are of another vessel, or state a wrong position.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from coastwatch import kernels
from coastwatch.batches import Bools, Floats, Ints
from coastwatch.kernels.filters.gaussian import Estimates
from coastwatch.kernels.filters.kalman import MANOEUVRE
from coastwatch.kernels.tracks.columns import Candidates, PlotColumns
from coastwatch.tracks.radar.motion import FILTER_COLUMNS, Filters
from coastwatch.tracks.radar.parts import FilterBank, Parts
from coastwatch.tracks.radar.plot_filters import PlotFilters
from coastwatch.tracks.radar.table import Table

LEAST_GAIN = 0.25  # of the variance of the filter of plots alone: a smaller difference is not tested more narrowly


def as_table(alone: PlotFilters, table: Table) -> Table:
    """The table of tracks with these filters in place of its own, as a bank takes it."""
    return replace(table, **{name: getattr(alone, name) for name in FILTER_COLUMNS})


def begin_at_tracks(alone: PlotFilters, table: Table, parts: Parts, slots: Ints) -> None:
    """Begin the filters of tracks that have plots and no message yet, at their estimates. In place. Args: slots: of any tracks."""
    slots = slots[~alone.has_filter(slots) & ~np.isfinite(table.message_s[slots])]
    of_plots = slots[np.isfinite(table.radar_s[slots]).any(axis=1)]
    begin_at(alone.filters, alone.estimates, of_plots, parts.bank, table.estimates, of_plots)
    alone.updated_s[of_plots] = table.updated_s[of_plots]
    newest_s = table.radar_s[of_plots].max(axis=1)
    alone.plots_s[of_plots] = np.column_stack([newest_s, np.where(table.hits[of_plots] > 1, newest_s, -np.inf)])


def begin_at(filters: Filters, estimates: Estimates, slots: Ints, of: FilterBank, other: Estimates, rows: Ints) -> None:
    """Begin filters at estimates of other filters, in place. Args: slots: (N,) of the filters; rows: (N,) of the estimates."""
    position, covariance = other.mean[rows, :2], other.covariance[rows]
    kernels.filters.imm.initialise_filters(tuple(filters), slots, position, covariance[:, :2, :2].copy(), 1.0, of.models)
    filters.state[slots, :, :MANOEUVRE] = other.mean[rows][:, None]
    filters.covariance[slots, :, :MANOEUVRE, :MANOEUVRE] = covariance[:, None]
    kernels.filters.imm.combine_filters(tuple(filters), estimates, slots, of.models)


def update(
    alone: PlotFilters, table: Table, parts: Parts, of: Ints, plot: Ints, share: Floats, likely: Ints, batch: PlotColumns
) -> None:
    """Update the filters by the plots of their tracks, with the shares of the association. In place.

    A track that messages began gets its filter by the first plot that it likely takes.
    Args: of, plot: (A,) slot and plot of each pair; share: (A,) its probability, given that its track exists; likely: rows of pairs.
    """
    has_filter = alone.has_filter(of)
    if not (has_filter | np.isfinite(table.message_s[of])).any():
        return
    rows = np.flatnonzero(has_filter)
    if len(rows):
        chosen = Candidates(plot[rows], of[rows], np.zeros(len(rows)), np.zeros(len(rows)))
        shadow = as_table(alone, table)
        predicted = parts.joint.predict_to_plots(shadow, chosen, batch)
        parts.joint.update_by_shares(shadow, predicted, share[rows], batch, parts.existence.least_model_probability)
    first = likely[~alone.has_filter(of[likely]) & np.isfinite(table.message_s[of[likely]])]
    parts.bank.begin(as_table(alone, table), of[first], plot[first], batch)
    slots, time_s = of[likely], batch.time[plot[likely]]
    later = time_s > alone.plots_s[slots, 0]
    alone.plots_s[slots[later], 1] = alone.plots_s[slots[later], 0]
    alone.plots_s[slots[later], 0] = time_s[later]


def seen(alone: PlotFilters, table: Table, parts: Parts, slots: Ints, time_s: float) -> Bools:
    """Which of these tracks radars see: one plot in `coast_s`, and of tracks with messages two in as many looks as end a track. (N,)

    Where messages alone begin or keep a track, a false plot will once be in its gate.
    """
    upkeep, radars = parts.existence, parts.sensors.radars
    if not len(radars):
        return np.zeros(len(slots), np.bool_)
    newest_s = table.radar_s[slots].max(axis=1)
    looks_s = upkeep.delete_misses * radars.period_s[table.radar_s[slots].argmax(axis=1)]
    once = time_s - alone.plots_s[slots, 1] > np.maximum(upkeep.coast_s, looks_s)  # not where it is not known
    out: Bools = (time_s - newest_s <= upkeep.coast_s) & ~(np.isfinite(table.message_s[slots]) & once)
    return out


def contradicted(
    alone: PlotFilters, table: Table, parts: Parts, slots: Ints, bias: Floats, time_s: float, limit: float
) -> Ints:
    """Which of these tracks have a filter of plots alone that contradicts their messages. Returns: rows of slots.

    The filter with messages is efficient, so the difference of the two has the difference of their covariances. Filters that are not
    finite contradict nothing. Args: bias: (N, 2, 2) covariance of what all plots of a track may share; limit: normalised squared distance
    of the positions.
    Source: J. A. Hausman, Specification tests in econometrics, Econometrica 46(6), 1978.
    """
    rows = np.flatnonzero(alone.has_filter(slots) & np.isfinite(table.message_s[slots]))
    apart = parts.bank.predict(alone.filters, alone.estimates, slots[rows], time_s)
    joint = parts.bank.predict(table.filters, table.estimates, slots[rows], time_s)
    sound = np.isfinite(apart.mean + joint.mean).all(axis=1) & np.isfinite(apart.covariance + joint.covariance).all(axis=(1, 2))
    rows = rows[sound]
    bias = bias[rows]
    apart, joint = (Estimates(*(column[sound] for column in one)) for one in (apart, joint))
    own = apart.covariance[:, :2, :2] + bias
    variance, axes = np.linalg.eigh(own - joint.covariance[:, :2, :2])
    along = np.einsum("nij,ni->nj", axes, apart.mean[:, :2] - joint.mean[:, :2])
    least = LEAST_GAIN * np.trace(own, axis1=1, axis2=2)[:, None] / 2.0
    out: Ints = rows[np.sum(along**2 / np.maximum(variance, least), axis=1) > limit]
    return out
