"""The picture as binary frames, `coastwatch.picture.v2` or `v1`: full frames, and deltas of what a viewer cannot foretell.

Version 2 has sizes by radar too, where there is one.

Every viewer moves vessels on from the last frame that had them, at constant speed and course (`ahead`). A delta has only the vessels
that are elsewhere by then. INTERFACE.md has the layout of a frame.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from coastwatch.batches import Array, Flag, Floats, Ints
from coastwatch.geodesy import KNOT_M_S, wrap_deg
from coastwatch.kernels.tables.lookup import find
from coastwatch.server.live_picture import LivePicture

PROTOCOL = "coastwatch.picture.v1"
VERSIONS = {"coastwatch.picture.v2": 2, PROTOCOL: 1}
"""The subprotocols that are spoken, the newest first, and the version of their frames."""
HEADER = struct.Struct("<4sBBHIIdIIIIII")
"""Magic, version, kind, flags, seq, base, time, slots, changed, removed, born, run, bytes."""

MAGIC = b"CWP1"
HAS_ECHOES = 1  # flag of a frame of version 2
FULL, DELTA, HEARTBEAT = 1, 2, 5
COLUMNS: dict[str, np.dtype[Any]] = {
    "lon": np.dtype("<i4"),  # 1e-7 deg
    "lat": np.dtype("<i4"),
    "sog": np.dtype("<u2"),  # 0.01 kn
    "cog": np.dtype("<u2"),  # 360/65536 deg
    "kind": np.dtype("u1"),  # sum of 1 AIS, 2 radar, 4 bearing
    "flag": np.dtype("u1"),
    "major": np.dtype("u1"),  # 1-sigma half axis: 2^(x/16)/2 m
    "minor": np.dtype("u1"),
    "angle": np.dtype("u1"),  # of the major axis from north, 180/256 deg
    "age": np.dtype("u1"),  # since the newest report: 0 under a second, else 2^(x/16) s
}
"""The columns of a frame, in their order."""
ECHO_COLUMNS: dict[str, np.dtype[Any]] = {
    "length": np.dtype("u1"),  # by radar: 2^(x/16)/2 m
    "width": np.dtype("u1"),
    "axis": np.dtype("u1"),  # of the length from north, 360/256 deg
}
"""The columns behind them in a frame of version 2 in which a vessel has a size by radar."""
EVERY = COLUMNS | ECHO_COLUMNS

Vessels = dict[str, Array]
"""An array for each of COLUMNS. One array with these fields would be read with strides: ten times as slow."""

UNKNOWN_SOG, UNKNOWN_AXIS = 65535, 255
FIRST_SIX = 63
"""Flags with the same bit on the wire: dark to coasting."""
ALARM = 64
ALARMING = Flag.AIS_SART | Flag.MAN_OVERBOARD | Flag.EPIRB | Flag.NOT_UNDER_COMMAND | Flag.AGROUND

METRES, KNOTS, DEGREES = 10.0, 0.3, 2.0
"""A vessel is sent again if it is so far from where a viewer has it, or its speed or course differs by so much."""
LENGTH_STEPS, AXIS_DEGREES = 3, 5.0  # the same of a size by radar: a factor of 2^(3/16), and so many degrees
SLOW_KN = 0.5  # the course of a slower vessel says nothing
AXIS_STEPS = 8  # sent again if an axis differs by a factor of 2^(8/16)
LONGEST_S = 120.0
"""Every vessel is sent again after this time."""

A_DEGREE_M = 111_120.0
SIN, COS = (f(np.arange(65536) * (2.0 * np.pi / 65536.0)) for f in (np.sin, np.cos))
"""Of every course that the wire can hold."""

RING = 40
"""Deltas that are kept for viewers that come back or are slow."""


@dataclass(frozen=True, eq=False)
class Frame:
    """The picture as all viewers have it after a message. S slots: a slot belongs to one vessel until it leaves.

    Nothing here is written to after it was made, so that threads may share it.
    """

    run: int  # random number of this server's run
    seq: int
    time_s: float
    ids: Array  # (S,) uint32; 0: the slot is free
    vessels: Vessels  # (S,) each, as last sent
    sent_s: Floats  # (S,) when
    position_deg: Floats  # (2, S) latitude and longitude where viewers have them at the time of the frame
    touched: Ints  # slots that changed, came or left with this frame
    messages: dict[tuple[int, int], bytes] = field(default_factory=dict)  # by version and base

    def full(self, version: int = 1) -> bytes:
        """The message with every vessel."""
        if (version, 0) not in self.messages:
            head = _Head(version, FULL, 0)
            self.messages[version, 0] = _message(self, head, self._at_time(slice(None)), self.ids)
        return self.messages[version, 0]

    def delta(self, base: int, before: Array, now: Array, touched: Ints, version: int = 1) -> bytes:
        """The message that brings a viewer from an earlier frame to this one.

        Args: base: seq of the earlier frame, 0: the viewer has nothing; before, now: (S',), (S,) ids that the viewer has and is to
        have; touched: slots that changed since then.
        """
        padded = np.zeros(len(now), np.uint32)
        padded[: len(before)] = before
        removed = np.flatnonzero((now == 0) & (padded != 0))
        added = np.flatnonzero((now != 0) & (now != padded))
        changed = np.zeros(len(now), np.bool_)
        changed[touched] = True
        changed[added] = True
        slots = np.flatnonzero(changed & (now != 0))
        return _message(self, _Head(version, DELTA, base), self._at_time(slots), now, slots, removed, added)

    def heartbeat(self, version: int = 1) -> bytes:
        """The message that says that there is no newer frame."""
        return _header(self, _Head(version, HEARTBEAT, self.seq), (), 0)

    def past(self) -> Frame:
        """What is needed of it once there is a newer one: its ids, and which slots changed."""
        return replace(self, vessels={}, sent_s=self.sent_s[:0], position_deg=self.position_deg[:, :0], messages={})

    def _at_time(self, slots: Ints | slice) -> Vessels:
        """These vessels, moved on to the time of the frame. Those of this frame are where they were measured."""
        columns = {name: column[slots] for name, column in self.vessels.items()}
        for axis, name in enumerate(("lat", "lon")):
            columns[name] = np.rint(self.position_deg[axis, slots] * 1e7).astype(COLUMNS[name])
        return columns


class Encoder:
    """Makes frames of pictures, one after the other."""

    def __init__(self, run: int) -> None:
        self._run = run
        self._last: Frame | None = None
        self._vessel_id, self._slot = np.zeros(0, np.int64), np.zeros(0, np.int64)
        self._free, self._left = np.zeros(0, np.int64), np.zeros(0, np.int64)  # _left: free from the next frame on
        self._due_s = np.zeros(0)  # when the vessel of a slot is sent again at the latest

    def frame(self, picture: LivePicture) -> Frame:
        """The next frame."""
        none = np.zeros(0)
        last = self._last or Frame(
            self._run,
            0,
            picture.time_s,
            np.zeros(0, np.uint32),
            {name: np.zeros(0, kind) for name, kind in EVERY.items()},
            none,
            none.reshape(2, 0),
            _NONE,
        )
        came, left = self._place(picture.array("vessel_id"))
        slots = self._slot
        size = max(len(last.ids), int(slots.max(initial=-1)) + 1)
        ids, sent_s = _longer(last.ids, size), _longer(last.sent_s, size)
        vessels = {name: _longer(column, size) for name, column in last.vessels.items()}
        self._due_s = _longer(self._due_s, size)
        sent = {name: column[slots] for name, column in vessels.items()}
        now, expected = encoded(picture), _moved(sent, picture.time_s - sent_s[slots])
        fresh = came | self._differs(sent, now, expected, picture.time_s)
        ids[left] = 0
        ids[slots[came]] = picture.array("vessel_id")[came]
        changed, rows = slots[fresh], np.flatnonzero(fresh)
        for name, column in vessels.items():
            column[left] = 0
            column[changed] = now[name][rows]
        sent_s[changed] = picture.time_s
        position = np.zeros((2, size))
        for axis, name in enumerate(("lat", "lon")):
            expected[axis][rows] = now[name][rows] * 1e-7
            position[axis, slots] = expected[axis]
        wait_s = np.where(came[fresh], 0.5 + (changed * 0.6180339887) % 0.5, 1.0) * LONGEST_S  # not all in the same frame
        self._due_s[changed] = picture.time_s + wait_s
        touched = np.concatenate([changed, left])
        self._last = Frame(self._run, last.seq + 1, picture.time_s, ids, vessels, sent_s, position, touched)
        return self._last

    def _place(self, vessel_id: Ints) -> tuple[Array, Ints]:
        """Give every vessel its slot. Returns: (V,) which have come; the slots of those that have left."""
        at = find(self._vessel_id, vessel_id)
        came = at < 0
        stays = np.zeros(len(self._vessel_id), np.bool_)
        stays[at[~came]] = True
        left = self._slot[~stays]
        slot = np.empty(len(vessel_id), np.int64)
        slot[~came] = self._slot[at[~came]]
        count = int(came.sum())
        used = len(self._vessel_id) + len(self._free) + len(self._left)  # slots so far
        new = np.concatenate([self._free[:count], np.arange(used, used + max(count - len(self._free), 0))])
        slot[came] = new
        self._free = np.sort(np.concatenate([self._free[count:], self._left]))
        self._left, self._vessel_id, self._slot = left, vessel_id, slot
        return came, left

    def _differs(self, sent: Vessels, now: Vessels, expected_deg: tuple[Floats, Floats], time_s: float) -> Array:
        """Which vessels are not as viewers have them. Args: expected_deg: (V,), (V,) where viewers have them. Returns: (V,)."""
        latitude, longitude = expected_deg
        north = (now["lat"] * 1e-7 - latitude) * A_DEGREE_M
        east = _within_half_a_turn(now["lon"] * 1e-7 - longitude) * A_DEGREE_M * _cos_deg(latitude)
        differs = north * north + east * east > METRES * METRES
        speed, before = now["sog"].astype(np.int32), sent["sog"].astype(np.int32)
        differs |= np.abs(speed - before) > round(KNOTS * 100)
        turned = np.abs((now["cog"] - sent["cog"]).view(np.int16).astype(np.int32)) > DEGREES * 65536 / 360  # it wraps
        differs |= turned & (speed > SLOW_KN * 100)
        differs |= (now["flag"] != sent["flag"]) | (now["kind"] != sent["kind"]) | (self._due_s[self._slot] <= time_s)
        for axis in ("major", "minor"):
            differs |= np.abs(now[axis].astype(np.int16) - sent[axis]) > AXIS_STEPS
        if (now["length"] != UNKNOWN_AXIS).any() or (sent["length"] != UNKNOWN_AXIS).any():
            for side in ("length", "width"):
                differs |= np.abs(now[side].astype(np.int16) - sent[side]) > LENGTH_STEPS
            differs |= np.abs((now["axis"] - sent["axis"]).view(np.int8).astype(np.int16)) > AXIS_DEGREES * 256 / 360
        return np.asarray(differs)


def encoded(picture: LivePicture) -> Vessels:
    """The vessels of a picture in the units of the wire. (V,) each"""
    columns = {
        "lon": np.rint(picture.array("longitude_deg") * 1e7),
        "lat": np.rint(picture.array("latitude_deg") * 1e7),
    }
    sog, cog = picture.array("sog_kn"), picture.array("cog_deg")
    is_known = np.isfinite(sog)
    columns["sog"] = np.where(is_known, np.rint(np.where(is_known, sog, 0.0) * 100.0).clip(0, UNKNOWN_SOG - 1), UNKNOWN_SOG)
    columns["cog"] = _steps(cog, 65536.0 / 360.0) & 65535
    columns["kind"] = picture.kind
    flags = picture.array("flags")
    columns["flag"] = (flags & FIRST_SIX) | np.where(flags & int(ALARMING), ALARM, 0)
    for name in ("major", "minor"):
        metres = picture.array(f"{name}_m").astype(np.float32)  # a step is 4 %
        steps = _sixteenths(np.fmax(metres, 0.5) * 2.0).clip(0, UNKNOWN_AXIS - 1)
        columns[name] = np.where(np.isfinite(metres), steps, UNKNOWN_AXIS)
    columns["angle"] = _steps(picture.array("orientation_deg"), 256.0 / 180.0) & 255
    age_s = (picture.array("time_s") - picture.array("updated_s")).astype(np.float32)
    columns["age"] = _sixteenths(np.fmax(age_s, 1.0)).clip(0, 255)
    return {name: columns[name].astype(kind) for name, kind in COLUMNS.items()} | _echoes(picture)


def _echoes(picture: LivePicture) -> Vessels:
    """The sizes by radar in the units of the wire. (V,) each"""
    columns = {name: np.full(len(picture), UNKNOWN_AXIS, np.uint8) for name in ECHO_COLUMNS}
    length = picture.array("echo_length_m")
    rows = np.flatnonzero(np.isfinite(length))
    for name in ("length", "width"):
        metres = picture.array(f"echo_{name}_m")[rows]
        steps = _sixteenths(np.fmax(np.nan_to_num(metres), 0.5) * 2.0).clip(0, UNKNOWN_AXIS - 1)
        columns[name][rows] = np.where(np.isfinite(metres), steps, UNKNOWN_AXIS)
    columns["axis"][rows] = _steps(picture.array("echo_axis_deg")[rows], 256.0 / 360.0) & 255
    return columns


def _steps(degrees: Floats, steps: float) -> Ints:
    """Angles in steps, so many of them a degree; not a number is 0."""
    return np.rint(np.where(np.isfinite(degrees), degrees, 0.0) * steps).astype(np.int64)


def _sixteenths(values: Array) -> Array:
    """Sixteenths of an octave above 1, rounded."""
    return np.asarray(np.rint(np.log(values) * np.float32(16.0 / np.log(2.0))))


def spoken(offered: Sequence[str]) -> str | None:
    """The newest subprotocol that both sides speak; None: the viewer offers none of them."""
    return next((name for name in VERSIONS if name in offered), None)


def ahead(latitude: Floats, longitude: Floats, sog_kn: Floats, cog_deg: Floats, seconds: Floats) -> tuple[Floats, Floats]:
    """Where vessels are after some seconds at constant speed and course; viewers use the same formula. Degrees."""
    way, course = sog_kn * (KNOT_M_S / A_DEGREE_M) * seconds, np.radians(cog_deg)
    return latitude + way * np.cos(course), longitude + way * np.sin(course) / np.cos(np.radians(latitude))


def since(frames: Sequence[Frame], seq: int) -> Ints:
    """The slots that changed after a frame. Args: frames: the newest, in order, that of `seq` among them."""
    return np.concatenate([_NONE, *(frame.touched for frame in frames if frame.seq > seq)])


def _moved(vessels: Vessels, seconds: Floats) -> tuple[Floats, Floats]:
    """Where viewers have vessels after some seconds: `ahead`, with the sine and cosine of every course on the wire looked up."""
    sog = vessels["sog"]
    way = np.where(sog == UNKNOWN_SOG, 0, sog) * (0.01 * KNOT_M_S / A_DEGREE_M) * seconds
    latitude, course = vessels["lat"] * 1e-7, vessels["cog"]
    north, east = way * COS[course], way * SIN[course]
    return latitude + north, _within_half_a_turn(vessels["lon"] * 1e-7 + east / _cos_deg(latitude))


def _cos_deg(latitude: Floats) -> Floats:
    """The cosine of latitudes to 1e-7, which is 1 mm of the way of 120 s."""
    return np.cos(np.radians(latitude.astype(np.float32))).astype(np.float64)


def _within_half_a_turn(degrees: Floats) -> Floats:
    """Longitudes or their differences within -180..180; most are."""
    return wrap_deg(degrees) if np.abs(degrees).max(initial=0.0) > 180.0 else degrees


class _Head(NamedTuple):
    """What a message says of itself."""

    version: int
    kind: int
    base: int
    flags: int = 0


def _message(frame: Frame, head: _Head, vessels: Vessels, ids: Array, *lists: Array) -> bytes:
    """Header, then columns, each padded to 4 bytes, so that a browser reads them in place.

    Args: lists: of a delta: slots that changed, slots that were left, slots with another vessel.
    """
    first = [*lists, ids[lists[2]]] if lists else [ids]
    parts = [np.ascontiguousarray(column, "<u4").tobytes() for column in first]
    names = [*COLUMNS]
    length = vessels["length"] if lists else vessels["length"][ids != 0]
    if head.version > 1 and (length != UNKNOWN_AXIS).any():
        head, names = head._replace(flags=HAS_ECHOES), [*EVERY]
    for name in names:
        data = np.ascontiguousarray(vessels[name]).tobytes()
        parts.append(data + b"\0" * (-len(data) % 4))
    body = b"".join(parts)
    return _header(frame, head, lists, len(body)) + body


def _header(frame: Frame, head: _Head, lists: Sequence[Array], size: int) -> bytes:
    """The header of a message. Args: lists: as of `_message`; size: of the body."""
    changed, removed, added = map(len, lists or ((), (), ()))
    slots, whole = len(frame.ids), HEADER.size + size
    f, h = frame, head
    return HEADER.pack(MAGIC, h.version, h.kind, h.flags, f.seq, h.base, f.time_s, slots, changed, removed, added, f.run, whole)


def _longer(array: Array, size: int) -> Array:
    """A copy, with zeros behind it up to this size."""
    longer = np.zeros(size, array.dtype)
    longer[: len(array)] = array
    return longer


_NONE = np.zeros(0, np.int64)
