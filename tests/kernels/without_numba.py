"""A module run with the kernels in plain Python, where numpy checks every index: `python without_numba.py MODULE ARGUMENTS`.

NUMBA_DISABLE_JIT=1 alone is not enough: kernels read fields of records as attributes, which numpy allows only of a recarray.
"""

from __future__ import annotations

import functools
import runpy
import sys
from collections.abc import Callable
from typing import Any

import numpy as np

from coastwatch.kernels import jit as compiling


def as_record(value: Any) -> Any:
    """The same array or row, with fields as attributes."""
    if isinstance(value, np.void) and value.dtype.names:
        return np.array([value], value.dtype).view(np.recarray)[0]
    return value.view(np.recarray) if isinstance(value, np.ndarray) and value.dtype.names else value


def uncompiled(function: Callable[..., Any]) -> Any:
    """The function itself, over records."""

    @functools.wraps(function)
    def called(*arguments: Any) -> Any:
        with np.errstate(all="ignore"):
            return function(*map(as_record, arguments))

    return called


if __name__ == "__main__":
    compiling.jit = uncompiled
    sys.argv = sys.argv[1:]
    runpy.run_module(sys.argv[0], run_name="__main__", alter_sys=True)
