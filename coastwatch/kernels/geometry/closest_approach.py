"""Pairs of vessels that are close to each other, or soon will be: by cells of a grid, each cell with half of its neighbours.

Vessels are points on a sphere of `DEGREE` metres a degree, on straight courses. A pair is let through a little too easily: whoever
asks looks at the few that are left again, in the precision that he wants.
"""

import math

from coastwatch.kernels.jit import jit

DEGREE = 111_120.0
LEAST_SQUARE = 0.01  # m2/s2: what moves slower against each other does not pass
SLACK_M, SLACK_S = 1e-3, 1e-6

LATITUDE, LONGITUDE, EAST, NORTH, COSINE, REACH = range(6)
COLUMNS = 6
"""Of a vessel: degrees, degrees, m/s, m/s, the cosine of its latitude, and how far it goes until the horizon, m."""


@jit
def _first(key, low, wanted):  # type: ignore[no-untyped-def]
    """The first entry from one on that is not below a key."""
    high = len(key)
    while low < high:
        middle = (low + high) >> 1
        if key[middle] < wanted:
            low = middle + 1
        else:
            high = middle
    return low


@jit
def _passes(a, b, turn, search, within, horizon):  # type: ignore[no-untyped-def]
    """Whether two vessels are within the search radius, and come within a distance at some time from now to the horizon."""
    y = (b[LATITUDE] - a[LATITUDE]) * DEGREE
    x = turn * DEGREE * math.cos(math.radians(0.5 * (a[LATITUDE] + b[LATITUDE])))
    if x * x + y * y > (search + SLACK_M) * (search + SLACK_M):
        return False
    if horizon <= 0.0:
        return True
    u, v = b[EAST] - a[EAST], b[NORTH] - a[NORTH]
    square = u * u + v * v
    if square <= LEAST_SQUARE * (1.0 - 1e-9):
        return False
    after = -(x * u + y * v) / square
    if after < -SLACK_S or after > horizon + SLACK_S:
        return False
    x, y = x + u * after, y + v * after
    return x * x + y * y <= (within + SLACK_M) * (within + SLACK_M)


@jit
def _compare(vessel, moves, i, low, high, search, within, horizon, count, out):  # type: ignore[no-untyped-def]
    """One vessel with those of a range; returns how many pairs there are so far."""
    a = vessel[i]
    for j in range(low, high):
        b = vessel[j]
        most = min(search, within + a[REACH] + b[REACH])
        if abs(b[LATITUDE] - a[LATITUDE]) * DEGREE > most + SLACK_M or not (moves[i] or moves[j]):
            continue
        turn = b[LONGITUDE] - a[LONGITUDE]
        turn -= 360.0 if turn > 180.0 else -360.0 if turn < -180.0 else 0.0
        if abs(turn) * DEGREE * min(a[COSINE], b[COSINE]) > most + SLACK_M:
            continue
        if _passes(a, b, turn, search, within, horizon):
            if count < len(out):
                out[count, 0], out[count, 1] = i, j
            count += 1
    return count


@jit
def passing_pairs(key, vessel, moves, columns, search, within, horizon, out):  # type: ignore[no-untyped-def]
    """Rows of the pairs; returns how many there are, of which as many are written as there is room for.

    Args: key: (N,) sorted, row of a cell times `columns`, 3 at least, and column; cells are as high and as wide as `search`; vessel:
    (N, COLUMNS); moves: (N,) bool, of a pair one does; search: m between the two now; within: m at the closest approach, which is
    from now to `horizon`, s; 0: only the distance now counts; out: (Q, 2).
    """
    count = 0
    east = south = end = 0
    east_end = south_end = 0
    for i in range(len(key)):
        if i == 0 or key[i] != key[i - 1]:
            row, column = key[i] // columns, key[i] % columns
            end = _first(key, i, key[i] + 1)
            beside = row * columns + (column + 1) % columns
            east = _first(key, 0, beside)
            east_end = _first(key, east, beside + 1)
            south = _first(key, 0, (row + 1) * columns + max(column - 1, 0))
            south_end = _first(key, south, (row + 1) * columns + min(column + 1, columns - 1) + 1)
        count = _compare(vessel, moves, i, i + 1, end, search, within, horizon, count, out)
        count = _compare(vessel, moves, i, east, east_end, search, within, horizon, count, out)
        count = _compare(vessel, moves, i, south, south_end, search, within, horizon, count, out)
        column = key[i] % columns
        if column == 0 or column == columns - 1:  # the neighbour on the other side of the seam
            other = (key[i] // columns + 1) * columns + (columns - 1 if column == 0 else 0)
            low = _first(key, end, other)
            count = _compare(vessel, moves, i, low, _first(key, low, other + 1), search, within, horizon, count, out)
    return count
