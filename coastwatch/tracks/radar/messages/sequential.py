"""Method A of Hem and Brekke: each AIS message at its own time."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np

from coastwatch import kernels
from coastwatch.batches import Messages
from coastwatch.geodesy import KNOT_M_S
from coastwatch.tracks.radar.messages.settings import MessageSettings
from coastwatch.tracks.radar.messages.weighing import columns_of, near, take_at_once
from coastwatch.tracks.radar.parts import Parts
from coastwatch.tracks.radar.table import RadarMemory, Table


class Sequential(MessageSettings):
    """AIS messages as measurements, each at its own time: method A of Hem and Brekke.

    A track says whose messages are in it (`Tracks.held_mmsi`), so that its AIS track is not fused with it again.
    """

    method: Literal["sequential"] = "sequential"

    def take(self, parts: Parts, memory: RadarMemory, messages: Messages, until_s: float) -> RadarMemory:
        """The memory after these messages. Messages whose gates have no track in common are taken together."""
        for some in rounds(parts, self, memory.table, messages):
            memory = take_at_once(parts, self, memory, some)
        return memory


def rounds(parts: Parts, rules: MessageSettings, table: Table, messages: Messages) -> list[Messages]:
    """The messages that are taken at once, in turn: each later than those before it that share a track or an id with it."""
    batch, count = columns_of(messages), len(messages)
    pairs = near(parts, table, batch)
    ids, name = np.unique(messages.mmsi, return_inverse=True)
    reach_m = parts.existence.max_speed_kn * KNOT_M_S * float(np.ptp(batch.time))
    reach_m += math.sqrt(2.0 * rules.limit * float(batch.covariance.max()))
    from scipy.spatial import cKDTree  # slow to import, and few runs use it

    close = cKDTree(batch.position).query_pairs(reach_m, output_type="ndarray")  # one may begin a track that the other is of
    message = np.concatenate([pairs.plot, np.arange(count)])
    node = np.concatenate([len(ids) + pairs.track, name])
    order, by_later = np.argsort(message, kind="stable"), np.lexsort(close.T)
    find = kernels.tracks.message_clusters.rounds
    turn = find(count, message[order], node[order], len(ids) + len(table.track_id), close[by_later].astype(np.int64))
    return [messages.take(np.flatnonzero(turn == number)) for number in range(int(turn.max(initial=-1)) + 1)]
