"""Why a vessel is dark or without radar, in words: since when a kind of sensor is silent about it, and which should notice it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

import numpy as np
from sqlalchemy import Connection, select

from coastwatch.batches import Flag, Floats, Ints, Picture
from coastwatch.geodesy import difference_m
from coastwatch.store.schema.tables import RUN, SENSOR

MOST_NAMED = 3
"""Sensors that a text names; the others are counted."""


@dataclass(frozen=True, eq=False)
class Expected:
    """The AIS stations and radars of a run by name, site and range, and the limits of its flags."""

    names: Mapping[str, Sequence[str]]  # by kind of sensor: ais, radar
    site_deg: Mapping[str, Floats]  # by kind, (R, 2)
    range_m: Mapping[str, Floats]  # by kind, (R,): where the picture counts on the sensor
    limit_s: Mapping[Flag, float | None]

    @classmethod
    def none(cls) -> Expected:
        """No sensors and no limits."""
        return cls({"ais": (), "radar": ()}, {}, {}, {})


def read_expected(connection: Connection, run_id: int) -> Expected:
    """The sensors and limits of a run, as they were stored when it began."""
    settings: Mapping[str, Any] = connection.scalars(select(RUN.c.settings).where(RUN.c.id == run_id)).one()
    of_picture = settings.get("picture") or {}
    margin = float(of_picture.get("cover_margin", 1.0))
    s, names, site_deg, range_m = SENSOR.c, {}, {}, {}
    for kind in ("ais", "radar"):
        query = select(s.name, s.latitude_deg, s.longitude_deg, s.range_m).where(s.run_id == run_id, s.kind == kind)
        rows = connection.execute(query.order_by(s.number)).all()
        names[kind] = [str(row[0]) for row in rows]
        site_deg[kind] = np.array([row[1:3] for row in rows], np.float64).reshape(-1, 2)
        range_m[kind] = margin * np.array([row[3] for row in rows], np.float64)
    limits = {Flag.DARK: of_picture.get("dark_after_s"), Flag.AIS_WITHOUT_RADAR: of_picture.get("unseen_after_s")}
    return Expected(names, site_deg, range_m, limits)


def reasons(expected: Expected, flag: Flag, picture: Picture, row: Ints, time_s: float, ais_heard_s: Floats) -> list[str]:
    """One text for each of these rows of the picture.

    Args: flag: DARK or AIS_WITHOUT_RADAR; row: (B,); ais_heard_s: (V,) newest AIS report of each vessel, -inf or none: not known.
    """
    limit_s = expected.limit_s.get(flag)
    limit = "" if limit_s is None else f"; limit {limit_s:g} s"
    if flag == Flag.AIS_WITHOUT_RADAR:
        near = _in_range(expected, "radar", picture.position_deg[row])
        return [f"AIS goes on without a radar track{_named('radar', found)}{limit}" for found in near]
    near = _in_range(expected, "ais", picture.position_deg[row])
    heard_s = ais_heard_s[row] if len(ais_heard_s) else np.full(len(row), -np.inf)
    said = [
        _silence(time_s, last_s, mmsi >= 0) for last_s, mmsi in zip(heard_s.tolist(), picture.mmsi[row].tolist(), strict=True)
    ]
    return [f"{text}{_named('AIS station', found)}{limit}" for text, found in zip(said, near, strict=True)]


def _silence(time_s: float, last_s: float, has_mmsi: bool) -> str:
    if last_s > -np.inf:
        return f"last AIS {datetime.fromtimestamp(last_s, UTC):%Y-%m-%d %H:%M:%S} UTC, {time_s - last_s:.0f} s before"
    return "no AIS since it came back" if has_mmsi else "never heard on AIS"


def _in_range(expected: Expected, kind: str, position_deg: Floats) -> list[list[str]]:
    """The sensors of a kind that reach each position, nearest first. Args: position_deg: (B, 2)."""
    names = expected.names[kind]
    if not names:
        return [[] for _ in position_deg]
    apart = difference_m(position_deg[:, None, :], expected.site_deg[kind][None])
    distance_m = np.hypot(apart[..., 0], apart[..., 1])
    reaches, order = distance_m <= expected.range_m[kind], np.argsort(distance_m, axis=1, kind="stable")
    return [[names[k] for k in of if there[k]] for of, there in zip(order.tolist(), reaches.tolist(), strict=True)]


def _named(what: str, found: Sequence[str]) -> str:
    """Such as "; in range of radars north, south and 2 more"."""
    if not found:
        return ""
    shown, more = ", ".join(found[:MOST_NAMED]), len(found) - MOST_NAMED
    return f"; in range of {what}{'s' if len(found) > 1 else ''} {shown}" + (f" and {more} more" if more > 0 else "")
