"""Zones and lines of the user: where vessels are to them, who has come in, left, stays too long, has a wrong speed, or has crossed.

Edges are straight on a Mercator chart (rhumb lines), as the map draws them. Longitudes count from the middle of a zone, so a zone may
lie across the antimeridian.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, model_validator

from coastwatch.alarms.lasting import KEYS, AlarmSettings, Holding, Lasting, Raised, extend
from coastwatch.alarms.watched import Seen
from coastwatch.batches import AlarmKind, Batch, Bools, Floats, Ints, column, joint_keys
from coastwatch.geodesy import KNOT_M_S, NAUTICAL_MILE_M, earth_centred, wrap_deg
from coastwatch.kernels.tables.lookup import find
from coastwatch.spelling import ONE_LINE
from coastwatch.stage import Settings

EARTH_M = 6371008.8
"""Mean radius (IUGG 1980)."""

INSIDE = 0
"""Kind of the condition that a vessel is inside a zone; no alarm has it."""

Latitude = Annotated[float, Field(gt=-85.0, lt=85.0, title="latitude")]
Longitude = Annotated[float, Field(ge=-180.0, le=180.0, title="longitude")]
Position = tuple[Latitude, Longitude]
Limit = Annotated[float, Field(gt=0.0, le=1000.0)]
Numbered = tuple[int, "Zone"]

MOST_POINTS = 1000
LINE_REACH_M = 5000.0
"""How far from a line the ways are that are compared with it: longer than any way of a cycle."""

EDGE_M = 1.0
"""A way that touches an edge of a line is found in spite of rounding."""

SPEED_SIGMAS = 1.0
"""Standard deviations by which a speed must be beyond a limit to be wrong: that of a track that has just begun may be off by knots."""

SIDES = {"both": (-1, 1), "to_left": (-1,), "to_right": (1,)}
"""To which sides a vessel crosses, -1: to the left, by the rule of a line."""

WIDEST_DEG = 170.0
SHORTEST_LINE_M, SMALLEST_AREA_M2 = 1.0, 1.0
NORTHERNMOST_DEG = 85.0
"""Charts and positions end here, and as far south."""


class Zone(Settings):
    """An area or a line of the user, and what raises an alarm there. Without a rule it is only drawn on the map.

    `kind`: `polygon` has 3 or more corners in `points_deg`, `circle` has `centre_deg` and `radius_nm`, and `line` has 2 or more points
    in `points_deg`. `crossing` is for lines, as seen along the line from its first point. All other rules are for areas.
    """

    name: Annotated[str, Field(min_length=1, max_length=64, pattern=ONE_LINE)]  # unique among the zones
    kind: Literal["polygon", "circle", "line"]
    points_deg: Annotated[tuple[Position, ...], Field(max_length=MOST_POINTS)] = ()  # latitude, longitude of each
    centre_deg: Position | None = None  # latitude, longitude
    radius_nm: Annotated[float, Field(gt=0.0, le=500.0)] | None = None
    enter: bool = False  # alarm when a vessel enters; it lasts while the vessel is inside
    leave: bool = False  # alarm when a vessel leaves
    dwell_s: Annotated[float, Field(gt=0.0)] | None = None  # alarm for a vessel that stays longer; none: no limit
    min_speed_kn: Limit | None = None  # alarm for a slower vessel; none: no limit
    max_speed_kn: Limit | None = None  # alarm for a faster one; none: no limit
    crossing: Literal["none", "both", "to_left", "to_right"] = "none"  # alarm for vessels that cross the line

    @model_validator(mode="after")
    def _has_a_name(self) -> Zone:
        if not self.name.strip():
            raise ValueError(f"name: got {self.name!r}, needed one with more than blanks")
        return self

    @model_validator(mode="after")
    def _has_a_shape(self) -> Zone:
        count, is_line = len(self.points_deg), self.kind == "line"
        if self.kind == "circle":
            if self.centre_deg is None or self.radius_nm is None or count:
                raise ValueError("got a circle with other keys, needed centre_deg and radius_nm")
        elif self.centre_deg is not None or self.radius_nm is not None or count < (2 if is_line else 3):
            needed = "2 or more points_deg" if is_line else "3 or more points_deg"
            raise ValueError(f"got a {self.kind} with {count} points_deg, needed {needed}, no centre_deg and no radius_nm")
        if count and np.ptp(_turned(np.array(self.points_deg)[:, 1])) > WIDEST_DEG:
            raise ValueError(f"points_deg: got a {self.kind} wider than {WIDEST_DEG:g} degrees, needed a narrower one")
        return self

    @model_validator(mode="after")
    def _has_rules_of_its_kind(self) -> Zone:
        of_area = self.enter or self.leave or any(v is not None for v in (self.dwell_s, self.min_speed_kn, self.max_speed_kn))
        if self.kind == "line" and of_area:
            raise ValueError("got a line with rules of an area, needed crossing only")
        if self.kind != "line" and self.crossing != "none":
            raise ValueError(f"crossing: got it with a {self.kind}, needed a line")
        if (self.min_speed_kn or 0.0) >= (self.max_speed_kn or np.inf):
            raise ValueError(f"min_speed_kn: got {self.min_speed_kn:g}, needed less than max_speed_kn = {self.max_speed_kn:g}")
        return self

    @model_validator(mode="after")
    def _has_a_size(self) -> Zone:
        shape = Shape(1, self, 0.0)
        if self.kind == "polygon":
            if not shape.polygon.is_valid:
                raise ValueError("points_deg: got corners whose edges cross, needed them in order around the area")
            if shape.polygon.area < SMALLEST_AREA_M2:
                raise ValueError(f"points_deg: got corners around less than {SMALLEST_AREA_M2:g} m2, needed a larger area")
        elif self.kind == "line" and np.ptp(shape.chart_m(shape.points_deg), axis=0).max() < SHORTEST_LINE_M:
            raise ValueError(
                f"points_deg: got a line of points at one place, needed points at least {SHORTEST_LINE_M:g} m apart"
            )
        elif self.kind == "circle":
            self._refuse_beyond_the_chart(shape)
        return self

    def _refuse_beyond_the_chart(self, shape: Shape) -> None:
        reach_deg = np.degrees((self.radius_nm or 0.0) * NAUTICAL_MILE_M / EARTH_M)
        latitude = shape.points_deg[0, 0]
        if latitude + reach_deg >= NORTHERNMOST_DEG:
            latitude_text = f"{latitude + reach_deg:.2f}, needed less than {NORTHERNMOST_DEG:g}"
        elif latitude - reach_deg <= -NORTHERNMOST_DEG:
            latitude_text = f"{latitude - reach_deg:.2f}, needed more than -{NORTHERNMOST_DEG:g}"
        else:
            return
        raise ValueError(f"radius_nm: got a circle that reaches latitude {latitude_text}")


@dataclass(frozen=True)
class Shape:
    """A zone in metres on a Mercator chart whose scale is right in the middle of the zone."""

    number: int
    zone: Zone
    margin_m: float  # a vessel so far outside may still count as inside

    @cached_property
    def points_deg(self) -> Floats:
        """(P, 2) corners; of a circle its centre."""
        centre = [] if self.zone.centre_deg is None else [self.zone.centre_deg]
        return np.array([*self.zone.points_deg, *centre], np.float64)

    @cached_property
    def middle_deg(self) -> tuple[float, float]:
        """Latitude and longitude that coordinates count from."""
        longitude = _turned(self.points_deg[:, 1])
        latitude = self.points_deg[:, 0]
        middle = wrap_deg(0.5 * (longitude.min() + longitude.max()))
        return float(0.5 * (latitude.min() + latitude.max())), float(middle)

    def chart_m(self, position_deg: Floats) -> Floats:
        """Mercator coordinates east and north of the middle. Args: (..., 2). Returns: (..., 2)."""
        latitude, longitude = self.middle_deg
        scale = EARTH_M * np.cos(np.radians(latitude))
        north = np.arcsinh(np.tan(np.radians(position_deg[..., 0]))) - np.arcsinh(np.tan(np.radians(latitude)))
        east_north: Floats = scale * np.stack([np.radians(wrap_deg(position_deg[..., 1] - longitude)), north], -1)
        return east_north

    @cached_property
    def polygon(self) -> Any:
        """The polygon in chart metres."""
        from shapely import Polygon

        return Polygon(self.chart_m(self.points_deg))

    @cached_property
    def _prepared(self) -> tuple[Any, Any]:
        from shapely import prepare

        prepared = self.polygon, self.polygon.buffer(self.margin_m)
        prepare(prepared)
        return prepared

    @cached_property
    def _edges(self) -> Any:
        """A tree of the boxes about the edges of a line, each EDGE_M wider than its edge."""
        from shapely import STRtree, box

        corner = self.chart_m(self.points_deg)
        low, high = np.minimum(corner[1:], corner[:-1]) - EDGE_M, np.maximum(corner[1:], corner[:-1]) + EDGE_M
        return STRtree(np.asarray(box(*low.T, *high.T)))

    @cached_property
    def box_deg(self) -> tuple[float, float, float]:
        """South, north, and half the width of a box about all that is inside or within the margin. Degrees."""
        reach_m = self.margin_m + (self.zone.radius_nm or 0.0) * NAUTICAL_MILE_M
        north = 1.01 * np.degrees(reach_m / EARTH_M)
        latitude, longitude = self.points_deg[:, 0], wrap_deg(self.points_deg[:, 1] - self.middle_deg[1])
        south, top = latitude.min() - north, latitude.max() + north
        widest = np.cos(np.radians(min(max(abs(south), abs(top)), 89.0)))
        return float(south), float(top), float(min(np.abs(longitude).max() + north / widest, 180.0))

    def contains(self, position_deg: Floats) -> tuple[Bools, Bools]:
        """Which positions are inside, and which are inside or within the margin. Args: (K, 2). Returns: (K,), (K,)."""
        if self.zone.kind == "circle":
            radius_m = (self.zone.radius_nm or 0.0) * NAUTICAL_MILE_M
            chord_m = np.linalg.norm(earth_centred(position_deg) - earth_centred(self.points_deg[0]), axis=-1)
            away_m = 2.0 * EARTH_M * np.arcsin(np.minimum(chord_m / (2.0 * EARTH_M), 1.0))
            return away_m <= radius_m, away_m <= radius_m + self.margin_m
        from shapely import contains_xy

        inner, outer = self._prepared
        east, north = self.chart_m(position_deg).T
        inside = np.asarray(contains_xy(inner, east, north))
        near, others = inside.copy(), np.flatnonzero(~inside)
        near[others] = contains_xy(outer, east[others], north[others])
        return inside, near

    def crossings(self, from_deg: Floats, to_deg: Floats) -> Ints:
        """How often each way crosses the line to its right, less how often to its left. Args: (K, 2), (K, 2). Returns: (K,).

        A line is seen from its first point on. A position on the line counts as right of it. Edges far from a way are not looked at.
        """
        from shapely import box

        begins, ends = self.chart_m(from_deg), self.chart_m(to_deg)
        way, edge = self._edges.query(box(*np.minimum(begins, ends).T, *np.maximum(begins, ends).T))
        corner, start, end = self.chart_m(self.points_deg), begins[way], ends[way]
        a, b = corner[edge], corner[edge + 1]
        left_before, left_after = _left_of(a, b, start) > 0.0, _left_of(a, b, end) > 0.0
        between = (_left_of(start, end, a) > 0.0) != (_left_of(start, end, b) > 0.0)
        count = np.zeros(len(begins), np.int64)
        np.add.at(count, way[between], left_before[between].astype(np.int64) - left_after[between])
        return count

    def breaks_speed(self, speed_m_s: Floats, margin_m_s: Floats | float) -> Bools:
        """Which speeds are outside the limits of the zone, each widened by the margin. (K,) Args: margin_m_s: (K,), or of all."""
        low, high = self.zone.min_speed_kn, self.zone.max_speed_kn
        slow = -np.inf if low is None else low * KNOT_M_S - margin_m_s
        fast = np.inf if high is None else high * KNOT_M_S + margin_m_s
        return np.asarray((speed_m_s < slow) | (speed_m_s > fast))

    @cached_property
    def outline(self) -> int:
        """A number that another outline does not have."""
        drawn = self.zone.model_dump_json(include={"kind", "points_deg", "centre_deg", "radius_nm"})
        return int.from_bytes(hashlib.sha256(drawn.encode()).digest()[:8], "little", signed=True)

    @property
    def is_area(self) -> bool:
        return self.zone.kind != "line"


def _left_of(a: Floats, b: Floats, point: Floats) -> Floats:
    """Positive where a point is left of the way from a to b; all (..., 2)."""
    return np.asarray(
        (b[..., 0] - a[..., 0]) * (point[..., 1] - a[..., 1]) - (b[..., 1] - a[..., 1]) * (point[..., 0] - a[..., 0])
    )


def _turned(longitude: Floats) -> Floats:
    """The longitudes as they go on from the first one, without a jump at the antimeridian."""
    return np.asarray(longitude[0] + wrap_deg(longitude - longitude[0]))


@lru_cache(maxsize=4)
def shapes(zones: tuple[Numbered, ...], margin_m: float) -> tuple[Shape, ...]:
    """The zones in metres. It is cached: the zones are the same throughout most of a run."""
    return tuple(Shape(number, zone, LINE_REACH_M if zone.kind == "line" else margin_m) for number, zone in zones)


class ByLatitude:
    """Positions sorted by latitude, so that each zone looks only at those at its height."""

    def __init__(self, position_deg: Floats) -> None:
        """Args: position_deg: (R, 2)."""
        self.position_deg = position_deg
        self._order = np.argsort(position_deg[:, 0], kind="stable")
        self._latitude = position_deg[self._order, 0]

    def near(self, shape: Shape) -> Ints:
        """Rows of the positions in the box of a zone, ascending."""
        south, north, half = shape.box_deg
        low, high = np.searchsorted(self._latitude, [south, north], "left").tolist()
        rows = self._order[low:high]
        rows = rows[np.abs(wrap_deg(self.position_deg[rows, 1] - shape.middle_deg[1])) <= half]
        return np.sort(rows)


def numbered(zones: Sequence[Zone]) -> tuple[Numbered, ...]:
    """Zones of a scenario with their numbers, from 1 in their order."""
    return tuple(enumerate(zones, 1))


@dataclass(frozen=True, eq=False)
class Moments(Batch):
    """Alarms of an instant, which last for `moment_s`. Rows sorted by key and subject, each pair once."""

    key: Ints = column(np.int64, "M")
    subject: Ints = column(np.int64, "M")
    until_s: Floats = column(np.float64, "M")
    to_right: Floats = column(np.float64, "M")


@dataclass(frozen=True, eq=False)
class ZoneMemory:
    """What alarms of zones need of the last cycle."""

    inside: Lasting  # subject: number of the zone; mark: the vessel was outside before, or was not seen before
    speeding: Lasting
    moments: Moments
    zones: Ints  # numbers of the zones, ascending
    began_s: float = np.nan  # first cycle of the run
    outlines: Ints = field(default_factory=lambda: np.zeros(0, np.int64))  # of each zone; empty: not known

    @classmethod
    def none(cls) -> ZoneMemory:
        return cls(Lasting.empty(), Lasting.empty(), Moments.empty(), np.zeros(0, np.int64))

    def changed(self, zones: Sequence[Shape]) -> Ints:
        """The numbers of the zones that have another outline than in the last cycle."""
        before = dict(zip(self.zones.tolist(), self.outlines.tolist(), strict=False))
        return np.array([z.number for z in zones if before.get(z.number, z.outline) != z.outline], np.int64)


def zone_alarms(
    settings: AlarmSettings, memory: ZoneMemory, seen: Seen, zones: Sequence[Shape], time_s: float
) -> tuple[ZoneMemory, list[Raised]]:
    """The alarms of zones and lines that hold in a cycle."""
    if np.isnan(memory.began_s):
        memory = replace(memory, began_s=float(time_s))
    if not zones and not len(memory.zones):
        return memory, []
    positions = ByLatitude(seen.picture.position_deg)
    changed = memory.changed(zones)
    areas = [shape for shape in zones if shape.is_area]
    now, speeds = _inside(settings, memory, np.setdiff1d(memory.zones, changed), seen, positions, areas, time_s)
    inside, left = extend(
        _of_outlines(memory.inside, now, changed), now, seen.frozen, settings.open_s, settings.close_s, time_s
    )
    speeding, _ = extend(memory.speeding, speeds, seen.frozen, settings.open_s, settings.close_s, time_s)
    by_number = {shape.number: shape for shape in zones}
    inside = inside.take(np.isin(inside.subject, list(by_number)))  # a zone that was deleted has no vessels
    moments = _moments(settings, memory.moments, seen, positions, left, by_number, time_s)

    stays = inside.take(inside.open)
    raised = []
    lasted_s = time_s - stays.since_s
    entering, dwell_s = _of_zones(by_number, stays.subject)
    entered = entering & _has_entered(settings, stays, seen)
    for kind, rows in ((AlarmKind.ZONE_ENTER, entered), (AlarmKind.ZONE_DWELL, lasted_s > dwell_s)):
        raised.append(Raised.of(kind, stays.vessel_id[rows], stays.subject[rows], interval_s=lasted_s[rows]))
    rows = speeding.open & np.isin(speeding.subject, list(by_number))
    raised.append(Raised.of(AlarmKind.ZONE_SPEED, speeding.vessel_id[rows], speeding.subject[rows]))
    for kind in (AlarmKind.ZONE_LEAVE, AlarmKind.LINE_CROSSED):
        rows = moments.key % KEYS == kind
        raised.append(Raised.of(kind, moments.key[rows] // KEYS, moments.subject[rows], to_right=moments.to_right[rows]))
    numbers = np.array(sorted(by_number), np.int64)
    outlines = np.array([by_number[number].outline for number in numbers.tolist()], np.int64)
    return ZoneMemory(inside, speeding, moments, numbers, memory.began_s, outlines), raised


def _of_outlines(inside: Lasting, now: Holding, changed: Ints) -> Lasting:
    """The stays without those in zones that were drawn anew, of vessels outside the new outline: they have not left.

    Args: changed: numbers of these zones.
    """
    kept = ~np.isin(inside.subject, changed)
    for number in changed.tolist():
        kept |= (inside.subject == number) & np.isin(inside.key, now.key[now.subject == number])
    return inside.take(kept)


def _has_entered(settings: AlarmSettings, stays: Lasting, seen: Seen) -> Bools:
    """Whether each stay is of a vessel that came from outside, or was first seen inside and tracked there for `first_seen_s`. (D,)"""
    at = find(seen.watched.vessel_id, stays.vessel_id)
    came_s, placed_s = (np.append(column, -np.inf)[at] for column in (seen.watched.came_s, seen.watched.placed_s))
    return stays.mark & ((came_s < stays.since_s) | (placed_s - stays.since_s >= settings.first_seen_s))


def _of_zones(by_number: dict[int, Shape], number: Ints) -> tuple[Bools, Floats]:
    """Whether entering each zone is an alarm, and the longest stay in it, inf: any. Args: number: (D,) of known zones."""
    numbers, index = np.unique(number, return_inverse=True)
    zones = [by_number[k].zone for k in numbers.tolist()]
    enter = np.array([zone.enter for zone in zones], np.bool_)
    dwell_s = np.array([np.inf if zone.dwell_s is None else zone.dwell_s for zone in zones], np.float64)
    return enter[index], dwell_s[index]


def _inside(
    settings: AlarmSettings,
    memory: ZoneMemory,
    known: Ints,
    seen: Seen,
    positions: ByLatitude,
    areas: Sequence[Shape],
    time_s: float,
) -> tuple[Holding, Holding]:
    """Who is inside which area, and who has a wrong speed there, as conditions of this cycle.

    A vessel was outside before if it was watched before it came in, and the zone too. One that was not watched before counts too, but
    for the start of the run, and but for one that was seen last in the zone. Args: known: numbers of zones with the outline of before.
    """
    vessel_id, came_s = seen.picture.vessel_id, seen.watched.came_s[seen.rows]
    speed_m_s, sigma_m_s = seen.watched.speed_m_s[seen.rows], seen.sigma_m_s
    inside, speeds = [], []
    for shape in areas:
        rows = positions.near(shape)
        within, near = shape.contains(positions.position_deg[rows])
        rows, within = rows[near], within[near]
        mark = np.full(len(rows), np.isin(shape.number, known).item())
        first = np.flatnonzero(came_s[rows] == time_s)
        was_inside, _ = shape.contains(seen.before_deg[rows[first]])
        mark[first] &= ~was_inside & (time_s - memory.began_s >= settings.start_up_s)
        number = np.full(len(rows), shape.number)
        inside.append(Holding(vessel_id[rows] * KEYS + INSIDE, number, within, mark))
        lasts = shape.breaks_speed(speed_m_s[rows], -settings.zone_speed_margin_kn * KNOT_M_S)
        wrong = within & shape.breaks_speed(speed_m_s[rows], SPEED_SIGMAS * sigma_m_s[rows])
        key = vessel_id[rows] * KEYS + AlarmKind.ZONE_SPEED
        speeds.append(Holding(key[lasts], number[lasts], wrong[lasts], mark[lasts]))
    all_inside, all_speeds = Holding.join(inside), Holding.join(speeds)
    return (
        all_inside.take(np.lexsort((all_inside.subject, all_inside.key))),
        all_speeds.take(np.lexsort((all_speeds.subject, all_speeds.key))),
    )


def _moments(
    settings: AlarmSettings,
    before: Moments,
    seen: Seen,
    positions: ByLatitude,
    left: Lasting,
    by_number: dict[int, Shape],
    time_s: float,
) -> Moments:
    """Alarms for leaving and crossing: the new ones, and those that are not over. Args: left: stays that have ended."""
    gone = find(seen.picture.vessel_id, left.vessel_id) < 0  # it has not left, it is not seen any more
    with_alarm = [number for number, shape in by_number.items() if shape.zone.leave]
    rows = np.flatnonzero(~gone & np.isin(left.subject, with_alarm))
    key = [left.vessel_id[rows] * KEYS + AlarmKind.ZONE_LEAVE]
    subject, to_right = [left.subject[rows]], [np.full(len(rows), np.nan)]
    lines = [shape for shape in by_number.values() if shape.zone.crossing in SIDES]
    starts = ByLatitude(seen.way_from_deg) if lines else positions
    for shape in lines:
        near = np.union1d(starts.near(shape), positions.near(shape))  # of a way its begin or end is near the line
        near = near[seen.moved[near]]
        sides = np.sign(shape.crossings(seen.way_from_deg[near], positions.position_deg[near]))
        rows_now = np.isin(sides, SIDES[shape.zone.crossing])
        key.append(seen.picture.vessel_id[near[rows_now]] * KEYS + AlarmKind.LINE_CROSSED)
        subject.append(np.full(int(rows_now.sum()), shape.number))
        to_right.append(sides[rows_now].astype(np.float64))
    lasting = (before.until_s > time_s) & np.isin(before.subject, list(by_number))
    new = np.concatenate(key), np.concatenate(subject), np.concatenate(to_right)
    keys = np.append(new[0], before.key[lasting]), np.append(new[1], before.subject[lasting])
    until_s = np.append(np.full(len(new[0]), time_s + settings.moment_s), before.until_s[lasting])
    sides_of = np.append(new[2], before.to_right[lasting])
    joint = joint_keys(keys)[0]
    _, first = np.unique(joint, return_index=True)  # a new one is before an old one
    return Moments(keys[0][first], keys[1][first], until_s[first], sides_of[first])
