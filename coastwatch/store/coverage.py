"""What each source contributes to the current picture."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from sqlalchemy import Connection, select

from coastwatch.store.collect import collected
from coastwatch.store.pictures import most_vessels
from coastwatch.store.rows import Rows
from coastwatch.store.tables import Member, Source

COLUMNS = ("number", "name", "kind", "tracks", "vessels", "vessels_of_it_alone")


def sensor_coverage(connection: Connection, values: Mapping[str, Any]) -> Rows:
    """The answer to question `sensor_coverage`. Args: values: the run."""
    run_id = values["run"]
    query = select(Member.vessel_id, Member.source).where(Member.run_id == run_id)
    vessel, source = collected(connection, query, 2 * most_vessels(connection, run_id))
    order = np.lexsort((source, vessel))
    vessel, source = vessel[order], source[order]
    other = vessel[1:] != vessel[:-1]
    first = np.append(True, other | (source[1:] != source[:-1]))[: len(vessel)]  # of a vessel's tracks of one source
    of, by = vessel[first], source[first]
    other = of[1:] != of[:-1]
    alone = np.append(True, other)[: len(of)] & np.append(other, True)[: len(of)]
    known = connection.execute(select(Source.number, Source.name, Source.kind).where(Source.run_id == run_id)).all()
    count = max((row.number for row in known), default=-1) + 1
    told = [np.bincount(sources, minlength=count)[:count].tolist() for sources in (source, by, by[alone])]
    return Rows(COLUMNS, [(*row, *(of_all[row.number] for of_all in told)) for row in sorted(known)])
