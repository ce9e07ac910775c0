"""Acquisition: the azimuth bias at which most AIS vessels have a plot at their range, by vote, until it cannot be chance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coastwatch.batches import Bools, Floats, Ints
from coastwatch.registration.residuals import Pairs

AROUND = 2  # windows to each side of the best that overlap with it or catch what it smears
RIVAL_PROBABILITY = 1e-3  # with which the second best window would have as many vessels as the best


@dataclass(frozen=True, eq=False)
class Votes:
    """Sums over the past, forgotten with time; windows overlap by half."""

    hits: Floats  # (R, B) vessels with a plot in each window
    looked: Floats  # (R,) vessels that the beam went over
    vessels: Floats  # (R,) vessels in cover
    weight: Floats  # (R,) cycles

    @classmethod
    def none(cls, radars: int, windows: int) -> Votes:
        zero = np.zeros(radars)
        return cls(np.zeros((radars, windows)), zero, zero, zero)


def add(votes: Votes, pairs: Pairs, bin_rad: float, search_rad: float, seen: Ints, share: Floats, keep: float) -> Votes:
    """The votes after a cycle. A vessel has one vote in each window in which a plot stands at its range.

    Args: seen: (R,) vessels in cover, 0 where the radar said nothing; share: (R,) of a turn that a cycle takes, at most 1;
    keep: what is left of the former sums.
    """
    windows = votes.hits.shape[1]
    slot = np.floor((pairs.azimuth_rad + search_rad) / bin_rad).astype(np.int64)
    # Window w is slots w and w + 1.
    at = np.concatenate([slot, slot - 1])
    vessel, radar = np.tile(pairs.vessel, 2), np.tile(pairs.radar, 2)
    inside = (at >= 0) & (at < windows)
    rows = int(pairs.vessel.max(initial=0)) + 1
    once = np.unique(((radar * windows + at) * rows + vessel)[inside]) // rows
    hits = np.bincount(once, minlength=votes.hits.size).reshape(votes.hits.shape).astype(np.float64)
    said = (seen > 0).astype(float)
    kept = np.where(seen > 0, keep, 1.0)  # nothing is forgotten while nothing is learned
    return Votes(
        votes.hits * kept[:, None] + hits,
        votes.looked * kept + seen * share,
        votes.vessels * kept + seen,
        votes.weight * kept + said,
    )


def significant(votes: Votes, false_alarm: float, least_vessels: int, least_share: float) -> tuple[Ints, Bools]:
    """The best window of each radar, and whether it is that of its own bias. (R,), (R,)

    It is, if among n vessels in cover so many would be in one window by chance with less than the false-alarm probability,
    all windows together, where vessels and plots are spread evenly; if the second best window does not explain it either (rows of
    moored boats, convoys); and if it has the greater part of the vessels. The mean number of vessels counts, not their sum
    over cycles: the same vessels again are no new evidence.
    """
    from scipy.special import betainc

    def at_least(count: Floats, of: Floats, probability: Floats) -> Floats:
        """That a binomial number is so high or higher."""
        some = np.maximum(count, 1.0)
        return np.where(count < 1.0, 1.0, betainc(some, np.maximum(of - some, 0.0) + 1.0, np.minimum(probability, 1.0)))

    windows = votes.hits.shape[1]
    best = votes.hits.argmax(axis=1)
    share = votes.hits / np.maximum(votes.looked, 1e-9)[:, None]
    n = np.floor(votes.vessels / np.maximum(votes.weight, 1e-9) + 1e-9)
    peak = np.take_along_axis(share, best[:, None], axis=1)[:, 0]
    others = np.abs(np.arange(windows) - best[:, None]) > AROUND
    # One vessel more than were seen: that none was met in a few looks does not mean that none can be.
    chance = (np.where(others, share, 0.0).sum(axis=1) * n + 1.0) / np.maximum(n * others.sum(axis=1), 1.0)
    rival = np.maximum(np.where(others, share, 0.0).max(axis=1), chance)
    count = np.floor(np.minimum(peak, 1.0) * n + 1e-9)
    by_chance = at_least(count, n, chance) * windows
    by_rival = at_least(count, n, rival)
    sure = (n >= least_vessels) & (peak >= least_share) & (by_chance <= false_alarm) & (by_rival <= RIVAL_PROBABILITY)
    return best, sure


def middle(pairs: Pairs, window_rad: Floats, half_rad: float, radars: int) -> tuple[Floats, Floats, Ints]:
    """Median azimuth and range difference of the pairs in each radar's window, and their number. (R,), (R,), (R,)"""
    azimuth, distance, count = np.zeros(radars), np.zeros(radars), np.zeros(radars, np.int64)
    for r in range(radars):
        here = (pairs.radar == r) & (np.abs(pairs.azimuth_rad - window_rad[r]) <= half_rad)
        count[r] = here.sum()
        if count[r]:
            azimuth[r], distance[r] = np.median(pairs.azimuth_rad[here]), np.median(pairs.range_m[here])
    return azimuth, distance, count
