"""What a turn at a steady rate does to a velocity: shared by the filters that turn. Compiled by numba."""

import math

from coastwatch.kernels.jit import jit

SMALL_TURN = 1e-3  # rad: below it the series replaces sin(a) / a and the like; its next term is under 1e-16 of the first


@jit
def turn_terms(rate, dt):  # type: ignore[no-untyped-def]
    """sin(a)/w, (1-cos(a))/w and their derivatives by w, for a = w dt."""
    a = rate * dt
    if abs(a) < SMALL_TURN:
        a2 = a * a
        s = dt * (1.0 - a2 / 6.0 * (1.0 - a2 / 20.0))
        c = dt * a * (0.5 - a2 / 24.0 * (1.0 - a2 / 30.0))
        ds = dt * dt * a * (-1.0 / 3.0 + a2 / 30.0)
        dc = dt * dt * (0.5 - a2 / 8.0 * (1.0 - a2 / 18.0))
        return s, c, ds, dc
    sin, cos = math.sin(a), math.cos(a)
    s, c = sin / rate, (1.0 - cos) / rate
    return s, c, (dt * cos - s) / rate, (dt * sin - c) / rate
