"""Jitter of the times of AIS feeds, estimated from the way that vessels sail between two reports."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coastwatch.batches import AisFeeds, Floats, Ints, Struct, column

KEPT = 512  # newest delays of a feed
LEAST = 20  # delays from which on the jitter is estimated
LEAST_SIGMA_S = 0.5  # less is the rounding of stamps to whole seconds and the noise of positions
STEP_S = 0.1  # of the estimate
QUANTILE = 0.8  # of the absolute delays: some vessels manoeuvre, and some send a wrong speed
NORMAL_QUANTILE = 1.2816  # of the absolute value of a standard normal variable


@dataclass(frozen=True, eq=False)
class FeedClocks(Struct):
    """The newest delays of each feed: how late a stamp is against the way sailed since the report before."""

    delay_s: Floats = column(np.float64, "F", KEPT, new=np.nan)  # NaN: none yet
    variance_s2: Floats = column(np.float64, "F", KEPT, new=np.nan)  # of each, if stamps were exact
    count: Ints = column(np.int64, "F")  # delays so far

    def updated(self, feed: Ints, delay_s: Floats, variance_s2: Floats) -> FeedClocks:
        """With the delays of these reports. Args: (M,) NaN: not measured."""
        known = np.flatnonzero(np.isfinite(delay_s))
        if not len(known):
            return self
        longer = self.with_room("F", int(feed[known].max()) + 1)
        delays, variances, count = longer.delay_s.copy(), longer.variance_s2.copy(), longer.count.copy()
        for k in np.unique(feed[known]).tolist():
            rows = known[feed[known] == k]
            for kept, new in ((delays, delay_s), (variances, variance_s2)):
                kept[k] = np.concatenate([kept[k], new[rows]])[-KEPT:]
            count[k] += len(rows)
        return FeedClocks(delays, variances, count)

    def sigma_s(self) -> Floats:
        """Standard deviation of the times of each feed, 0 where it is too small to be told from other errors. (F,)

        A delay is the difference of two errors of time, beside the errors of positions and speeds.
        """
        out = np.zeros(len(self.count))
        for k in np.flatnonzero(self.count >= LEAST).tolist():
            known = np.isfinite(self.delay_s[k])
            spread = float(np.quantile(np.abs(self.delay_s[k][known]), QUANTILE)) / NORMAL_QUANTILE
            excess = spread**2 - float(np.median(self.variance_s2[k][known]))
            sigma = np.sqrt(max(excess, 0.0) / 2.0)
            out[k] = round(sigma / STEP_S) * STEP_S if sigma >= LEAST_SIGMA_S else 0.0
        return out

    def summary(self) -> AisFeeds:
        """What is known of each feed."""
        return AisFeeds(self.sigma_s(), self.count.copy())
