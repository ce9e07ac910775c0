"""The score of one pair of tracks over its window, by one step after the other: what the array code must give to 1e-12.

Windows are lists of entries, newest last: latitude and longitude in deg, velocity in m/s, the sums over both axes of the variances of
position in m2 and of velocity in m2/s2.
"""

import math

import numpy as np

A = 6378137.0
E2 = (2.0 - 1.0 / 298.257223563) / 298.257223563


def scales(latitude):
    s = math.sin(math.radians(latitude))
    w2 = 1.0 - E2 * s * s
    north = A * (1.0 - E2) / (w2 * math.sqrt(w2)) * math.pi / 180.0
    return north, A / math.sqrt(w2) * math.cos(math.radians(latitude)) * math.pi / 180.0


def cholesky(m):
    """Lower factor, None where the matrix is not positive definite."""
    low = np.zeros((4, 4)).tolist()
    for i in range(4):
        for j in range(i + 1):
            s = float(m[i][j])
            for k in range(j):
                s -= low[i][k] * low[j][k]
            if i == j:
                if not s > 0.0:
                    return None
                low[i][i] = math.sqrt(s)
            else:
                low[i][j] = s / low[j][j]
    return low


def shown(delta, low, first):
    """tr(Phi0^-1 S) / 2 of the 2 x 2 block that begins at `first`."""
    n = len(delta)
    mean0 = mean1 = 0.0
    for d in delta:
        mean0 += d[first]
        mean1 += d[first + 1]
    mean0, mean1 = mean0 / n, mean1 / n
    s00 = s01 = s11 = 0.0
    for d in delta:
        x, y = d[first] - mean0, d[first + 1] - mean1
        s00 += x * x
        s01 += x * y
        s11 += y * y
    p00 = p01 = p11 = 0.0
    for k in range(first + 1):
        p00 += low[first][k] * low[first][k]
        p01 += low[first][k] * low[first + 1][k]
    for k in range(first + 2):
        p11 += low[first + 1][k] * low[first + 1][k]
    return (s00 * p11 - 2.0 * s01 * p01 + s11 * p00) / (p00 * p11 - p01 * p01) / (2.0 * (n - 1))


def factor(delta, phi, registration, rules):
    """Factor of phi, scaled block by block by what the window shows, plus the registration term."""
    low, n = cholesky(phi), len(delta)
    if low is None:
        return None
    gain = [1.0, 1.0]
    if n > 2:
        weight = (n - 1.0) / (n - 1.0 + rules.prior)
        for block in range(2):
            gain[block] = min(max(1.0 + weight * (shown(delta, low, 2 * block) - 1.0), rules.floor), rules.cap)
    total = [[float(phi[i, j]) * math.sqrt(gain[i // 2] * gain[j // 2]) for j in range(4)] for i in range(4)]
    for i in range(2):
        for j in range(2):
            total[i][j] += float(registration[i, j])
    return cholesky(total)


def ratio(delta, low, older_p, older_v, place, course, rules):
    """Log-likelihood ratio of one difference, bounded by the limit."""
    limit, null_variance = rules.step_limit, 2.0 * rules.unrelated_speed_m_s * rules.unrelated_speed_m_s
    p, v = 1.0 / math.sqrt(older_p), 1.0 / math.sqrt(older_v)
    a = p * delta[0] / low[0][0]
    b = (p * delta[1] - low[1][0] * a) / low[1][1]
    place -= 0.5 * (a * a + b * b)
    course += 0.5 * (delta[2] * delta[2] + delta[3] * delta[3]) / null_variance
    if place + max(course, 0.0) <= -limit:
        return -limit
    c = (v * delta[2] - low[2][0] * a - low[2][1] * b) / low[2][2]
    d = (v * delta[3] - low[3][0] * a - low[3][1] * b - low[3][2] * c) / low[3][3]
    course -= 0.5 * (c * c + d * d)
    place -= math.log(older_p)
    course -= math.log(older_v)
    if course > 30.0:
        return min(max(place + course + math.log1p(-rules.misled_share), -limit), limit)
    mixed = rules.misled_share + (1.0 - rules.misled_share) * math.exp(course)
    return min(max(place + math.log(mixed), -limit), limit)


def score(one, other, phi, registration, density, rules):
    """Discounted log-likelihood ratio over the common window of two lists of entries; -inf where there is no covariance."""
    n = min(len(one), len(other))
    one, other = one[-n:], other[-n:]
    north, east = scales(0.5 * (one[-1][0] + other[-1][0]))
    delta = []
    for x, y in zip(one, other, strict=True):
        turn = y[1] - x[1]
        turn -= 360.0 if turn > 180.0 else -360.0 if turn < -180.0 else 0.0
        delta.append((turn * east, (y[0] - x[0]) * north, y[2] - x[2], y[3] - x[3]))
    low = factor(delta, phi, registration, rules)
    if low is None:
        return -math.inf
    null_variance = 2.0 * rules.unrelated_speed_m_s * rules.unrelated_speed_m_s
    place = -math.log(2.0 * math.pi * low[0][0] * low[1][1] * density)
    course = math.log(null_variance / (low[2][2] * low[3][3]))
    now_p, now_v, total = one[-1][4] + other[-1][4], one[-1][5] + other[-1][5], 0.0
    for x, y, d in zip(one, other, delta, strict=True):
        older_p, older_v = max((x[4] + y[4]) / now_p, 1.0), max((x[5] + y[5]) / now_v, 1.0)
        total = max(rules.forgetting * total + ratio(d, low, older_p, older_v, place, course, rules), -rules.step_limit)
    return total
