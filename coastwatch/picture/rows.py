"""The rows of the picture: vessels with tracks, and those without, moved on in straight motion."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from coastwatch import kernels
from coastwatch.batches import Array, Flag, FusedTracks, Picture, Rows, Tracks
from coastwatch.kernels.threads import in_blocks
from coastwatch.picture.known import Known, columns, few, unwritten
from coastwatch.picture.succession import Heirs, LineUp

if TYPE_CHECKING:
    from coastwatch.picture.identity import Identity

Past = tuple[Array, Array]
"""A column of the shown and of the hidden of the last cycle."""


def unnamed(vessels: Rows, heirs: Heirs, tracks: Tracks, fused: FusedTracks) -> Picture:
    """Rows of these vessels, which are nobody of the last cycle; the id is still open."""
    out = unwritten(np.full(len(vessels), -1, np.int64))
    none = np.zeros(0), np.zeros(0)
    _write(vessels, none, (none[0].astype(np.int64),) * 2, heirs, tracks, fused, out)
    return out


def pictured(
    settings: Identity, known: Known, heirs: Heirs, line: LineUp, tracks: Tracks, fused: FusedTracks, time_s: float
) -> tuple[Picture, Picture]:
    """The rows that are shown, of which the flags are still open but COASTING, and those that are hidden."""
    shown, hidden = unwritten(line.vessel_id), unwritten(line.hidden_id)
    _write(line.come, known.past("since_s"), known.past("mmsi"), heirs, tracks, fused, shown)
    lost, split = few(line.come < 0), len(known.shown)
    for slots, rows, out in (
        (-1 - line.come[lost], lost, shown),
        (line.hidden, np.arange(len(hidden), dtype=np.int32), hidden),
    ):
        later = slots >= split
        for part, mine, first in ((known.shown, ~later, 0), (known.hidden, later, split)):
            _coast(settings, part, slots[mine] - first, rows[mine], time_s, out)
    return shown, hidden


def moved_on(settings: Identity, vessels: Picture, time_s: float) -> Picture:
    """Vessels at a later time in straight motion, with the growth of their uncertainty, and flagged as coasting."""
    out, everyone = unwritten(vessels.vessel_id), np.arange(len(vessels), dtype=np.int32)
    _coast(settings, vessels, everyone, everyone, time_s, out)
    return out


def _write(come: Rows, since: Past, mmsi: Past, heirs: Heirs, tracks: Tracks, fused: FusedTracks, out: Picture) -> None:
    """The rows of vessels with tracks, into `out`; what comes from a slot with a past keeps since and MMSI."""

    of_fused = fused.time_s, fused.position_deg, fused.velocity_m_s, fused.covariance
    of_tracks = tracks.started_s, tracks.updated_s, tracks.mmsi, tracks.origin
    given = heirs.chosen, (since, mmsi), columns(out)
    in_blocks(kernels.identity.picture_columns.present, len(come), come, heirs.start, heirs.row, of_fused, of_tracks, *given)


def _coast(settings: Identity, vessels: Picture, of: Rows, rows: Rows, time_s: float, out: Picture) -> None:
    """Rows of vessels without tracks, into `out`."""

    how = float(time_s), settings.drift_m_s15**2, int(Flag.COASTING), columns(out)
    in_blocks(kernels.identity.picture_columns.coasting, len(of), columns(vessels), of, rows, *how)
