"""Places in range of sites, by cells, against every site asked for every place."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from coastwatch.geodesy import offset_deg, within_any
from coastwatch.picture.cover import cover, covered


def places(site, reach, rng, count):
    """Places about the sites: near their limits, a little within or beyond, or anywhere in twice the range."""
    k = rng.integers(0, len(site), count)
    away = reach[k] * np.where(rng.random(count) < 0.5, rng.normal(1.0, 0.01, count), rng.uniform(0.0, 2.0, count))
    angle = rng.uniform(0.0, 2.0 * np.pi, count)
    at = offset_deg(site[k], np.column_stack([np.cos(angle), np.sin(angle)]) * away[:, None])
    return np.column_stack([np.clip(at[:, 0], -89.99, 89.99), at[:, 1]])


@given(st.integers(1, 12), st.integers(0, 10**6), st.sampled_from([300.0, 8e3, 60e3, 400e3]))
def test_cells_say_what_every_site_says(sites, seed, reach_m):
    rng = np.random.default_rng([seed, 51])
    site = np.column_stack([rng.uniform(-86.0, 86.0, sites), rng.uniform(-180.0, 180.0, sites)])
    site[1::3] = offset_deg(site[:1], rng.normal(0.0, reach_m, (len(site[1::3]), 2)))
    site[::4, 1] = 179.999
    reach = reach_m * rng.uniform(0.3, 1.5, sites)
    at = places(site, reach, rng, 400)
    np.testing.assert_array_equal(covered(cover(site, reach), at), within_any(at, site, reach))


@pytest.mark.parametrize("pole", [-90.0, 90.0])
def test_a_site_at_a_pole_is_asked_whatever_the_longitude(pole):
    site, reach = np.array([[pole, 0.0]]), np.array([50e3])
    at = np.array([[pole * k, lon] for k in (0.9945, 0.9952, 1.0) for lon in (-180.0, -91.0, 0.0, 77.0, 180.0)])
    found = covered(cover(site, reach), at)
    np.testing.assert_array_equal(found, within_any(at, site, reach))
    assert found.any()
    assert not found.all()


def test_no_site_and_no_place():
    nowhere = cover(np.zeros((0, 2)), np.zeros(0))
    assert covered(nowhere, np.array([[0.0, 0.0], [90.0, 180.0], [-90.0, -180.0]])).tolist() == [False] * 3
    assert len(covered(nowhere, np.zeros((0, 2)))) == 0


def test_the_other_side_of_the_earth_is_out_of_range():
    """There the tangent plane at the site is as near as at the site itself."""
    assert covered(cover(np.array([[0.0, 0.0]]), np.array([50e3])), np.array([[0.0, 180.0], [0.1, 0.1]])).tolist() == [
        False,
        True,
    ]


FRUGAL = """
import resource
import numpy as np
from coastwatch.picture.cover import cover
from coastwatch.workers.freed import keep_freed_memory

def resident_bytes():
    return int(open("/proc/self/statm").read().split()[1]) * resource.getpagesize()

assert keep_freed_memory()
cover(np.array([[-23.0, -43.0]]), np.array([60e3]))
left = [np.ones(1 << 22) for _ in range(2)]
del left
before = resident_bytes()
kept = [cover(np.array([[lat, 10.0]]), np.array([60e3])) for lat in range(40, 47)]
print(sum(c[1].nbytes for c in kept) >> 20, (resident_bytes() - before) >> 20)
"""


@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="memory of a process is read from Linux's /proc")
def test_cells_far_from_any_site_take_no_memory() -> None:
    """Seven sets of cells of 25 MiB."""
    done = subprocess.run([sys.executable, "-c", FRUGAL], capture_output=True, text=True, check=True)
    made, taken = map(int, done.stdout.split())
    assert made > 170
    assert taken < 10
