"""Stone Soup's track-to-track counting: `python -m scaling.peers.stonesoup.adapter association GIVEN.npz ANSWER.npz`."""

from __future__ import annotations

from datetime import datetime, timedelta

import numpy as np
from scipy.optimize import linear_sum_assignment
from stonesoup.dataassociator.tracktotrack import TrackToTrackCounting
from stonesoup.types.array import StateVector
from stonesoup.types.state import State
from stonesoup.types.track import Track

from scaling.peers.exchange import AIS, RADAR, Answer, Given, Ints, Task, Watch, answer_command

THRESHOLD_M = 70.0  # of the root mean square of the two differences, which is what its default measure gives; README.md: how it was chosen
FAR_M = 1e6  # no pair
START = datetime(2027, 1, 15)


def association(given: Given, watch: Watch) -> Answer:
    """One call over all cycles, its time shared out among them. Of what it returns the nearest pairs stand, one to one; untimed."""
    seconds = given.time_s - given.time_s[0]
    times = [START + timedelta(seconds=float(s)) for s in seconds]
    radar, ais = ({k: _track(given, k, times) for k in np.flatnonzero(given.source == s).tolist()} for s in (RADAR, AIS))
    rows = {id(track): row for side in (radar, ais) for row, track in side.items()}
    counting = TrackToTrackCounting(association_threshold=THRESHOLD_M, pos_map=[0, 1])
    with watch.lap(len(times)):
        found = counting.associate_tracks(set(radar.values()), set(ais.values()))
    held = [(*sorted((rows[id(track)] for track in one.objects), key=lambda row: given.source[row]), one) for one in found]
    pairs = [np.zeros((0, 3), np.int64)]
    for cycle in range(given.first, len(times)):
        now = np.array([(first, second) for first, second, one in held if times[cycle] in one.time_range], np.int64)
        pairs.append(_nearest(given, cycle, now.reshape(-1, 2)))
    return watch.answer(
        ("stonesoup", "numpy"),
        unit=f"pair of tracks over {len(times)} cycles",
        units=len(radar) * len(ais) / len(times),
        pairs=np.concatenate(pairs),
    )


def _nearest(given: Given, cycle: int, pairs: Ints) -> Ints:
    """The one-to-one choice of least distance, mean over the window, out of pairs that share tracks. Returns: (A, 3)."""
    window = given.position_m[max(0, cycle + 1 - given.settings["window"]) : cycle + 1]
    off = window[:, pairs[:, 1]] - window[:, pairs[:, 0]]
    (left, row), (right, column) = (np.unique(pairs[:, k], return_inverse=True) for k in range(2))
    cost = np.full((len(left), len(right)), FAR_M)
    cost[row, column] = np.hypot(off[..., 0], off[..., 1]).mean(axis=0)
    row, column = linear_sum_assignment(cost)
    real = cost[row, column] < FAR_M
    row, column = row[real], column[real]
    return np.stack([np.full(len(row), cycle), left[row], right[column]], axis=1)


def _track(given: Given, row: int, times: list[datetime]) -> Track:
    places = given.position_m[:, row]
    return Track([State(StateVector(place), timestamp=when) for place, when in zip(places, times, strict=True)])


TASKS: dict[str, Task] = {"association": association}

if __name__ == "__main__":
    answer_command(TASKS)
