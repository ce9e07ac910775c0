"""Symmetric 4 x 4 matrices as tuples of ten numbers, (a00, a10, a11, a20, a21, a22, a30, a31, a32, a33): nothing is allocated.

Scalar code, compiled by numba.
"""

from __future__ import annotations

from coastwatch.kernels.jit import jit


@jit
def load(matrices, n):  # type: ignore[no-untyped-def]
    """The lower triangle of one of (N, 4, 4)."""
    m = matrices[n]
    return m[0, 0], m[1, 0], m[1, 1], m[2, 0], m[2, 1], m[2, 2], m[3, 0], m[3, 1], m[3, 2], m[3, 3]


@jit
def store(a, out, n):  # type: ignore[no-untyped-def]
    """Write a matrix into row n of (N, 4, 4), both triangles."""
    m = out[n]
    m[0, 0], m[0, 1], m[0, 2], m[0, 3] = a[0], a[1], a[3], a[6]
    m[1, 0], m[1, 1], m[1, 2], m[1, 3] = a[1], a[2], a[4], a[7]
    m[2, 0], m[2, 1], m[2, 2], m[2, 3] = a[3], a[4], a[5], a[8]
    m[3, 0], m[3, 1], m[3, 2], m[3, 3] = a[6], a[7], a[8], a[9]


@jit
def determinant(a):  # type: ignore[no-untyped-def]
    """By the minors of the upper and the lower two rows (Laplace): no division."""
    a00, a10, a11, a20, a21, a22, a30, a31, a32, a33 = a
    return (
        (a00 * a11 - a10 * a10) * (a22 * a33 - a32 * a32)
        - (a00 * a21 - a20 * a10) * (a21 * a33 - a31 * a32)
        + (a00 * a31 - a30 * a10) * (a21 * a32 - a31 * a22)
        + (a10 * a21 - a20 * a11) * (a20 * a33 - a30 * a32)
        - (a10 * a31 - a30 * a11) * (a20 * a32 - a30 * a22)
        + (a20 * a31 - a30 * a21) * (a20 * a31 - a30 * a21)
    )


@jit
def factor(a):  # type: ignore[no-untyped-def]
    """L and 1 / D of a positive definite L D L' (Cholesky without roots): l10, l20, l21, l30, l31, l32, then the four of 1 / D."""
    a00, a10, a11, a20, a21, a22, a30, a31, a32, a33 = a
    e0 = 1.0 / a00
    l10, l20, l30 = a10 * e0, a20 * e0, a30 * e0
    e1 = 1.0 / (a11 - l10 * a10)
    b21, b31 = a21 - l20 * a10, a31 - l30 * a10
    l21, l31 = b21 * e1, b31 * e1
    e2 = 1.0 / (a22 - l20 * a20 - l21 * b21)
    b32 = a32 - l30 * a20 - l31 * b21
    l32 = b32 * e2
    e3 = 1.0 / (a33 - l30 * a30 - l31 * b31 - l32 * b32)
    return l10, l20, l21, l30, l31, l32, e0, e1, e2, e3


@jit
def forward_substitution(f, b0, b1, b2, b3):  # type: ignore[no-untyped-def]
    """L^-1 b for a factor."""
    y1 = b1 - f[0] * b0
    y2 = b2 - f[1] * b0 - f[2] * y1
    return b0, y1, y2, b3 - f[3] * b0 - f[4] * y1 - f[5] * y2


@jit
def weighted_dot(f, x, y):  # type: ignore[no-untyped-def]
    """x' D^-1 y for a factor and two vectors from `forward_substitution`."""
    return x[0] * y[0] * f[6] + x[1] * y[1] * f[7] + x[2] * y[2] * f[8] + x[3] * y[3] * f[9]


@jit
def quadratic_form(f, w0, w1, w2, w3):  # type: ignore[no-untyped-def]
    """W' D^-1 W, where the columns of W are four vectors from `forward_substitution`."""
    return (
        weighted_dot(f, w0, w0),
        weighted_dot(f, w1, w0),
        weighted_dot(f, w1, w1),
        weighted_dot(f, w2, w0),
        weighted_dot(f, w2, w1),
        weighted_dot(f, w2, w2),
        weighted_dot(f, w3, w0),
        weighted_dot(f, w3, w1),
        weighted_dot(f, w3, w2),
        weighted_dot(f, w3, w3),
    )


@jit
def solve_lower(f, a):  # type: ignore[no-untyped-def]
    """L^-1 A for a factor and a symmetric matrix: its four columns."""
    return (
        forward_substitution(f, a[0], a[1], a[3], a[6]),
        forward_substitution(f, a[1], a[2], a[4], a[7]),
        forward_substitution(f, a[3], a[4], a[5], a[8]),
        forward_substitution(f, a[6], a[7], a[8], a[9]),
    )


@jit
def inverse(a):  # type: ignore[no-untyped-def]
    """Of a positive definite matrix."""
    f = factor(a)
    return quadratic_form(
        f,
        forward_substitution(f, 1.0, 0.0, 0.0, 0.0),
        forward_substitution(f, 0.0, 1.0, 0.0, 0.0),
        forward_substitution(f, 0.0, 0.0, 1.0, 0.0),
        forward_substitution(f, 0.0, 0.0, 0.0, 1.0),
    )


@jit
def multiply(a, x):  # type: ignore[no-untyped-def]
    """A x for a symmetric matrix and a vector."""
    return (
        a[0] * x[0] + a[1] * x[1] + a[3] * x[2] + a[6] * x[3],
        a[1] * x[0] + a[2] * x[1] + a[4] * x[2] + a[7] * x[3],
        a[3] * x[0] + a[4] * x[1] + a[5] * x[2] + a[8] * x[3],
        a[6] * x[0] + a[7] * x[1] + a[8] * x[2] + a[9] * x[3],
    )


@jit
def subtract(a, b):  # type: ignore[no-untyped-def]
    """A - B."""
    return (
        a[0] - b[0],
        a[1] - b[1],
        a[2] - b[2],
        a[3] - b[3],
        a[4] - b[4],
        a[5] - b[5],
        a[6] - b[6],
        a[7] - b[7],
        a[8] - b[8],
        a[9] - b[9],
    )


@jit
def add_scaled(a, b, scale):  # type: ignore[no-untyped-def]
    """A + scale B."""
    return (
        a[0] + scale * b[0],
        a[1] + scale * b[1],
        a[2] + scale * b[2],
        a[3] + scale * b[3],
        a[4] + scale * b[4],
        a[5] + scale * b[5],
        a[6] + scale * b[6],
        a[7] + scale * b[7],
        a[8] + scale * b[8],
        a[9] + scale * b[9],
    )
