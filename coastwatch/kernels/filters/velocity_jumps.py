"""Interacting multiple models of which some may be kicked: many filters, each fed with its measurements. Scalar, by numba.

State of a filter in one model: a row of WIDTH numbers: east, north, east rate, north rate, turn rate (m, m/s, rad/s), then the lower
triangle of its covariance by rows, so that the four that go straight need only the first ten of fifteen.
Models, by `kind`: 0 constant velocity, 1 coordinated turn, as in `imm`. A model besides may be kicked: at the rate `kick_rate` its
velocity jumps by a random step of variance `kick_variance` an axis, at a moment unknown between two measurements. A step with
and one without a kick are two hypotheses, weighed by the measurement and then merged again, so that a kick costs one update
more and no model of its own. Noise that grows with time would have to be large all the time to allow for it.
The oracle is tests/oracles/kicked_textbook.py.

Source: Y. Bar-Shalom, X. R. Li, T. Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001, sections 11.6.4
(first-order generalised pseudo-Bayesian, for the kicks) and 11.6.6 (IMM, for the models).
"""

import math

import numpy as np

from coastwatch.kernels.filters.coordinated_turn import turn_terms
from coastwatch.kernels.filters.imm import FLOOR, LOG_TWO_PI
from coastwatch.kernels.jit import jit

SIZE = 5
WIDTH = SIZE + SIZE * (SIZE + 1) // 2
STRAIGHT = 4  # components of a model that does not turn


@jit
def _copy(row, out):  # type: ignore[no-untyped-def]
    for k in range(len(out)):
        out[k] = row[k]


@jit
def _moments(rows, weight, size, out):  # type: ignore[no-untyped-def]
    """Mean and covariance of a mixture, of the first `size` components, into `out` (WIDTH,); the weights sum to one."""
    for a in range(size):
        out[a] = 0.0
        for i in range(len(weight)):
            out[a] += weight[i] * rows[i, a]
    at = SIZE
    for a in range(size):
        for b in range(a + 1):
            t = 0.0
            for i in range(len(weight)):
                t += weight[i] * (rows[i, at] + (rows[i, a] - out[a]) * (rows[i, b] - out[b]))
            out[at] = t
            at += 1


@jit
def _shaken(row, dt, variance):  # type: ignore[no-untyped-def]
    """A row in place, its velocity less certain by `variance`, of which every part of dt gave its share: a kick or noise."""
    row[5] += variance * dt * dt / 3.0
    row[7] += variance * dt * dt / 3.0
    row[8] += 0.5 * variance * dt
    row[12] += 0.5 * variance * dt
    row[10] += variance
    row[14] += variance


@jit
def _go_straight(row, dt, turn_sigma):  # type: ignore[no-untyped-def]
    """A row in place after dt at constant velocity; its turn rate is what it was before anything was known."""
    row[0] += dt * row[2]
    row[1] += dt * row[3]
    row[5] += dt * (2.0 * row[8] + dt * row[10])
    row[6] += dt * (row[9] + row[11] + dt * row[13])
    row[7] += dt * (2.0 * row[12] + dt * row[14])
    row[8] += dt * row[10]
    row[9] += dt * row[13]
    row[11] += dt * row[13]
    row[12] += dt * row[14]
    row[4] = row[15] = row[16] = row[17] = row[18] = 0.0
    row[19] = turn_sigma * turn_sigma


@jit
def _turn(row, dt, turn_noise, f, p, half):  # type: ignore[no-untyped-def]
    """A row in place after dt at its turn rate, linearised; f, p, half (5, 5) are to work in."""
    s, c, ds, dc = turn_terms(row[4], dt)
    sin, cos = math.sin(row[4] * dt), math.cos(row[4] * dt)
    x, y = row[2], row[3]
    f[:] = 0.0
    f[0, 0] = f[1, 1] = f[4, 4] = 1.0
    f[0, 2], f[0, 3], f[0, 4] = s, -c, ds * x - dc * y
    f[1, 2], f[1, 3], f[1, 4] = c, s, dc * x + ds * y
    f[2, 2], f[2, 3], f[2, 4] = cos, -sin, -dt * (sin * x + cos * y)
    f[3, 2], f[3, 3], f[3, 4] = sin, cos, dt * (cos * x - sin * y)
    row[0], row[1] = row[0] + s * x - c * y, row[1] + c * x + s * y
    row[2], row[3] = cos * x - sin * y, sin * x + cos * y
    at = SIZE
    for a in range(SIZE):
        for b in range(a + 1):
            p[a, b] = p[b, a] = row[at]
            at += 1
    for a in range(SIZE):
        own = 1.0 if a < 2 else 0.0  # of the place in itself; the other components come from the last three
        for b in range(SIZE):
            half[a, b] = own * p[a, b] + f[a, 2] * p[2, b] + f[a, 3] * p[3, b] + f[a, 4] * p[4, b]
    at = SIZE
    for a in range(SIZE):
        for b in range(a + 1):
            own = 1.0 if b < 2 else 0.0
            row[at] = own * half[a, b] + half[a, 2] * f[b, 2] + half[a, 3] * f[b, 3] + half[a, 4] * f[b, 4]
            at += 1
    row[19] += turn_noise * dt


