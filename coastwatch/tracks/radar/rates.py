"""What each radar detects, learnt from its own plots: the density of false plots and the probability of detection.

The stated density and probability are where a radar starts. Both are means over its range: the clutter map (`clutter.py`) has false
plots by place, and starts from the density learnt here.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from coastwatch.batches import Floats, Radars
from coastwatch.batches.struct import Struct, column
from coastwatch.kernels.tracks.columns import DetectionColumns
from coastwatch.stage import Positive, Probability, Settings

PAUSE_TURNS = 3.0  # a radar that was silent for longer has not turned


class RateSettings(Settings):
    """How the density of false plots and the probability of detection of each radar are learnt."""

    learnt: bool = True  # else the stated ones hold
    prior_turns: Positive = 10.0  # that the stated density of false plots is worth
    prior_looks: Positive = 100.0  # that the stated probability of detection is worth
    memory_turns: Positive = 100.0  # after which a plot or look counts 1 / e
    least_detection: Probability = 0.3  # least probability of detection that is learnt; the largest is the stated one


@dataclass(frozen=True, eq=False)
class LearntRates(Struct):
    """Counts of R radars that fade with the turns of each."""

    turns: Floats = column(np.float64, "R")  # in which false plots were counted
    newest_s: Floats = column(np.float64, "R")  # newest plot, NaN before the first
    false_plots: Floats = column(np.float64, "R")  # expected number
    looks: Floats = column(np.float64, "R")  # at tracks that surely exist
    detections: Floats = column(np.float64, "R")  # expected number in these looks

    @classmethod
    def none(cls, radars: int) -> Self:
        """Nothing learnt of so many radars."""
        zero = np.zeros((4, radars))
        return cls(zero[0], np.full(radars, np.nan), *zero[1:])

    def false_plots_per_m2(self, settings: RateSettings, radars: Radars, stated: Floats) -> Floats:
        """The density of false plots of each radar in one turn: lambda, (R,).

        lambda = (prior_turns lambda_0 + false plots / area in range) / (prior_turns + turns). Args: stated: lambda_0, (R,).
        """
        if not settings.learnt:
            return stated
        counted = self.false_plots / (np.pi * radars.range_m**2)
        return (settings.prior_turns * stated + counted) / (settings.prior_turns + self.turns)

    def detection(self, settings: RateSettings, stated: Floats, visible: float) -> DetectionColumns:
        """The probability that each radar detects a visible vessel in a look: P_D, between `least_detection` and the stated one.

        P_D = (prior_looks P_0 v + detections) / (v (prior_looks + looks)). Args: stated: P_0, (R,); visible: v, the share of time.
        """
        if not settings.learnt:
            return DetectionColumns(stated, np.ones(len(stated)), np.zeros(len(stated)))
        mean = (settings.prior_looks * stated + self.detections / visible) / (settings.prior_looks + self.looks)
        probability = np.minimum(np.maximum(mean, settings.least_detection), stated)
        return DetectionColumns(probability, np.log1p(-probability) / np.log1p(-stated), self.looks)

    def turn(self, settings: RateSettings, radar: int, newest_s: float, period_s: float) -> None:
        """Let the counts of a radar fade to its newest plot, in place. Args: newest_s: of a batch of its plots."""
        passed = turns_between(float(self.newest_s[radar]), newest_s, period_s)
        self.newest_s[radar] = np.fmax(newest_s, self.newest_s[radar])
        for count in (self.turns, self.false_plots, self.looks, self.detections):
            count[radar] *= np.exp(-passed / settings.memory_turns)
        self.turns[radar] += passed


def turns_between(before_s: float, newest_s: float, period_s: float) -> float:
    """The turns of a radar between two plots, 1 before the first and after a pause: a radar that sends nothing has not turned."""
    passed = max((newest_s - before_s) / period_s, 0.0) if np.isfinite(before_s) else 1.0
    return passed if passed <= PAUSE_TURNS else 1.0
