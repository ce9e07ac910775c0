"""Association by windowed covariance, a track, a pair and a component at a time: what the array code must give to the bit.

The slow way, without arrays. Sums are taken in the same order, with the same library functions.
"""

from collections import Counter
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree
from score_by_pairs import E2, A, score

LEAST_GAIN = 1e-3  # of an accepted pair
NUDGE = 1e-10  # of a score: far more than rounding, far less than what tells two assignments apart


@dataclass(frozen=True)
class Rules:
    """The settings, by the names that `WindowedCovariance` has for them."""

    window: int = 20
    gate_m: float = 1000.0
    prior: float = 10.0
    floor: float = 0.5
    cap: float = 2.0
    forgetting: float = 0.9
    rival_forgetting: float = 0.5
    registration: float = 0.5
    step_limit: float = 20.0
    misled_share: float = 0.01
    threshold: float = 0.0
    unrelated_speed_m_s: float = 4.0
    unknown_velocity_sigma_m_s: float = 0.5


@dataclass
class Found:
    first: list = field(default_factory=list)
    second: list = field(default_factory=list)
    statistic: list = field(default_factory=list)
    vessel: list = field(default_factory=list)
    tested: int = 0
    scores: dict = field(default_factory=dict)  # of every pair within the gate
    newest: dict = field(default_factory=dict)  # the same, that decide among accepted pairs
    unique: bool = (
        True  # no other assignment is as good: where scores are bounded many pairs have the same, and roundings decide
    )


def covariance_of(tracks, row, rules):
    if np.isfinite(tracks.covariance[row]).all():
        return tracks.covariance[row]
    out = np.zeros((4, 4))
    out[:2, :2] = tracks.report_covariance[row]
    out[2, 2] = out[3, 3] = rules.unknown_velocity_sigma_m_s**2
    return out


def step(windows, tracks, spots, rules):
    """Windows after this cycle (a dict of ids to lists of entries, newest last), and Found. `windows` stays as it was."""
    covariance = [covariance_of(tracks, row, rules) for row in range(len(tracks))]
    after, history = {}, []
    for row, track in enumerate(tracks.track_id.tolist()):
        c = covariance[row]
        rates = np.array([*tracks.velocity_m_s[row], c[0, 0] + c[1, 1], c[2, 2] + c[3, 3]]).astype(np.float32)
        entry = (*tracks.position_deg[row], *rates)
        after[track] = [*windows.get(track, []), tuple(float(x) for x in entry)][-rules.window :]
        history.append(after[track])
    registration = [
        rules.registration * tracks.report_covariance[row] if tracks.mmsi[row] < 0 else np.zeros((2, 2))
        for row in range(len(tracks))
    ]
    found = Found()
    for pairs in pairs_by_spot(tracks, spots, rules.gate_m):
        found.tested += len(pairs)
        around = Counter(a for a, _ in pairs)
        for a, b in pairs:
            density = max(around[a] - 1, 1) / (np.pi * rules.gate_m**2)
            phi, offset = covariance[a] + covariance[b], registration[a] + registration[b]
            found.scores[(a, b)] = score(history[a], history[b], phi, offset, density, rules)
            newer = replace(rules, forgetting=rules.rival_forgetting)
            found.newest[(a, b)] = score(history[a], history[b], phi, offset, density, newer)
    kept = sorted(pair for pair, value in found.scores.items() if value > rules.threshold)
    first, second = (np.array([pair[k] for pair in kept], np.int64) for k in range(2))
    value = np.array([found.scores[pair] for pair in kept])
    gain = np.array([found.newest[pair] for pair in kept]) + rules.step_limit + LEAST_GAIN
    sources = int(tracks.source.max(initial=0)) + 1
    labels = first * sources + tracks.source[second], second * sources + tracks.source[first]
    taken = assign(*labels, gain)
    for seed in range(2):
        nudged = gain + NUDGE * np.random.default_rng([seed, 5]).uniform(-1.0, 1.0, len(gain))
        found.unique &= bool((assign(*labels, nudged) == taken).all())
    found.vessel, stands = vessels(tracks, first[taken], second[taken], gain[taken])
    found.first, found.second, found.statistic = (x[taken][stands].tolist() for x in (first, second, value))
    return after, found


