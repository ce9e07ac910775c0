"""The models of motion behind the radar filters, and where a filter stands after one plot."""

from __future__ import annotations

from typing import Annotated, NamedTuple, Protocol, Self

import numpy as np
from pydantic import Field, model_validator

from coastwatch.batches import Bools, Floats, Ints
from coastwatch.geodesy import KNOT_M_S
from coastwatch.stage import Settings

Positive = Annotated[float, Field(gt=0.0)]
NotNegative = Annotated[float, Field(ge=0.0)]

CONSTANT_VELOCITY, COORDINATED_TURN = 0, 1  # as the kernel numbers them


class Filters(NamedTuple):
    """What the filters of N tracks know, each in J models of east, north, east rate, north rate and turn rate.

    In `sided_imm` the fifth is what the model has of its own: turn rate, acceleration along the track, or nothing.
    """

    state: Floats  # (N, J, 5) m, m/s, rad/s in the region's plane
    covariance: Floats  # (N, J, 5, 5)
    mode: Floats  # (N, J)

    def take(self, rows: Ints | Bools) -> Filters:
        return Filters(self.state[rows], self.covariance[rows], self.mode[rows])


class Prior(Protocol):
    """What is taken of motion before a track is seen to move."""

    @property
    def count(self) -> int:
        """J, the number of models."""
        ...

    def start(self, position_m: Floats, covariance: Floats) -> Filters:
        """Filters that know one plot and no velocity. Args: (N, 2); (N, 2, 2) of the plots."""
        ...


class Parameters(NamedTuple):
    """The models as the kernel wants them, (J,) each."""

    kind: Ints
    noise: Floats
    turn_noise: Floats
    turn_sigma: Floats
    sojourn_s: Floats


class Motion(Settings):
    """Models in the order constant velocity with low noise, with high noise, coordinated turn.

    Noises are densities of white noise: of the acceleration in m2/s3, of the turn rate's drift in rad2/s3.
    """

    quiet_noise_m2_s3: NotNegative = 1e-4
    agile_noise_m2_s3: NotNegative = 0.25
    turn_noise_m2_s3: NotNegative = 0.001
    turn_rate_noise_rad2_s3: NotNegative = 5e-9
    turn_rate_sigma_deg_s: Positive = 0.45  # of turn rates before anything is known
    quiet_sojourn_s: Positive = 900.0
    agile_sojourn_s: Positive = 100.0
    turn_sojourn_s: Positive = 1200.0
    start_speed_kn: Positive = 8.0  # standard deviation of each velocity component before anything is known
    start_share: tuple[Positive, Positive, Positive] = (0.4, 0.2, 0.4)  # of the models at the start

    @model_validator(mode="after")
    def _shares_sum_to_one(self) -> Self:
        if abs(sum(self.start_share) - 1.0) > 1e-9:
            raise ValueError(f"start_share: got a sum of {sum(self.start_share)}, needed 1")
        return self

    @property
    def count(self) -> int:
        """J."""
        return len(self.start_share)

    def parameters(self) -> Parameters:
        """The models as arrays."""
        sigma = float(np.radians(self.turn_rate_sigma_deg_s))
        return Parameters(
            np.array([CONSTANT_VELOCITY, CONSTANT_VELOCITY, COORDINATED_TURN], np.int64),
            np.array([self.quiet_noise_m2_s3, self.agile_noise_m2_s3, self.turn_noise_m2_s3]),
            np.array([0.0, 0.0, self.turn_rate_noise_rad2_s3]),
            np.full(3, sigma),
            np.array([self.quiet_sojourn_s, self.agile_sojourn_s, self.turn_sojourn_s]),
        )

    def start(self, position_m: Floats, covariance: Floats) -> Filters:
        """Filters that know one plot and no velocity.

        Args: position_m: (N, 2); covariance: (N, 2, 2) of the plots.
        """
        n, j = len(position_m), self.count
        state, spread = np.zeros((n, j, 5)), np.zeros((n, j, 5, 5))
        state[:, :, :2] = position_m[:, None]
        spread[:, :, :2, :2] = covariance[:, None]
        spread[:, :, 2, 2] = spread[:, :, 3, 3] = (self.start_speed_kn * KNOT_M_S) ** 2
        spread[:, :, 4, 4] = float(np.radians(self.turn_rate_sigma_deg_s)) ** 2
        return Filters(state, spread, np.tile(np.array(self.start_share), (n, 1)))
