"""Alarms as each rule raises them, before they are put together for the store."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from coastwatch.alarms.watched import Watched
from coastwatch.alarms.zones import Shape
from coastwatch.batches import AlarmKind, Floats, Ints, VesselAlarms
from coastwatch.kernels.tables.lookup import find


@dataclass(frozen=True, eq=False)
class Raised:
    """Alarms of one kind. A rows."""

    kind: AlarmKind
    vessel_id: Ints  # (A,)
    subject: Ints  # (A,)
    distance_m: Floats  # (A,) the columns from here on as in `VesselAlarms`, NaN where they say nothing
    range_m: Floats
    interval_s: Floats
    to_right: Floats

    @classmethod
    def of(cls, kind: AlarmKind, vessel_id: Ints, subject: Ints | None = None, **given: Floats) -> Raised:
        """Alarms of a kind. Args: given: columns by name."""
        unknown = np.full(len(vessel_id), np.nan)
        names = ("distance_m", "range_m", "interval_s", "to_right")
        columns = {name: np.asarray(given.get(name, unknown), np.float64) for name in names}
        return cls(kind, vessel_id, np.zeros(len(vessel_id), np.int64) if subject is None else subject, **columns)


def together(parts: Sequence[Raised], watched: Watched, zones: Sequence[Shape]) -> VesselAlarms:
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
    of_zone = (kind >= AlarmKind.ZONE_ENTER) & (kind <= AlarmKind.LINE_CROSSED)
    name = [names.get(number, "") if zoned else "" for number, zoned in zip(columns["subject"].tolist(), of_zone, strict=True)]
    return VesselAlarms(
        kind=kind[order],
        name=np.array(name, "U64")[order],
        position_deg=watched.position_deg[row],
        velocity_m_s=watched.velocity_m_s[row],
        mmsi=watched.mmsi[row],
        **{key: value[order] for key, value in columns.items()},
    )
