"""A bank of filters, one a track: its interface, and the bank of the compiled kernels."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

from coastwatch import kernels
from coastwatch.batches import Ints
from coastwatch.geodesy import KNOT_M_S
from coastwatch.kernels.tracks.columns import Estimates, PlotColumns
from coastwatch.tracks.motion import Filters, Prior


class FilterBank(Protocol):
    """The interface of a bank of filters, one a track. `initialise` and `update` write into the arrays that they are given.

    Arguments of both: filters: of S slots; estimates: the combined estimate of each; rows: (B,) slots; plots: (B,) rows of columns.
    """

    @property
    def models(self) -> Any:
        """The models of each filter. (J,) MODEL"""
        ...

    def initialise(self, filters: Filters, estimates: Estimates, rows: Ints, plots: Ints, columns: PlotColumns) -> None:
        """Begin the filters in these slots: they know one plot and no velocity."""
        ...

    def update(self, filters: Filters, estimates: Estimates, rows: Ints, plots: Ints, columns: PlotColumns) -> None:
        """Predict each filter to the time of its plot and update it. A slot may come again: its plots are taken in this order.

        A plot older than its filter is moved to the filter's time by the velocity; its covariance grows accordingly.
        """
        ...

    def predict(self, filters: Filters, estimates: Estimates, rows: Ints, time_s: float) -> Estimates:
        """The combined estimates of these slots (N), predicted to a time by all models; one that is newer is not taken back."""
        ...


@dataclass(frozen=True)
class CompiledBank:
    """Filters by the compiled kernels."""

    prior: Prior

    def initialise(self, filters: Filters, estimates: Estimates, rows: Ints, plots: Ints, columns: PlotColumns) -> None:
        variance = (self.prior.start_speed_kn * KNOT_M_S) ** 2
        measured = columns.position[plots], columns.covariance[plots]
        kernels.filters.imm.initialise_filters(tuple(filters), rows, *measured, variance, self.models)
        kernels.filters.imm.combine_filters(tuple(filters), estimates, rows, self.models)
        estimates.time[rows] = columns.time[plots]

    def update(self, filters: Filters, estimates: Estimates, rows: Ints, plots: Ints, columns: PlotColumns) -> None:
        given = tuple(filters), estimates, rows, plots, columns, self.prior.renewal_s, self.models
        kernels.filters.imm.update_by_plots(*given)

    def predict(self, filters: Filters, estimates: Estimates, rows: Ints, time_s: float) -> Estimates:
        given = tuple(filters), estimates, rows, float(time_s), self.prior.renewal_s, self.models
        predicted: Estimates = kernels.filters.imm.predicted_estimates(*given)
        return predicted

    @cached_property
    def models(self) -> Any:
        """The models as the kernels take them. (J,) MODEL"""
        return self.prior.table()
