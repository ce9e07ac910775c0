"""Sorted tables are merged and compared as Python's sets are."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from coastwatch.kernels.tables.sorted_rows import differences, is_sorted, merge

tables = st.sets(st.tuples(*[st.integers(-2, 4)] * 3), max_size=30)


def table(rows: set[tuple[int, ...]]) -> np.ndarray:
    return np.array(sorted(rows), np.int64).reshape(-1, 3)


@given(tables, tables)
def test_differences_are_those_of_sets(before: set[tuple[int, ...]], now: set[tuple[int, ...]]) -> None:
    gone, come = np.zeros(len(before), np.bool_), np.zeros(len(now), np.bool_)
    differences(table(before), table(now), gone, come)
    assert set(map(tuple, table(before)[gone].tolist())) == before - now
    assert set(map(tuple, table(now)[come].tolist())) == now - before


@given(tables, tables)
def test_merged_rows_are_sorted(one: set[tuple[int, ...]], two: set[tuple[int, ...]]) -> None:
    out = np.empty((len(one) + len(two), 3), np.int64)
    merge(table(one), table(two), out)
    assert out.tolist() == [list(row) for row in sorted([*one, *two])]
    assert is_sorted(out) == (not one & two)


@given(st.lists(st.tuples(st.integers(0, 2), st.integers(0, 2)), max_size=8))
def test_what_is_sorted(rows: list[tuple[int, int]]) -> None:
    assert is_sorted(np.array(rows, np.int64).reshape(-1, 2)) == (sorted(set(rows)) == rows)
