"""Earth-centred places of many points: `geodesy.earth_centred` for the rows of a cycle, compiled by numba, over threads."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from coastwatch.kernels.jit import jit
from coastwatch.kernels.threads import in_blocks
from coastwatch.kernels.vectorised_math import WHOLE

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

SEMI_MAJOR = 6378137.0
ECCENTRICITY2 = (2.0 - 1.0 / 298.257223563) / 298.257223563
RADIANS = math.pi / 180.0
ROWS = 256  # at a time: three times eight bytes of each stay in the first cache


@jit
def _eighth(degrees):  # type: ignore[no-untyped-def]
    """Quarter turns, -2 to 2, and sine and cosine of what remains, without a branch. The remainder is exact.

    Source: FreeBSD msun, k_sin.c and k_cos.c: minimax polynomials on an eighth of the circle, error under an ulp of 1.
    """
    quarter = (degrees * (1.0 / 90.0) + WHOLE) - WHOLE
    x = (degrees - 90.0 * quarter) * RADIANS
    z = x * x
    s = 2.75573137070700676789e-06 + z * (-2.50507602534068634195e-08 + z * 1.58969099521155010221e-10)
    s = x + x * z * (-1.66666666666666324348e-01 + z * (8.33333333332248946124e-03 + z * (-1.98412698298579493134e-04 + z * s)))
    c = -2.75573143513906633035e-07 + z * (2.08757232129817482790e-09 - z * 1.13596475577881948265e-11)
    c = -1.38888888888741095749e-03 + z * (2.48015872894767294178e-05 + z * c)
    c = 1.0 - 0.5 * z + z * z * (4.16666666666666019037e-02 + z * c)
    return quarter - 4.0 * ((quarter * 0.25 + WHOLE) - WHOLE), s, c


@jit
def sine_cosine(degrees):  # type: ignore[no-untyped-def]
    """Sine and cosine: of quarter turns q the signs and the exchange of the two are polynomials of q."""
    q, s, c = _eighth(degrees)
    odd = q * q * (4.0 - q * q) * (1.0 / 3.0)  # 1 for an odd quarter, else 0
    sign = (1.0 - odd) * (1.0 - 0.5 * q * q)
    return odd * q * c + sign * s, sign * c - odd * q * s


@jit
def _laid(low, high, position, row, out):  # type: ignore[no-untyped-def]
    latitude, longitude, place = np.zeros(ROWS), np.zeros(ROWS), np.zeros((3, ROWS))
    for first in range(low, high, ROWS):
        count = min(ROWS, high - first)
        for i in range(count):
            latitude[i], longitude[i] = position[row[first + i], 0], position[row[first + i], 1]
        for i in range(ROWS):
            sp, cp = sine_cosine(latitude[i])
            sl, cl = sine_cosine(longitude[i])
            r = SEMI_MAJOR / math.sqrt(1.0 - ECCENTRICITY2 * sp * sp)
            place[0, i] = r * cp * cl
            place[1, i] = r * cp * sl
            place[2, i] = r * (1.0 - ECCENTRICITY2) * sp
        for axis in range(3):
            for i in range(count):  # an array assigned whole would have numba compile how its shape is told in an error: 5 s
                out[axis, first + i] = place[axis, i]


def centred_rows(position: Floats, row: Ints) -> Floats:
    """Earth-centred, Earth-fixed metres of these rows of points on the ellipsoid, right to 1e-8 m, an axis a row.

    Args: position: (N, 2) latitude, longitude in degrees; row: (M,). Returns: (3, M).
    Source: NIMA TR8350.2, WGS 84, eq. 4-14.
    """
    out = np.empty((3, len(row)))
    in_blocks(_laid, len(row), np.ascontiguousarray(position), row, out)
    return out
