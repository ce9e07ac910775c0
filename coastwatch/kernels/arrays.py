"""The types of arrays, once for kernels and batches."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]
Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]
Rows = NDArray[np.int32]
"""Numbers of rows and groups within a cycle, in half the memory of Ints."""

Records = NDArray[np.void]
"""Structured: each record has named fields."""
