"""What tracks were at the last W cycles: one array a cycle, never written again, and where each track stands in each."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from coastwatch import kernels
from coastwatch.batches import Floats, Ints
from coastwatch.kernels.threads import in_blocks

Rows = NDArray[np.int32]


@dataclass(frozen=True, eq=False)
class History:
    """Windows of N tracks. A cycle adds an array to the ring and drops the oldest; nothing is copied.

    Tracks are numbered by their rank: any order of a cycle. The array of a cycle is in the order of that cycle.
    """

    track_id: Ints  # (N,) as they came
    rank: Rows  # (N,) of each of them
    chain: Rows  # (N, W - 1) by rank: row in the array of the last cycle, of the one before that, ...
    length: Rows  # (N,) by rank: entries that there are, 1 to W
    ring: tuple[
        Floats, ...
    ]  # up to W arrays (any, 4), newest last, its rows by rank: entries of `kernels.rings`, latitude, longitude, velocity east and north,
    # traces of the covariances of position (m2) and velocity (m2/s2)

    @staticmethod
    def empty(window: int) -> History:
        none = np.zeros(0, np.int32)
        return History(np.zeros(0, np.int64), none, np.zeros((0, window - 1), np.int32), none, ())

    @property
    def window(self) -> int:
        """W."""
        return int(self.chain.shape[1]) + 1

    def extended(self, track_id: Ints, rank: Rows, entry: Floats, room: Callable[..., Any]) -> History:
        """The windows after this cycle; tracks that are gone are forgotten.

        Args: track_id: (N,) as they come; rank: (N,) of each, 0 to N - 1; entry: (N, 4) by rank; room: who makes arrays, as np.empty.
        """

        count = len(track_id)
        before, chain, length = np.empty(count, np.int32), room((count, self.window - 1), np.int32), room(count, np.int32)
        in_blocks(
            kernels.association.pair_features.come_from,
            count,
            rank,
            kernels.tables.match_ids.index_of(self.track_id, track_id),
            self.rank,
            before,
        )
        in_blocks(kernels.association.pair_features.carried, count, before, self.chain, self.length, chain, length)
        return History(track_id, rank, chain, length, (*self.ring, entry)[-self.window :])
