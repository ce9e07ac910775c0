"""Normalised estimation error squared (NEES): whether covariances agree with the errors."""

from __future__ import annotations

import numpy as np

from coastwatch.batches import Floats


def nees(error: Floats, covariance: Floats) -> Floats:
    """Normalised estimation error squared: in units of its covariance, mean d for a consistent estimator.

    Args: error: (N, d); covariance: (N, d, d), positive definite. Returns: (N,), NaN where either is NaN, or the
    covariance is singular: a method of a paper takes it from the scatter of two tracks, which may lie on a line.
    Source: Y. Bar-Shalom, X. R. Li, T. Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001, eq. 5.4.2-1.
    """
    usable = np.flatnonzero(np.isfinite(error).all(axis=1) & np.isfinite(covariance).all(axis=(1, 2)))
    usable = usable[np.linalg.det(covariance[usable]) != 0.0]
    nees_of_row = np.full(len(error), np.nan)
    solved = np.linalg.solve(covariance[usable], error[usable][..., None])[..., 0]
    nees_of_row[usable] = (error[usable] * solved).sum(axis=1)
    return nees_of_row
