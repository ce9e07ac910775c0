"""Tasks of Coastwatch with numpy, scipy and scikit-learn alone.

`python -m scaling.peers.scipy.adapter TASK INPUT.npz RESULT.npz`
"""

from __future__ import annotations

import numpy as np

from scaling.peers.exchange import Stopwatch, Task, TaskResult, TrackHistory, run_adapter
from scaling.peers.scipy.filters import imm
from scaling.peers.scipy.pairs import association, association_batched

PACKAGES = ("numpy",)


def fusion(history: TrackHistory, watch: Stopwatch) -> TaskResult:
    """Convex combination of the radar and AIS track of each vessel, all at once by numpy.linalg.inv."""
    vessels = history.true_position_m.shape[1]
    row = np.full((2, vessels), -1)
    row[history.source, history.vessel] = np.arange(len(history.source))
    both, lead = np.flatnonzero((row >= 0).all(axis=0)), row.max(axis=0)
    radar, ais = row[:, both]
    estimates = np.zeros((history.measured, vessels, 4))
    for cycle in range(history.first, len(history.time_s)):
        states = np.concatenate([history.position_m[cycle], history.velocity_m_s[cycle]], axis=1)
        with watch.lap():
            out, covariance = states[lead], history.covariance[lead]
            weight = [np.linalg.inv(history.covariance[rows]) for rows in (radar, ais)]
            covariance[both] = np.linalg.inv(weight[0] + weight[1])
            total = np.einsum("vij,vj->vi", weight[0], states[radar]) + np.einsum("vij,vj->vi", weight[1], states[ais])
            out[both] = np.einsum("vij,vj->vi", covariance[both], total)
        estimates[cycle - history.first] = out
    position, velocity = estimates[..., :2], estimates[..., 2:]
    return watch.result(PACKAGES, unit="vessel", units=vessels, position_m=position, velocity_m_s=velocity)


def spots(history: TrackHistory, watch: Stopwatch) -> TaskResult:
    """One Lloyd step of scikit-learn's KMeans a cycle from the last centres, k-means++ at the first cycle. No halo."""
    from sklearn.cluster import KMeans

    count = int(np.ceil(len(history.track_id) / history.settings["tracks_per_spot"]))
    found = KMeans(count, n_init=1, max_iter=50, random_state=0).fit(history.position_m[0])
    for cycle in range(1, len(history.time_s)):
        with (watch if cycle >= history.first else Stopwatch()).lap():
            found = KMeans(count, init=found.cluster_centers_, n_init=1, max_iter=1).fit(history.position_m[cycle])
    return watch.result(
        (*PACKAGES, "scikit-learn"), unit="track", units=len(history.track_id), spot=found.labels_.astype(np.int64)
    )


TASKS: dict[str, Task] = {
    "association": association,
    "association_batched": association_batched,
    "imm": imm,
    "fusion": fusion,
    "spots": spots,
}

if __name__ == "__main__":
    run_adapter(TASKS)
