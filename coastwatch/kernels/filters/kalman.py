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

    No component moves with the position: of the transition F, (5, 5), only the last three columns are read, the first two being
    those of the unit matrix.
    """
    p, f = covariance, transition
    for b in range(SIZE):  # F P
        east_rate, north_rate, manoeuvre = p[EAST_RATE, b], p[NORTH_RATE, b], p[MANOEUVRE, b]
        p[EAST_RATE, b] = p[NORTH_RATE, b] = p[MANOEUVRE, b] = 0.0
        for a in range(SIZE):
            p[a, b] += f[a, EAST_RATE] * east_rate + f[a, NORTH_RATE] * north_rate + f[a, MANOEUVRE] * manoeuvre
    for a in range(SIZE):  # (F P) F'
        east_rate, north_rate, manoeuvre = p[a, EAST_RATE], p[a, NORTH_RATE], p[a, MANOEUVRE]
        for b in range(a + 1):
            own = p[a, b] if b < EAST_RATE else 0.0
            p[a, b] = own + f[b, EAST_RATE] * east_rate + f[b, NORTH_RATE] * north_rate + f[b, MANOEUVRE] * manoeuvre
            p[b, a] = p[a, b]


@jit
def update(mean, covariance, z, noise, root, gain, residual):  # type: ignore[no-untyped-def]
    """Update a state in place by a measurement of its first d components; the log-likelihood of the measurement.

    With H = [I 0] and S = H P H' + R = L L', and with the gain and the residual whitened, W = L^-1 H P and y = L^-1 (z - H x):
        x = x + W' y
        P = P - W' W
        log N(z; H x, S) = -1/2 y'y - log |L| - d/2 log 2 pi
    Args: mean: (5,); covariance: (5, 5); z: (d,), d up to 4; noise: R, (d, d) or larger; root: L, (4, 4); gain: W, (4, 5);
    residual: y, (4,).
    """
    d, determinant, distance = len(z), 1.0, 0.0  # |L|
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
    return -0.5 * distance - math.log(determinant) - 0.5 * d * LOG_TWO_PI