def earth_centred(position_deg):
    lat, lon = np.radians(position_deg[:, 0]), np.radians(position_deg[:, 1])
    n = A / np.sqrt(1.0 - E2 * np.sin(lat) ** 2)
    return np.stack([n * np.cos(lat) * np.cos(lon), n * np.cos(lat) * np.sin(lon), n * (1.0 - E2) * np.sin(lat)], axis=1)


def pairs_by_spot(tracks, spots, gate_m):
    """The pairs that each spot owns: those whose track of the lower source is its member, the other a member or in its halo."""
    points = earth_centred(tracks.position_deg)
    for k in range(len(spots.centre_m)):
        member = np.flatnonzero(spots.spot == k)
        every = np.concatenate([member, spots.halo_row[spots.halo_spot == k]])
        if len(member) == 0 or len(every) < 2:
            continue
        near = cKDTree(points[member]).sparse_distance_matrix(cKDTree(points[every]), gate_m, output_type="ndarray")
        pairs = zip(member[near["i"]].tolist(), every[near["j"]].tolist(), strict=True)
        yield sorted((a, b) for a, b in pairs if tracks.source[a] < tracks.source[b])


def assign(first, second, gain):
    """Which pairs to take so that their gains sum to the most, each label of either side in one pair at most. Returns: (A,)."""
    taken = np.zeros(len(first), np.bool_)
    useful = np.flatnonzero(gain > 0.0)
    if len(useful) == 0:
        return taken
    firsts, row = np.unique(first[useful], return_inverse=True)
    seconds, column = np.unique(second[useful], return_inverse=True)
    graph = coo_matrix((np.ones(len(useful)), (row, column + len(firsts))), shape=(len(firsts) + len(seconds),) * 2)
    label = connected_components(graph, directed=False)[1][row]
    for k in np.unique(label):
        mine = np.flatnonzero(label == k)
        (rows, i), (columns, j) = (np.unique(side[mine], return_inverse=True) for side in (row, column))
        gains = np.zeros((len(rows), len(columns)))
        gains[i, j] = gain[useful[mine]]
        chosen = np.zeros(gains.shape, np.bool_)
        chosen[linear_sum_assignment(gains, maximize=True)] = True
        taken[useful[mine]] = chosen[i, j]
    return taken


def vessels(tracks, first, second, gain):
    """The vessel of each track, numbered by first row, no vessel with two tracks of a source; and the indices of the pairs that stand."""
    group = {row: {row} for row in range(len(tracks))}
    joined = {row: {row} for row in range(len(tracks))}
    for a, b in zip(first.tolist(), second.tolist(), strict=True):
        if joined[a] is not joined[b]:
            joined[a] |= joined[b]
            for row in joined[b]:
                joined[row] = joined[a]
    stands = []
    order = sorted(range(len(first)), key=lambda p: (-gain[p], tracks.track_id[first[p]], tracks.track_id[second[p]]))
    for p in order:
        a, b = int(first[p]), int(second[p])
        every = [tracks.source[row] for row in joined[a]]
        if len(set(every)) < len(every) and group[a] is not group[b]:
            held = [{tracks.source[row] for row in group[side]} for side in (a, b)]
            if held[0] & held[1]:
                continue
        stands.append(p)
        if group[a] is not group[b]:
            group[a] |= group[b]
            for row in group[b]:
                group[row] = group[a]
    number = {id(members): k for k, members in enumerate({id(m): m for m in (group[r] for r in range(len(tracks)))}.values())}
    return [number[id(group[row])] for row in range(len(tracks))], np.array(sorted(stands), np.int64)
