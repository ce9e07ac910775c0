"""`CentralImm` one vessel after the other, with a dictionary of filters: what its arrays must equal. The filter is the same kernel.

Nothing is learnt here.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from fused_by_arrays import intersection

from coastwatch.batches import Floats, FusedTracks, Ints, Measurements, SourceKind, Tracks
from coastwatch.fused_tracks import CentralImm
from coastwatch.fused_tracks.central_imm import LEAST_GAIN, LESS_CERTAIN, MODELS, SEARCH_STEPS
from coastwatch.geodesy import difference_m, offset_deg
from coastwatch.kernels.filters.fused_filters import Alternatives, TimedMeasurements, estimate, update


@dataclass
class Filter:
    """One filter in the plane at its anchor."""

    anchor_deg: Floats
    arrays: tuple[Floats, ...]  # state (1, J, 5), covariance (1, J, 5, 5), mode probability (1, J), times (1,)
    tracks: set[int]  # that were in it in the last cycle


class ByVessels:
    """The memory and the step of the method."""

    def __init__(self, settings: CentralImm) -> None:
        self.settings = settings
        self.filters: list[Filter] = []

    def step(self, tracks: Tracks, measured: Measurements, vessel: Ints, time_s: float, kinds: Ints) -> FusedTracks:
        """One estimate a vessel."""
        covariance = tracks.known_covariance(self.settings.unknown_velocity_sigma_m_s)
        alive, filters, rows = set(tracks.track_id.tolist()), [], []
        for v in range(int(vessel.max(initial=-1)) + 1):
            mine = np.flatnonzero(vessel == v)
            here = np.isin(measured.track_id, tracks.track_id[mine])
            old = self._continued(tracks.take(mine), measured.take(here), alive)
            out = tracks.position_deg[mine[0]], tracks.velocity_m_s[mine[0]], covariance[mine[0]]
            of = kinds[tracks.source[mine]]
            if old is not None:
                self._update(old, measured.take(here), SourceKind.AIS in of)
                seen = self._estimate(old, time_s)
                out = seen if len(mine) > 1 or SourceKind.RADAR in of else out
                filters.append(Filter(old.anchor_deg, old.arrays, set(tracks.track_id[mine].tolist())))
            elif len(mine) > 1:
                made = intersection(tracks.take(mine), covariance[mine], np.zeros(len(mine), np.int64), SEARCH_STEPS)
                out = made[0][0], made[1][0], made[2][0]
                filters.append(self._new(out, time_s, set(tracks.track_id[mine].tolist())))
            known = mine[(of == SourceKind.AIS) & np.isfinite(tracks.covariance[mine, 0, 0])]
            if len(known):
                k = min(known, key=lambda k: np.trace(tracks.covariance[k, :2, :2]))
                if self._contradicts(out, tracks.take(np.array([k]))):
                    out = tracks.position_deg[k], tracks.velocity_m_s[k], tracks.covariance[k]
            rows.append(out)
        self.filters = filters
        if not rows:
            return FusedTracks.empty()
        return FusedTracks(np.full(len(rows), time_s), *(np.array(column) for column in zip(*rows, strict=True)))

    def _continued(self, tracks: Tracks, measured: Measurements, alive: set[int]) -> Filter | None:
        """The filter with which a vessel goes on: all of whose living tracks it has, with no track of another, and no update unmeasured."""
        ids = set(tracks.track_id.tolist())
        found = [f for f in self.filters if f.tracks & ids]
        if len(found) != 1 or (found[0].tracks & alive) - ids:
            return None
        newest = max([*measured.time_s.tolist(), float(found[0].arrays[3][0])])
        return found[0] if tracks.updated_s.max() <= newest else None

    def _update(self, old: Filter, m: Measurements, has_ais: bool) -> None:
        m = m.take(np.lexsort((m.sensor, m.time_s)))
        z, noise = np.empty((len(m), 4)), np.zeros((len(m), 4, 4))
        for k in range(len(m)):
            z[k, :2], z[k, 2:] = difference_m(m.position_deg[k], old.anchor_deg), m.velocity_m_s[k]
            noise[k, :2, :2], noise[k, 2:, 2:] = m.covariance[k, :2, :2], m.covariance[k, 2:, 2:]
            if has_ais and m.sensor[k] >= 0:
                beam = difference_m(m.position_deg[k], m.site_deg[k])
                along = beam / max(float(np.hypot(*beam)), 1.0)
                across = np.array([-along[1], along[0]])
                for share, axis in ((self.settings.range_registration, along), (self.settings.azimuth_registration, across)):
                    noise[k, :2, :2] += share * (axis @ m.covariance[k, :2, :2] @ axis) * np.outer(axis, axis)
        old.arrays = tuple(part.copy() for part in old.arrays)
        doubt = np.where(has_ais & (m.sensor >= 0), self.settings.plot_doubt, np.inf)
        measured = TimedMeasurements(m.time_s, z, noise, doubt, np.isfinite(z[:, 2]) | (not has_ais))
        compared = Alternatives(np.ones(1), np.ones(1))
        update(0, 1, old.arrays, measured, np.array([0, len(m)]), self._models(), compared, np.zeros((1, 2)))

    def _models(self) -> Any:
        return self.settings._models(self.settings.init().evidence)

    def _contradicts(self, fused: tuple[Floats, Floats, Floats], ais: Tracks) -> bool:
        """Whether an estimate is farther from an AIS track than the difference of their covariances lets it, or less certain."""
        of_ais, of_fused = max(ais.covariance[0, :2, :2], ais.report_covariance[0], key=np.trace), fused[2][:2, :2]
        variance, axes = np.linalg.eigh(of_ais - of_fused)
        along = axes.T @ difference_m(ais.position_deg[0], fused[0])
        distance = np.sum(along**2 / np.maximum(variance, LEAST_GAIN * np.trace(of_ais) / 2.0))
        return bool(distance > self.settings.ais_doubt or np.trace(of_fused) > LESS_CERTAIN * np.trace(of_ais))

    def _estimate(self, old: Filter, time_s: float) -> tuple[Floats, Floats, Floats]:
        mean, covariance = np.empty((1, 5)), np.empty((1, 5, 5))
        estimate(0, 1, old.arrays, time_s, self._models(), mean, covariance)
        old.anchor_deg = offset_deg(old.anchor_deg, mean[0, :2])
        old.arrays[0][0, :, :2] -= mean[0, :2]
        return old.anchor_deg, mean[0, 2:4], covariance[0, :4, :4]

    def _new(self, first: tuple[Floats, Floats, Floats], time_s: float, ids: set[int]) -> Filter:
        state, covariance = np.zeros((1, MODELS, 5)), np.zeros((1, MODELS, 5, 5))
        state[0, :, 2:4], covariance[0, :, :4, :4] = first[1], first[2]
        covariance[0, :, 4, 4] = np.radians(self.settings.turn_rate_sigma_deg_s) ** 2
        mode = np.array(self.settings.share)[None] / sum(self.settings.share)
        return Filter(first[0], (state, covariance, mode, np.array([time_s]), np.array([time_s])), ids)
