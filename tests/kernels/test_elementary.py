"""Branchless logarithm, exponential and angle against the library's."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from coastwatch.kernels.compiling import arithmetic

from coastwatch.kernels.vectorised_math import angle, exponential, logarithm

FEW, ANGLE = 2.0, 6.0  # units in the last place of the answer: an angle is eight times one of a series
COUNT = 200_000


@arithmetic
def _logarithms(x, out):  # type: ignore[no-untyped-def]
    for i in range(len(x)):
        out[i] = logarithm(x[i])


@arithmetic
def _exponentials(x, out):  # type: ignore[no-untyped-def]
    for i in range(len(x)):
        out[i] = exponential(x[i])


@arithmetic
def _angles(x, y, out):  # type: ignore[no-untyped-def]
    for i in range(len(x)):
        out[i] = angle(x[i], y[i])


def of(function: Callable[..., None], *x: np.ndarray) -> np.ndarray:
    out = np.empty(len(x[0]))
    function(*x, out)
    return out


def assert_close(got: np.ndarray, expected: np.ndarray, ulps: float = FEW) -> None:
    assert (np.abs(got - expected) <= ulps * np.spacing(np.abs(expected))).all()


def test_logarithm() -> None:
    rng = np.random.default_rng([1, 1])
    every = np.concatenate([np.exp(rng.uniform(-700.0, 700.0, COUNT)), 1.0 + rng.uniform(-0.5, 1.0, COUNT), [1.0, 2.0, 0.5]])
    assert_close(of(_logarithms, every), np.log(every))
    assert of(_logarithms, np.zeros(1)).tolist() == [-np.inf]


def test_exponential() -> None:
    rng = np.random.default_rng([1, 2])
    every = np.concatenate([rng.uniform(-707.0, 700.0, COUNT), rng.uniform(-1.0, 1.0, COUNT), [0.0]])
    assert_close(of(_exponentials, every), np.exp(every))
    assert of(_exponentials, np.array([-709.0, -1e300, -np.inf])).tolist() == [0.0, 0.0, 0.0]


def test_angle() -> None:
    rng = np.random.default_rng([1, 3])
    turn = np.concatenate([rng.uniform(-np.pi, np.pi, COUNT), rng.uniform(-1e-3, 1e-3, COUNT), np.arange(-4, 5) * np.pi / 4.0])
    length = np.exp(rng.uniform(-10.0, 12.0, len(turn)))
    sine, cosine = length * np.sin(turn), length * np.cos(turn)
    assert_close(of(_angles, sine, cosine), np.arctan2(sine, cosine), ANGLE)
    zero = np.array([0.0, 0.0, 1.0, -1.0]), np.array([0.0, -1.0, 0.0, 0.0])
    np.testing.assert_allclose(of(_angles, *zero), np.arctan2(*zero), rtol=1e-15)
    assert np.isnan(of(_angles, np.array([np.nan, np.nan, 1.0, 0.0]), np.array([1.0, np.nan, np.nan, np.nan]))).all()
