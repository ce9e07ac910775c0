"""AIS tracks on the echoes of large ships. Until a ship has sent the place of its antenna, radar and AIS are far apart."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from coastwatch.batches import Floats, Ints, Measurements, SourceKind, Tracks
from coastwatch.geodesy import difference_m, earth_centred
from coastwatch.kernels.tables.lookup import row_of

LARGE_M = 50.0
"""Length of the shortest echo on which the place of the antenna matters."""

BESIDE_M = 15.0
"""Beyond the ends and sides of an echo, for its errors."""

FAR_M = 25.0
"""From the middle of its echo on, an AIS track counts less in its vessel."""


@dataclass(frozen=True, eq=False)
class OnEchoes:
    """Each AIS track that is the only one on the echo of a large ship."""

    ais: Ints  # (K,) row
    echo: Ints  # (K,) row of the radar track
    off_m: Floats  # (K, 2) east and north from the middle of the echo

    def at_middles(self, tracks: Tracks) -> Tracks:
        """The tracks for comparison, with each AIS track at the middle of its echo: the antenna may be anywhere on a hull."""
        position_deg = tracks.position_deg.copy()
        position_deg[self.ais] = tracks.position_deg[self.echo]
        return replace(tracks, position_deg=position_deg)

    def inflated(self, tracks: Tracks, measurements: Measurements) -> tuple[Tracks, Measurements]:
        """Tracks and measurements for fusion: an AIS track errs by its distance from the middle, where that is `FAR_M` or more."""
        far = np.hypot(*self.off_m.T) >= FAR_M
        if not far.any():
            return tracks, measurements
        rows, added = self.ais[far], self.off_m[far, :, None] * self.off_m[far, None, :]
        covariance = tracks.covariance.copy()
        covariance[rows, :2, :2] += added
        row = row_of(tracks.track_id[rows], measurements.track_id)
        measured, mine = measurements.covariance.copy(), np.flatnonzero(row >= 0)
        measured[mine, :2, :2] += added[row[mine]]
        return replace(tracks, covariance=covariance), replace(measurements, covariance=measured)


def antennas_on_echoes(tracks: Tracks, kinds: Ints) -> OnEchoes:
    """The AIS tracks on echoes of large ships. Args: kinds: (K,) SourceKind of each source.

    By ITU-R M.1371-5, table 1, a ship sends its size and the place of its antenna each six minutes, and at anchor its position each three.
    """
    is_ais = kinds[tracks.source] == SourceKind.AIS
    echo, ais = np.flatnonzero(~is_ais & (tracks.echo_length_m >= LARGE_M)), np.flatnonzero(is_ais)
    if not (len(echo) and len(ais)):
        return OnEchoes(ais[:0], ais[:0], np.zeros((0, 2)))
    from scipy.spatial import cKDTree

    half_m = 0.5 * tracks.echo_length_m + BESIDE_M
    echoes, antennas = (cKDTree(earth_centred(tracks.position_deg[rows])) for rows in (echo, ais))
    near = echoes.sparse_distance_matrix(antennas, float(half_m[echo].max()), output_type="ndarray")
    first, second = echo[near["i"]], ais[near["j"]]
    off_m, axis = difference_m(tracks.position_deg[second], tracks.position_deg[first]), np.radians(tracks.echo_axis_deg[first])
    across_m = np.abs(off_m[:, 0] * np.cos(axis) - off_m[:, 1] * np.sin(axis))
    along_m = np.abs(off_m[:, 0] * np.sin(axis) + off_m[:, 1] * np.cos(axis))
    width_m = np.nan_to_num(tracks.echo_width_m[first])
    on = (along_m <= half_m[first]) & (across_m <= 0.5 * width_m + BESIDE_M)
    first, second, off_m = first[on], second[on], off_m[on]
    alone = (np.bincount(first, minlength=len(tracks))[first] == 1) & (np.bincount(second, minlength=len(tracks))[second] == 1)
    return OnEchoes(second[alone], first[alone], off_m[alone])
