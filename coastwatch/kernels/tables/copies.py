"""Copies between arrays inside kernels."""

from __future__ import annotations

from coastwatch.kernels.arrays import Array
from coastwatch.kernels.jit import jit


@jit
def copy_into(target: Array, source: Array) -> None:
    """Copy an array of one to three axes to the beginning of each axis of another one.

    As `target[:n] = source`, whose check of shapes and of overlap numba takes six times as long to compile. Nothing is checked here:
    a source that is larger than the target is written past its end.
    """
    if source.ndim == 1:
        for i in range(source.shape[0]):
            target[i] = source[i]
    elif source.ndim == 2:
        for i in range(source.shape[0]):
            for j in range(source.shape[1]):
                target[i, j] = source[i, j]
    else:
        for i in range(source.shape[0]):
            for j in range(source.shape[1]):
                for k in range(source.shape[2]):
                    target[i, j, k] = source[i, j, k]
