"""The bound of bearing association: whose bearings are whose for one who knows where every vessel is."""

from __future__ import annotations

import bearing_world as bw
import numpy as np

from coastwatch.batches import BearingReports, Floats, Trajectories
from coastwatch.geodesy import from_plane
from scaling.decisions.bearing_bound import of_look

START = bw.START_S


def at_rest(bearing_deg: Floats) -> Trajectories:
    """Vessels at rest, 4 km from the sensor."""
    n, angle = len(bearing_deg), np.radians(bearing_deg)
    where = from_plane(4000.0 * np.column_stack([np.sin(angle), np.cos(angle)]), bw.ORIGIN_DEG)
    twice, none = np.repeat(where[:, None], 2, axis=1), np.zeros(n)
    still, kicks = np.zeros((n, 2, 2)), np.full((n, 0), np.nan)
    times = np.array([START, START + 3.0])
    return Trajectories(np.arange(n), times, twice, still, np.ones((n, 2), np.bool_), kicks, none, none, np.zeros((n, 2)))


def look(bearing_deg: Floats) -> BearingReports:
    n = len(bearing_deg)
    stamp, none, site = np.full(n, START + 1.0), np.full(n, -1), np.tile(bw.ORIGIN_DEG, (n, 1))
    return BearingReports(none * 0, stamp, stamp, bearing_deg, none, site, none, np.arange(n))


def test_apart_all_are_right_and_a_vessel_out_of_the_picture_is_none() -> None:
    sensors, true = bw.centre(), np.array([10.0, 100.0, 190.0])
    for found in of_look(look(true + 0.5), at_rest(true), np.array([0, 1]), sensors):
        assert (found.tp, found.fn, found.fp, found.tn) == (2, 0, 0, 1)


def test_bearings_in_the_other_order_are_a_swap() -> None:
    sensors, true = bw.centre(), np.array([10.0, 11.0])
    for found in of_look(look(np.array([11.0, 10.0])), at_rest(true), np.array([0, 1]), sensors):
        assert (found.tp, found.fn, found.fp, found.tn) == (0, 2, 2, 0)
