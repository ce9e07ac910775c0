"""Stone Soup's track-to-track counting: `python -m scaling.peers.stonesoup.adapter association INPUT.npz RESULT.npz`."""

from __future__ import annotations

from datetime import datetime, timedelta

import numpy as np
from scipy.optimize import linear_sum_assignment
from stonesoup.dataassociator.tracktotrack import TrackToTrackCounting
from stonesoup.types.array import StateVector
from stonesoup.types.state import State
from stonesoup.types.track import Track

from scaling.peers.exchange import AIS, RADAR, Ints, Stopwatch, Task, TaskResult, TrackHistory, run_adapter

THRESHOLD_M = 70.0  # of the RMS of the differences east and north, its default measure; README.md: how it was chosen
NO_PAIR_M = 1e6
START = datetime(2027, 1, 15)


def association(history: TrackHistory, watch: Stopwatch) -> TaskResult:
    """One call over all cycles; a cycle has its mean time. The nearest of the returned pairs are chosen one to one, untimed."""
    seconds = history.time_s - history.time_s[0]
    times = [START + timedelta(seconds=float(s)) for s in seconds]
    radar, ais = ({k: _track(history, k, times) for k in np.flatnonzero(history.source == s).tolist()} for s in (RADAR, AIS))
    rows = {id(track): row for side in (radar, ais) for row, track in side.items()}
    counting = TrackToTrackCounting(association_threshold=THRESHOLD_M, pos_map=[0, 1])
    with watch.lap(len(times)):
        associations = counting.associate_tracks(set(radar.values()), set(ais.values()))
    with_rows = [
        (*sorted((rows[id(track)] for track in one.objects), key=lambda row: history.source[row]), one) for one in associations
    ]
    pairs = [np.zeros((0, 3), np.int64)]
    for cycle in range(history.first, len(times)):
        now = np.array([(first, second) for first, second, one in with_rows if times[cycle] in one.time_range], np.int64)
        pairs.append(_nearest(history, cycle, now.reshape(-1, 2)))
    return watch.result(
        ("stonesoup", "numpy"),
        unit=f"pair of tracks over {len(times)} cycles",
        units=len(radar) * len(ais) / len(times),
        pairs=np.concatenate(pairs),
    )


def _nearest(history: TrackHistory, cycle: int, pairs: Ints) -> Ints:
    """The one-to-one assignment of least mean distance over the window. Args: pairs: (B, 2) rows. Returns: (A, 3)."""
    window = history.position_m[max(0, cycle + 1 - history.settings["window"]) : cycle + 1]
    off = window[:, pairs[:, 1]] - window[:, pairs[:, 0]]
    (left, row), (right, column) = (np.unique(pairs[:, k], return_inverse=True) for k in range(2))
    cost = np.full((len(left), len(right)), NO_PAIR_M)
    cost[row, column] = np.hypot(off[..., 0], off[..., 1]).mean(axis=0)
    row, column = linear_sum_assignment(cost)
    real = cost[row, column] < NO_PAIR_M
    row, column = row[real], column[real]
    return np.stack([np.full(len(row), cycle), left[row], right[column]], axis=1)


def _track(history: TrackHistory, row: int, times: list[datetime]) -> Track:
    positions = history.position_m[:, row]
    return Track([State(StateVector(p), timestamp=when) for p, when in zip(positions, times, strict=True)])


TASKS: dict[str, Task] = {"association": association}

if __name__ == "__main__":
    run_adapter(TASKS)
