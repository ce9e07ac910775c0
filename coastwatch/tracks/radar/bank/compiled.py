"""The filters of many tracks by the compiled kernels."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from coastwatch import kernels
from coastwatch.batches import Floats, Ints
from coastwatch.geodesy import KNOT_M_S
from coastwatch.kernels.arrays import Records
from coastwatch.kernels.filters.gaussian import Estimates
from coastwatch.kernels.tracks.columns import Candidates, PlotColumns
from coastwatch.kernels.tracks.joint_update import Hypotheses
from coastwatch.tracks.radar.motion import Filters, Prior
from coastwatch.tracks.radar.table import Table


@dataclass(frozen=True)
class CompiledBank:
    """Filters by the compiled kernels. Its functions: see `coastwatch.tracks.radar.parts`."""

    prior: Prior
    particles: int = 0

    @cached_property
    def models(self) -> Records:
        """The models as the kernels take them. (J,) MODEL"""
        return self.prior.table()

    def begin(self, table: Table, slots: Ints, plots: Ints, batch: PlotColumns) -> None:
        self.initialise(table.filters, table.estimates, slots, plots, batch)

    def initialise(self, filters: Filters, estimates: Estimates, rows: Ints, plots: Ints, columns: PlotColumns) -> None:
        """Begin filters that are in no table. Args: as of `update`."""
        variance = (self.prior.start_speed_kn * KNOT_M_S) ** 2
        position, noise = columns.position[plots], columns.covariance[plots]
        kernels.filters.imm.initialise_filters(tuple(filters), rows, position, noise, variance, self.models)
        kernels.filters.imm.combine_filters(tuple(filters), estimates, rows, self.models)
        estimates.time[rows] = columns.time[plots]

    def update(self, filters: Filters, estimates: Estimates, rows: Ints, plots: Ints, columns: PlotColumns) -> None:
        update, renewal_s = kernels.filters.imm.update_by_plots, self.prior.renewal_s
        update(tuple(filters), estimates, rows, plots, columns, renewal_s, self.models)

    def predict(self, filters: Filters, estimates: Estimates, rows: Ints, time_s: float) -> Estimates:
        predict, renewal_s = kernels.filters.imm.predicted_estimates, self.prior.renewal_s
        predicted: Estimates = predict(tuple(filters), estimates, rows, float(time_s), renewal_s, self.models)
        return predicted

    def predict_to_plots(self, table: Table, pairs: Candidates, batch: PlotColumns, added: Floats | None = None) -> Hypotheses:
        hypotheses = by_track(pairs, len(self.models))
        predict, renewal_s = kernels.tracks.joint_update.predict_to_plots, self.prior.renewal_s
        share = np.zeros(len(hypotheses.slot)) if added is None else added[hypotheses.slot]
        predict(tuple(table.filters), table.estimates, hypotheses, batch, share, renewal_s, self.models)
        return hypotheses

    def likelihood(self, table: Table, pairs: Hypotheses) -> Floats:
        mode = table.mode_probability[pairs.slot[pairs.track]]
        total: Floats = (mode * pairs.likelihood).sum(axis=1)
        return total

    def update_by_shares(self, table: Table, pairs: Hypotheses, share: Floats, batch: PlotColumns, least: float) -> None:
        update = kernels.tracks.joint_update.update_by_shares
        update(tuple(table.filters), table.estimates, pairs, share, least, self.models)


def by_track(pairs: Candidates, models: int) -> Hypotheses:
    """These pairs sorted by track, then plot, with room for what the kernel fills in."""
    order = np.argsort(pairs.track, kind="stable")
    track, count = pairs.track[order], len(order)
    first = np.flatnonzero(np.diff(track, prepend=-1))
    start, likelihood = np.append(first, count), np.empty((count, models))
    return Hypotheses(track[first], start, pairs.plot[order], np.empty((count, 2)), np.empty((count, 2, 2)), likelihood)
