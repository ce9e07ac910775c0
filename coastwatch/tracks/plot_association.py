"""Which plot belongs to which track: gates, gains and the global nearest neighbour, or the known origin."""

from __future__ import annotations

import math

import numpy as np

from coastwatch import kernels
from coastwatch.batches import Bools, Floats, Ints
from coastwatch.geodesy import KNOT_M_S
from coastwatch.kernels.filters.gaussian import gate
from coastwatch.kernels.tracks.columns import PlotColumns
from coastwatch.tracks.table import Table
from coastwatch.tracks.track_management import TrackManagement


def associate(
    management: TrackManagement, table: Table, batch: PlotColumns, period_s: float, false_plots_per_m2: Floats
) -> tuple[Ints, Bools]:
    """The slot of the track that takes each plot of a batch, -1 for none, and which plots may begin a track. (M,), (M,)

    The gain of a pair is the log-likelihood ratio of "its plot" against "track missed, plot false or new".
    Args: batch: plots of one radar; period_s: of one turn of it; false_plots_per_m2: (M,) in one look, at each plot.
    """
    limit = gate(management.gate_probability, 2)
    pairs = kernels.tracks.gate.candidates(table.estimates, table.live, batch, limit, management.late_s)
    found = management.detection_probability / (1.0 - management.detection_probability)
    gain = pairs.log_likelihood + math.log(found) - np.log(false_plots_per_m2)[pairs.plot]
    due = batch.time[pairs.plot] - table.radar_s[pairs.track, batch.sensor[0]] > 0.5 * period_s
    max_speed = management.max_speed_kn * KNOT_M_S
    due &= kernels.tracks.gate.reachable(pairs, table.estimates, table.status, batch, max_speed)
    slot, free = kernels.tracks.plot_assignment.assign_plots(pairs, gain, due, table.status, len(batch.time))
    return slot, free


def associate_by_origin(table: Table, batch: PlotColumns) -> tuple[Ints, Bools]:
    """As `associate`, by the known vessel behind each plot: clutter is dropped, the first plot of a new vessel begins a track."""
    at = kernels.tables.match_ids.index_of(table.origins[table.live, 0], batch.origin)
    slot = np.where(at >= 0, np.append(table.live, -1)[at], -1)
    unknown = np.flatnonzero((slot < 0) & (batch.origin >= 0))
    _, first = np.unique(batch.origin[unknown], return_index=True)
    begins = np.zeros(len(slot), np.bool_)
    begins[unknown[first]] = True
    return slot, begins
