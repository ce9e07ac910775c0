"""Distances and gates of Gaussians. Vectorised numpy."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


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
