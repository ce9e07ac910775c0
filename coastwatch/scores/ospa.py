"""Optimal sub-pattern assignment: one distance between a set of estimates and a set of true positions."""

from __future__ import annotations

from typing import NamedTuple

from coastwatch.scores.gospa import Gospa


class Ospa(NamedTuple):
    """The distance and its parts: total**p = localisation**p + cardinality**p."""

    total_m: float
    localisation_m: float
    cardinality_m: float


def ospa(assigned: Gospa, cutoff_m: float, order: float) -> Ospa:
    """The OSPA distance of two sets whose GOSPA is known; of two empty sets 0, of an empty and another set the cutoff.

    A pair inside the cutoff c saves c**p - d**p in OSPA as in GOSPA with alpha = 2, so both have the same best pairs.

    Args: assigned: the GOSPA of the sets with this cutoff_m, c, and order, p >= 1.
    Source: D. Schuhmacher, B.-T. Vo, B.-N. Vo, A Consistent Metric for Performance Evaluation of Multi-Object Filters, 2008, eq. 3.
    """
    fewer, more = sorted((assigned.missed_count, assigned.false_count))  # unassigned points of the smaller and the larger set
    most = assigned.assigned_count + more
    if most == 0:
        return Ospa(0.0, 0.0, 0.0)
    near = (assigned.localisation + fewer * cutoff_m**order) / most
    missing = (more - fewer) * cutoff_m**order / most
    return Ospa((near + missing) ** (1.0 / order), near ** (1.0 / order), missing ** (1.0 / order))
