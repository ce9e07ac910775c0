"""What AIS says of vessels beside their motion: navigational status, and the flags that follow from it and from the MMSI."""

from __future__ import annotations

import numpy as np

from coastwatch import kernels
from coastwatch.batches import AisAlarms, Flag, Ints, NavStatus, Tracks
from coastwatch.batches.ais_codes import AIS_SART, EPIRB, MAN_OVERBOARD, is_vessel


def nav_statuses(before: Ints, tracks: Tracks, row_of_track: Ints, alarms: AisAlarms) -> Ints:
    """The navigational status of each vessel: of its newest AIS report, or as it was before where it has no AIS now. (R,)

    Args: before: (R,) -1: none was sent; row_of_track: (N,) of the picture; alarms: with the status of each AIS track.
    """
    ais = np.flatnonzero(tracks.mmsi >= 0)
    at = kernels.tables.match_ids.index_of(alarms.track_id, tracks.track_id[ais])
    out, has_status = before.copy(), at >= 0
    out[row_of_track[ais[has_status]]] = alarms.nav_status[at[has_status]]
    return out


def ais_flags(mmsi: Ints, nav_status: Ints) -> Ints:
    """The flags that follow from an MMSI and a navigational status. Args: (R,) -1: none. Returns: (R,)"""
    device = mmsi // 1_000_000
    when = {
        Flag.ODD_MMSI: (mmsi >= 0) & ~is_vessel(mmsi),
        Flag.AIS_SART: (device == AIS_SART)
        | ((nav_status == NavStatus.AIS_SART_ACTIVE) & (device != MAN_OVERBOARD) & (device != EPIRB)),
        Flag.MAN_OVERBOARD: device == MAN_OVERBOARD,
        Flag.EPIRB: device == EPIRB,
        Flag.NOT_UNDER_COMMAND: nav_status == NavStatus.NOT_UNDER_COMMAND,
        Flag.AGROUND: nav_status == NavStatus.AGROUND,
    }
    out = np.zeros(len(mmsi), np.int64)
    for flag, holds in when.items():
        out[holds] |= int(flag)
    return out
