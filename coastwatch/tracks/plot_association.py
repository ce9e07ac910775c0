"""Which plot belongs to which track: gates, gains and the global nearest neighbour, or the known origin."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coastwatch import kernels
from coastwatch.batches import Array, Bools, Floats, Ints, Plots
from coastwatch.geodesy import KNOT_M_S
from coastwatch.kernels.filters.gaussian import gate
from coastwatch.tracks.filter_bank import FilterBank
from coastwatch.tracks.motion import Filters
from coastwatch.tracks.table import Status, Table, with_updates
from coastwatch.tracks.track_management import TrackManagement


@dataclass(frozen=True, eq=False)
class Candidates:
    """Pairs of a track and a plot inside its gate, with the updated filter of each pair."""

    track: Ints  # (A,) row of the table
    plot: Ints  # (A,) row of the plots
    gain: Floats  # (A,) log-likelihood ratio: "its plot" against "track missed, plot false or new"
    due: Bools  # (A,) the track has had no plot of this radar in this look
    after: Filters  # (A, ...) the track updated by the plot

    def take(self, rows: Array) -> Candidates:
        return Candidates(self.track[rows], self.plot[rows], self.gain[rows], self.due[rows], self.after.take(rows))


def candidates(
    management: TrackManagement, bank: FilterBank, table: Table, rows: Ints, plots: Plots, period_s: Floats
) -> Candidates:
    """Every pair of one of these tracks and a plot inside its gate, sorted by track, then plot.

    Args: rows: (B,) of the table; plots: of one slice of time; period_s: (R,) of one turn of each radar.
    """
    furthest = gate(management.gate_probability, 2)
    track, plot = _possible_pairs(bank, table, rows, plots, furthest)
    dt = plots.time_s[plot] - table.updated_s[track]
    usable = dt >= -management.late_s
    track, plot, dt = track[usable], plot[usable], dt[usable]
    after, fit, square = bank.update(table.filters, track, dt, plots.position_m[plot], plots.covariance[plot])
    inside = (square <= furthest) & _reachable(management, table, track, plots, plot, dt)
    radar = plots.sensor[plot]
    due = plots.time_s[plot] - table.radar_s[track, radar] > 0.5 * period_s[radar]
    found = management.detection_probability / (1.0 - management.detection_probability)
    gain = fit + np.log(found / management.false_plots_per_m2)
    return Candidates(track, plot, gain, due, after).take(inside)


def _possible_pairs(bank: FilterBank, table: Table, rows: Ints, plots: Plots, furthest: float) -> tuple[Ints, Ints]:
    """Pairs that may be in the gate, by the predicted positions at the middle of the slice."""
    middle = 0.5 * (plots.time_s.min() + plots.time_s.max())
    half = 0.5 * float(plots.time_s.max() - plots.time_s.min())
    mean, spread = bank.predict(table.filters.take(rows), np.maximum(middle - table.updated_s[rows], 0.0))
    widest = float(np.trace(plots.covariance, axis1=1, axis2=2).max())
    rate_spread = np.sqrt(spread[:, 2, 2] + spread[:, 3, 3])
    sigma = np.sqrt(spread[:, 0, 0] + spread[:, 1, 1] + widest) + half * rate_spread
    radius = np.sqrt(furthest) * sigma + half * np.hypot(mean[:, 2], mean[:, 3])
    track, plot = kernels.geometry.neighbours.near_pairs(mean[:, :2], radius, plots.position_m)
    return rows[track], plot


def _reachable(management: TrackManagement, table: Table, track: Ints, plots: Plots, plot: Ints, dt_s: Floats) -> Bools:
    """Whether a single plot can reach a plot at the greatest speed, within three standard deviations."""
    gap = plots.position_m[plot] - table.state[track, 0, :2]
    noise = plots.covariance[plot] + table.covariance[track, 0, :2, :2]
    slack = 3.0 * np.sqrt(np.trace(noise, axis1=1, axis2=2))
    within = np.hypot(gap[:, 0], gap[:, 1]) <= management.max_speed_kn * KNOT_M_S * np.abs(dt_s) + slack
    reachable: Bools = within | (table.status[track] != Status.SINGLE)
    return reachable


def assign_plots(table: Table, pairs: Candidates, plots: Plots, radars: int) -> Bools:
    """Which pairs are assigned: plots go to confirmed tracks first, then to tentative ones, then to single plots.

    Each radar gives a track one plot at most, each plot goes to one track at most.
    Returns: (A,).
    """
    chosen = np.zeros(len(pairs.track), np.bool_)
    left = pairs.track * radars + plots.sensor[pairs.plot]
    taken = np.zeros(len(plots), np.bool_)
    for status in (Status.CONFIRMED, Status.TENTATIVE, Status.SINGLE):
        rows = np.flatnonzero((table.status[pairs.track] == status) & pairs.due & ~taken[pairs.plot])
        won = rows[kernels.association.assignment.assign(left[rows], pairs.plot[rows], pairs.gain[rows])]
        chosen[won] = True
        taken[pairs.plot[won]] = True
    return chosen


def update_tracks(bank: FilterBank, table: Table, track: Ints, plot: Ints, plots: Plots, first: Filters | None) -> Table:
    """The table after these pairs, each track's plots in order of time, in rounds of one plot a track.

    Args: track, plot: (B,); first: (B, ...) each track after this plot alone, if it is known already.
    """
    order = np.lexsort((plot, plots.time_s[plot], track))
    start = np.searchsorted(track[order], track[order], side="left")
    turn = np.arange(len(order)) - start
    for k in range(int(turn.max(initial=-1)) + 1):
        at = order[turn == k]
        taken, rows = plots.take(plot[at]), track[at]
        if k == 0 and first is not None:
            after = first.take(at)
        else:
            dt = taken.time_s - table.updated_s[rows]
            after, _, _ = bank.update(table.filters, rows, dt, taken.position_m, taken.covariance)
        table = with_updates(table, rows, after, taken)
    return table


def may_initiate(pairs: Candidates, chosen: Bools, plots: Plots) -> Bools:
    """Which plots may begin a track: unassigned, and outside the gates of tracks without a plot of this radar in this look.

    A vessel gives a radar one plot a look, so a plot in the gate of a track that has one is of another vessel.
    Args: pairs, chosen: of the tracks of more than one plot. Returns: (M,).
    """
    free = np.ones(len(plots), np.bool_)
    free[pairs.plot[chosen]] = False
    radars = int(plots.sensor.max(initial=0)) + 1
    wanted = pairs.track * radars + plots.sensor[pairs.plot]
    free[pairs.plot[pairs.due & ~np.isin(wanted, wanted[chosen])]] = False
    return free
