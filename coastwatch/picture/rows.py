"""The rows of the picture: vessels with tracks, and those without, moved on in straight motion."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from coastwatch.batches import Flag, FusedTracks, Picture, Rows, Tracks
from coastwatch.kernels.threads import in_blocks
from coastwatch.picture.known import Known, columns, few, unwritten
from coastwatch.picture.succession import Heirs, LineUp

if TYPE_CHECKING:
    from coastwatch.picture.identity import Identity


def unnamed(vessels: Rows, heirs: Heirs, tracks: Tracks, fused: FusedTracks) -> Picture:
    """Rows of these vessels, which are nobody of the last cycle; the id is still open."""
    out = unwritten(np.full(len(vessels), -1, np.int64))
    _write(vessels, Known.nobody(), heirs, tracks, fused, out)
    return out


def pictured(
    settings: Identity, known: Known, heirs: Heirs, line: LineUp, tracks: Tracks, fused: FusedTracks, time_s: float
) -> tuple[Picture, Picture]:
    """The rows that are shown, of which the flags are still open but COASTING, and those that are hidden."""
    shown, hidden = unwritten(line.vessel_id), unwritten(line.hidden_id)
    _write(line.come, known, heirs, tracks, fused, shown)
    lost = few(line.come < 0)
    _coast(settings, known, -1 - line.come[lost], lost, time_s, shown)
    _coast(settings, known, line.hidden, np.arange(len(hidden), dtype=np.int32), time_s, hidden)
    return shown, hidden


def moved_on(settings: Identity, vessels: Picture, time_s: float) -> Picture:
    """Vessels at a later time in straight motion, with the growth of their uncertainty, and flagged as coasting."""
    out, everyone = unwritten(vessels.vessel_id), np.arange(len(vessels), dtype=np.int32)
    _coast(settings, Known(vessels, Picture.empty(), np.zeros(0, np.int64)), everyone, everyone, time_s, out)
    return out


def _write(come: Rows, known: Known, heirs: Heirs, tracks: Tracks, fused: FusedTracks, out: Picture) -> None:
    """The rows of vessels with tracks, into `out`; what comes from a slot with a past keeps since and MMSI."""
    from coastwatch.kernels.vessel_rows import present

    of_fused = fused.time_s, fused.position_deg, fused.velocity_m_s, fused.covariance
    of_tracks = tracks.started_s, tracks.updated_s, tracks.mmsi, tracks.origin
    given = heirs.chosen, (known.past("since_s"), known.past("mmsi")), columns(out)
    in_blocks(present, len(come), come, heirs.start, heirs.row, of_fused, of_tracks, *given)


def _coast(settings: Identity, known: Known, slots: Rows, rows: Rows, time_s: float, out: Picture) -> None:
    """The rows of vessels without tracks, into `out`."""
    from coastwatch.kernels.vessel_rows import coasting

    how = float(time_s), settings.drift_m_s15**2, int(Flag.COASTING), columns(out)
    split = len(known.shown)
    for part, mine, first in ((known.shown, slots < split, 0), (known.hidden, slots >= split, split)):
        of, to = slots[mine] - first, rows[mine]
        in_blocks(coasting, len(of), columns(part), of, to, *how)
