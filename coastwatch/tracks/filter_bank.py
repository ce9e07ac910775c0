"""A bank of filters, one a track: its interface, and the bank of the compiled kernels."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

from coastwatch import kernels
from coastwatch.batches import Floats, Ints
from coastwatch.tracks.motion import Filters, Prior, initialise


class FilterBank(Protocol):
    """The interface of a bank of filters, one a track."""

    def initialise(self, position_m: Floats, covariance: Floats) -> Filters:
        """Filters that know one plot and no velocity. Args: position_m: (N, 2); covariance: (N, 2, 2) of the plots."""
        ...

    def predict(self, filters: Filters, dt_s: Floats) -> tuple[Floats, Floats]:
        """Mean (N, 5) and covariance (N, 5, 5) over the models after dt_s (N,), not negative."""
        ...

    def update(
        self, filters: Filters, rows: Ints, dt_s: Floats, position_m: Floats, covariance: Floats
    ) -> tuple[Filters, Floats, Floats]:
        """Some filters after a plot each, the log-likelihood of the plot (A,), and its squared Mahalanobis distance (A,).

        A plot older than its filter is moved to the filter's time by the velocity; its covariance grows accordingly.
        Args: rows: (A,) of the filters; dt_s: (A,) from the filter to the plot; position_m: (A, 2); covariance: (A, 2, 2).
        """
        ...


@dataclass(frozen=True)
class CompiledBank:
    """Filters by the compiled kernels."""

    prior: Prior

    def initialise(self, position_m: Floats, covariance: Floats) -> Filters:
        return initialise(self.prior, position_m, covariance)

    def predict(self, filters: Filters, dt_s: Floats) -> tuple[Floats, Floats]:
        mean, covariance = kernels.filters.imm.predicted_estimates(*filters, dt_s, self.prior.renewal_s, self._models)
        return mean, covariance

    def update(
        self, filters: Filters, rows: Ints, dt_s: Floats, position_m: Floats, covariance: Floats
    ) -> tuple[Filters, Floats, Floats]:
        given = tuple(filters), rows, dt_s, position_m, covariance, self.prior.renewal_s, self._models
        *after, log_likelihood, distance = kernels.filters.imm.updated_by_plots(*given)
        return Filters(*after), log_likelihood, distance

    @cached_property
    def _models(self) -> Any:
        return self.prior.table()
