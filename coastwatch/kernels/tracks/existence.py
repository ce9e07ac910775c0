"""Existence and visibility of tracks: how they fade with time, and what a look without a plot says. Scalar code, compiled by numba.

A vessel that exists is visible or not, and changes between the two as a Markov chain; only a visible one gives plots.
Source: A. G. Hem, E. F. Brekke, Variations of joint integrated data association with radar and target-provided measurements, Journal of
Advances in Information Fusion 17(2), 2022, equations (19), (20) and (48) to (50), for any time between looks.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from coastwatch.kernels.jit import jit
from coastwatch.kernels.tracks.prediction import predicted_position

SURELY = 1.0 - 1e-12  # most that is believed, so that 1 - r keeps digits
EXISTS = 0.9  # existence before a look, from which it counts as one at a vessel
LATELY = 10.5  # turns since the newest plot of the radar, up to which it counts: others may be out of sight for ever


class ExistenceChain(NamedTuple):
    """Rates of change, 1/s."""

    end: float  # of a vessel that ceases to exist
    hide: float  # of a visible vessel that becomes invisible
    show: float  # of an invisible one that becomes visible


@jit
def after(existence, visibility, dt, chain):  # type: ignore[no-untyped-def]
    """Probability that a vessel still exists after dt, and that it is visible then."""
    if dt <= 0.0:
        return existence, visibility
    rate = chain.hide + chain.show
    if rate > 0.0:
        share = chain.show / rate
        visibility = share + (visibility - share) * math.exp(-rate * dt)
    return existence * math.exp(-chain.end * dt), visibility


@jit
def missed(existence, visibility, detection):  # type: ignore[no-untyped-def]
    """Existence, visibility and probability of a look that gave a vessel no plot. Args: detection: probability for a visible vessel."""
    found = visibility * detection
    nothing = 1.0 - existence * found
    return existence * (1.0 - found) / nothing, visibility * (1.0 - detection) / (1.0 - found), nothing


@jit
def _count_missed(life, n, radar, period, looks, detection, chain):  # type: ignore[no-untyped-def]
    """Lower existence and visibility of track n by so many looks of a radar, one period after the other. In place.

    These looks also count in `detection.looks`. Args: detection: DetectionColumns.
    """
    for _ in range(looks):
        life.looked[n, radar] += period
        counts = life.existence[n] >= EXISTS and life.looked[n, radar] - life.radar_time[n, radar] <= LATELY * period
        life.existence[n], life.visibility[n] = after(
            life.existence[n], life.visibility[n], life.looked[n, radar] - life.time[n], chain
        )
        life.time[n] = max(life.time[n], life.looked[n, radar])
        life.existence[n], life.visibility[n], _ = missed(life.existence[n], life.visibility[n], detection.probability[radar])
        life.misses[n] += detection.miss[radar]
        detection.looks[radar] += counts


@jit
def predict_existence(life, slots, time, radar, period, detection, chain):  # type: ignore[no-untyped-def]
    """Predict existence and visibility to a look of a radar, past the looks before it that gave no plot. In place.

    Args: life: ExistenceColumns; slots: (T,); time: (T,) of the look; radar: its number; period: of its turns; detection:
    DetectionColumns; chain: ExistenceChain.
    """
    for t in range(len(slots)):
        n = slots[t]
        looks = int((time[t] - life.looked[n, radar]) / period - 0.5)  # one less than the turns, rounded
        _count_missed(life, n, radar, period, max(looks, 0), detection, chain)
        life.existence[n], life.visibility[n] = after(life.existence[n], life.visibility[n], time[t] - life.time[n], chain)
        life.time[n] = max(life.time[n], time[t])


@jit
def fade(life, slots, time, chain):  # type: ignore[no-untyped-def]
    """Predict existence and visibility to a time at which no radar looks. In place.

    Args: life: ExistenceColumns; slots: (T,); time: (T,); chain: ExistenceChain.
    """
    for t in range(len(slots)):
        n = slots[t]
        life.existence[n], life.visibility[n] = after(life.existence[n], life.visibility[n], time[t] - life.time[n], chain)
        life.time[n] = max(life.time[n], time[t])


@jit
def count_missed_looks(life, estimates, rows, radars, numbers, detection, slack, chain):  # type: ignore[no-untyped-def]
    """Lower existence and visibility by each look of a radar that gave a track no plot in its gate. In place.

    A look is over after 1 + slack turns, counted by the newest plot of the radar; one that does not cover the track has not looked.
    Args: life: ExistenceColumns; estimates: Estimates; rows: (N,) slots; radars: RadarColumns; numbers: (R,) of these radars
    among the columns of life.looked and in detection; detection: DetectionColumns; slack: in turns; chain: ExistenceChain.
    """
    for n in rows:
        for r in range(len(radars.range)):
            number = numbers[r]
            turns = math.floor((radars.newest[r] - life.looked[n, number]) / radars.period[r] - slack)
            if turns <= 0.0:
                continue
            position = predicted_position(estimates, n, max(radars.newest[r], estimates.time[n]))
            east, north = position[0] - radars.site[r, 0], position[1] - radars.site[r, 1]
            if east * east + north * north <= radars.range[r] * radars.range[r]:
                _count_missed(life, n, number, radars.period[r], int(turns), detection, chain)
            else:
                life.looked[n, number] = radars.newest[r]
