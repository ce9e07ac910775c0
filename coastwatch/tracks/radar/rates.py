"""What each radar detects, learnt from its own plots: the density of false plots and the probability of detection.

The stated density and probability are where a radar starts. Both are means over its range: the clutter map (`clutter.py`) has false
plots by place, and starts from the density learnt here.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coastwatch.batches import Floats, Radars
from coastwatch.batches.struct import Struct, column
from coastwatch.kernels.tracks.columns import DetectionColumns
from coastwatch.stage import Positive, Probability, Settings

PAUSE_TURNS = 3.0  # a radar that was silent for longer has not turned
BURST_FACTOR, BURST_SIGMAS = 4.0, 5.0  # so much more plots than expected are a burst of clutter
LEAST_PART = 0.05  # of a turn, in which plots are compared with those expected


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
    newest_s: Floats = column(np.float64, "R", new=np.nan)  # newest plot, NaN before the first
    false_plots: Floats = column(np.float64, "R")  # expected number
    looks: Floats = column(np.float64, "R")  # at tracks that surely exist
    detections: Floats = column(np.float64, "R")  # expected number in these looks
    burst_per_m2: Floats = column(np.float64, "R")  # false plots in one turn of a burst; fades within few turns

    def false_plots_per_m2(self, settings: RateSettings, radars: Radars, stated: Floats) -> Floats:
        """The density of false plots of each radar in one turn: lambda, (R,).

        lambda = (prior_turns lambda_0 + false plots / area in range) / (prior_turns + turns), or that of a burst of clutter where
        that is more. Args: stated: lambda_0, (R,).
        """
        if not settings.learnt:
            return stated
        counted = self.false_plots / (np.pi * radars.range_m**2)
        return np.maximum((settings.prior_turns * stated + counted) / (settings.prior_turns + self.turns), self.burst_per_m2)

    def detection(self, settings: RateSettings, stated: Floats, visible: float) -> DetectionColumns:
        """The probability that each radar detects a visible vessel in a look: P_D, between `least_detection` and the stated one.

        P_D = (prior_looks P_0 v + detections) / (v (prior_looks + looks)). Args: stated: P_0, (R,); visible: v, the share of time.
        """
        if not settings.learnt:
            return DetectionColumns(stated, np.ones(len(stated)), np.zeros(len(stated)))
        mean = (settings.prior_looks * stated + self.detections / visible) / (settings.prior_looks + self.looks)
        probability = np.minimum(np.maximum(mean, settings.least_detection), stated)
        return DetectionColumns(probability, np.log1p(-probability) / np.log1p(-stated), self.looks)

    def turn(self, settings: RateSettings, radar: int, newest_s: float, period_s: float) -> float:
        """Let the counts of a radar fade to its newest plot, in place. Returns: the turns since then.

        Args: newest_s: of a batch of its plots.
        """
        passed = turns_between(float(self.newest_s[radar]), newest_s, period_s)
        self.newest_s[radar] = np.fmax(newest_s, self.newest_s[radar])
        for count in (self.turns, self.false_plots, self.looks, self.detections):
            count[radar] *= np.exp(-passed / settings.memory_turns)
        self.turns[radar] += passed
        self.burst_per_m2[radar] *= np.exp(-passed)
        return passed

    def notice_burst(
        self, settings: RateSettings, radar: int, stated_plots: float, area_m2: float, plots: int, passed: float
    ) -> None:
        """Take the density of a batch, in place, where it has far more plots of no track than false plots explain.

        Only a radar that has turned for `prior_turns` is judged: before that, plots may be of vessels without tracks.
        Args: stated_plots: false ones in a turn; area_m2: in range; plots: less tracks that exist; passed: turns since the last batch.
        """
        turns = float(self.turns[radar])
        if passed < LEAST_PART or turns < settings.prior_turns:
            return
        each_turn = (settings.prior_turns * stated_plots + float(self.false_plots[radar])) / (settings.prior_turns + turns)
        expected = passed * each_turn
        if plots > BURST_FACTOR * expected and plots > expected + BURST_SIGMAS * np.sqrt(expected + 1.0):
            self.burst_per_m2[radar] = max(plots / (passed * area_m2), float(self.burst_per_m2[radar]))


def turns_between(before_s: float, newest_s: float, period_s: float) -> float:
    """The turns of a radar between two plots, 1 before the first and after a pause: a radar that sends nothing has not turned."""
    passed = max((newest_s - before_s) / period_s, 0.0) if np.isfinite(before_s) else 1.0
    return passed if passed <= PAUSE_TURNS else 1.0
