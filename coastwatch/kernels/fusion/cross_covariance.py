"""Cross-covariance of the errors of two tracks of one target, and fusion with it. Batched numpy.

Tracks of one target share its process noise, so their errors are correlated. With e the error of a track, C = E[e_first e_second'].
A filter that predicts by F and Q and updates by the gain K has the error (I - K H) F e + ..., so C becomes
(I - K_first H) (F C F' + Q) (I - K_second H)'. The gains need not be known: I - K H = P_after P_before^-1.

Source: Y. Bar-Shalom, P. K. Willett, X. Tian, Tracking and Data Fusion, 2011, section 9.3; A. Sagild, track-to-track fusion of radar
and AIS, 2021, eq. 9.17 to 9.25.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coastwatch.kernels.arrays import Bools, Floats, Ints
from coastwatch.kernels.tables.match_ids import index_of


def predicted(matrix: Floats, dt: Floats, noise: float) -> Floats:
    """F M F' + Q at constant velocity, for a covariance or a cross-covariance.

    Args: matrix: M, (A, 4, 4) of east, north, east rate, north rate; dt: (A,) s; noise: density of the white acceleration, m2/s3.
    """
    t = np.asarray(dt, np.float64)[:, None, None]
    out = matrix.astype(np.float64)
    out[:, :2] += t * out[:, 2:]
    out[:, :, :2] += t * out[:, :, 2:]
    unit = noise * np.eye(2)
    out[:, :2, :2] += t**3 / 3.0 * unit
    out[:, :2, 2:] += t**2 / 2.0 * unit
    out[:, 2:, :2] += t**2 / 2.0 * unit
    out[:, 2:, 2:] += t * unit
    return out


def remaining(before: Floats, after: Floats) -> Floats:
    """I - K H of an update: the share of the predicted error that remains. Args: covariance before and after, (A, 4, 4)."""
    return np.asarray(np.linalg.solve(before, after).transpose(0, 2, 1))  # both are symmetric


def combined(first: Floats, second: Floats, cross: Floats) -> tuple[Floats, Floats]:
    """Fuse two tracks whose errors are dependent: x = x_first + K (x_second - x_first).

    Args: covariances of both, and C, (A, 4, 4). Zero C: fusion of independent tracks.
    Returns: K, (A, 4, 4); covariance of x, (A, 4, 4).
    Source: Y. Bar-Shalom and L. Campo, The effect of the common process noise on the two-sensor fused-track covariance, 1986.
    """
    own = first - cross
    total = own + second - cross.transpose(0, 2, 1)
    gain = np.asarray(np.linalg.solve(total, own.transpose(0, 2, 1)).transpose(0, 2, 1))  # the total is symmetric
    covariance = first - gain @ own.transpose(0, 2, 1)
    return gain, 0.5 * (covariance + covariance.transpose(0, 2, 1))


def geometric_mean(first: Floats, second: Floats) -> Floats:
    """A^1/2 (A^-1/2 B A^-1/2)^1/2 A^1/2 of each pair of covariances. Args: A, B: (A, 4, 4). Returns: (A, 4, 4).

    Source: R. Bhatia, Positive Definite Matrices, 2007, section 4.1.
    """
    root, inverse = _power(first, 0.5), _power(first, -0.5)
    return np.asarray(root @ _power(inverse @ second @ inverse, 0.5) @ root)


def _power(matrix: Floats, exponent: float) -> Floats:
    """A power of each symmetric, positive definite matrix."""
    value, vector = np.linalg.eigh(matrix)
    return np.asarray((vector * value[:, None, :] ** exponent) @ vector.transpose(0, 2, 1))


def positive(matrix: Floats) -> Bools:
    """Whether each symmetric matrix is positive definite. Args: (A, d, d). Returns: (A,)."""
    try:
        np.linalg.cholesky(matrix)
    except np.linalg.LinAlgError:
        return np.asarray(np.linalg.eigvalsh(matrix)[:, 0] > 0.0)
    return np.ones(len(matrix), np.bool_)


@dataclass(frozen=True, eq=False)
class CrossCovariances:
    """C of A pairs of tracks at one time, and what the next step needs of their tracks."""

    first_id: Ints  # (A,)
    second_id: Ints  # (A,)
    cross: Floats  # (A, 4, 4)
    first: Floats  # (A, 4, 4) covariance
    second: Floats  # (A, 4, 4)
    updated_s: Floats  # (A, 2) newest measurement of each
    time_s: float

    @staticmethod
    def empty() -> CrossCovariances:
        """No pair."""
        none, matrices = np.zeros(0, np.int64), np.zeros((0, 4, 4))
        return CrossCovariances(none, none, matrices, matrices, matrices, np.zeros((0, 2)), 0.0)

    def advanced(
        self, track_id: Ints, covariance: Floats, updated_s: Floats, pairs: tuple[Ints, Ints], time_s: float, noise: float
    ) -> CrossCovariances:
        """C of these pairs one cycle later. It is 0 for a pair that was not there before.

        Args:
            track_id: (N,), each once; covariance: (N, 4, 4), finite for tracks in pairs; updated_s: (N,) of the newest measurement.
            pairs: rows of the first and second track, (A,) each, each pair once. noise: as in `predicted`.
        """
        first, second = pairs
        count = len(track_id)
        rows = index_of(track_id, self.first_id).astype(np.int64), index_of(track_id, self.second_id).astype(np.int64)
        here = np.flatnonzero((rows[0] >= 0) & (rows[1] >= 0))
        at = index_of(rows[0][here] * count + rows[1][here], np.asarray(first * count + second))
        known = np.flatnonzero(at >= 0)
        before, dt = here[at[known]], np.full(len(known), time_s - self.time_s)
        cross = np.zeros((len(first), 4, 4))
        cross[known] = predicted(self.cross[before], dt, noise)
        for side, (rows_now, covariances) in enumerate(((first, self.first), (second, self.second))):
            row, old = rows_now[known], covariances[before]
            some = np.flatnonzero(updated_s[row] != self.updated_s[before, side])
            share = remaining(predicted(old[some], dt[some], noise), covariance[row[some]])
            kept = cross[known[some]]
            cross[known[some]] = kept @ share.transpose(0, 2, 1) if side else share @ kept
        newest = np.column_stack([updated_s[first], updated_s[second]])
        ids, own = (track_id[first], track_id[second]), (covariance[first], covariance[second])
        return CrossCovariances(*ids, cross, *own, newest, float(time_s))
