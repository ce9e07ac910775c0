"""The straightforward way with numpy, scipy and scikit-learn.

`python -m scaling.peers.scipy.adapter TASK GIVEN.npz ANSWER.npz`
"""

from __future__ import annotations

import numpy as np

from scaling.peers.exchange import Answer, Given, Task, Watch, answer_command
from scaling.peers.scipy.filters import imm
from scaling.peers.scipy.pairs import association, association_batched

PACKAGES = ("numpy",)


def fusion(given: Given, watch: Watch) -> Answer:
    """Radar and AIS track of a vessel weighed by the inverse of their covariances, all at once by numpy.linalg.inv."""
    vessels = given.true_position_m.shape[1]
    row = np.full((2, vessels), -1)
    row[given.source, given.vessel] = np.arange(len(given.source))
    both, lead = np.flatnonzero((row >= 0).all(axis=0)), row.max(axis=0)
    radar, ais = row[:, both]
    estimates = np.zeros((given.measured, vessels, 4))
    for cycle in range(given.first, len(given.time_s)):
        seen = np.concatenate([given.position_m[cycle], given.velocity_m_s[cycle]], axis=1)
        with watch.lap():
            out, covariance = seen[lead], given.covariance[lead]
            weight = [np.linalg.inv(given.covariance[rows]) for rows in (radar, ais)]
            covariance[both] = np.linalg.inv(weight[0] + weight[1])
            total = np.einsum("vij,vj->vi", weight[0], seen[radar]) + np.einsum("vij,vj->vi", weight[1], seen[ais])
            out[both] = np.einsum("vij,vj->vi", covariance[both], total)
        estimates[cycle - given.first] = out
    position, velocity = estimates[..., :2], estimates[..., 2:]
    return watch.answer(PACKAGES, unit="vessel", units=vessels, position_m=position, velocity_m_s=velocity)


def spots(given: Given, watch: Watch) -> Answer:
    """One Lloyd step of scikit-learn's KMeans a cycle from the last centres, k-means++ at the first cycle. No halo."""
    from sklearn.cluster import KMeans

    count = int(np.ceil(len(given.track_id) / given.settings["tracks_per_spot"]))
    found = KMeans(count, n_init=1, max_iter=50, random_state=0).fit(given.position_m[0])
    for cycle in range(1, len(given.time_s)):
        with (watch if cycle >= given.first else Watch()).lap():
            found = KMeans(count, init=found.cluster_centers_, n_init=1, max_iter=1).fit(given.position_m[cycle])
    return watch.answer(
        (*PACKAGES, "scikit-learn"), unit="track", units=len(given.track_id), spot=found.labels_.astype(np.int64)
    )


TASKS: dict[str, Task] = {
    "association": association,
    "association_batched": association_batched,
    "imm": imm,
    "fusion": fusion,
    "spots": spots,
}

if __name__ == "__main__":
    answer_command(TASKS)
