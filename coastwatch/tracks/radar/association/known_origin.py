"""Association by the known origin of plots, as simulations have it."""

from __future__ import annotations

from typing import ClassVar, Literal

import numpy as np

from coastwatch import kernels
from coastwatch.batches import Bools, Ints
from coastwatch.kernels.tracks.columns import PlotColumns
from coastwatch.tracks.radar.association.nearest_neighbour import update_by_single_plots
from coastwatch.tracks.radar.parts import Parts, begin_tracks
from coastwatch.tracks.radar.plot_association import PlotAssociation
from coastwatch.tracks.radar.table import RadarMemory, Status, Table


class KnownOrigin(PlotAssociation):
    """Each plot goes to the track of the vessel that it is known to come from: the bound of what association can do. Clutter is dropped."""

    upkeep: ClassVar[str] = "hits"
    by_radar: ClassVar[bool] = False
    method: Literal["known_origin"] = "known_origin"

    def track_batch(self, parts: Parts, memory: RadarMemory, batch: PlotColumns) -> tuple[RadarMemory, Ints]:
        """Give each track its plots, and begin tracks. Returns: memory, the slot of the track that took each plot, -1 for none."""
        slot, begins = associate_by_origin(memory.table, batch)
        memory = begin_tracks(parts.bank, memory, np.flatnonzero(begins), batch)
        if begins.any():  # their later plots of this batch
            slot = np.where(begins, -1, associate_by_origin(memory.table, batch)[0])
        memory.table.status[update_by_single_plots(parts, memory.table, slot, batch)] = Status.CONFIRMED
        return memory, slot

    def end_cycle(self, parts: Parts, memory: RadarMemory, time_s: float) -> RadarMemory:
        """There are no duplicates."""
        return memory


def associate_by_origin(table: Table, batch: PlotColumns) -> tuple[Ints, Bools]:
    """The slot of the track of the vessel behind each plot, -1 for none, and the first plot of each new vessel. (M,), (M,)"""
    at = kernels.tables.match_ids.index_of(table.origins[table.live, 0], batch.origin)
    slot = np.append(table.live, -1)[at]
    unknown = np.flatnonzero((slot < 0) & (batch.origin >= 0))
    _, first = np.unique(batch.origin[unknown], return_index=True)
    begins = np.zeros(len(slot), np.bool_)
    begins[unknown[first]] = True
    return slot, begins
