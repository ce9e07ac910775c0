"""Which id the AIS messages of a vessel carry: likelihood of an id in a message, and the update by messages. Compiled by numba.

A message carries the id of its vessel with probability `correct`, else any other of the `IDS` that there are, all equally likely.
Source: A. G. Hem, E. F. Brekke, Variations of joint integrated data association with radar and target-provided measurements, Journal of
Advances in Information Fusion 17(2), 2022, equations (9) and (63) to (66); in (9) a wrong id has one of |V| - 2 values, not |V| - 1.
"""

from __future__ import annotations

import numpy as np

from coastwatch.kernels.jit import jit
from coastwatch.kernels.tables.copies import copy_into
from coastwatch.kernels.tracks.columns import NAMES

IDS = 1e9  # |V|: MMSI have nine digits
OTHER = NAMES + 1  # column of the probability of any other id
LEAST = 1e-12  # of "any other id", so that a track that was given another vessel's id recovers


@jit
def _known(name, mmsi):  # type: ignore[no-untyped-def]
    """Where an id is among the names of a track, -1: nowhere."""
    for k in range(NAMES):
        if name[k] == mmsi:
            return k
    return -1


@jit
def _likelihood(probability, column, correct):  # type: ignore[no-untyped-def]
    """Probability that a message of the vessel carries an id, and of the id before the message.

    Args: probability: (NAMES + 2,); column: of the id, OTHER where it is not among the names.
    """
    had = probability[column] / IDS if column == OTHER else probability[column]
    others = max(1.0 - probability[0] - had, 0.0)
    return had * correct + others * (1.0 - correct) / (IDS - 2.0), had


@jit
def likelihoods(ids, slot, mmsi, correct):  # type: ignore[no-untyped-def]
    """The probability that a message of each track's vessel carries this id. (A,)

    Args: ids: VesselIds; slot: (A,) of the track; mmsi: (A,) in the message; correct: probability that a message carries the right id.
    """
    out = np.empty(len(slot))
    for a in range(len(slot)):
        k = _known(ids.name[slot[a]], mmsi[a])
        out[a], _ = _likelihood(ids.probability[slot[a]], OTHER if k < 0 else 1 + k, correct)
    return out


@jit
def _named(name, before, now, mmsi):  # type: ignore[no-untyped-def]
    """The place of an id among the names of a track. An id that is not there replaces the least probable one, which joins the others."""
    k = _known(name, mmsi)
    if k >= 0:
        return k, 1 + k
    k = 0
    for other in range(NAMES):
        if name[other] < 0:
            k = other
            break
        if now[1 + other] < now[1 + k]:
            k = other
    for one in (before, now):
        one[OTHER] += one[1 + k]
        one[1 + k] = 0.0
    name[k] = mmsi
    return k, OTHER


@jit
def update(ids, slot, start, mmsi, share, correct):  # type: ignore[no-untyped-def]
    """Update the ids of tracks by messages. In place.

    Args: ids: VesselIds; slot: (T,); start: (T + 1,) first message of each track; mmsi: (A,) in the messages; share: (A,) probability
    that the message is of the track, given that it exists; correct: as of `likelihoods`.
    """
    before, now = np.empty(NAMES + 2), np.empty(NAMES + 2)
    for t in range(len(slot)):
        name, probability = ids.name[slot[t]], ids.probability[slot[t]]
        copy_into(before, probability)
        missed = 1.0
        for a in range(start[t], start[t + 1]):
            missed -= share[a]
        now[:] = max(missed, 0.0) * before
        for a in range(start[t], start[t + 1]):
            k, column = _named(name, before, now, mmsi[a])
            found, had = _likelihood(before, column, correct)
            wrong = (1.0 - correct) / (IDS - 2.0)
            for other in range(1, NAMES + 2):
                if other != 1 + k:
                    now[other] += share[a] * before[other] * wrong / found
            now[1 + k] += share[a] * had * correct / found
        now[OTHER] = max(now[OTHER], LEAST)
        probability[:] = now / now.sum()
