"""Acquisition, third part: every few seconds, whether the evidence of a radar is enough to take a bias for its own."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from coastwatch.batches import Batch, Bools, Floats, Ints, Sensors, column
from coastwatch.registration.evidence import decide, evidence, is_apart, log_evidence_at
from coastwatch.registration.reference_cells import Grid, ReferenceCells, counted

SURE_SHARE = 0.99  # of the evidence of all biases, that the window of one that is taken has: rows and convoys repeat themselves
PROBABLE_ODDS = 1e3
FIRM_ODDS = 100.0  # with which the candidate moves the centre of the estimate
CENTRE_GAIN = 0.2  # by which it does, a decision
WATCH_LEAST_S, WATCH_MOST_S = 30.0, 120.0  # memory of the evidence once a bias is found: a step is to be seen soon
WATCH_FACTOR = 3.0  # of the time that acquisition took
MOST_LOG = 690.0  # a number of more does not fit a double


class Rules(NamedTuple):
    """When a bias is taken; settings of the method."""

    decision_s: float  # between two decisions
    vote_memory_s: float  # time constant of the evidence until a bias is found
    false_alarm: float  # probability of one decision
    least_vessels: int  # compared
    least_voices: int  # that speak for it
    grid: Grid  # biases that are searched


@dataclass(frozen=True, eq=False)
class Acquisition(Batch):
    """What the last decision on each radar was."""

    found: Bools = column(np.bool_, "R")  # a bias is known
    acquired: Bools = column(np.bool_, "R")  # it was found, or found elsewhere, in this cycle
    doubtful: Bools = column(np.bool_, "R")  # another bias is significant, but not by enough
    begun_s: Floats = column(np.float64, "R", new=np.inf)  # first decision; infinite: none yet
    decided_s: Floats = column(np.float64, "R", new=-np.inf)  # last decision
    watch_s: Floats = column(np.float64, "R", new=np.nan)  # time constant of the evidence once a bias is found
    centre: Floats = column(np.float64, "R", 3)  # azimuth rad, range m, lag s about which the errors are estimated
    azimuth_rad: Floats = column(np.float64, "R", new=np.nan)  # candidate; NaN before the first decision
    range_m: Floats = column(np.float64, "R", new=np.nan)
    odds: Floats = column(np.float64, "R", new=np.nan)  # of the candidate against chance
    found_odds: Floats = column(np.float64, "R", new=np.nan)  # the same when it was found
    groups: Ints = column(np.int64, "R")
    rival_share: Floats = column(np.float64, "R", new=np.nan)  # of all evidence, that the best other bias has


def decide_all(
    former: Acquisition,
    reference_cells: tuple[ReferenceCells, ...],
    estimate: Floats,
    compared: Ints,
    time_s: float,
    rules: Rules,
    sensors: Sensors,
) -> tuple[Acquisition, tuple[ReferenceCells, ...]]:
    """The decisions on all radars that are due, and the reference cells after them.

    Args: estimate: (R, 3) azimuth rad, range m, lag s; compared: (R,) AIS vessels in this cycle.
    """
    new = former.take(np.arange(len(former)))  # a copy
    new.acquired[:] = False
    after = list(reference_cells)
    for r, mine in enumerate(reference_cells):
        elapsed_s = time_s - former.decided_s[r]
        if elapsed_s < rules.decision_s or not mine.new_looks.any():
            continue
        memory_s = former.watch_s[r] if former.found[r] else rules.vote_memory_s
        after[r] = counted(mine, float(np.exp(-elapsed_s / memory_s)) if np.isfinite(elapsed_s) else 1.0, rules.grid)
        # The first interval differs from radar to radar, so that later decisions are spread over cycles.
        new.decided_s[r] = time_s if np.isfinite(elapsed_s) else time_s - rules.decision_s * r / len(reference_cells)
        new.begun_s[r] = min(former.begun_s[r], time_s)
        if len(after[r].counts):
            enough = bool(compared[r] >= rules.least_vessels)
            sigma = float(sensors.radars.azimuth_sigma_rad[r])
            _decide(new, r, after[r], float(estimate[r, 0]), sigma, enough, time_s, rules)
    return new, tuple(after)


def _decide(
    new: Acquisition,
    r: int,
    reference_cells: ReferenceCells,
    applied_rad: float,
    sigma: float,
    enough: bool,
    time_s: float,
    rules: Rules,
) -> None:
    """Write the decision on radar r. Args: sigma: of its azimuth, rad; enough: whether it was compared with enough vessels."""
    field = evidence(reference_cells, sigma, rules.grid)
    best = decide(field, sigma)
    new.azimuth_rad[r], new.range_m[r], new.groups[r] = best.azimuth_rad, best.range_m, best.groups
    new.odds[r], new.rival_share[r] = np.exp(min(best.log_odds, MOST_LOG)), best.rival_share
    # It is no chance, has no rival, and is no matter of one or two vessels.
    sure = best.share >= SURE_SHARE and best.groups >= rules.least_voices
    significant = enough and sure and bool(best.log_odds >= -np.log(rules.false_alarm))
    is_other = is_apart(best.azimuth_rad, applied_rad, sigma, rules.grid.step_rad)
    beaten = best.log_evidence - log_evidence_at(field, applied_rad) > -np.log(rules.false_alarm)
    new.doubtful[r] = bool(new.found[r]) and significant and is_other and not beaten
    if significant and (not new.found[r] or (is_other and beaten)):
        if not new.found[r]:
            new.watch_s[r] = np.clip(WATCH_FACTOR * (time_s - new.begun_s[r]), WATCH_LEAST_S, WATCH_MOST_S)
        new.found[r] = new.acquired[r] = True
        new.found_odds[r] = new.odds[r]
        new.centre[r, :2] = best.azimuth_rad, best.range_m
    elif new.found[r] and not is_other and sure and new.odds[r] > FIRM_ODDS:
        new.centre[r, :2] += CENTRE_GAIN * (np.array([best.azimuth_rad, best.range_m]) - new.centre[r, :2])
