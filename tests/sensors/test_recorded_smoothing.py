"""The smoother against the exact solution: all fixes and all steps in one set of normal equations."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from coastwatch.sensors.recorded.datasets.smoothing import START_ACCELERATION, between, smooth

pytestmark = pytest.mark.oracle

Floats = NDArray[np.float64]
EXACT = 1e-6  # m, m/s, m/s2: two solutions of equations whose condition is about 1e8


def step(t: float, jerk: float) -> tuple[Floats, Floats]:
    move = np.array([[1.0, t, t * t / 2], [0.0, 1.0, t], [0.0, 0.0, 1.0]])
    added = jerk * np.array([[t**5 / 20, t**4 / 8, t**3 / 6], [t**4 / 8, t**3 / 3, t**2 / 2], [t**3 / 6, t**2 / 2, t]])
    return np.kron(move, np.eye(2)), np.kron(added, np.eye(2))


def exact(time: Floats, seen: Floats, noise: Floats, jerk: float) -> Floats:
    """The maximum of the posterior over all states at once."""
    n = len(time)
    left, right = np.zeros((6 * n, 6 * n)), np.zeros(6 * n)
    see = np.eye(4, 6)
    first = np.zeros((6, 6))
    first[:4, :4] = 100.0 * noise[0]
    first[4:, 4:] = START_ACCELERATION**2 * np.eye(2)
    left[:6, :6] += np.linalg.inv(first)
    right[:6] += np.linalg.inv(first) @ np.concatenate([seen[0], [0.0, 0.0]])
    for k in range(n):
        here = slice(6 * k, 6 * k + 6)
        left[here, here] += see.T @ np.linalg.inv(noise[k]) @ see
        right[here] += see.T @ np.linalg.inv(noise[k]) @ seen[k]
        if k:
            before = slice(6 * k - 6, 6 * k)
            move, added = step(time[k] - time[k - 1], jerk)
            weight = np.linalg.inv(added)
            left[here, here] += weight
            left[before, before] += move.T @ weight @ move
            left[here, before] -= weight @ move
            left[before, here] -= move.T @ weight
    return np.linalg.solve(left, right).reshape(n, 6)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_paths_of_any_length_are_smoothed_exactly(seed: int) -> None:
    rng = np.random.default_rng([seed, 1])
    length = np.array([1, 7, 2, 12])
    start = np.concatenate([[0], np.cumsum(length)[:-1]])
    m = int(length.sum())
    time = np.cumsum(rng.uniform(2.0, 20.0, m))
    seen = rng.normal(0.0, 30.0, (m, 4))
    shape = rng.normal(0.0, 1.0, (m, 4, 4))
    noise = shape @ shape.swapaxes(1, 2) + np.eye(4)
    got = smooth(start, length, time, seen, noise, 1e-2)
    for s, n in zip(start, length, strict=True):
        rows = slice(s, s + n)
        np.testing.assert_allclose(got[rows], exact(time[rows], seen[rows], noise[rows], 1e-2), rtol=EXACT, atol=EXACT)


def test_no_path_gives_no_state() -> None:
    none = np.zeros(0, np.int64)
    assert smooth(none, none, np.zeros(0), np.zeros((0, 4)), np.zeros((0, 4, 4)), 1.0).shape == (0, 6)


def test_between_follows_a_cubic_and_never_bridges_parts() -> None:
    time, part = np.array([0.0, 10.0, 20.0, 100.0, 110.0]), np.array([1, 1, 1, 2, 2])

    def path(t: Floats) -> tuple[Floats, Floats]:
        return np.stack([t + 0.02 * t**3, 5.0 - t**2], -1), np.stack([1.0 + 0.06 * t**2, -2.0 * t], -1)

    state = np.concatenate([*path(time), np.zeros((5, 2))], axis=1)
    at = np.array([-1.0, 0.0, 3.0, 10.0, 17.5, 20.0, 50.0, 100.0, 104.0, 110.0, 111.0])
    position, velocity, inside = between(time, state, part, at)
    assert inside.tolist() == [False, True, True, True, True, True, False, True, True, True, False]
    np.testing.assert_allclose(position[inside], path(at[inside])[0], rtol=1e-12, atol=1e-9)
    np.testing.assert_allclose(velocity[inside], path(at[inside])[1], rtol=1e-12, atol=1e-9)
    assert np.isnan(position[~inside]).all()
