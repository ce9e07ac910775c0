"""Logarithm, exponential and angle without a branch or a call: in a loop over rows they become instructions on eight rows at once.

All are right to a few units of the last place (tests/kernels/test_elementary.py), and the same to the bit whatever is beside a row.
"""

import math
from typing import Any

import numpy as np
from numba import types
from numba.extending import intrinsic

from coastwatch.kernels.jit import jit

LN2 = math.log(2.0)
LN2_HIGH = 0.69314718036912381649  # LN2 to 32 bits: a multiple of it by up to 2^20 is exact
LN2_LOW = 1.90821492927058770002e-10
ROOT_HALF_BITS = 0x3FE6A09E667F3BCD  # of sqrt(1/2)
MANTISSA_BITS = 52
ONE_EXPONENT = 1023
WHOLE = (
    6755399441055744.0  # added and taken away it leaves the nearest whole number; np.rint is a call, which stops vectorisation
)
LEAST_EXPONENT = -708.0
WHOLE_BITS = 0x4338000000000000  # of WHOLE: whole numbers that were added to it stand below
TINY = 1e-300
TANGENT_22_5_DEG = math.tan(math.pi / 8.0)


def _fused(typingctx: Any, a: Any, b: Any, c: Any) -> Any:
    """a b + c, rounded once: one instruction where there are two otherwise."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.fma(*args)

    return types.float64(types.float64, types.float64, types.float64), generate


fused: Any = intrinsic(_fused)


@jit
def logarithm(x):  # type: ignore[no-untyped-def]
    """Natural logarithm of a positive normal number, -inf of 0: x = 2^e m, ln m = 2 artanh((m - 1) / (m + 1)), m about 1.

    Source: FreeBSD msun, e_log.c: a minimax polynomial for the series of artanh, right to 2^-58.
    """
    bits = np.float64(x).view(np.int64)
    e = (bits - ROOT_HALF_BITS) >> MANTISSA_BITS
    m = np.int64(bits - (e << MANTISSA_BITS)).view(np.float64)
    t = (m - 1.0) / (m + 1.0)
    z = t * t
    p = fused(z, fused(z, 1.479819860511658591e-01, 1.531383769920937332e-01), 1.818357216161805012e-01)
    p = fused(z, fused(z, p, 2.222219843214978396e-01), 2.857142874366239149e-01)
    p = z * fused(z, fused(z, p, 3.999999999940941908e-01), 6.666666666666735130e-01)
    return fused(e, LN2_HIGH, e * LN2_LOW + fused(t, p, 2.0 * t)) if x > 0.0 else -math.inf


@jit
def exponential(x):  # type: ignore[no-untyped-def]
    """e^x of a number up to 700; 0 under -708.

    The exponent is read from the bits of the sum that rounds: few processors can make whole numbers of several floating ones at once.
    """
    y = max(x, LEAST_EXPONENT)
    above = fused(y, 1.0 / LN2, WHOLE)
    whole = above - WHOLE
    r = fused(-whole, LN2_LOW, fused(-whole, LN2_HIGH, y))
    p = fused(r, fused(r, 1.0 / 6227020800.0, 1.0 / 479001600.0), 1.0 / 39916800.0)
    p = fused(r, fused(r, fused(r, p, 1.0 / 3628800.0), 1.0 / 362880.0), 1.0 / 40320.0)
    p = fused(r, fused(r, fused(r, p, 1.0 / 5040.0), 1.0 / 720.0), 1.0 / 120.0)
    p = fused(r, fused(r, fused(r, fused(r, fused(r, p, 1.0 / 24.0), 1.0 / 6.0), 0.5), 1.0), 1.0)
    power = np.int64((np.float64(above).view(np.int64) - (WHOLE_BITS - ONE_EXPONENT)) << MANTISSA_BITS).view(np.float64)
    return p * power if x > LEAST_EXPONENT else 0.0


@jit
def angle(sine, cosine):  # type: ignore[no-untyped-def]
    """atan2(sine, cosine), in [-pi, pi], of any two finite numbers; 0 where both are 0, NaN where either is.

    A polynomial gives the angle to the nearest of the lines at multiples of 45 degrees: (atan(t) / t - 1) / t^2 in t^2, fitted at
    Chebyshev's points for angles up to 22.5 degrees, right to 1e-17.
    """
    up, along = abs(sine), abs(cosine)
    longer, shorter = up if up > along else along, along if up > along else up
    tilted = shorter > TANGENT_22_5_DEG * longer
    t = (shorter - longer if tilted else shorter) / ((shorter + longer if tilted else longer) + TINY)
    z = t * t
    p = fused(z, fused(z, -0.01917688711906226, 0.03923165829558719), -0.0508544973794026)
    p = fused(z, fused(z, fused(z, p, 0.0585814891280221), -0.06664511447381948), 0.07692183190826087)
    p = fused(z, fused(z, fused(z, p, -0.09090904578123903), 0.11111111015256361), -0.14285714284666542)
    p = fused(z, fused(z, p, 0.1999999999999552), -0.3333333333333333)
    a = fused(t * z, p, t) + (0.25 * math.pi if tilted else 0.0)
    a = 0.5 * math.pi - a if up > along else a
    return math.copysign(math.pi - a if cosine < 0.0 else a, sine)
