"""Symmetric matrices of four rows in scalar code: ten numbers each, the lower triangle by rows. Nothing is allocated a matrix.

Compiled by numba; a matrix is a tuple (a00, a10, a11, a20, a21, a22, a30, a31, a32, a33), so that it stays in registers.
"""

from __future__ import annotations

from coastwatch.kernels.jit import jit


@jit
def lower(matrices, n):  # type: ignore[no-untyped-def]
    """The lower triangle of one of (N, 4, 4)."""
    m = matrices[n]
    return m[0, 0], m[1, 0], m[1, 1], m[2, 0], m[2, 1], m[2, 2], m[3, 0], m[3, 1], m[3, 2], m[3, 3]


@jit
def put(a, out, n):  # type: ignore[no-untyped-def]
    """A matrix into row n of (N, 4, 4), both triangles."""
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
    """L and 1 / D of a positive definite L D L': l10, l20, l21, l30, l31, l32, then the four of 1 / D (Cholesky without roots)."""
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
def forward(f, b0, b1, b2, b3):  # type: ignore[no-untyped-def]
    """L^-1 b for a factor."""
    y1 = b1 - f[0] * b0
    y2 = b2 - f[1] * b0 - f[2] * y1
    return b0, y1, y2, b3 - f[3] * b0 - f[4] * y1 - f[5] * y2


@jit
def dot(f, x, y):  # type: ignore[no-untyped-def]
    """x' D^-1 y for a factor and two vectors that `forward` gave."""
    return x[0] * y[0] * f[6] + x[1] * y[1] * f[7] + x[2] * y[2] * f[8] + x[3] * y[3] * f[9]


@jit
def squared(f, w0, w1, w2, w3):  # type: ignore[no-untyped-def]
    """W' D^-1 W, where the columns of W are four vectors that `forward` gave."""
    return (
        dot(f, w0, w0),
        dot(f, w1, w0),
        dot(f, w1, w1),
        dot(f, w2, w0),
        dot(f, w2, w1),
        dot(f, w2, w2),
        dot(f, w3, w0),
        dot(f, w3, w1),
        dot(f, w3, w2),
        dot(f, w3, w3),
    )


@jit
def columns(f, a):  # type: ignore[no-untyped-def]
    """L^-1 A, its four columns, for a factor and a symmetric matrix."""
    return (
        forward(f, a[0], a[1], a[3], a[6]),
        forward(f, a[1], a[2], a[4], a[7]),
        forward(f, a[3], a[4], a[5], a[8]),
        forward(f, a[6], a[7], a[8], a[9]),
    )


@jit
def inverse(a):  # type: ignore[no-untyped-def]
    """Of a positive definite matrix."""
    f = factor(a)
    return squared(
        f,
        forward(f, 1.0, 0.0, 0.0, 0.0),
        forward(f, 0.0, 1.0, 0.0, 0.0),
        forward(f, 0.0, 0.0, 1.0, 0.0),
        forward(f, 0.0, 0.0, 0.0, 1.0),
    )


@jit
def times(a, x):  # type: ignore[no-untyped-def]
    """A x of a symmetric matrix and four numbers."""
    return (
        a[0] * x[0] + a[1] * x[1] + a[3] * x[2] + a[6] * x[3],
        a[1] * x[0] + a[2] * x[1] + a[4] * x[2] + a[7] * x[3],
        a[3] * x[0] + a[4] * x[1] + a[5] * x[2] + a[8] * x[3],
        a[6] * x[0] + a[7] * x[1] + a[8] * x[2] + a[9] * x[3],
    )


@jit
def less(a, b):  # type: ignore[no-untyped-def]
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
def towards(a, difference, share):  # type: ignore[no-untyped-def]
    """A and a share of a difference."""
    return (
        a[0] + share * difference[0],
        a[1] + share * difference[1],
        a[2] + share * difference[2],
        a[3] + share * difference[3],
        a[4] + share * difference[4],
        a[5] + share * difference[5],
        a[6] + share * difference[6],
        a[7] + share * difference[7],
        a[8] + share * difference[8],
        a[9] + share * difference[9],
    )
