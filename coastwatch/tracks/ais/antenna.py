"""AIS positions of large ships, moved from the antenna to the middle of the hull, where radar sees the ship."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from coastwatch.batches import AisReports, AisStatics, Batch, Floats, Ints, column
from coastwatch.geodesy import offset_deg
from coastwatch.kernels.tables.lookup import find
from coastwatch.stage import Method, Positive

FORGOTTEN_S = 86_400.0  # after the newest report or size


@dataclass(frozen=True, eq=False)
class Antennas(Batch):
    """Large ships that said where their antenna is, sorted by MMSI."""

    mmsi: Ints = column(np.int64, "K")
    ahead_m: Floats = column(np.float64, "K")  # from the antenna to the middle of the hull; negative: aft
    starboard_m: Floats = column(np.float64, "K")
    since_s: Floats = column(np.float64, "K")  # when this was first known
    heard_s: Floats = column(np.float64, "K")
    heading_deg: Floats = column(np.float64, "K")  # the newest; NaN: none was sent


class HullMiddle(Method):
    """The positions of ships of `from_m` or more that send their heading and where their antenna is, moved to the middle of the hull.

    A position moves over `ramp_s`, from when the place of the antenna is known: no ship jumps. A report without heading has that of
    the one before. A ship that sends no heading stays at its antenna.
    """

    method: Literal["hull_middle"] = "hull_middle"
    from_m: Positive = 50.0  # length of the smallest ship whose positions are moved
    ramp_s: Positive = 60.0  # over which they move

    def init(self) -> Antennas:
        """No ship."""
        return Antennas.empty()

    def step(self, memory: Antennas, given: tuple[AisReports, AisStatics, float]) -> tuple[Antennas, AisReports]:
        """The reports with the positions of large ships moved. Args: given: reports, sizes that came with them, time of the cycle."""
        reports, statics, time_s = given
        known = self._with_sizes(memory, statics)
        if not len(known) or not len(reports):
            return known, reports
        row = find(known.mmsi, reports.mmsi)
        mine = np.flatnonzero(row >= 0)
        mine = mine[np.lexsort((reports.time_s[mine], row[mine]))]
        ship = row[mine]
        heading = _carried(reports.heading_deg[mine], ship, known.heading_deg)
        known = replace(known, heading_deg=known.heading_deg.copy(), heard_s=known.heard_s.copy())
        known.heading_deg[ship] = heading  # of equal rows the newest stays
        np.maximum.at(known.heard_s, ship, reports.received_s[mine])
        has_heading = np.isfinite(heading)
        mine, ship, heading = mine[has_heading], ship[has_heading], heading[has_heading]
        share = np.clip((reports.received_s[mine] - known.since_s[ship]) / self.ramp_s, 0.0, 1.0)
        sine, cosine = np.sin(np.radians(heading)), np.cos(np.radians(heading))
        ahead, starboard = share * known.ahead_m[ship], share * known.starboard_m[ship]
        position = reports.position_deg.copy()
        off_m = np.column_stack([ahead * sine + starboard * cosine, ahead * cosine - starboard * sine])
        position[mine] = offset_deg(position[mine], off_m)
        fresh = time_s - known.heard_s <= FORGOTTEN_S
        return known.take(fresh) if not fresh.all() else known, replace(reports, position_deg=position)

    def _with_sizes(self, known: Antennas, statics: AisStatics) -> Antennas:
        """The ships, with those that sent their size now. A ship keeps the time since which it is known."""
        bow, stern, port, starboard = statics.to_bow_m, statics.to_stern_m, statics.to_port_m, statics.to_starboard_m
        stated = (bow + stern >= self.from_m) & (port + starboard > 0.0) & ((bow > 0.0) | (port > 0.0))
        if not stated.any():
            return known
        some = np.flatnonzero(stated)
        mmsi, last = np.unique(statics.mmsi[some][::-1], return_index=True)
        rows = some[::-1][last]
        at = find(known.mmsi, mmsi)
        now_s = statics.received_s[rows]
        fresh = Antennas(
            mmsi=mmsi,
            ahead_m=0.5 * (bow - stern)[rows],
            starboard_m=0.5 * (starboard - port)[rows],
            since_s=np.where(at >= 0, np.append(known.since_s, 0.0)[at], now_s),
            heard_s=now_s,
            heading_deg=np.append(known.heading_deg, np.nan)[at],
        )
        kept = np.ones(len(known), np.bool_)
        kept[at[at >= 0]] = False
        joined = Antennas.join([known.take(kept), fresh])
        return joined.take(np.argsort(joined.mmsi))


def _carried(heading_deg: Floats, ship: Ints, before_deg: Floats) -> Floats:
    """The headings, a missing one as in the report before. (M,) Args: ship: (M,) sorted rows; before_deg: (K,) of each ship before."""
    place = np.arange(len(ship))
    newest = np.maximum.accumulate(np.where(np.isfinite(heading_deg), place, -1))
    begin = np.searchsorted(ship, ship)
    return np.where(newest >= begin, heading_deg[newest], before_deg[ship])
