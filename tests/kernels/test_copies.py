"""Copies inside kernels against those of numpy."""

from __future__ import annotations

import numpy as np
import pytest

from coastwatch.kernels.tables.copies import copy_into

pytestmark = pytest.mark.oracle


@pytest.mark.parametrize("shape", [(3,), (2, 3), (2, 3, 4), (0,), (0, 3)])
def test_the_beginning_of_each_axis_is_that_of_the_source_and_the_rest_stays(shape: tuple[int, ...]) -> None:
    rng = np.random.default_rng(1)
    source, target = rng.normal(size=shape), rng.normal(size=tuple(n + 2 for n in shape))
    wanted = target.copy()
    wanted[tuple(slice(n) for n in shape)] = source
    copy_into(target, source)
    assert target.tolist() == wanted.tolist()


def test_a_part_of_a_larger_array_and_whole_numbers_are_copied_too() -> None:
    source = np.arange(25).reshape(5, 5)
    target = np.zeros((2, 4))
    copy_into(target, source[1:3, 1:5])
    assert target.tolist() == [[6.0, 7.0, 8.0, 9.0], [11.0, 12.0, 13.0, 14.0]]
