"""One point of the ellipsoid at a time, against coastwatch.geodesy, which numpy computes."""

import numpy as np
import pytest
from hypothesis import given, strategies as st

from coastwatch import geodesy
from coastwatch.kernels.geometry import ellipsoid

pytestmark = pytest.mark.oracle

POSITION_M = 1e-5  # rounding of Earth-centred coordinates (1e-9) grows by the cosecant of the slope near the poles
ROUNDING_M = 1e-8
TURN = 1e-9  # a radian of longitude at 89 degrees is 110 km: POSITION_M is 1e-10 of it
OFFSET_M = 1e-6  # what two rounds of the inverse leave at 100 km
LATITUDE, LONGITUDE, NEAR = st.floats(-89.0, 89.0), st.floats(-180.0, 180.0), st.floats(-40e3, 40e3)


def test_earth_centred_points_of_many_rows():
    rng = np.random.default_rng([7, 0])
    position = np.column_stack([rng.uniform(-90.0, 90.0, 1000), rng.uniform(-540.0, 540.0, 1000)])
    edges = [(0, 180), (90, -180), (-90, 0), (45, 135), (45, -135), (-45, 90), (0, -90), (-0.0, 45), (1e-300, 360)]
    position[: len(edges)] = edges
    rows = rng.permutation(1000)
    expected = geodesy.earth_centred(position[rows])
    np.testing.assert_allclose(ellipsoid.ecef_of_rows(position, rows), expected, rtol=0.0, atol=ROUNDING_M)
    assert ellipsoid.ecef_of_rows(position, np.zeros(0, np.int64)).shape == (0, 3)


@given(LATITUDE, LONGITUDE, NEAR, NEAR)
def test_plane_and_back(lat, lon, east, north):
    anchor = np.array([lat, lon])
    *there, turn = ellipsoid.from_plane(east, north, ellipsoid.ecef_and_axes(lat, lon))
    expected = geodesy.from_plane(np.array([east, north]), anchor)
    assert np.hypot(*geodesy.difference_m(np.array(there), expected)) < POSITION_M
    back = ellipsoid.to_enu(*there, lat, lon)
    assert np.hypot(back[0] - east, back[1] - north) < POSITION_M
    assert np.abs(np.array(back[:2]) - geodesy.to_plane(np.array(there), anchor)).max() < POSITION_M
    assert np.abs(np.reshape(turn, (2, 2)) - geodesy.turn(anchor, np.array(there))).max() < TURN


@pytest.mark.parametrize("pole", [90.0, -90.0])
def test_a_point_at_a_pole_has_a_longitude(pole):
    """The axis of the Earth is hit exactly: no longitude can be divided out."""
    frame = (0.0, 0.0, *ellipsoid.ecef_and_axes(pole, 0.0)[2:4], 0.0, 0.0, 1.0)
    lat, lon, turn = ellipsoid.from_plane(0.0, 0.0, frame)
    assert (lat, lon) == (pole, 0.0)
    np.testing.assert_allclose(np.reshape(turn, (2, 2)), np.eye(2), rtol=0.0, atol=1e-15)


@given(st.floats(-85.0, 85.0), LONGITUDE, st.floats(-70e3, 70e3), st.floats(-70e3, 70e3))
def test_offset_by_mid_latitude_and_back(lat, lon, east, north):
    start = np.array([lat, lon])
    there = ellipsoid.add_enu_offset(lat, lon, east, north)
    expected = geodesy.offset_deg(start, np.array([east, north]))
    assert np.hypot(*geodesy.difference_m(np.array(there), expected)) < OFFSET_M
    assert -180.0 < there[1] <= 180.0
    back = ellipsoid.enu_offset(*there, lat, lon)
    np.testing.assert_allclose(back, geodesy.difference_m(np.array(there), start), rtol=0.0, atol=ROUNDING_M)
    np.testing.assert_allclose(back, (east, north), rtol=0.0, atol=OFFSET_M)


@given(st.floats(-90.0, 90.0))
def test_metres_per_degree(lat):
    metres = ellipsoid.metres_per_degree(lat)
    assert metres == pytest.approx(geodesy.scale_m_deg(np.float64(lat)), rel=1e-14, abs=ROUNDING_M)
    assert metres[0] > ellipsoid.SHORTEST_DEGREE


@given(LATITUDE, LONGITUDE, st.floats(-0.3, 0.3), st.floats(-0.3, 0.3))
def test_rotation_between_planes(lat, lon, dlat, dlon):
    expected = geodesy.turn(np.array([lat + dlat, lon + dlon]), np.array([lat, lon]))
    got = np.reshape(ellipsoid.enu_rotation(lat + dlat, lon + dlon, lat, lon), (2, 2))
    assert np.abs(got - expected).max() < 1e-12


def test_up_tells_the_far_half_of_the_earth():
    assert ellipsoid.to_enu(-50.0, 170.0, 50.0, -10.0)[2] < -1.9 * geodesy.SEMI_MAJOR_M
    assert ellipsoid.to_enu(50.0, 55.0, 50.8, -1.1)[2] > -0.5 * geodesy.SEMI_MAJOR_M
