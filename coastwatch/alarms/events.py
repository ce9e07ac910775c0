"""When flags and alarms begin and end. One that returns soon goes on with its event: flapping is one event."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from coastwatch.alarms.evidence import Evidence, texts
from coastwatch.batches import BegunEvents, Bools, EventChanges, EventSpans, Floats, Ints, Picture, VesselAlarms, joint_keys
from coastwatch.batches.events import FLAG_KINDS
from coastwatch.geodesy import KNOT_M_S
from coastwatch.kernels.tables.lookup import find

KINDS = 64
"""A key is vessel_id * KINDS + number of the kind."""

FLAGS = np.array(list(FLAG_KINDS), np.int64)


@dataclass(frozen=True, eq=False)
class EventMemory:
    """The events that last, and those that ended lately. E rows, sorted; of each key and subject at most one."""

    key: Ints  # (E,)
    subject: Ints  # (E,) of an alarm: number of the zone or id of the other vessel; 0: none
    start_s: Floats  # (E,)
    end_s: Floats  # (E,) time of the last cycle with the flag or alarm; NaN: it lasts
    time_s: float  # of the newest cycle; -inf before the first

    @classmethod
    def none(cls) -> EventMemory:
        """Before the first cycle."""
        number, time = np.zeros(0, np.int64), np.zeros(0)
        return cls(number, number, time, time, -np.inf)

    def spans(self, rows: Ints | Bools) -> EventSpans:
        """Some of the events."""
        vessel_id, kind = np.divmod(self.key[rows], KINDS)
        return EventSpans(vessel_id, kind, self.subject[rows], self.start_s[rows], self.end_s[rows])


def next_events(
    memory: EventMemory, picture: Picture, alarms: VesselAlarms, time_s: float, gap_s: float, evidence: Evidence
) -> tuple[EventMemory, EventChanges]:
    """The events after a cycle, and what it changed.

    Args: picture: sorted by vessel; alarms: that hold; gap_s: a flag or alarm that was there so lately goes on with its event.
    """
    key, subject = _keys(picture, alarms)
    old, now = joint_keys((memory.key, memory.subject), (key, subject))
    lasts = np.isnan(memory.end_s)
    at = find(old, now)
    known = at >= 0
    returns = np.zeros(len(now), np.bool_)
    returns[known] = ~lasts[at[known]] & (time_s - memory.end_s[at[known]] <= gap_s)
    new = ~(known & (returns | lasts[at])) if len(old) else np.ones(len(now), np.bool_)
    gone = lasts & (find(now, old) < 0)
    returned = memory.spans(at[returns])

    end_s = memory.end_s.copy()
    end_s[gone] = memory.time_s
    ended = replace(memory, end_s=end_s).spans(gone)
    end_s[at[returns]] = np.nan
    kept = np.isnan(end_s) | (time_s - end_s <= gap_s)
    begins = np.full(int(new.sum()), time_s)
    order = np.argsort(np.append(old[kept], now[new]), kind="stable")
    after = EventMemory(
        np.append(memory.key[kept], key[new])[order],
        np.append(memory.subject[kept], subject[new])[order],
        np.append(memory.start_s[kept], begins)[order],
        np.append(end_s[kept], np.full(len(begins), np.nan))[order],
        time_s,
    )
    changes = EventChanges(_begun(key[new], subject[new], time_s, picture, alarms, evidence), ended, returned)
    return after, changes


def _keys(picture: Picture, alarms: VesselAlarms) -> tuple[Ints, Ints]:
    """Key and subject of each flag that is set and of each alarm, sorted."""
    rows = np.flatnonzero(picture.flags)
    at, flag = np.nonzero((picture.flags[rows, None] >> FLAGS) & 1)
    key, subject = picture.vessel_id[rows[at]] * KINDS + FLAGS[flag], np.zeros(len(at), np.int64)
    if len(alarms):
        key, subject = np.append(key, alarms.vessel_id * KINDS + alarms.kind), np.append(subject, alarms.subject)
        order = np.lexsort((subject, key))
        key, subject = key[order], subject[order]
    return key, subject


def _begun(key: Ints, subject: Ints, time_s: float, picture: Picture, alarms: VesselAlarms, evidence: Evidence) -> BegunEvents:
    """The events that begin. A flag has the position of its vessel in the picture, an alarm its own: the vessel may have left."""
    if not len(key):
        return BegunEvents.empty()
    vessel_id, kind = np.divmod(key, KINDS)
    row = find(picture.vessel_id, vessel_id)
    of_alarms, wanted = joint_keys((alarms.vessel_id * KINDS + alarms.kind, alarms.subject), (key, subject))
    alarm = find(of_alarms, wanted)
    raised = alarm >= 0
    position_deg, velocity_m_s = np.full((len(key), 2), np.nan), np.full((len(key), 2), np.nan)
    mmsi = np.full(len(key), -1, np.int64)
    for column, of_picture, of_alarm in (
        (position_deg, picture.position_deg, alarms.position_deg),
        (velocity_m_s, picture.velocity_m_s, alarms.velocity_m_s),
        (mmsi, picture.mmsi, alarms.mmsi),
    ):
        column[~raised] = of_picture[row[~raised]]
        column[raised] = of_alarm[alarm[raised]]
    speed_kn = np.hypot(*velocity_m_s.T) / KNOT_M_S
    try:
        said = texts(row, kind, alarm, picture, alarms, time_s, evidence)
    except Exception as error:  # an alarm without its evidence is better than no alarm, and than no picture
        said = [f"no evidence, {type(error).__name__}: {error}"] * len(key)
    told = np.array(said, object)
    return BegunEvents(vessel_id, kind, subject, np.full(len(key), time_s), position_deg, speed_kn, mmsi, told)
