"""How scalar code that is given all its memory is compiled: no array is counted as held, no lock, no fast mathematics.

numba counts who holds an array, and cannot always leave it out where arrays come in tuples: an atomic addition of 5 ns each time, on
one address for all threads. Code that makes no array needs no such count (`_nrt`): 10.5 ns became 1.8 ns where a number was
read from one of two arrays (`python -m scaling.decisions.picture_cycle`). What needs room to work in is given it by a caller that is
compiled with the count.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numba import cfunc, njit

from coastwatch.kernels import stamps

__all__ = ["arithmetic", "arithmetic_part", "bare_part", "cfunc", "inner", "kernel", "lanes_part", "njit", "part"]

stamps.take_over()  # before anything is compiled: what is kept is then known by all that it is made of

OPTIONS: dict[str, Any] = {"cache": True, "nogil": True, "_nrt": False}


def kernel(function: Callable[..., Any]) -> Any:
    """Compiled, kept on disk, and free to run beside Python; it may make no array."""
    return njit(**OPTIONS)(function)


def part(function: Callable[..., Any]) -> Any:
    """The same, laid into the code that calls it: a call with a dozen arrays costs 30 ns."""
    return njit(**OPTIONS, forceinline=True)(function)


def inner(function: Callable[..., Any]) -> Any:
    """For compiled code alone, which calls it or, where that is shorter, has it laid in. It may make arrays."""
    return njit(cache=True, nogil=True)(function)


def arithmetic(function: Callable[..., Any]) -> Any:
    """Compiled, kept on disk, free to run beside Python; a division by zero is infinite or not a number, as in numpy, and no exception.

    The check for that is a branch in every loop. Arrays may be made: those are counted.
    """
    return njit(cache=True, nogil=True, error_model="numpy")(function)


def arithmetic_part(function: Callable[..., Any]) -> Any:
    """The same, laid into the code that calls it."""
    return njit(cache=True, nogil=True, error_model="numpy", forceinline=True)(function)


def bare_part(function: Callable[..., Any]) -> Any:
    """As `part`, but a division by zero is infinite or not a number."""
    return njit(**OPTIONS, error_model="numpy", forceinline=True)(function)


def lanes_part(function: Callable[..., Any]) -> Any:
    """As `arithmetic_part`, but laid into the caller before either is compiled: shapes that the caller knows are then known here.

    A part is compiled for any shape first, and only so laid in: a loop over lanes then asks each time whether rows overlap.
    """
    return njit(nogil=True, error_model="numpy", inline="always")(function)
