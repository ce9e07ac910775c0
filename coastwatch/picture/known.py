"""What is known of the vessels of the last cycle, each named by a slot: the shown, then the hidden, then those that only are a home."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coastwatch import kernels
from coastwatch.batches import Array, Bools, Floats, Ints, Picture, Rows

Columns = tuple[Floats, Floats, Floats, Floats, Floats, Floats, Ints, Ints, Ints]


@dataclass(frozen=True, eq=False)
class Known:
    """Vessels that may come back under their ids."""

    shown: Picture  # as shown in the last cycle, sorted by id
    hidden: Picture  # shown no longer; they may come back by name or by place
    gone_id: Ints  # (G,) merged into others or forgotten; they may come back while a track lives that was first in them

    @staticmethod
    def nobody() -> Known:
        return Known(Picture.empty(), Picture.empty(), np.zeros(0, np.int64))

    def __len__(self) -> int:
        """Rows with a past: those of `shown` and `hidden`, which come first."""
        return len(self.shown) + len(self.hidden)

    @property
    def ids(self) -> Ints:
        """Of every slot. (K,)"""
        return np.concatenate([self.shown.vessel_id, self.hidden.vessel_id, self.gone_id])

    def past(self, column: str) -> tuple[Array, Array]:
        """A column of the picture, of the slots with a past: of the shown and of the hidden."""
        return getattr(self.shown, column), getattr(self.hidden, column)

    def take(self, slots: Rows) -> Picture:
        """The rows of these slots, which have a past, in that order."""

        out = unwritten(np.empty(len(slots), np.int64))
        of_each = ((p.vessel_id, columns(p)) for p in (self.shown, self.hidden, out))
        kernels.identity.picture_columns.recalled_rows(slots, *of_each)
        return out


def columns(picture: Picture) -> Columns:
    """The columns but the id, as `coastwatch.kernels.identity.picture_columns` takes them."""
    p = picture
    first = p.time_s, p.position_deg, p.velocity_m_s, p.covariance, p.since_s, p.updated_s
    return *first, p.mmsi, p.flags, p.origin


def unwritten(vessel_id: Ints) -> Picture:
    """A picture of these vessels of which nothing is written yet."""
    n = len(vessel_id)
    floats = np.empty(n), np.empty((n, 2)), np.empty((n, 2)), np.empty((n, 4, 4)), np.empty(n), np.empty(n)
    return Picture(vessel_id, *floats, *(np.empty(n, np.int64) for _ in range(3)))


def few(mask: Bools) -> Rows:
    """Where a mask is set."""
    return np.flatnonzero(mask).astype(np.int32)
