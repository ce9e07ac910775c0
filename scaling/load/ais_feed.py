"""A file of NMEA as a national AIS network records it, encoded by pyais: vessels of every class, with their reporting intervals.

The mix of `dma-ais/AisLib` (Denmark, 29 s) is the model: 139 sentences a second of 1,933 transponders, each with a tag block.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pyais import encode_dict

from coastwatch.batches import Floats, Ints
from coastwatch.geodesy import KNOT_M_S, scale_m_deg

START_S = 1_751_328_000  # 2025-07-01T00:00:00Z
CHUNK_S = 60.0  # of a feed that is made at a time
POSITION_SIGMA_M = 3.0
STATIC_S = 360.0  # ITU-R M.1371
SOUTH_DEG, WEST_DEG, HEIGHT_DEG, WIDTH_DEG = 54.0, 4.0, 12.0, 8.0


@dataclass(frozen=True)
class Kind:
    """Transponders of one kind. Source of the intervals: Recommendation ITU-R M.1371-5 (2014), annex 1, tables 1 and 2."""

    share: float  # of all transponders
    message: int  # type of its position reports
    interval_s: float
    least_kn: float
    most_kn: float
    status: int = 0  # navigational status


KINDS = (
    Kind(0.28, 1, 10.0, 4.0, 14.0),
    Kind(0.12, 1, 6.0, 14.0, 23.0),
    Kind(0.03, 1, 2.0, 23.0, 35.0),
    Kind(0.305, 3, 180.0, 0.0, 0.0, status=5),
    Kind(0.12, 18, 30.0, 4.0, 20.0),
    Kind(0.12, 18, 180.0, 0.0, 0.0),
    Kind(0.025, 4, 10.0, 0.0, 0.0),  # base stations
)


@dataclass(frozen=True)
class Fleet:
    """Transponders, each going round a circle of its own. Arrays (V,)."""

    kind: Ints
    mmsi: Ints
    centre_deg: Floats  # (V, 2)
    radius_m: Floats
    speed_kn: Floats
    phase_s: Floats  # of its reports

    @classmethod
    def of(cls, count: int, seed: int) -> Fleet:
        """A fleet of so many transponders."""
        rng = np.random.default_rng([seed, 0])
        kind = np.searchsorted(np.cumsum([k.share for k in KINDS]) - 1e-9, rng.random(count))
        least, most = (np.array([getattr(k, name) for k in KINDS])[kind] for name in ("least_kn", "most_kn"))
        station = np.array([k.message for k in KINDS])[kind] == 4
        number = np.arange(count)
        centre = np.stack([SOUTH_DEG + HEIGHT_DEG * rng.random(count), WEST_DEG + WIDTH_DEG * rng.random(count)], axis=-1)
        speed = least + (most - least) * rng.random(count)
        return cls(
            kind,
            np.where(station, 2_570_000 + number, 257_000_000 + number),
            centre,
            rng.uniform(3e3, 20e3, count),
            speed,
            rng.random(count) * STATIC_S,
        )

    def at(self, rows: Ints, time_s: Floats) -> tuple[Floats, Floats]:
        """True position in degrees (M, 2) and course in degrees (M,)."""
        angle = self.speed_kn[rows] * KNOT_M_S / self.radius_m[rows] * time_s + self.phase_s[rows]
        north, east = self.radius_m[rows] * np.sin(angle), -self.radius_m[rows] * np.cos(angle)
        offset = np.stack([north, east], axis=-1)
        scale = np.stack(scale_m_deg(self.centre_deg[rows, 0]), axis=-1)
        return self.centre_deg[rows] + offset / scale, np.degrees(np.arctan2(np.sin(angle), np.cos(angle))) % 360.0


def write_feed(path: Path, sentences: int, transponders: int, seed: int) -> float:
    """Write a feed of at least so many sentences. Returns: its length in seconds."""
    fleet, written, start_s = Fleet.of(transponders, seed), 0, 0.0
    with path.open("w", encoding="ascii", newline="\n") as file:
        while written < sentences:
            lines = list(_lines(fleet, start_s, np.random.default_rng([seed, 1, int(start_s)])))
            file.writelines(lines)
            written, start_s = written + len(lines), start_s + CHUNK_S
    return start_s


def _lines(fleet: Fleet, start_s: float, rng: np.random.Generator) -> Iterator[str]:
    """The lines of the chunk that begins then."""
    interval = np.array([k.interval_s for k in KINDS])[fleet.kind]
    static = np.flatnonzero(np.array([k.message for k in KINDS])[fleet.kind] != 4)
    parts = [_due(np.arange(len(fleet.mmsi)), interval, fleet.phase_s, start_s), _due(static, STATIC_S, fleet.phase_s, start_s)]
    row, time_s = (np.concatenate(both) for both in zip(*parts, strict=True))
    is_static = np.arange(len(row)) >= len(parts[0][0])
    order = np.argsort(time_s, kind="stable")
    row, time_s, is_static = row[order], time_s[order], is_static[order]
    position, course = fleet.at(row, time_s)
    position = position + rng.normal(0.0, POSITION_SIGMA_M, position.shape) / np.stack(scale_m_deg(position[:, 0]), axis=-1)
    columns = row, time_s, is_static, position[:, 0], position[:, 1], course, fleet.speed_kn[row], fleet.mmsi[row]
    for number, (v, t, is_name, lat, lon, cog, sog, mmsi) in enumerate(zip(*(c.tolist() for c in columns), strict=True)):
        kind, clock_s = KINDS[fleet.kind[v]], START_S + t
        common = {"mmsi": mmsi, "lat": lat, "lon": lon, "speed": sog, "course": cog, "second": int(clock_s) % 60}
        said = _static(kind, v, mmsi) if is_name else {**common, "msg_type": kind.message, "status": kind.status}
        for line in encode_dict(said, talker_id="BS", sentence_type="VDM", seq_id=number % 10):
            yield tagged(f"s:25732{v % 60:02},c:{int(clock_s)}", line)


def _due(row: Ints, interval_s: Any, phase_s: Floats, start_s: float) -> tuple[Ints, Floats]:
    """Which of these transponders send within the chunk, and when; a row for each time."""
    every = np.broadcast_to(interval_s, phase_s.shape)[row]
    first = np.ceil((start_s - phase_s[row]) / every)
    count = np.maximum(np.ceil((start_s + CHUNK_S - phase_s[row]) / every) - first, 0.0).astype(np.int64)
    again = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    return np.repeat(row, count), np.repeat(phase_s[row] + first * every, count) + again * np.repeat(every, count)


def _static(kind: Kind, number: int, mmsi: int) -> dict[str, Any]:
    """Name and type of a vessel: type 5 in two sentences of class A, type 24 of class B."""
    name = f"VESSEL {number}"
    if kind.message == 18:
        return {"msg_type": 24, "mmsi": mmsi, "partno": 0, "shipname": name}
    sizes = {"to_bow": 80, "to_stern": 20, "to_port": 8, "to_starboard": 8}
    return {"msg_type": 5, "mmsi": mmsi, "shipname": name, "callsign": f"LA{number:04}", "ship_type": 70, **sizes}


def tagged(tag: str, line: str) -> str:
    """A line with a tag block before the sentence."""
    check = 0
    for code in tag.encode():
        check ^= code
    return f"\\{tag}*{check:02X}\\{line}\n"
