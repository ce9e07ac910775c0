"""Logarithm, exponential and angle without a branch or a call: in a loop over rows they become instructions on eight rows at once.

All are right to a few units of the last place (tests/kernels/test_elementary.py), and the same to the bit whatever is beside a row.
"""

import math

import numpy as np

from coastwatch.kernels.compiling import arithmetic_part

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
TINY = 1e-300


@arithmetic_part
def logarithm(x):  # type: ignore[no-untyped-def]
    """Natural logarithm of a positive normal number, -inf of 0: x = 2^e m, ln m = 2 artanh((m - 1) / (m + 1)), m about 1."""
    bits = np.float64(x).view(np.int64)
    e = (bits - ROOT_HALF_BITS) >> MANTISSA_BITS
    m = np.int64(bits - (e << MANTISSA_BITS)).view(np.float64)
    t = (m - 1.0) / (m + 1.0)
    z = t * t
    p = 1.0 / 17.0 + z * (1.0 / 19.0 + z * (1.0 / 21.0))
    p = 1.0 / 9.0 + z * (1.0 / 11.0 + z * (1.0 / 13.0 + z * (1.0 / 15.0 + z * p)))
    p = z * (1.0 / 3.0 + z * (1.0 / 5.0 + z * (1.0 / 7.0 + z * p)))
    return e * LN2_HIGH + (e * LN2_LOW + 2.0 * (t + t * p)) if x > 0.0 else -math.inf


@arithmetic_part
def exponential(x):  # type: ignore[no-untyped-def]
    """e^x of a number up to 700; 0 under -708."""
    whole = (max(x, LEAST_EXPONENT) * (1.0 / LN2) + WHOLE) - WHOLE
    r = max(x, LEAST_EXPONENT) - whole * LN2_HIGH - whole * LN2_LOW
    p = 1.0 / 3628800.0 + r * (1.0 / 39916800.0 + r * (1.0 / 479001600.0 + r * (1.0 / 6227020800.0)))
    p = 1.0 / 720.0 + r * (1.0 / 5040.0 + r * (1.0 / 40320.0 + r * (1.0 / 362880.0 + r * p)))
    p = 1.0 + r * (1.0 + r * (0.5 + r * (1.0 / 6.0 + r * (1.0 / 24.0 + r * (1.0 / 120.0 + r * p)))))
    power = np.int64((np.int64(whole) + ONE_EXPONENT) << MANTISSA_BITS).view(np.float64)
    return p * power if x > LEAST_EXPONENT else 0.0


@arithmetic_part
def angle(sine, cosine):  # type: ignore[no-untyped-def]
    """atan2(sine, cosine), in [-pi, pi], of any two numbers whose squares are finite; 0 where both are 0.

    The tangent of half the angle to the nearer end of the line, twice halved again, lies under 0.2, where a series is short.
    """
    length = math.sqrt(sine * sine + cosine * cosine)
    t = sine / max(length + abs(cosine), TINY)
    t = t / (1.0 + math.sqrt(1.0 + t * t))
    t = t / (1.0 + math.sqrt(1.0 + t * t))
    z = t * t
    p = 1.0 / 17.0 - z * (1.0 / 19.0 - z * (1.0 / 21.0 - z * (1.0 / 23.0)))
    p = 1.0 / 9.0 - z * (1.0 / 11.0 - z * (1.0 / 13.0 - z * (1.0 / 15.0 - z * p)))
    a = 8.0 * (t - t * z * (1.0 / 3.0 - z * (1.0 / 5.0 - z * (1.0 / 7.0 - z * p))))
    return a if cosine >= 0.0 else math.copysign(math.pi, sine) - a
