"""Rows of vessels without tracks: gathered by slot, and which of them may be near a new vessel."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest

from coastwatch.batches import Picture
from coastwatch.geodesy import earth_centred, offset_deg
from coastwatch.kernels.identity.picture_columns import may_meet
from coastwatch.picture.known import Known, unwritten

NEAR_M, NOW_S = 2000.0, 100.0


def picture(seed: int, rows: int) -> Picture:
    rng = np.random.default_rng([seed, 8])
    out = unwritten(rng.permutation(1000)[:rows])
    for field in fields(Picture):
        column = getattr(out, field.name)
        column[...] = (1000.0 * rng.uniform(size=column.shape)).astype(column.dtype)
    return out


def test_rows_of_slots_are_those_of_the_shown_and_the_hidden() -> None:
    shown, hidden = picture(1, 20), picture(2, 9)
    slots = np.array([0, 28, 19, 20, 5, 5], np.int32)
    every = Picture.join([shown, hidden])
    taken = Known(shown, hidden, np.zeros(0, np.int64)).take(slots)
    for field in fields(Picture):
        np.testing.assert_array_equal(getattr(taken, field.name), getattr(every, field.name)[slots])


@pytest.mark.parametrize("middle_deg", [(-22.9, -43.1), (60.0, 180.0), (89.99, 10.0), (-90.0, 0.0)])
def test_none_that_may_meet_is_left_out_and_few_others_are_kept(middle_deg: tuple[float, float]) -> None:
    rng = np.random.default_rng(3)
    old, new = (np.array(middle_deg) + rng.uniform(-0.5, 0.5, (n, 2)) for n in (3000, 40))
    for place in (old, new):
        place[:, 0] = np.clip(place[:, 0], -90.0, 90.0)
        place[:, 1] = (place[:, 1] + 180.0) % 360.0 - 180.0
    velocity, time = rng.normal(0.0, 10.0, (3000, 2)), NOW_S - rng.uniform(0.0, 120.0, 3000)
    velocity[:, 0] = np.where(np.abs(old[:, 0]) > 89.0, 0.0, velocity[:, 0])
    moved = offset_deg(old, (NOW_S - time)[:, None] * velocity)
    apart = np.linalg.norm(earth_centred(moved)[:, None] - earth_centred(new), axis=2).min(axis=1)
    out = np.empty(3000, np.bool_)
    may_meet(0, 3000, old, velocity, time, NOW_S, NEAR_M, new, np.argsort(new[:, 0]), out)
    assert out[apart <= NEAR_M].all()
    assert (apart <= NEAR_M).sum() > 10
    far = apart > 4.0 * NEAR_M + np.linalg.norm(velocity, axis=1) * 120.0 * 4.0
    assert abs(middle_deg[0]) > 80.0 or (far.any() and not out[far].any())
