"""Gaussians: the combined estimates of filters, distances and gates. Vectorised numpy."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from coastwatch.kernels.arrays import Floats


class Estimates(NamedTuple):
    """The combined estimate of each filter: the moments over its models, at the time of its newest plot.

    Source: Y. Bar-Shalom, X. R. Li, T. Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001, section 11.6.6, step 5.
    """

    time: Floats  # (S,) of the newest plot
    mean: Floats  # (S, 4) east, north, east rate, north rate
    covariance: Floats  # (S, 4, 4)
    noise: Floats  # (S,) density of white acceleration, averaged over the models by their probabilities, m2/s3


def squared_distance(difference: Floats, covariance: Floats) -> Floats:
    """Squared Mahalanobis distances.

    Args: difference: (A, d); covariance: (A, d, d), symmetric, positive definite. Returns: (A,).
    """
    solved = np.linalg.solve(covariance, difference[..., None])[..., 0]
    square: Floats = (difference * solved).sum(axis=-1)
    return square


def gate(probability: float, dimensions: int) -> float:
    """The squared distance that a Gaussian in so many dimensions stays within, with this probability (chi-square quantile)."""
    from scipy.special import chdtri  # here: its import takes half a second, and only radar tracks need it

    return float(chdtri(dimensions, 1.0 - probability))
