"""Scores of whole paths beside the paths of a few targets: track loss, tracking percentage, deviation, initiation, false tracks.

A path is a row of positions over common instants, NaN where there is none.

Source: E. Liland, AIS aided multi hypothesis tracker, master thesis, NTNU, 2017, sections 5.4 and 5.5.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from coastwatch.batches import Bools, Floats, Ints

BEGUN = 0.8  # share of the targets of which the time until they have tracks is given


class Kept(NamedTuple):
    """The target of each track, and how much of its path is of it."""

    target: Ints  # (N,) -1: none, a false track
    instants: Ints  # (N,) from the first one that the track shares with its target
    rmsd_m: Floats  # (N,) over these instants, (5.5); NaN for a false track


def kept_instants(error_m: Floats, limit_m: float, for_good: float) -> int:
    """For how many instants, from the first, a path is of its target: until it leaves for good.

    A path leaves where its error exceeds the limit, and comes back where it is within it twice, or at the last instant. If it is off by
    `for_good` times the limit before it is back at the end, it left for good.

    Args: error_m: (L,) at successive instants.
    """
    for at in np.flatnonzero(error_m > limit_m):
        later = error_m[at + 1 :]
        back = np.flatnonzero(later <= limit_m)
        at_last = len(back) == 1 and back[0] == len(later) - 1
        if not (len(back) > 1 or at_last) or (error_m[at:] > for_good * limit_m).any():
            return int(at)
    return len(error_m)


def kept(path_m: Floats, true_m: Floats, limit_m: float, for_good: float) -> Kept:
    """The target of each track: of those that its path is of, the one from which it deviates least. Args: (N, T, 2), (V, T, 2)."""
    error_m = distances(path_m, true_m)
    target, instants, rmsd_m = np.full(len(path_m), -1), np.zeros(len(path_m), np.int64), np.full(len(path_m), np.nan)
    for n, v in zip(*np.nonzero((error_m <= limit_m).any(axis=2)), strict=True):
        common = error_m[n, v][np.isfinite(error_m[n, v])]
        count = kept_instants(common, limit_m, for_good)
        off_m = float(np.sqrt(np.mean(common[:count] ** 2))) if count else np.inf
        if off_m < np.nan_to_num(rmsd_m[n], nan=np.inf):
            target[n], instants[n], rmsd_m[n] = v, count, off_m
    return Kept(target, instants, rmsd_m)


def distances(path_m: Floats, true_m: Floats) -> Floats:
    """The distance of each path to each target at each instant, NaN where one of them is absent. (N, V, T)"""
    apart: Floats = np.hypot(*np.moveaxis(path_m[:, None] - true_m[None], 3, 0))
    return apart


def path_scores(path_m: Floats, true_m: Floats, limit_m: float, for_good: float) -> dict[str, float | None]:
    """The figures of paths (N, T, 2) beside those of targets (V, T, 2); none where nothing was counted.

    loss: share of the targets there at the first instant whose track of that instant is not of them to their end; one without a track
    counts as lost. tracking: mean over targets of the share of their time that tracks are of them. rmsd_m: mean over the tracks of targets.
    false_tracks: tracks of no target.
    """
    found, life = kept(path_m, true_m, limit_m, for_good), np.isfinite(true_m[..., 0]).sum(axis=1)
    covered = np.bincount(found.target[found.target >= 0], found.instants[found.target >= 0], len(true_m))
    there, of_target = life > 0, np.isfinite(found.rmsd_m)
    lost = lost_from_start(path_m, true_m, limit_m, for_good)
    return {
        "loss": float(lost.mean()) if len(lost) else None,
        "tracking": float((covered[there] / life[there]).mean()) if there.any() else None,
        "rmsd_m": float(found.rmsd_m[of_target].mean()) if of_target.any() else None,
        "false_tracks": int((found.target < 0).sum()),
    }


def lost_from_start(path_m: Floats, true_m: Floats, limit_m: float, for_good: float) -> Bools:
    """Whether each target that is there at the first instant loses the track that it has then: the nearest within the limit. (V0,)"""
    error_m = distances(path_m, true_m)
    out = []
    for v in np.flatnonzero(np.isfinite(true_m[:, 0, 0])):
        first = np.nan_to_num(error_m[:, v, 0], nan=np.inf)
        n = int(first.argmin()) if len(first) else -1
        life = np.flatnonzero(np.isfinite(true_m[v, :, 0]))
        if n < 0 or first[n] > limit_m:
            out.append(True)
            continue
        own = error_m[n, v, life]
        whole = bool(np.isfinite(own).all())
        out.append(not whole or kept_instants(own, limit_m, for_good) < len(life))
    return np.array(out, np.bool_)


def initiation_scores(path_m: Floats, true_m: Floats, limit_m: float, period_s: float) -> dict[str, float | None]:
    """The figures of the beginnings of tracks, as they were shown at the time; none without an instant.

    begun: share of the targets that a track began at, within the limit, at some time. t80_s: from the first instant until this share
    was 0.8, or the length of the run. false_begun: tracks that began at no target. false_alive: of them, mean over instants;
    false_alive_end: at the last one. cost_s: t80_s (1 + false_alive), (5.2).

    Args: path_m: (N, T, 2); true_m: (V, T, 2); period_s: between instants.
    """
    instants = true_m.shape[1]
    if not instants or not len(true_m):
        return dict.fromkeys(("begun", "t80_s", "false_begun", "false_alive", "false_alive_end", "cost_s"))
    there = np.isfinite(path_m[..., 0])
    path_m, there = path_m[there.any(axis=1)], there[there.any(axis=1)]
    first = there.argmax(axis=1)
    begins_m = np.hypot(*(path_m[np.arange(len(path_m)), first][:, None] - true_m[:, first].swapaxes(0, 1)).transpose(2, 0, 1))
    at_target = np.nan_to_num(begins_m, nan=np.inf) <= limit_m  # (N, V)
    begun = np.zeros((len(true_m), instants), np.bool_)
    for n, v in zip(*np.nonzero(at_target), strict=True):
        begun[v, first[n] :] = True
    share = begun.mean(axis=0)
    reached = np.flatnonzero(share >= BEGUN - 1e-9)
    t80_s = period_s * (float(reached[0]) if len(reached) else instants - 1.0)
    alive = there[~at_target.any(axis=1)].sum(axis=0)
    return {
        "begun": float(share[-1]),
        "t80_s": t80_s,
        "false_begun": int((~at_target.any(axis=1)).sum()),
        "false_alive": float(alive.mean()),
        "false_alive_end": int(alive[-1]),
        "cost_s": t80_s * (1.0 + float(alive.mean())),
    }


def shadow_scores(path_m: Floats, true_m: Floats, hidden: Bools, near_m: float, after: int) -> dict[str, float | int | None]:
    """The figures of tracks of targets that pass through a shadow; none where nothing was counted.

    held: share of the hidden instants of targets with a track within a distance. same_id: of the passages with a track at the instant
    before, the share of those that have the same track some instants after. passages: counted in `same_id`.

    Args: path_m: (N, T, 2); true_m: (V, T, 2); hidden: (V, T); after: instants after the last hidden one.
    """
    error_m = np.nan_to_num(distances(path_m, true_m), nan=np.inf)
    track = error_m.argmin(axis=0) if len(path_m) else np.full(hidden.shape, -1)
    track = np.where(error_m.min(axis=0, initial=np.inf) <= near_m, track, -1)  # (V, T)
    same = []
    for v in np.flatnonzero(hidden.any(axis=1)):
        edges = np.diff(np.concatenate([[0], hidden[v].astype(np.int64), [0]]))
        for begins, ends in zip(np.flatnonzero(edges == 1), np.flatnonzero(edges == -1), strict=True):
            then = ends - 1 + after
            if begins > 0 and then < hidden.shape[1] and track[v, begins - 1] >= 0 and np.isfinite(true_m[v, then, 0]):
                same.append(track[v, then] == track[v, begins - 1])
    return {
        "held": float((track[hidden] >= 0).mean()) if hidden.any() else None,
        "same_id": float(np.mean(same)) if same else None,
        "passages": len(same),
    }
