"""Likelihoods of what a sensor says of the class of a vessel, look after look. Vectorised numpy."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

LEAST = 1e-9  # that a class is said: no sensor is so good that one look rules a class out
ROUNDING = 1e-6  # that a row of a matrix written by hand may miss 1 by


def even_confusion(accuracy: float, classes: int) -> Floats:
    """The confusion of a sensor that says the true class with this probability, and each other as often. Returns: (C, C) true, said."""
    out = np.full((classes, classes), (1.0 - accuracy) / (classes - 1))
    np.fill_diagonal(out, accuracy)
    return out


def log_likelihood(counts: Ints, confusion: Floats, habit: float) -> Floats:
    """Log probability of what a sensor said of each track, in one order of saying it, if the vessel were of each class.

    Of each vessel the sensor has one habitual answer, drawn from the confusion once; each look repeats it with probability `habit`,
    else draws afresh. So habit 0 is independent looks, and near 1 any number of looks says little more than one.
    Args: counts: (N, C) looks that said each class; confusion: (C, C) true, said, each row sums to 1; habit: 0 <= habit < 1.
    Returns: (N, C), 0 where there was no look.
    """
    confusion = np.maximum(confusion, LEAST)
    fresh, first = np.log((1.0 - habit) * confusion), np.log(confusion)
    repeated = np.log(habit + (1.0 - habit) * confusion)
    n = counts.astype(np.float64)[:, None, :]
    said = n * fresh  # (N, C true, C said)
    terms = first + said.sum(axis=2, keepdims=True) - said + n * repeated  # (N, C true, C habitual answer)
    most = terms.max(axis=2)
    out = most + np.log(np.exp(terms - most[:, :, None]).sum(axis=2))
    out[counts.sum(axis=1) == 0] = 0.0
    return np.asarray(out)


def check_confusion(name: str, rows: tuple[tuple[float, ...], ...], classes: int) -> None:
    """Raises: ValueError where these rows, if there are any, are no confusion of so many classes."""
    shape = [len(row) for row in rows]
    if rows and (shape != [classes] * classes or any(abs(sum(row) - 1.0) > ROUNDING for row in rows)):
        raise ValueError(
            f"{name}: got rows of {shape} that sum to {[sum(r) for r in rows]}, needed {classes} of {classes} that sum to 1"
        )