@jit
def _predict(rows, mode, dt, models, work, ahead, mode_ahead):  # type: ignore[no-untyped-def]
    """All models of a filter after dt without a kick, into the last two arguments: mixing, then each model's own motion."""
    kind, noise, turn_noise, turn_sigma, sojourn = models[:5]
    weight, stay, f, p, half = work[:5]
    j = len(mode)
    for i in range(j):
        stay[i] = 1.0
        if j > 1:
            stay[i] = (1.0 + (j - 1) * math.exp(-dt / sojourn[i] * j / (j - 1))) / j
    for m in range(j):
        total = 0.0
        for i in range(j):
            weight[i] = mode[i] * (stay[i] if i == m else (1.0 - stay[i]) / (j - 1))
            total += weight[i]
        mode_ahead[m] = total
        for i in range(j):
            weight[i] /= total
        if kind[m] == 1:
            _moments(rows, weight, SIZE, ahead[m])
            _turn(ahead[m], dt, turn_noise[m], f, p, half)
        else:
            _moments(rows, weight, STRAIGHT, ahead[m])
            _go_straight(ahead[m], dt, turn_sigma[m])
        _shaken(ahead[m], dt, noise[m] * dt)


@jit
def _correct(row, size, first, z0, z1, r00, r10, r11, u, w):  # type: ignore[no-untyped-def]
    """A row in place after its components first and first + 1 were measured; the log-likelihood. u, w (5,) are to work in."""
    for a in range(size):
        hi, lo = max(a, first), min(a, first)
        u[a] = row[SIZE + hi * (hi + 1) // 2 + lo]
        hi, lo = max(a, first + 1), min(a, first + 1)
        w[a] = row[SIZE + hi * (hi + 1) // 2 + lo]
    s00, s10, s11 = u[first] + r00, w[first] + r10, w[first + 1] + r11
    det = s00 * s11 - s10 * s10
    e0, e1 = z0 - row[first], z1 - row[first + 1]
    i00, i10, i11 = s11 / det, -s10 / det, s00 / det
    at = SIZE
    for a in range(size):
        k0, k1 = u[a] * i00 + w[a] * i10, u[a] * i10 + w[a] * i11
        row[a] += k0 * e0 + k1 * e1
        for b in range(a + 1):
            row[at] -= k0 * u[b] + k1 * w[b]
            at += 1
    return -0.5 * (e0 * (i00 * e0 + 2.0 * i10 * e1) + i11 * e1 * e1) - 0.5 * math.log(det) - LOG_TWO_PI


@jit
def _measured(row, size, z, u, w):  # type: ignore[no-untyped-def]
    """A row in place after a measurement of MEASURED numbers; the log-likelihood."""
    fit = _correct(row, size, 0, z[0], z[1], z[4], z[5], z[6], u, w)
    if not math.isnan(z[2]):
        fit += _correct(row, size, 2, z[2], z[3], z[7], z[8], z[9], u, w)
    return fit


@jit
def _weigh(rows, mode, ahead, mode_ahead, dt, z, models, work, branch, chance):  # type: ignore[no-untyped-def]
    """All models of a filter after a measurement, kicked and not, into rows and mode; branch (2, J, WIDTH), chance (J, 2)."""
    kind, kick_rate, kick_variance = models[0], models[5], models[6]
    u, w, best = work[5], work[6], -np.inf
    j = len(mode)
    for m in range(j):
        size = SIZE if kind[m] == 1 else STRAIGHT
        kicked = 1.0 - math.exp(-kick_rate[m] * dt)
        for k in range(2):
            chance[m, k] = -np.inf
            _copy(ahead[m], branch[m, k])
            if k == 1 and kicked > 0.0:
                _shaken(branch[m, k], dt, kick_variance[m])
            if k == 0 or kicked > 0.0:
                prior = mode_ahead[m] * (kicked if k == 1 else 1.0 - kicked)
                chance[m, k] = _measured(branch[m, k], size, z, u, w) + math.log(max(prior, FLOOR))
                best = max(best, chance[m, k])
    total = 0.0
    for m in range(j):
        for k in range(2):
            chance[m, k] = math.exp(chance[m, k] - best)
        mode[m] = chance[m, 0] + chance[m, 1]
        total += mode[m]
    floored = 0.0
    for m in range(j):
        _copy(branch[m, 0], rows[m])
        if chance[m, 1] > FLOOR * mode[m]:
            chance[m, 0], chance[m, 1] = chance[m, 0] / mode[m], chance[m, 1] / mode[m]
            _moments(branch[m], chance[m], SIZE if kind[m] == 1 else STRAIGHT, rows[m])
        mode[m] = max(mode[m] / total, FLOOR)
        floored += mode[m]
    for m in range(j):
        mode[m] /= floored
    return best + math.log(total)


@jit
def _brought_forward(rows, mode, late, z, mean, out):  # type: ignore[no-untyped-def]
    """A measurement older than the filter by `late`, moved by the filter's velocity and as much less certain, into `out`."""
    _moments(rows, mode, SIZE, mean)
    _copy(z, out)
    out[0] += late * mean[2]
    out[1] += late * mean[3]
    out[4] += late * late * mean[10]
    out[5] += late * late * mean[13]
    out[6] += late * late * mean[14]
    sin, cos = math.sin(mean[4] * late), math.cos(mean[4] * late)
    out[2], out[3] = cos * z[2] - sin * z[3], sin * z[2] + cos * z[3]


@jit
def absorb(low, high, filters, mode, time, measured_time, z, order, begin, models, log_likelihood):  # type: ignore[no-untyped-def]
    """Filters low to high after their measurements, in place.

    Measurements are taken in order of time. One older than the filter is brought forward by the filter's velocity; to play it again in
    its place would take 0.6 % off the error where every report is 2 s late and more (scaling/decisions/central_imm.py).

    Args:
        filters: (V, J, WIDTH); mode: (V, J) probabilities; time: (V,) of the newest measurement in each.
        measured_time: (M,); z: (M, 10) east, north, east rate, north rate, then the lower triangle of the covariance of the
        place and that of the velocity; NaN rates where none were measured.
        order: (M,) the measurements of each filter one after the other, in order of time; begin: (V + 1,) of each in it.
        models: kind, noise, turn_noise, turn_sigma, sojourn, kick_rate, kick_variance, (J,) each; the first five as in `imm_predict`.
        log_likelihood: (V,) of all of a filter's measurements: written.
    """
    j = mode.shape[1]
    square, line = (SIZE, SIZE), np.zeros(SIZE)
    work = (np.zeros(j), np.zeros(j), np.zeros(square), np.zeros(square), np.zeros(square), line, np.zeros(SIZE))
    ahead, mode_ahead = np.zeros((j, WIDTH)), np.zeros(j)
    branch, chance, mean, moved = np.zeros((j, 2, WIDTH)), np.zeros((j, 2)), np.zeros(WIDTH), np.zeros(10)
    for v in range(low, high):
        log_likelihood[v] = 0.0
        for k in range(begin[v], begin[v + 1]):
            dt = measured_time[order[k]] - time[v]
            moved[:] = z[order[k]]
            if dt > 0.0:
                _predict(filters[v], mode[v], dt, models, work, ahead, mode_ahead)
                time[v] = measured_time[order[k]]
            else:
                _brought_forward(filters[v], mode[v], -dt, z[order[k]], mean, moved)
                ahead[:], mode_ahead[:] = filters[v], mode[v]
            log_likelihood[v] += _weigh(
                filters[v], mode[v], ahead, mode_ahead, max(dt, 0.0), moved, models, work, branch, chance
            )


@jit
def foresee(low, high, filters, mode, time, now, models, mean, covariance):  # type: ignore[no-untyped-def]
    """Filters low to high predicted to one time and averaged over the models.

    Args: filters, mode, time, models: as in `absorb`; now: a filter that has heard of later is not taken back; mean: (V, 5) and
    covariance: (V, 5, 5): written.
    """
    j = mode.shape[1]
    square = (SIZE, SIZE)
    work = (np.zeros(j), np.zeros(j), np.zeros(square), np.zeros(square), np.zeros(square), np.zeros(SIZE), np.zeros(SIZE))
    ahead, mode_ahead, both = np.zeros((j, WIDTH)), np.zeros(j), np.zeros(WIDTH)
    for v in range(low, high):
        dt = max(now - time[v], 0.0)
        ahead[:], mode_ahead[:] = filters[v], mode[v]
        if dt > 0.0:
            _predict(filters[v], mode[v], dt, models, work, ahead, mode_ahead)
            for m in range(j):
                kicks = (1.0 - math.exp(-models[5][m] * dt)) * models[6][m]
                _shaken(ahead[m], dt, kicks)
        _moments(ahead, mode_ahead, SIZE, both)
        mean[v] = both[:SIZE]
        at = SIZE
        for a in range(SIZE):
            for b in range(a + 1):
                covariance[v, a, b] = covariance[v, b, a] = both[at]
                at += 1
