"""Which filters of vessels go on from one cycle to the next, and what they are told."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from coastwatch import kernels
from coastwatch.batches import Floats, Ints, Measurements, Rows, Tracks
from coastwatch.fused_tracks.membership import Grouped
from coastwatch.kernels.threads import in_blocks


class Going(NamedTuple):
    """What becomes of the filters."""

    going: Rows  # (G,) vessels whose filters go on, which are the first filters of this cycle
    of: Rows  # (G,) the filters of the last cycle with which they do
    begins: Rows  # (B,) vessels of several tracks whose filters begin: the filters after those
    filter_of: Rows  # (N,) of each track, -1 where none
    heard_row: Rows  # (M,) the track of each measurement, -1 where it is not among them


def continuity(
    known_id: Ints, known_row: Rows, newest_s: Floats, groups: Grouped, vessel: Ints, tracks: Tracks, measured: Measurements
) -> Going:
    """Filters that have heard of one vessel only, as far as is known now, and of all that its tracks were updated with, go on.

    Args: known_id, known_row: (L,) the tracks of the last cycle and the filter of each; newest_s: (F,) of each filter.
    """

    at = kernels.tables.match_ids.index_of(known_id, tracks.track_id)
    heard_row = kernels.tables.match_ids.index_of(tracks.track_id, measured.track_id)
    was = kernels.filters.fused_filters.former(at, known_row, len(newest_s), heard_row, measured.time_s)
    of = np.empty(len(groups), np.int32)
    in_blocks(kernels.filters.fused_filters.going_on, len(groups), *groups, *was, tracks.updated_s, newest_s, of)
    going, begins = (np.flatnonzero(which).astype(np.int32) for which in (of >= 0, (of < 0) & (np.diff(groups.start) > 1)))
    filter_of = np.full(len(groups), -1, np.int32)
    filter_of[going] = np.arange(len(going))
    filter_of[begins] = len(going) + np.arange(len(begins))
    return Going(going, of[going], begins, filter_of[vessel], heard_row)
