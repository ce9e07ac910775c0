"""Settings of gates and of the life of radar tracks."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from coastwatch.stage import Settings

Positive = Annotated[float, Field(gt=0.0)]
Probability = Annotated[float, Field(gt=0.0, lt=1.0)]
Count = Annotated[int, Field(ge=1)]
PlotOrigin = Literal["estimated", "known"]


class Upkeep(Settings):
    """Gates, initiation, deletion. A look is one turn of a radar that covers the track."""

    slice_s: Positive = 1.0  # plots are taken in slices so long, never longer than half a turn of the fastest radar
    gate_probability: Probability = 0.999
    detection_probability: Probability = 0.9
    false_plots_per_m2: Positive = 1e-6  # clutter and new vessels, in one look
    max_speed_kn: Positive = 50.0  # between the first two plots of a track
    confirm_hits: Annotated[int, Field(ge=2)] = 4
    confirm_looks: Count = 5
    delete_misses: Count = 5  # looks in a row
    misses_per_hit: Positive = 0.5  # a track with few hits ends after so many misses for each; `delete_misses` is the most
    look_slack: Annotated[float, Field(gt=-0.5, lt=0.5)] = 0.1  # turns after which the next look is over, less one
    coast_s: Positive = 30.0  # where no radar looks
    merge_probability: Probability = 0.99
    merge_looks: Count = 3
    late_s: Positive = 5.0  # a plot so much older than what its track has is still used
    ahead_s: Positive = 5.0  # a plot stamped so much later than the cycle is not believed

    @model_validator(mode="after")
    def _hits_fit_into_looks(self) -> Self:
        if self.confirm_hits > self.confirm_looks:
            raise ValueError(f"confirm_hits: got {self.confirm_hits}, needed at most confirm_looks = {self.confirm_looks}")
        return self
