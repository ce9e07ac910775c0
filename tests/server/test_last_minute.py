"""Counts of the last minute."""

from __future__ import annotations

import pytest

from coastwatch.server.link import WITHIN_S, LastMinute

pytestmark = pytest.mark.contract


def test_it_is_how_much_each_count_grew_in_a_minute() -> None:
    made = LastMinute()
    assert made.change()["late"] == 0
    for second in range(200):
        made.note(float(second), late=second, used=10 * second)
    assert made.change() == {"late": WITHIN_S, "used": 10 * WITHIN_S}
    assert made.change(newest=3)["late"] == 2


def test_the_fewest_notes_are_kept_however_old_they_are() -> None:
    made = LastMinute(fewest=4)
    for number in range(9):
        made.note(1000.0 * number, late=number)
    assert made.change()["late"] == 3


def test_it_begins_anew_where_a_count_falls() -> None:
    made = LastMinute()
    made.note(0.0, spokes=500, lost=7)
    made.note(1.0, spokes=20, lost=7)
    assert not made.change()
    made.note(2.0, spokes=50, lost=8)
    assert made.change() == {"spokes": 30, "lost": 1}
