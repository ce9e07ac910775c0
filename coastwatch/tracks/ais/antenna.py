"""AIS positions of large ships, moved from the antenna to the middle of the hull, where radar sees the ship."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from coastwatch.batches import AisReports, AisStatics, Batch, Bools, Floats, HullOffsets, Ints, column
from coastwatch.geodesy import offset_deg, wrap_deg
from coastwatch.kernels.tables.lookup import find
from coastwatch.stage import Method, Positive

FORGOTTEN_S = 86_400.0  # after the newest report or size
UNDER_WAY_KN = 3.0
HEADING_S = 60.0  # for which a ship under way keeps the heading of an earlier report
ECHO_SHARE = 0.1  # of the length: standard deviation of where on the hull the echo is
SETTLED_S = 30.0  # after a move, until a track is where its positions are
MOST_DRIFT_DEG = 60.0  # between heading and course of a ship under way: beyond it the heading is wrong


@dataclass(frozen=True, eq=False)
class Antennas(Batch):
    """Large ships that said where their antenna is, sorted by MMSI. Offsets are metres ahead and to starboard of the antenna."""

    mmsi: Ints = column(np.int64, "K")
    middle_m: Floats = column(np.float64, "K", 2)  # offset of the middle of the hull
    length_m: Floats = column(np.float64, "K")
    from_m: Floats = column(np.float64, "K", 2)  # offset that positions had when their move began
    to_m: Floats = column(np.float64, "K", 2)  # offset that they have at its end: that of the middle, or 0 without a heading
    since_s: Floats = column(np.float64, "K")  # when the move began
    heard_s: Floats = column(np.float64, "K")
    heading_deg: Floats = column(np.float64, "K")  # the newest; NaN: none was sent
    heading_s: Floats = column(np.float64, "K")  # when it was received
    has_heading: Bools = column(np.bool_, "K")  # the newest report had one, or an earlier one that still holds

    def offset_m(self, ship: Ints, time_s: Floats, ramp_s: float) -> Floats:
        """The offset of each position, ahead and to starboard. (M, 2) Args: ship: (M,) rows; time_s: (M,); ramp_s: of a move."""
        share = np.clip((time_s - self.since_s[ship]) / ramp_s, 0.0, 1.0)[:, None]
        out: Floats = (1.0 - share) * self.from_m[ship] + share * self.to_m[ship]
        return out


class HullMiddle(Method):
    """The positions of ships of `from_m` or more that send their heading and where their antenna is, moved to the middle of the hull.

    A position moves over `ramp_s`, from when the place of the antenna is known; to a new size it moves as slowly. No ship jumps. A report
    without heading has that of an earlier one: under way, above 3 kn, for 60 s. A heading more than 60 deg from the course under way is
    none. A ship that sends no heading is at its antenna.
    """

    method: Literal["hull_middle"] = "hull_middle"
    from_m: Positive = 10.0  # length of the smallest ship whose positions are moved
    ramp_s: Positive = 60.0  # over which they move

    def init(self) -> Antennas:
        return Antennas.empty()

    def step(self, memory: Antennas, given: tuple[AisReports, AisStatics, float]) -> tuple[Antennas, AisReports]:
        """The reports with the positions of large ships moved. Args: given: reports, sizes that came with them, time of the cycle."""
        reports, statics, time_s = given
        known = self._with_sizes(memory, statics)
        if not len(known):
            return known, reports
        row = find(known.mmsi, reports.mmsi)
        mine = np.flatnonzero(row >= 0)
        mine = mine[np.lexsort((reports.time_s[mine], row[mine]))]
        ship, received_s = row[mine], reports.received_s[mine]
        first = np.isnan(known.heading_deg)  # its move began with its size: a ship at anchor reports each three minutes
        known, heading_deg = _with_headings(known, ship, reports.take(mine))
        now_s, to_m = np.full(len(known), time_s), np.where(known.has_heading[:, None], known.middle_m, 0.0)
        begins = (to_m != known.to_m).any(axis=1)
        offset_m = known.offset_m(np.arange(len(known)), now_s, self.ramp_s)
        known = replace(
            known,
            from_m=np.where(begins[:, None], offset_m, known.from_m),
            to_m=to_m,
            since_s=np.where(begins & ~first, now_s, known.since_s),
        )
        ahead, starboard = known.offset_m(ship, received_s, self.ramp_s).T
        sine, cosine = np.sin(np.radians(heading_deg)), np.cos(np.radians(heading_deg))
        off_m = np.column_stack([ahead * sine + starboard * cosine, ahead * cosine - starboard * sine])
        moved = np.isfinite(heading_deg) & ((ahead != 0.0) | (starboard != 0.0))
        position = reports.position_deg.copy()
        position[mine[moved]] = offset_deg(position[mine[moved]], off_m[moved])
        fresh = time_s - known.heard_s <= FORGOTTEN_S
        return known.take(fresh) if not fresh.all() else known, replace(reports, position_deg=position)

    def hull_offsets(self, memory: Antennas, time_s: float) -> HullOffsets:
        """How far the positions of large ships may lie from the middle of their echo. Args: memory: after the step of this cycle."""
        at_antenna = np.where(memory.has_heading, 0.0, np.hypot(memory.middle_m[:, 0], memory.middle_m[:, 1]))
        moves = (time_s - memory.since_s < self.ramp_s + SETTLED_S) & (memory.from_m != memory.to_m).any(axis=1)
        return HullOffsets(memory.mmsi, np.hypot(ECHO_SHARE * memory.length_m, at_antenna), moves)

    def _with_sizes(self, known: Antennas, statics: AisStatics) -> Antennas:
        """The ships, with those that sent their size now."""
        bow, stern, port, starboard = statics.to_bow_m, statics.to_stern_m, statics.to_port_m, statics.to_starboard_m
        stated = (bow + stern >= self.from_m) & (port + starboard > 0.0) & ((bow > 0.0) | (port > 0.0))
        if not stated.any():
            return known
        some = np.flatnonzero(stated)
        mmsi, last = np.unique(statics.mmsi[some][::-1], return_index=True)
        rows = some[::-1][last]
        at, new, now_s = find(known.mmsi, mmsi), len(mmsi), statics.received_s[rows]
        unknown, zero = np.full(new, np.nan), np.zeros((new, 2))
        first = Antennas(mmsi, zero, np.zeros(new), zero, zero, now_s, now_s, unknown, unknown, np.zeros(new, np.bool_))
        out = Antennas.join([known, first.take(at < 0)])
        out = out.take(np.argsort(out.mmsi))
        ship = find(out.mmsi, mmsi)
        out.middle_m[ship] = 0.5 * np.column_stack([bow - stern, starboard - port])[rows]
        out.length_m[ship] = (bow + stern)[rows]
        out.heard_s[ship] = np.maximum(out.heard_s[ship], now_s)
        return out


def _with_headings(known: Antennas, ship: Ints, reports: AisReports) -> tuple[Antennas, Floats]:
    """The ships after these reports, and the heading at each report, NaN: none was sent yet. (M,)

    Args: ship: (M,) row of each report, increasing; reports: (M,) of one ship in order of time.
    """
    under_way = ~(reports.sog_kn <= UNDER_WAY_KN)  # or of unknown speed
    wrong = (reports.sog_kn > UNDER_WAY_KN) & (np.abs(wrap_deg(reports.heading_deg - reports.cog_deg)) > MOST_DRIFT_DEG)
    newest = np.maximum.accumulate(np.where(np.isfinite(reports.heading_deg) & ~wrong, np.arange(len(ship)), -1))
    here = newest >= np.searchsorted(ship, ship)
    heading_deg = np.where(here, reports.heading_deg[newest], known.heading_deg[ship])
    heading_s = np.where(here, reports.received_s[newest], known.heading_s[ship])
    old = under_way & (reports.received_s - heading_s > HEADING_S)
    names = ("heard_s", "heading_deg", "heading_s", "has_heading")
    known = replace(known, **{name: getattr(known, name).copy() for name in names})
    known.heading_deg[ship], known.heading_s[ship] = heading_deg, heading_s  # of equal rows the newest stays
    known.has_heading[ship] = np.isfinite(heading_deg) & ~old
    np.maximum.at(known.heard_s, ship, reports.received_s)
    return known, heading_deg
