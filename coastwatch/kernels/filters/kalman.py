"""The Kalman filter: the one prediction and the one update of every filter here. Scalar code, compiled by numba.

State: east, north, east rate, north rate (m, m/s), and a manoeuvre: turn rate or acceleration, see `motion_models`. (5,)
A measurement is of the first components of the state: of the position, or of position and velocity.
What is said to be updated in place is overwritten; arguments named `root`, `gain` and `residual` are memory to work in.

Source: Y. Bar-Shalom, X. R. Li, T. Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001, section 5.2.
"""

import math

from coastwatch.kernels.jit import jit

SIZE = 5
EAST, NORTH, EAST_RATE, NORTH_RATE, MANOEUVRE = range(SIZE)
LOG_TWO_PI = math.log(2.0 * math.pi)


@jit
def predict(covariance, transition):  # type: ignore[no-untyped-def]
    """Predict a covariance in place, before process noise: F P F'.

    No component moves with the position, and the manoeuvre with none: of the transition F, (5, 5), only the first four rows of the last
    three columns are read, the rest being that of the unit matrix.
    """
    p, f = covariance, transition
    f02, f03, f04, f12, f13, f14 = f[0, 2], f[0, 3], f[0, 4], f[1, 2], f[1, 3], f[1, 4]  # in registers: p could alias f
    f22, f23, f24, f32, f33, f34 = f[2, 2], f[2, 3], f[2, 4], f[3, 2], f[3, 3], f[3, 4]
    for b in range(SIZE):  # F P
        east_rate, north_rate, manoeuvre = p[EAST_RATE, b], p[NORTH_RATE, b], p[MANOEUVRE, b]
        p[EAST, b] += f02 * east_rate + f03 * north_rate + f04 * manoeuvre
        p[NORTH, b] += f12 * east_rate + f13 * north_rate + f14 * manoeuvre
        p[EAST_RATE, b] = f22 * east_rate + f23 * north_rate + f24 * manoeuvre
        p[NORTH_RATE, b] = f32 * east_rate + f33 * north_rate + f34 * manoeuvre
    for a in range(SIZE):  # (F P) F'
        east_rate, north_rate, manoeuvre = p[a, EAST_RATE], p[a, NORTH_RATE], p[a, MANOEUVRE]
        p[a, EAST] += f02 * east_rate + f03 * north_rate + f04 * manoeuvre
        p[a, NORTH] += f12 * east_rate + f13 * north_rate + f14 * manoeuvre
        p[a, EAST_RATE] = f22 * east_rate + f23 * north_rate + f24 * manoeuvre
        p[a, NORTH_RATE] = f32 * east_rate + f33 * north_rate + f34 * manoeuvre
    for a in range(SIZE):
        for b in range(a):
            p[b, a] = p[a, b]


@jit
def predict_straight(covariance, dt):  # type: ignore[no-untyped-def]
    """Predict a covariance in place, before process noise, by constant velocity, of which the manoeuvre is forgotten: F P F'."""
    p = covariance
    for a in range(2):
        for b in range(2):
            p[a, b] += dt * (p[a, b + 2] + p[a + 2, b] + dt * p[a + 2, b + 2])
    for a in range(2):
        for b in range(2):
            p[a, b + 2] += dt * p[a + 2, b + 2]
            p[b + 2, a] = p[a, b + 2]
    for a in range(SIZE):
        p[a, MANOEUVRE] = p[MANOEUVRE, a] = 0.0


@jit
def update(mean, covariance, z, noise, root, gain, residual):  # type: ignore[no-untyped-def]
    """Update a state in place by a measurement of its first d components; |L| and y'y of its innovation, see `log_likelihood`.

    With H = [I 0] and S = H P H' + R = L L', and with the gain and the residual whitened, W = L^-1 H P and y = L^-1 (z - H x):
        x = x + W' y
        P = P - W' W
    Args: mean: (5,); covariance: (5, 5); z: (d,), d up to 4; noise: R, (d, d) or larger; root: L, (4, 4); gain: W, (4, 5);
    residual: y, (4,).
    """
    d, determinant, distance = len(z), 1.0, 0.0
    for a in range(d):
        y = z[a] - mean[a]
        for k in range(SIZE):
            gain[a, k] = covariance[a, k]
        for c in range(a):
            s = covariance[a, c] + noise[a, c]
            for b in range(c):
                s -= root[a, b] * root[c, b]
            root[a, c] = s / root[c, c]
            y -= root[a, c] * residual[c]
            for k in range(SIZE):
                gain[a, k] -= root[a, c] * gain[c, k]
        s = covariance[a, a] + noise[a, a]
        for b in range(a):
            s -= root[a, b] * root[a, b]
        root[a, a] = math.sqrt(s)
        inverse = 1.0 / root[a, a]
        for k in range(SIZE):
            gain[a, k] *= inverse
        residual[a] = y * inverse
        determinant *= root[a, a]
        distance += residual[a] * residual[a]
    for a in range(d):
        for k in range(SIZE):
            mean[k] += gain[a, k] * residual[a]
            for b in range(SIZE):
                covariance[k, b] -= gain[a, k] * gain[a, b]
    return determinant, distance


@jit
def update_position(mean, covariance, z, noise):  # type: ignore[no-untyped-def]
    """As `update` by a measurement of east and north, d = 2: written out, a third of the time. Args: z: (2,); noise: (2, 2)."""
    p = covariance
    l00 = math.sqrt(p[0, 0] + noise[0, 0])
    i0 = 1.0 / l00
    l10 = (p[1, 0] + noise[1, 0]) * i0
    l11 = math.sqrt(p[1, 1] + noise[1, 1] - l10 * l10)
    i1 = 1.0 / l11
    a0, a1, a2, a3, a4 = p[0, 0] * i0, p[0, 1] * i0, p[0, 2] * i0, p[0, 3] * i0, p[0, 4] * i0
    b0, b1, b2 = (p[1, 0] - l10 * a0) * i1, (p[1, 1] - l10 * a1) * i1, (p[1, 2] - l10 * a2) * i1
    b3, b4 = (p[1, 3] - l10 * a3) * i1, (p[1, 4] - l10 * a4) * i1
    y0 = (z[0] - mean[0]) * i0
    y1 = (z[1] - mean[1] - l10 * y0) * i1
    first, second = (a0, a1, a2, a3, a4), (b0, b1, b2, b3, b4)  # the rows of W
    for k in range(SIZE):
        mean[k] += first[k] * y0 + second[k] * y1
        for b in range(SIZE):
            p[k, b] -= first[k] * first[b] + second[k] * second[b]
    return l00 * l11, y0 * y0 + y1 * y1


@jit
def log_likelihood(determinant, distance, d):  # type: ignore[no-untyped-def]
    """Of a measurement of d components: log N(z; H x, S) = -1/2 y'y - log |L| - d/2 log 2 pi. Args: as `update` returns them."""
    return -0.5 * distance - math.log(determinant) - 0.5 * d * LOG_TWO_PI
