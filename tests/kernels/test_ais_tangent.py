"""The scalar tangent plane against geodesy.py, which numpy computes."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from coastwatch import geodesy
from coastwatch.kernels.geometry import tangent

PLACE_M = 1e-5  # rounding of Earth-centred coordinates (1e-9) grows by the cosecant of the slope near the poles
TURN = 1e-12


def test_the_ellipsoid_is_the_same():
    assert tangent.SEMI_MAJOR == geodesy.SEMI_MAJOR_M
    assert tangent.FLATTENING == geodesy.FLATTENING


@given(st.floats(-89.0, 89.0), st.floats(-180.0, 180.0), st.floats(-40e3, 40e3), st.floats(-40e3, 40e3))
def test_plane_and_back(lat, lon, east, north):
    anchor = np.array([lat, lon])
    there = tangent.from_tangent(east, north, lat, lon)
    expected = geodesy.from_plane(np.array([east, north]), anchor)
    assert np.hypot(*geodesy.difference_m(np.array(there), expected)) < PLACE_M
    back = tangent.to_tangent(*there, lat, lon)
    assert np.hypot(back[0] - east, back[1] - north) < PLACE_M
    assert np.abs(np.array(back[:2]) - geodesy.to_plane(np.array(there), anchor)).max() < PLACE_M


@given(st.floats(-89.0, 89.0), st.floats(-180.0, 180.0), st.floats(-0.3, 0.3), st.floats(-0.3, 0.3))
def test_turn(lat, lon, dlat, dlon):
    expected = geodesy.turn(np.array([lat + dlat, lon + dlon]), np.array([lat, lon]))
    got = np.reshape(tangent.turn_to(lat + dlat, lon + dlon, lat, lon), (2, 2))
    assert np.abs(got - expected).max() < TURN


def test_up_tells_the_far_half_of_the_earth():
    assert tangent.to_tangent(-50.0, 170.0, 50.0, -10.0)[2] < -1.9 * geodesy.SEMI_MAJOR_M
    assert tangent.to_tangent(50.0, 55.0, 50.8, -1.1)[2] > -0.5 * geodesy.SEMI_MAJOR_M
