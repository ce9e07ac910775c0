"""The motion models of the radar filters: settings, prior probabilities, and how a vessel changes from one to another."""

from __future__ import annotations

import math
from typing import Annotated, Literal, NamedTuple, Self

import numpy as np
from pydantic import Field, model_validator

from coastwatch import kernels
from coastwatch.batches import Floats
from coastwatch.kernels.arrays import Records
from coastwatch.kernels.filters.gaussian import Estimates
from coastwatch.stage import NotNegative, Positive, Settings

SUM_TOLERANCE = 1e-9  # of shares: decimal fractions are not exact


class Filters(NamedTuple):
    """The filters of S tracks, each of J models of east, north, east rate, north rate, and turn rate or acceleration."""

    state: Floats  # (S, J, 5) m, m/s, rad/s or m/s2, in the region's plane
    covariance: Floats  # (S, J, 5, 5)
    mode_probability: Floats  # (S, J)


class HasFilters:
    """A struct with a filter in each row: it declares these columns, of S tracks and J models."""

    updated_s: Floats  # (S,) time of the state
    state: Floats  # these three as of `Filters`
    covariance: Floats
    mode_probability: Floats
    combined_mean: Floats  # (S, 4) over the models
    combined_covariance: Floats  # (S, 4, 4)
    noise_m2_s3: Floats  # (S,) density of white acceleration

    @property
    def filters(self) -> Filters:
        """The filter of each row."""
        return Filters(self.state, self.covariance, self.mode_probability)

    @property
    def estimates(self) -> Estimates:
        """The combined estimate of each row."""
        return Estimates(self.updated_s, self.combined_mean, self.combined_covariance, self.noise_m2_s3)


FILTER_COLUMNS = tuple(HasFilters.__annotations__)


class Motion(Settings):
    """Three models: constant velocity with low noise, with high noise, coordinated turn.

    Noises are densities of white noise: of the acceleration in m2/s3, of the turn rate's drift in rad2/s3.
    """

    kind: Literal["imm"] = "imm"  # of motion models
    quiet_noise_m2_s3: NotNegative = 1e-4  # acceleration of a vessel that keeps course and speed
    agile_noise_m2_s3: NotNegative = 0.25  # acceleration of one that manoeuvres
    turn_noise_m2_s3: NotNegative = 0.001  # acceleration on top of a turn
    turn_rate_noise_rad2_s3: NotNegative = 5e-9  # drift of the turn rate
    turn_rate_sigma_deg_s: Positive = 0.45  # of turn rates before anything is known
    quiet_sojourn_s: Positive = 900.0
    agile_sojourn_s: Positive = 100.0
    turn_sojourn_s: Positive = 1200.0
    start_speed_kn: Positive = 8.0  # standard deviation of each velocity component before anything is known
    start_share: tuple[Positive, Positive, Positive] = (0.4, 0.2, 0.4)  # of the models at the start

    @model_validator(mode="after")
    def _shares_sum_to_one(self) -> Self:
        if abs(sum(self.start_share) - 1.0) > SUM_TOLERANCE:
            raise ValueError(f"start_share: got a sum of {sum(self.start_share)}, needed 1")
        return self

    @property
    def renewal_s(self) -> float:
        """Infinite: these models are a Markov chain."""
        return math.inf

    def table(self) -> Records:
        """The models as the kernels take them. (3,) MODEL"""
        models = kernels.filters.motion_models
        table: Records = models.table(
            kind=[models.STRAIGHT, models.STRAIGHT, models.TURNING],
            noise=[self.quiet_noise_m2_s3, self.agile_noise_m2_s3, self.turn_noise_m2_s3],
            manoeuvre_sigma=np.radians(self.turn_rate_sigma_deg_s),
            manoeuvre_noise=[0.0, 0.0, self.turn_rate_noise_rad2_s3],
            prior_probability=self.start_share,
            sojourn=[self.quiet_sojourn_s, self.agile_sojourn_s, self.turn_sojourn_s],
        )
        return table


class Straight(Settings):
    """Constant velocity under white acceleration."""

    kind: Literal["straight"] = "straight"  # of motion
    noise_m2_s3: NotNegative  # density of the white acceleration
    share: Positive  # probability at the start and of each new motion

    def columns(self) -> dict[str, float]:
        """This model as columns of MODEL."""
        return {"kind": kernels.filters.motion_models.STRAIGHT, "noise": self.noise_m2_s3, "prior_probability": self.share}


class Turning(Settings):
    """A turn at a rate that is estimated, positive to port, under white acceleration."""

    kind: Literal["turning"] = "turning"  # of motion
    noise_m2_s3: NotNegative  # density of the white acceleration
    rate_deg_s: float  # mean of such turns: positive is to port
    rate_sigma_deg_s: Positive
    rate_noise_rad2_s3: NotNegative = 1e-10  # density of the drift of the rate
    share: Positive  # probability at the start and of each new motion

    def columns(self) -> dict[str, float]:
        """This model as columns of MODEL."""
        return {
            "kind": kernels.filters.motion_models.TURNING,
            "noise": self.noise_m2_s3,
            "manoeuvre_mean": math.radians(self.rate_deg_s),
            "manoeuvre_sigma": math.radians(self.rate_sigma_deg_s),
            "manoeuvre_noise": self.rate_noise_rad2_s3,
            "prior_probability": self.share,
        }


class Speeding(Settings):
    """A change of speed along the track at an acceleration that is estimated, under white acceleration."""

    kind: Literal["speeding"] = "speeding"  # of motion
    noise_m2_s3: NotNegative  # density of the white acceleration
    acceleration_sigma_m_s2: Positive  # either way
    acceleration_noise_m2_s5: NotNegative = 1e-10  # density of the drift of the acceleration
    share: Positive  # probability at the start and of each new motion

    def columns(self) -> dict[str, float]:
        """This model as columns of MODEL."""
        return {
            "kind": kernels.filters.motion_models.SPEEDING,
            "noise": self.noise_m2_s3,
            "manoeuvre_sigma": self.acceleration_sigma_m_s2,
            "manoeuvre_noise": self.acceleration_noise_m2_s5,
            "prior_probability": self.share,
        }


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
    """Models of motion. At the rate 1 / renewal_s a vessel draws a new one by the shares.

    A turn is linearised about its rate, so one model for both sides believes too soon in the rate it began with.
    Source: see coastwatch/kernels/filters/imm.py.
    """

    kind: Literal["manoeuvres"] = "manoeuvres"  # of motion models
    renewal_s: Positive = 1000.0
    start_speed_kn: Positive = 8.0  # standard deviation of each velocity component before anything is known
    models: tuple[Model, ...] = Field((STEADY, RESTLESS, AGILE, *TURNS, SHARP, CHANGING), min_length=1)

    @model_validator(mode="after")
    def _shares_sum_to_one(self) -> Self:
        total = sum(m.share for m in self.models)
        if abs(total - 1.0) > SUM_TOLERANCE:
            raise ValueError(f"models: got shares with a sum of {total}, needed 1")
        return self

    def table(self) -> Records:
        """The models as the kernels take them. (J,) MODEL"""
        rows = [model.columns() for model in self.models]
        names = sorted(set().union(*rows))
        table: Records = kernels.filters.motion_models.table(**{name: [row.get(name, 0.0) for row in rows] for name in names})
        return table


Prior = Manoeuvres | Motion
MotionModels = Annotated[Prior, Field(discriminator="kind")]
