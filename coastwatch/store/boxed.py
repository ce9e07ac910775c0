"""A picture of the past in a box, from the history by place: exactly what the whole picture has there, without reading all of it."""

from __future__ import annotations

from collections.abc import Sequence

from sqlalchemy import Connection, text

from coastwatch.batches import Array, Floats
from coastwatch.store.blocks import points_between
from coastwatch.store.box import FASTEST_M_S, Box, inside, widened
from coastwatch.store.collect import arrays, listed
from coastwatch.store.history_rule import newest, reckoned
from coastwatch.store.tables import History

MOST = 2000
"""Vessels above which the whole picture is read."""

ROUNDED_M = 10.0
"""More than places and courses by place may be off."""

NEWER = """
WITH {shown}
SELECT s.vessel FROM shown s CROSS JOIN cycle c CROSS JOIN history h
WHERE c.run_id = :run AND c.number > s.cycle AND c.number <= :cycle
    AND h.run_id = :run AND h.cycle = c.number AND h.vessel_id = s.vessel
"""

ROWS = """
WITH {shown}
SELECT {names} FROM shown s CROSS JOIN history h
WHERE h.run_id = :run AND h.cycle = s.cycle AND h.vessel_id = s.vessel
"""


def newest_in_box(
    connection: Connection, run_id: int, first: int, cycle: int, at_s: Floats, bbox: Box, names: Sequence[str]
) -> dict[str, Array] | None:
    """The newest points up to a cycle of the vessels that are then in a box, and of some beside it; None where they are too many.

    Args: first: cycle from which on every vessel has a point; at_s: times of the cycles from there on; names: of columns.
    """
    reach = widened(bbox, (at_s[-1] - at_s[0]) * FASTEST_M_S + ROUNDED_M)
    points = points_between(connection, run_id, first, cycle, reach)
    points = points.take(newest(points.vessel_id, points.cycle, points.closing))
    now = reckoned(points.position_deg, points.sog_kn, points.cog_deg, at_s[-1] - at_s[points.cycle - first])
    points = points.take(inside(now, widened(bbox, ROUNDED_M)))
    if len(points.cycle) > MOST:
        return None
    types = [getattr(History, name).type for name in names]
    if not len(points.cycle):
        return dict(zip(names, arrays([], types), strict=True))
    keys = list(zip(points.cycle.tolist(), points.vessel_id.tolist(), strict=True))
    shown, given = listed(connection, "shown", ("cycle", "vessel"), keys)
    left = set(connection.scalars(text(NEWER.format(shown=shown)), {**given, "run": run_id, "cycle": cycle}))
    wanted = ", ".join(f"h.{name}" for name in names)
    rows = connection.execute(text(ROWS.format(shown=shown, names=wanted)), {**given, "run": run_id}).all()
    at = names.index("vessel_id")
    return dict(
        zip(names, arrays(sorted((r for r in rows if r[at] not in left), key=lambda r: int(r[at])), types), strict=True)
    )
