"""What a vessel may be doing, as the prior of the method `sided_imm`: models of motion, their shares, and when one ends."""

from __future__ import annotations

from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from coastwatch.batches import Floats
from coastwatch.geodesy import KNOT_M_S
from coastwatch.kernels.filters.model_kinds import OWN, OWN_SIGMA, SHARE, SPEEDING, STRAIGHT, TURNING
from coastwatch.stage import Settings
from coastwatch.tracks.motion import Filters, NotNegative, Positive

SHARES_ADD_UP_TO = 1e-9  # decimal fractions are not exact


class Straight(Settings):
    """Constant velocity under white acceleration."""

    kind: Literal["straight"] = "straight"
    noise_m2_s3: NotNegative
    share: Positive

    def row(self) -> list[float]:
        return [STRAIGHT, self.noise_m2_s3, 0.0, 0.0, 0.0, self.share]


class Turning(Settings):
    """A turn at a rate that is estimated, positive to port, under white acceleration."""

    kind: Literal["turning"] = "turning"
    noise_m2_s3: NotNegative
    rate_deg_s: float  # mean of such turns
    rate_sigma_deg_s: Positive
    rate_noise_rad2_s3: NotNegative = 1e-10  # density of the drift of the rate
    share: Positive

    def row(self) -> list[float]:
        mean, sigma = np.radians([self.rate_deg_s, self.rate_sigma_deg_s]).tolist()
        return [TURNING, self.noise_m2_s3, mean, sigma, self.rate_noise_rad2_s3, self.share]


class Speeding(Settings):
    """A change of speed along the track at an acceleration that is estimated, under white acceleration."""

    kind: Literal["speeding"] = "speeding"
    noise_m2_s3: NotNegative
    acceleration_sigma_m_s2: Positive  # either way
    acceleration_noise_m2_s5: NotNegative = 1e-10  # density of the drift of the acceleration
    share: Positive

    def row(self) -> list[float]:
        return [SPEEDING, self.noise_m2_s3, 0.0, self.acceleration_sigma_m_s2, self.acceleration_noise_m2_s5, self.share]


Model = Annotated[Straight | Turning | Speeding, Field(discriminator="kind")]

STEADY = Straight(noise_m2_s3=4e-4, share=0.4)
RESTLESS = Straight(noise_m2_s3=5e-3, share=0.1)
AGILE = Straight(noise_m2_s3=0.15, share=0.05)
GENTLE_PORT = Turning(noise_m2_s3=1e-4, rate_deg_s=0.35, rate_sigma_deg_s=0.12, share=0.075)
GENTLE_STARBOARD = Turning(noise_m2_s3=1e-4, rate_deg_s=-0.35, rate_sigma_deg_s=0.12, share=0.075)
HARD_PORT = Turning(noise_m2_s3=1e-4, rate_deg_s=0.65, rate_sigma_deg_s=0.12, share=0.075)
HARD_STARBOARD = Turning(noise_m2_s3=1e-4, rate_deg_s=-0.65, rate_sigma_deg_s=0.12, share=0.075)
TURNS = (GENTLE_PORT, GENTLE_STARBOARD, HARD_PORT, HARD_STARBOARD)
SHARP = Turning(noise_m2_s3=5e-3, rate_deg_s=0.0, rate_sigma_deg_s=1.0, rate_noise_rad2_s3=1e-9, share=0.05)
CHANGING = Speeding(noise_m2_s3=4e-4, acceleration_sigma_m_s2=0.06, share=0.1)


class Manoeuvres(Settings):
    """Models of motion. At the rate 1 / renewal_s a vessel takes up one anew, drawn by the shares."""

    renewal_s: Positive = 1000.0
    start_speed_kn: Positive = 8.0  # standard deviation of each velocity component before anything is known
    models: tuple[Model, ...] = Field((STEADY, RESTLESS, AGILE, *TURNS, SHARP, CHANGING), min_length=1)

    @model_validator(mode="after")
    def _shares_sum_to_one(self) -> Self:
        total = sum(m.share for m in self.models)
        if abs(total - 1.0) > SHARES_ADD_UP_TO:
            raise ValueError(f"models: got shares with a sum of {total}, needed 1")
        return self

    @property
    def count(self) -> int:
        """J."""
        return len(self.models)

    def table(self) -> Floats:
        """The models as the kernel wants them. (J, 6)"""
        return np.array([m.row() for m in self.models], float)

    def start(self, position_m: Floats, covariance: Floats) -> Filters:
        """Filters that know one plot and no velocity.

        Args: position_m: (N, 2); covariance: (N, 2, 2) of the plots.
        """
        n, table = len(position_m), self.table()
        state, spread = np.zeros((n, self.count, 5)), np.zeros((n, self.count, 5, 5))
        state[:, :, :2] = position_m[:, None]
        spread[:, :, :2, :2] = covariance[:, None]
        spread[:, :, 2, 2] = spread[:, :, 3, 3] = (self.start_speed_kn * KNOT_M_S) ** 2
        state[:, :, 4], spread[:, :, 4, 4] = table[:, OWN], table[:, OWN_SIGMA] ** 2
        return Filters(state, spread, np.tile(table[:, SHARE], (n, 1)))
