"""AIS tracks on the echoes of large ships: compared at the middle, and counted less while far from it."""

from __future__ import annotations

import numpy as np
import pytest

from coastwatch.associations.antennas_on_echoes import OnEchoes, antennas_on_echoes
from coastwatch.batches import Measurements, SourceKind, Tracks
from coastwatch.geodesy import offset_deg

pytestmark = pytest.mark.contract

HOME = np.array([54.15, 12.1])
KINDS = np.array([SourceKind.RADAR, SourceKind.AIS])
AXIS_DEG = 30.0
AHEAD = np.array([np.sin(np.radians(AXIS_DEG)), np.cos(np.radians(AXIS_DEG))])
STARBOARD = np.array([AHEAD[1], -AHEAD[0]])


def tracks(off_m: list[np.ndarray], length_m: float = 300.0) -> Tracks:
    """A radar track of a ship of 300 by 46 m at home, and AIS tracks beside it."""
    n = 1 + len(off_m)
    place = offset_deg(HOME, np.array([np.zeros(2), *off_m]))
    none, radar = np.full(n - 1, np.nan), np.zeros(n, np.int64)
    radar[1:] = 1
    sized = [np.concatenate([[value], none]) for value in (length_m, 46.0, AXIS_DEG)]
    return Tracks(
        np.arange(n) + 7, radar, np.zeros(n), place, np.zeros((n, 2)), np.tile(9.0 * np.eye(4), (n, 1, 1)),
        np.tile(np.eye(2), (n, 1, 1)), np.zeros(n), np.zeros(n), np.where(radar, 219_000_000, -1), np.full(n, -1),
        echo_length_m=sized[0], echo_width_m=sized[1], echo_axis_deg=sized[2],
    )  # fmt: skip


def found(off_m: list[np.ndarray], length_m: float = 300.0) -> OnEchoes:
    return antennas_on_echoes(tracks(off_m, length_m), KINDS)


def test_an_antenna_anywhere_on_the_hull_is_compared_at_its_middle_and_nothing_else_moves() -> None:
    for ahead, starboard in ((-130.0, 0.0), (140.0, 15.0), (0.0, -20.0)):
        given = tracks([ahead * AHEAD + starboard * STARBOARD, 400.0 * AHEAD])
        on = antennas_on_echoes(given, KINDS)
        assert (on.ais.tolist(), on.echo.tolist()) == ([1], [0])
        assert on.off_m[0] == pytest.approx(ahead * AHEAD + starboard * STARBOARD, abs=0.01)
        moved = on.at_middles(given)
        assert np.array_equal(moved.position_deg, given.position_deg[[0, 0, 2]])
        assert np.array_equal(moved.covariance, given.covariance)


@pytest.mark.parametrize(
    ("off_m", "length_m"),
    [
        ([170.0 * AHEAD], 300.0),  # before the bow
        ([60.0 * STARBOARD], 300.0),  # alongside
        ([100.0 * STARBOARD], np.nan),  # the length is not known
        ([10.0 * AHEAD], 40.0),  # a small ship
        ([100.0 * AHEAD, -50.0 * AHEAD], 300.0),  # a tug at its side: which is which?
        ([], 300.0),
    ],
)
def test_beside_the_hull_and_where_two_are_on_it_all_stay(off_m: list[np.ndarray], length_m: float) -> None:
    assert len(found(off_m, length_m).ais) == 0


def test_far_from_the_middle_an_ais_track_and_its_reports_err_by_that_distance() -> None:
    for off, want in ((-130.0, 130.0), (20.0, 0.0)):
        given = tracks([400.0 * AHEAD, off * AHEAD])
        measured = Measurements(
            np.array([7, 8, 9, 9, 11]), np.array([0, -1, -1, -1, -1]), np.zeros(5), given.position_deg[[0, 1, 2, 2, 2]],
            np.zeros((5, 2)), np.tile(np.eye(4), (5, 1, 1)), np.full((5, 2), np.nan),
        )  # fmt: skip
        on = antennas_on_echoes(given, KINDS)
        assert on.ais.tolist() == [2]
        states, reports = on.inflated(given, measured)
        along = [float(AHEAD @ block[:2, :2] @ AHEAD) for block in (*states.covariance, *reports.covariance)]
        assert along == pytest.approx([9.0, 9.0, 9.0 + want**2, 1.0, 1.0, 1.0 + want**2, 1.0 + want**2, 1.0], rel=1e-3)
        across = [float(STARBOARD @ block[:2, :2] @ STARBOARD) for block in (*states.covariance, *reports.covariance)]
        assert across == pytest.approx([9.0] * 3 + [1.0] * 5, rel=1e-2)
        assert np.array_equal(given.covariance, tracks([400.0 * AHEAD, off * AHEAD]).covariance)
