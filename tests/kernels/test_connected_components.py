"""Rows joined by pairs, against sets."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, strategies as st

from coastwatch.kernels.association.connected_components import components, joined_without_sharing

pytestmark = pytest.mark.oracle

ROWS, SOURCES = 12, 4


def by_sets(first, second, source):
    """The component of each row, numbered by first row; which pairs stand if no component may have two rows of one source."""
    group = {row: {row} for row in range(ROWS)}
    stands = []
    for a, b in zip(first.tolist(), second.tolist(), strict=True):
        same = group[a] is group[b]
        stands.append(same or source is None or not {source[r] for r in group[a]} & {source[r] for r in group[b]})
        if stands[-1] and not same:
            group[a] |= group[b]
            for row in group[b]:
                group[row] = group[a]
    lowest = sorted({min(members) for members in group.values()})
    return [lowest.index(min(group[row])) for row in range(ROWS)], stands


@given(st.integers(0, 10**6), st.integers(0, 14))
def test_components_and_those_without_a_repeated_source(seed, count):
    rng = np.random.default_rng([seed, 6])
    first, second = rng.integers(0, ROWS, (2, count))
    source = rng.integers(0, SOURCES, ROWS)
    keep = source[first] != source[second]
    first, second = first[keep], second[keep]
    assert components(first, second, ROWS).tolist() == by_sets(first, second, None)[0]
    assert joined_without_sharing(first, second, source).tolist() == by_sets(first, second, source)[1]
