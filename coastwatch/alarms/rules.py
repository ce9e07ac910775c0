"""The alarms of a cycle: zones and lines, close approaches, dragging anchors, lost vessels, silent sensors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from coastwatch.alarms.close_approach import Approaching, close_pairs
from coastwatch.alarms.lasting import KEYS, AlarmSettings, Holding, Lasting, Raised, extend
from coastwatch.alarms.silent_sensors import sensor_alarms, standing
from coastwatch.alarms.watched import AIS, RADAR, Seen, Watched, watch_vessels
from coastwatch.alarms.zone_alarms import Numbered, Shape, ZoneMemory, shapes, zone_alarms
from coastwatch.batches import (
    AlarmKind,
    Bools,
    Floats,
    Members,
    Picture,
    RadarCover,
    SensorHearing,
    Sensors,
    VesselAlarms,
    joint_keys,
)
from coastwatch.batches.hearing import sensor_covers
from coastwatch.batches.kinds import KINDS, Subject
from coastwatch.geodesy import KNOT_M_S, NAUTICAL_MILE_M, difference_m, offset_deg
from coastwatch.kernels.tables.lookup import find


class AlarmInput(NamedTuple):
    """The picture of a cycle, and what it is watched for."""

    picture: Picture
    members: Members
    time_s: float
    sensors: Sensors
    zones: tuple[Numbered, ...] = ()  # with their numbers, each above 0 and once
    cover: RadarCover | None = None  # of each radar; none, or empty: it sees within its range
    hearing: SensorHearing | None = None  # which sensors are heard; none: all


@dataclass(frozen=True, eq=False)
class AlarmMemory:
    """The memory of the alarms between cycles."""

    watched: Watched
    zones: ZoneMemory
    approaching: Approaching
    close: Lasting  # of pairs: the vessel with the lower id, and the other one as subject
    dragging: Lasting
    members: Members  # of the newest cycle


class AlarmRules(AlarmSettings):
    """Alarms beside the flags: zones, lines, close approaches, dragging anchors, lost vessels and silent sensors.

    An alarm begins when its condition has held for `open_s`, and ends when it has not held for `close_s`. While a vessel has no track,
    its alarms stay as they are. One that returns within `store.event_gap_s` goes on with the event before.
    """

    def init(self) -> AlarmMemory:
        return AlarmMemory(
            Watched.empty(), ZoneMemory.none(), Approaching.none(), Lasting.empty(), Lasting.empty(), Members.empty()
        )

    def step(self, memory: AlarmMemory, given: AlarmInput) -> tuple[AlarmMemory, VesselAlarms]:
        """The alarms that hold in this cycle."""
        picture, members, time_s, sensors, zones, cover, hearing = given
        zone_shapes = shapes(zones, self.zone_margin_m)
        seen = watch_vessels(self, memory.watched, picture, members, memory.members, sensors, time_s)
        zone_memory, raised = zone_alarms(self, memory.zones, seen, zone_shapes, time_s)
        followed, close, approaching = self._close(memory, seen, time_s)
        dragging, anchored = self._dragging(memory.dragging, seen, time_s)
        seen = self._standing(seen, sensors, hearing, time_s)
        raised = [*raised, approaching, anchored, self._lost(seen, sensors, cover, hearing, time_s)]
        after = AlarmMemory(seen.watched, zone_memory, followed, close, dragging, members)
        alarms = _together(raised, seen.watched, zone_shapes)
        if hearing is None:
            return after, alarms
        return after, VesselAlarms.join([sensor_alarms(hearing, sensors, picture, time_s), alarms])

    def _close(self, memory: AlarmMemory, seen: Seen, time_s: float) -> tuple[Approaching, Lasting, Raised]:
        """Close approaches. Within the limits they begin, within the wider ones they last."""
        none = np.zeros(0, np.int64)
        if self.cpa_nm == 0.0:
            return Approaching.none(), Lasting.empty(), Raised.of(AlarmKind.CLOSE_APPROACH, none)
        opened = memory.close.take(memory.close.open)
        followed, pairs = close_pairs(self, memory.approaching, seen.picture, time_s, (opened.vessel_id, opened.subject))
        vessel_id = seen.picture.vessel_id
        key, subject = vessel_id[pairs.first] * KEYS + AlarmKind.CLOSE_APPROACH, vessel_id[pairs.second]
        strong = (pairs.cpa_m <= self.cpa_nm * NAUTICAL_MILE_M) & (pairs.tcpa_s <= self.tcpa_min * 60.0)
        now = Holding(key, subject, strong, np.zeros(len(key), np.bool_))
        after, _ = extend(memory.close, now, none, self.cpa_open_s, self.close_s, time_s)
        opened = after.take(after.open)
        of_now, wanted = joint_keys((key, subject), (opened.key, opened.subject))
        row = find(of_now, wanted)
        of_pair = {
            name: np.append(value, np.nan)[row]
            for name, value in (("distance_m", pairs.cpa_m), ("range_m", pairs.range_m), ("interval_s", pairs.tcpa_s))
        }
        return followed, after, Raised.of(AlarmKind.CLOSE_APPROACH, opened.vessel_id, opened.subject, **of_pair)

    def _dragging(self, before: Lasting, seen: Seen, time_s: float) -> tuple[Lasting, Raised]:
        rows = np.flatnonzero(seen.dragging)
        key, zero = seen.picture.vessel_id[rows] * KEYS + AlarmKind.ANCHOR_DRAG, np.zeros(len(rows), np.int64)
        now = Holding(key, zero, np.ones(len(rows), np.bool_), np.zeros(len(rows), np.bool_))
        after, _ = extend(before, now, seen.frozen, self.open_s, self.close_s, time_s)
        opened = after.vessel_id[after.open]
        at = find(seen.picture.vessel_id, opened)
        of_row = {
            name: np.append(value, np.nan)[at] for name, value in (("distance_m", seen.away_m), ("interval_s", seen.lain_s))
        }
        return after, Raised.of(AlarmKind.ANCHOR_DRAG, opened, **of_row)

    def _standing(self, seen: Seen, sensors: Sensors, hearing: SensorHearing | None, time_s: float) -> Seen:
        """The same, with the vessels that only silent sensors would see as they were when these were heard last."""
        if hearing is None or not any(kind.silent.any() for kind in (hearing.stations, hearing.radars, hearing.track_sources)):
            return seen
        covers = sensor_covers(sensors, self.cover_margin, hearing)
        u = seen.watched
        rows = np.flatnonzero(~u.tracked)
        then_deg = offset_deg(u.position_deg[rows], u.velocity_m_s[rows] * self.lost_after_s)
        return replace(seen, watched=standing(u, rows, covers, hearing.track_sources, then_deg, time_s))

    def _lost(
        self, seen: Seen, sensors: Sensors, cover: RadarCover | None, hearing: SensorHearing | None, time_s: float
    ) -> Raised:
        """Vessels that were under way, have left the picture, and would still be within cover of what tracked them.

        A silent sensor covers too: its vessels are as long away as when it was heard last.
        """
        u = seen.watched
        silent_s = time_s - u.seen_s
        gone = ~u.here & (silent_s >= self.lost_after_s) & (silent_s <= self.lost_for_s)
        gone &= (u.seen_s - u.since_s >= self.lost_known_s) & (u.speed_m_s >= self.lost_under_way_kn * KNOT_M_S)
        rows = np.flatnonzero(gone & (self.lost_after_s > 0.0))
        then_deg = offset_deg(u.position_deg[rows], u.velocity_m_s[rows] * self.lost_after_s)
        covered = np.zeros(len(rows), np.bool_)
        for bit, sensor_cover in zip((AIS, RADAR), sensor_covers(sensors, self.cover_margin, hearing), strict=True):
            of_kind = (u.sources[rows] & bit) != 0
            if bit == RADAR and cover is not None and len(cover):
                was_heard = np.ones(len(cover), np.bool_) if hearing is None else np.isfinite(hearing.radars.heard_s)
                covered[of_kind] |= self._seen_by_radar(then_deg[of_kind], sensors, cover, was_heard)
            else:
                covered |= sensor_cover.within(then_deg, of_kind)
                covered |= np.isfinite(sensor_cover.stands_from_s(then_deg, of_kind))
        rows = rows[covered]
        return Raised.of(AlarmKind.LOST, u.vessel_id[rows], interval_s=silent_s[rows])

    def _seen_by_radar(self, position_deg: Floats, sensors: Sensors, cover: RadarCover, was_heard: Bools) -> Bools:
        """Whether some radar should see each position: by its learnt cover where it has looked often enough, else by its range.

        Args: position_deg: (K, 2); was_heard: (R,) radars that were ever heard. Returns: (K,).
        """
        placed = np.isfinite(cover.site_deg[:, :1])
        site_deg = np.where(placed, cover.site_deg, sensors.radars.site_deg)
        away = difference_m(position_deg[:, None], site_deg[None])
        in_range = was_heard & (np.hypot(away[..., 0], away[..., 1]) <= self.cover_margin * cover.range_m)
        detection, looks = cover.ais_at(away[..., 0], away[..., 1])
        sees = in_range & ((looks < self.cover_looks) | (detection >= self.should_see))
        return np.asarray(sees.any(axis=1))


def _together(parts: Sequence[Raised], watched: Watched, zones: Sequence[Shape]) -> VesselAlarms:
    """All alarms of a cycle, with where their vessels are. Those of vessels that are no longer watched are left out."""
    if not any(len(part.vessel_id) for part in parts):
        return VesselAlarms.empty()
    columns = {name: np.concatenate([getattr(part, name) for part in parts]) for name in vars(parts[0]) if name != "kind"}
    kind = np.concatenate([np.full(len(part.vessel_id), int(part.kind)) for part in parts])
    row = find(watched.vessel_id, columns["vessel_id"])
    order = np.lexsort((columns["subject"], kind, columns["vessel_id"]))
    order = order[row[order] >= 0]
    row = row[order]
    names = {shape.number: shape.zone.name for shape in zones}
    of_zone = (KINDS[number].subject == Subject.ZONE for number in kind.tolist())
    name = [names.get(number, "") if zoned else "" for number, zoned in zip(columns["subject"].tolist(), of_zone, strict=True)]
    return VesselAlarms(
        kind=kind[order],
        name=np.array(name, "U64")[order],
        position_deg=watched.position_deg[row],
        velocity_m_s=watched.velocity_m_s[row],
        mmsi=watched.mmsi[row],
        **{key: value[order] for key, value in columns.items()},
    )
