"""Association by counting, one pair at a time in plain Python, and the one-to-one choice by trying all."""

from itertools import product


def count(hits, begin, end, at_once=None):
    """Whether a pair is associated in each cycle. Args: hits: of each cycle, whether it passed; None while a track is away."""
    on, run, missed, out = False, 0, 0, []
    for cycle, hit in enumerate(hits):
        if hit is None:
            on, run, missed = False, 0, 0
        else:
            run, missed = (run + 1, 0) if hit else (0, missed + 1)
            on = missed < end if on else run >= begin
            on = on or bool(hit and at_once and at_once[cycle])
        out.append(on)
    return out


def one_to_one(distance):
    """The pairs of the assignment with the most pairs, then the least sum. Args: distance: {(first, second): metres}."""
    firsts = sorted({a for a, _ in distance})
    best = (0, 0.0, frozenset())
    for choice in product(*([None, *(b for a, b in distance if a == f)] for f in firsts)):
        taken = [(f, b) for f, b in zip(firsts, choice, strict=True) if b is not None]
        if len({b for _, b in taken}) == len(taken):
            best = min(best, (-len(taken), sum(distance[p] for p in taken), frozenset(taken)), key=lambda c: c[:2])
    return best[2]
