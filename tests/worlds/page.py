"""A page as a program: it takes frames as the page in the browser does, from the written layout alone."""

from __future__ import annotations

import struct
from typing import Any

import numpy as np

HEADER = struct.Struct("<4sBBHIIdIIIIII")
COLUMNS = (
    ("lon", "<i4"),
    ("lat", "<i4"),
    ("sog", "<u2"),
    ("cog", "<u2"),
    *((n, "u1") for n in ("kind", "flag", "major", "minor", "angle", "age")),
)
ECHOES = tuple((n, "u1") for n in ("length", "width", "axis"))  # of version 2
FULL, DELTA, HEARTBEAT = 1, 2, 5


class Page:
    """Flat arrays by slot. `refused` counts deltas that do not fit."""

    def __init__(self) -> None:
        self.run = self.seq = self.refused = 0
        self.time_s = 0.0
        self.ids = np.zeros(0, np.uint32)
        self.columns = {name: np.zeros(0, kind) for name, kind in (*COLUMNS, *ECHOES)}
        self.sent_s = np.zeros(0)
        self.changed = 0  # vessels in the last frame

    def take(self, message: bytes) -> int:
        """Apply a message. Returns: its kind."""
        magic, version, kind, flags, seq, base, time_s, slots, changed, removed, born, run, size = HEADER.unpack_from(message)
        assert (magic, size) == (b"CWP1", len(message))
        assert version == 2 or (version, flags) == (1, 0)
        at = HEADER.size

        def read(count: int, form: str) -> np.ndarray:
            nonlocal at
            out = np.frombuffer(message, form, count, at)
            at += -(-out.nbytes // 4) * 4
            return out

        if kind == HEARTBEAT:
            assert size == HEADER.size
            return kind
        if kind == FULL:
            self._clear(slots)
            self.ids[:] = read(slots, "<u4")
            at_slots: Any = slice(None)
            rows = slots
        else:
            if base == 0:
                self._clear(slots)
            elif (run, base) != (self.run, self.seq):
                self.refused += 1
                return kind
            self._grow(slots)
            at_slots, gone, new = read(changed, "<u4"), read(removed, "<u4"), read(born, "<u4")
            self.ids[gone] = 0
            self.ids[new] = read(born, "<u4")
            assert set(new) <= set(at_slots)
            rows = changed
        for name, form in COLUMNS:
            self.columns[name][at_slots] = read(rows, form)
        for name, form in ECHOES:
            self.columns[name][at_slots] = read(rows, form) if flags & 1 else 255
        assert at == size
        self.sent_s[at_slots] = time_s
        self.run, self.seq, self.time_s, self.changed = run, seq, time_s, rows
        return kind

    def positions_deg(self, time_s: float) -> dict[int, tuple[float, float]]:
        """Where each vessel is drawn, by its id."""
        c, since_s = self.columns, time_s - self.sent_s
        way = np.where(c["sog"] == 65535, 0, c["sog"]) * 0.01 * (1852 / 3600 / 111_120) * since_s
        course, latitude = np.radians(c["cog"] * (360 / 65536)), c["lat"] * 1e-7
        longitude = c["lon"] * 1e-7 + way * np.sin(course) / np.cos(np.radians(latitude))
        latitude = latitude + way * np.cos(course)
        return {int(i): (float(a), float(b)) for i, a, b in zip(self.ids, latitude, longitude, strict=True) if i}

    def vessel(self, number: int) -> dict[str, int]:
        """The columns of a vessel but its position."""
        (slot,) = np.flatnonzero(self.ids == number)
        return {name: int(column[slot]) for name, column in self.columns.items() if name not in ("lon", "lat")}

    def _clear(self, slots: int) -> None:
        self.ids, self.sent_s = np.zeros(slots, np.uint32), np.zeros(slots)
        self.columns = {name: np.zeros(slots, form) for name, form in (*COLUMNS, *ECHOES)}

    def _grow(self, slots: int) -> None:
        more = slots - len(self.ids)
        assert more >= 0
        self.ids, self.sent_s = np.append(self.ids, np.zeros(more, np.uint32)), np.append(self.sent_s, np.zeros(more))
        self.columns = {name: np.append(column, np.zeros(more, column.dtype)) for name, column in self.columns.items()}
