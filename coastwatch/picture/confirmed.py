"""Which vessels are shown, where a region sees them alone that a radar of another region should see too.

A region is judged if each of its radars reaches no farther than one radar of another region: that radar sees every place it sees.
A vessel with a track of any source that is not judged is shown. A vessel of judged tracks alone is shown while other sources
confirmed one of them for a share of its time, or those of its region before it:

    (b + w p) / (a + b + w) >= confirmed_share,  p = (B + w / 2) / (A + B + w)

a and b are the times of the track alone and in one vessel with a track of another source, A and B the sums over the tracks of its
region, w is `confirm_s`. So a second radar that tracks quays and wakes adds no vessel, and one whose tracks others confirm does.
It is off by default: where land hides a place from the wider radar, a vessel without AIS would be hidden too.
Source: W. James, C. Stein, Estimation with quadratic loss, 1961 (a share is drawn to that of its group).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coastwatch.batches import Bools, Floats, Ints, Sensors, Struct, Tracks, column
from coastwatch.geodesy import difference_m
from coastwatch.kernels.tables.match_ids import index_of
from coastwatch.picture.settings import IdentitySettings


@dataclass(frozen=True, eq=False)
class Confirmations(Struct):
    """For how long other sources confirmed the tracks of judged regions."""

    track_id: Ints = column(np.int64, "L")
    track_s: Floats = column(np.float64, "L", 2)  # alone, confirmed
    source_s: Floats = column(np.float64, "S", 2)  # the same, of all tracks of each source so far
    time_s: Floats = column(np.float64, "C")  # of the last cycle; empty before the first


def judged_regions(sensors: Sensors) -> Bools:
    """Which regions are judged: each of their radars reaches only where one radar of another region does. (regions,)"""
    r, count = sensors.radars, len(sensors.region_names)
    one, other = np.indices((len(r), len(r))).reshape(2, -1)
    apart_m = np.hypot(*difference_m(r.site_deg[one], r.site_deg[other]).T)
    within = (r.region[one] != r.region[other]) & (apart_m + r.range_m[one] < r.range_m[other])
    is_within = np.bincount(one[within], minlength=len(r)) > 0
    free = np.bincount(r.region[~is_within], minlength=count)
    judged: Bools = (np.bincount(r.region, minlength=count) > 0) & (free == 0)
    return judged


def confirm(
    settings: IdentitySettings,
    before: Confirmations,
    tracks: Tracks,
    row_of_track: Ints,
    rows: int,
    time_s: float,
    sensors: Sensors,
) -> tuple[Confirmations, Bools]:
    """The memory after a cycle, and which vessels are shown. (R,)

    Args: row_of_track: (N,) of the picture, of `rows` vessels.
    """
    shown = np.ones(rows, np.bool_)
    if settings.confirmed_share == 0.0 or len(sensors.region_names) < 2:
        return before, shown
    regions = judged_regions(sensors)
    if not regions.any():
        return before, shown
    judged = np.append(regions, np.zeros(sensors.ais_source + 1 - len(regions), np.bool_))[tracks.source]
    mine = np.flatnonzero(judged)
    row, source = row_of_track[mine], tracks.source[mine]
    passed_s = min(time_s - float(before.time_s[0]), settings.confirm_s) if len(before.time_s) else 0.0
    first, last = np.full(rows, len(sensors.source_names)), np.full(rows, -1)
    np.minimum.at(first, row_of_track, tracks.source)
    np.maximum.at(last, row_of_track, tracks.source)
    confirmed = first[row] < last[row]
    now_s = passed_s * np.column_stack([~confirmed, confirmed])
    at = index_of(before.track_id, tracks.track_id[mine])
    track_s = np.concatenate([before.track_s, np.zeros((1, 2))])[at] + now_s
    source_s = before.source_s.copy() if len(before.source_s) else np.zeros((len(regions), 2))
    np.add.at(source_s, source, now_s)
    weight = settings.confirm_s
    prior = (source_s[:, 1] + 0.5 * weight) / (source_s.sum(axis=1) + weight)
    confirmed_share = (track_s[:, 1] + weight * prior[source]) / (track_s.sum(axis=1) + weight)
    shown[row] = False
    shown[row_of_track[~judged]] = True
    shown[row[confirmed | (confirmed_share >= settings.confirmed_share)]] = True
    return Confirmations(tracks.track_id[mine], track_s, source_s, np.array([time_s])), shown
