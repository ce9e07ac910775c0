"""The AIS vessels that a radar is compared with: a fixed draw, because a few hundred vessels tell as much as all of them.

300 vessels give the azimuth bias to 2 % of the noise of one plot in 30 s. Evidence is kept for each vessel, so a vessel stays drawn for
as long as it has an AIS track in cover of the radar. A vessel that is lost is replaced.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from coastwatch import kernels
from coastwatch.batches import Batch, Bools, Floats, Ints, Sensors, Tracks, column
from coastwatch.geodesy import scale_m_deg, to_plane, wrap_deg

SIGMA_M = 30.0  # an AIS track whose position is less certain is no reference
SECTORS = 24  # of azimuth, over which the vessels are spread
CONSIDERED = 8  # vessels for each that is wanted, from which those in cover are spread over the sectors
WIDER = 1.25  # than its cover is the square that is looked through: a degree of longitude is shorter at its far side
Sums = TypeVar("Sums", bound=Batch)
MIX = np.uint64(0x9E3779B97F4A7C15)  # 2^64 over the golden ratio (Fibonacci hashing)


@dataclass(frozen=True, eq=False)
class References(Batch):
    """The vessels that are drawn for each radar, sorted by radar, then vessel."""

    radar: Ints = column(np.int64, "N")
    track_id: Ints = column(np.int64, "N")


@dataclass(frozen=True, eq=False)
class Compared(Batch):
    """The drawn vessels whose position is known well enough in this cycle, in the order of `References`."""

    radar: Ints = column(np.int64, "N")
    row: Ints = column(np.int64, "N")  # of the AIS tracks


def draw_references(
    former: References, tracks: Tracks, alarmed: Bools, site_deg: Floats, sensors: Sensors, count: int
) -> tuple[References, Compared]:
    """The vessels to compare with each radar, and the rows of those that can be compared now.

    Args: former: of the last cycle; tracks, alarmed: (N) of AIS; site_deg: (R, 2) of the radars, NaN for one that sent no plot: its
    vessels stay drawn and none is compared; count: of vessels for each radar, at most.
    """
    row_of_former = kernels.tables.match_ids.index_of(tracks.track_id, former.track_id).astype(np.int64)
    references, compared = [], []
    for r in range(len(sensors.radars)):
        mine = former.radar == r
        if np.isnan(site_deg[r]).any():
            references.append(former.take(mine))
            continue
        row, cover = row_of_former[mine], (site_deg[r], float(sensors.radars.range_m[r]))
        row = _in_cover(row[row >= 0], tracks, alarmed, *cover)[0]
        row = np.concatenate([row, _newly_drawn(row, tracks, alarmed, *cover, count)])
        row = row[np.argsort(tracks.track_id[row])]
        references.append(References(np.full(len(row), r, np.int64), tracks.track_id[row]))
        row = row[_is_certain(row, tracks)]
        compared.append(Compared(np.full(len(row), r, np.int64), row))
    return References.join(references), Compared.join(compared)


def _in_cover(row: Ints, tracks: Tracks, alarmed: Bools, site_deg: Floats, reach_m: float) -> tuple[Ints, Ints]:
    """Those of the rows that have no alarm and are in range, and the sector of each."""
    at = to_plane(tracks.position_deg[row], site_deg)
    good = ~alarmed[row] & (np.hypot(at[:, 0], at[:, 1]) <= reach_m)
    turn = np.arctan2(at[good, 0], at[good, 1]) / (2.0 * np.pi) % 1.0
    return row[good], np.minimum((turn * SECTORS).astype(np.int64), SECTORS - 1)


def _newly_drawn(drawn: Ints, tracks: Tracks, alarmed: Bools, site_deg: Floats, reach_m: float, count: int) -> Ints:
    """The rows of vessels to add to those drawn: the least hash first, in the sectors with the fewest vessels."""
    wanted = count - len(drawn)
    if wanted <= 0:
        return drawn[:0]
    north, east = scale_m_deg(site_deg[0])
    near = np.abs(tracks.position_deg[:, 0] - site_deg[0]) * north <= WIDER * reach_m
    near[drawn] = False
    row = np.flatnonzero(near)
    row = row[np.abs(wrap_deg(tracks.position_deg[row, 1] - site_deg[1])) * east <= WIDER * reach_m]
    if len(row) > CONSIDERED * count:
        row = row[np.argpartition(id_hash(tracks.track_id[row]), CONSIDERED * count)[: CONSIDERED * count]]
    row, sector = _in_cover(row, tracks, alarmed, site_deg, reach_m)
    certain = _is_certain(row, tracks)
    row, sector = row[certain], sector[certain]
    drawn_in_sector = np.bincount(_in_cover(drawn, tracks, alarmed, site_deg, reach_m)[1], minlength=SECTORS)
    order = np.lexsort((id_hash(tracks.track_id[row]), sector))
    row, sector = row[order], sector[order]
    size = np.bincount(sector, minlength=SECTORS)
    place = np.arange(len(row)) - np.repeat(np.cumsum(size) - size, size) + drawn_in_sector[sector]
    return row[np.lexsort((id_hash(tracks.track_id[row]), place))[:wanted]]


def _is_certain(row: Ints, tracks: Tracks) -> Bools:
    """Which of the rows have a position that is certain enough."""
    covariance = tracks.covariance[row, :2, :2]
    covariance = np.where(np.isfinite(covariance), covariance, tracks.report_covariance[row])
    certain: Bools = np.trace(covariance, axis1=1, axis2=2) <= SIGMA_M**2
    return certain


def summed_by_vessel(rows: Sums) -> Sums:
    """One row for each radar and vessel, the first two columns, sorted by both. The others are summed in the order of the rows."""
    radar, vessel, *others = (f.name for f in fields(rows))
    ids, which = np.unique(getattr(rows, vessel), return_inverse=True)
    key, group = np.unique(getattr(rows, radar) * len(ids) + which, return_inverse=True)
    sums = {name: np.zeros((len(key), *getattr(rows, name).shape[1:])) for name in others}
    for name, total in sums.items():
        np.add.at(total, group, getattr(rows, name))
    count = max(len(ids), 1)
    return type(rows)(**{radar: key // count, vessel: ids[key % count]}, **sums)


def id_hash(track_id: Ints) -> NDArray[np.uint64]:
    """A number of each vessel that has nothing to do with where it is."""
    mixed = track_id.astype(np.uint64) * MIX
    return (mixed ^ (mixed >> np.uint64(32))) * MIX
