"""Likelihood of the classes that a sensor reports of a vessel, look after look."""

from __future__ import annotations

import numpy as np

from coastwatch.kernels.arrays import Floats, Ints

LEAST = 1e-9  # probability of a report: no sensor is so good that one look rules a class out
ROUNDING = 1e-6  # that a row of a matrix written by hand may miss 1 by


def even_confusion(accuracy: float, classes: int) -> Floats:
    """The confusion matrix of a sensor that reports the true class with this probability, all others equally often.

    Returns: (C, C) true, reported.
    """
    out = np.full((classes, classes), (1.0 - accuracy) / (classes - 1))
    np.fill_diagonal(out, accuracy)
    return out


def log_likelihood(counts: Ints, confusion: Floats, habit: float) -> Floats:
    """Log probability of the sequence of reported classes of each track, given each true class.

    Of each vessel the sensor has one habitual answer, drawn from the confusion once; each look repeats it with probability `habit`,
    else draws afresh. So habit 0 is independent looks, and near 1 any number of looks says little more than one.
    Args: counts: (N, C) looks that reported each class; confusion: (C, C) true, reported, each row sums to 1; habit: 0 <= habit < 1.
    Returns: (N, C), 0 where there was no look.
    """
    confusion = np.maximum(confusion, LEAST)
    fresh, first = np.log((1.0 - habit) * confusion), np.log(confusion)
    repeated = np.log(habit + (1.0 - habit) * confusion)
    n = counts.astype(np.float64)[:, None, :]
    drawn = n * fresh  # (N, C true, C reported)
    terms = first + drawn.sum(axis=2, keepdims=True) - drawn + n * repeated  # (N, C true, C habitual answer)
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
