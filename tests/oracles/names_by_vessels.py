"""Who keeps a former MMSI, and what AIS elsewhere says against it, one vessel after the other. What it says is the measure."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coastwatch.batches import Flag, Picture, Sensors, SourceKind, Tracks
from coastwatch.geodesy import difference_m
from coastwatch.picture import Identity


@dataclass
class Past:
    """The newest AIS of a vessel."""

    mmsi: int
    track_id: int
    heard_s: float
    paired_since_s: float
    elsewhere_since_s: float
    ended: bool

    def was_paired(self, settings: Identity) -> bool:
        return self.heard_s - self.paired_since_s >= settings.paired_s


class Names:
    """What tracks say of the vessels of a cycle, and the memory after it."""

    def __init__(
        self, before: dict[int, Past], kept: Picture, tracks: Tracks, of_track: np.ndarray, sensors: Sensors, time_s: float
    ) -> None:
        self.has_radar, heard, naming, self.live = set(), {}, {}, {}
        columns = tracks.source, tracks.mmsi, tracks.track_id, of_track, tracks.updated_s
        for source, mmsi, track_id, vessel, updated_s in zip(*(column.tolist() for column in columns), strict=True):
            if sensors.source_kinds[source] == SourceKind.RADAR:
                self.has_radar.add(vessel)
            else:
                heard[vessel] = max(heard.get(vessel, -np.inf), updated_s)
                self.live.setdefault(mmsi, set()).add(vessel)
                naming[vessel] = track_id
        self.heard, self.past = heard, {}
        for vessel, mmsi in zip(kept.vessel_id.tolist(), kept.mmsi.tolist(), strict=True):
            old = before.get(vessel)
            if vessel in heard:
                goes_on = old is not None and old.mmsi == mmsi and old.elsewhere_since_s == np.inf
                since_s = min(old.paired_since_s, time_s) if goes_on else time_s
                since_s = since_s if vessel in self.has_radar else np.inf
                self.past[vessel] = Past(mmsi, naming[vessel], heard[vessel], since_s, np.inf, False)
            elif old is not None:
                elsewhere_s = min(old.elsewhere_since_s, time_s) if old.mmsi in self.live else old.elsewhere_since_s
                ended = old.ended or (old.elsewhere_since_s == np.inf and old.track_id not in tracks.track_id)
                self.past[vessel] = Past(old.mmsi, old.track_id, old.heard_s, old.paired_since_s, elsewhere_s, ended)

    def lose(self, kept: Picture) -> np.ndarray:
        """Which of the known vessels lose their former MMSI."""
        out, best = np.zeros(len(kept), bool), {}
        for k, (vessel, mmsi) in enumerate(zip(kept.vessel_id.tolist(), kept.mmsi.tolist(), strict=True)):
            if mmsi < 0 or vessel in self.heard:
                continue
            if mmsi in self.live:
                out[k] = True
                continue
            rank = -self.past[vessel].heard_s, vessel
            if mmsi not in best or rank < best[mmsi][0]:
                best[mmsi] = rank, k
            out[k] = True
        for _, k in best.values():
            out[k] = False
        return out

    def flags(self, settings: Identity, shown: Picture, time_s: float) -> np.ndarray:
        """MMSI_TWICE and AIS_CONTRADICTED that follow from names."""
        row = {vessel: k for k, vessel in enumerate(shown.vessel_id.tolist())}
        out = np.zeros(len(shown), np.int64)
        for vessels in self.live.values():
            if len(vessels) > 1:
                out[[row[vessel] for vessel in vessels]] |= int(Flag.MMSI_TWICE)
        for vessel, past in self.past.items():
            since_s = time_s - past.elsewhere_since_s
            if vessel not in row or vessel in self.heard or vessel not in self.has_radar or not past.was_paired(settings):
                continue
            if not past.ended or not 0.0 <= since_s <= settings.contradicted_for_s:
                continue
            for other in self.live.get(past.mmsi, ()):
                apart = difference_m(shown.position_deg[[row[other]]], shown.position_deg[[row[vessel]]])
                if np.linalg.norm(apart) >= settings.taken_from_m:
                    out[[row[vessel], row[other]]] |= int(Flag.AIS_CONTRADICTED)
        return out
