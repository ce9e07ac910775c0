"""Acquisition: the azimuth bias at which most AIS vessels have a plot at their range, found by a Hough transform.

Source: P. V. C. Hough, Method and means for recognizing complex patterns, US patent 3069654, 1962.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coastwatch.batches import Bools, Floats, Ints
from coastwatch.registration.polar import Pairs

OVERLAPPING_WINDOWS = 2  # windows to each side of the best that share vessels with it
RIVAL_PROBABILITY = 1e-3  # that the second best window has as many vessels as the best one


@dataclass(frozen=True, eq=False)
class Accumulator:
    """Votes of the past for each window of azimuth bias, forgotten with time; windows overlap by half."""

    hits: Floats  # (R, B) vessels with a plot in each window
    swept: Floats  # (R,) vessels that the beam went over
    vessels: Floats  # (R,) vessels in cover that were compared
    weight: Floats  # (R,) cycles

    @classmethod
    def none(cls, radars: int, windows: int) -> Accumulator:
        zero = np.zeros(radars)
        return cls(np.zeros((radars, windows)), zero, zero, zero)


def accumulate(
    votes: Accumulator, pairs: Pairs, radar_of_vessel: Ints, bin_rad: float, search_rad: float, share: Floats, keep: float
) -> Accumulator:
    """The votes after a cycle. A vessel has one vote in each window in which a plot stands at its range.

    Args: radar_of_vessel: (N,) of the compared vessels; share: (R,) of a turn that a cycle takes, at most 1; keep: factor of the
    former sums.
    """
    seen = np.bincount(radar_of_vessel, minlength=len(votes.swept))
    windows = votes.hits.shape[1]
    bin_of_pair = np.floor((pairs.azimuth_rad + search_rad) / bin_rad).astype(np.int64)
    inside = (bin_of_pair >= 0) & (bin_of_pair <= windows)
    stands = np.zeros((len(radar_of_vessel), windows + 1), np.bool_)
    stands[pairs.vessel[inside], bin_of_pair[inside]] = True
    in_window = stands[:, :-1] | stands[:, 1:]  # window w is bins w and w + 1
    hits = np.array([in_window[radar_of_vessel == r].sum(axis=0) for r in range(len(seen))], float).reshape(votes.hits.shape)
    kept = np.where(seen > 0, keep, 1.0)  # without new votes none are forgotten
    return Accumulator(
        votes.hits * kept[:, None] + hits,
        votes.swept * kept + seen * share,
        votes.vessels * kept + seen,
        votes.weight * kept + (seen > 0).astype(float),
    )


def detect_peak(votes: Accumulator, false_alarm: float, least_vessels: int, least_share: float) -> tuple[Ints, Bools]:
    """The best window of each radar, and whether it is the radar's bias. (R,), (R,)

    The best window is the bias if all of these hold:
    - By chance, any window would have so many of the n vessels in cover with less than the false-alarm probability. Vessels and
      plots are assumed to be spread evenly.
    - The second best window has fewer vessels. (Rows of moored boats and convoys repeat themselves.)
    - The best window has `least_share` of the vessels.
    The mean number of vessels over cycles counts, not the sum: the same vessels again are no new information.
    """
    from scipy.special import betainc

    def at_least(count: Floats, n: Floats, probability: Floats) -> Floats:
        """Probability that a binomial number of n is so high or higher."""
        some = np.maximum(count, 1.0)
        return np.where(count < 1.0, 1.0, betainc(some, np.maximum(n - some, 0.0) + 1.0, np.minimum(probability, 1.0)))

    windows = votes.hits.shape[1]
    best = votes.hits.argmax(axis=1)
    share = votes.hits / np.maximum(votes.swept, 1e-9)[:, None]
    n = np.floor(votes.vessels / np.maximum(votes.weight, 1e-9) + 1e-9)
    peak = np.take_along_axis(share, best[:, None], axis=1)[:, 0]
    others = np.abs(np.arange(windows) - best[:, None]) > OVERLAPPING_WINDOWS
    # One vessel more than were seen: that none was met in a few cycles does not mean that none can be.
    chance = (np.where(others, share, 0.0).sum(axis=1) * n + 1.0) / np.maximum(n * others.sum(axis=1), 1.0)
    rival = np.maximum(np.where(others, share, 0.0).max(axis=1), chance)
    count = np.floor(np.minimum(peak, 1.0) * n + 1e-9)
    by_chance = at_least(count, n, chance) * windows
    by_rival = at_least(count, n, rival)
    is_bias = (n >= least_vessels) & (peak >= least_share) & (by_chance <= false_alarm) & (by_rival <= RIVAL_PROBABILITY)
    return best, is_bias


def window_medians(pairs: Pairs, window_rad: Floats, half_rad: float, radars: int) -> tuple[Floats, Floats, Ints]:
    """Median azimuth and range difference of the pairs in each radar's window, and their number. (R,), (R,), (R,)"""
    azimuth, distance, count = np.zeros(radars), np.zeros(radars), np.zeros(radars, np.int64)
    for r in range(radars):
        here = (pairs.radar == r) & (np.abs(pairs.azimuth_rad - window_rad[r]) <= half_rad)
        count[r] = here.sum()
        if count[r]:
            azimuth[r], distance[r] = np.median(pairs.azimuth_rad[here]), np.median(pairs.range_m[here])
    return azimuth, distance, count
