"""What all rules share: their settings, hysteresis, and the alarms of one kind that a rule raises.

A condition lasts once it has held for some time, until it has not held for some other time. Both count seconds, so they do not depend
on the period, nor on cycles that a late server has merged.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from coastwatch.batches import AlarmKind, Batch, Bools, Floats, Ints, column, joint_keys
from coastwatch.kernels.tables.lookup import find
from coastwatch.stage import Method, NotNegative

KEYS = 64
"""A key is vessel_id * KEYS + number of the kind."""

SLACK_S = 1e-3
"""What the difference of two times may be short of a limit: they are rounded to parts of a microsecond."""


class AlarmSettings(Method):
    """Settings of `AlarmRules`."""

    method: Literal["rules"] = "rules"
    open_s: NotNegative = 6.0  # how long a condition must hold before its alarm begins
    close_s: NotNegative = 15.0  # how long it must not hold before the alarm ends
    zone_margin_m: NotNegative = 50.0  # a vessel leaves a zone when it is so far outside
    zone_speed_margin_kn: NotNegative = 1.0  # an alarm for speed ends so far below (above) the limit
    line_margin_m: Annotated[float, Field(gt=0.0)] = 50.0  # a vessel must move so far before a crossing is looked for
    moment_s: NotNegative = 60.0  # how long an alarm for leaving a zone or crossing a line lasts
    forget_s: NotNegative = 300.0  # a vessel that is away for longer is new to zones and lines when it returns
    first_seen_s: NotNegative = 60.0  # a vessel first seen inside a zone has entered it when it has been there for so long
    start_up_s: NotNegative = 600.0  # of a run: what is first seen inside a zone until then was there before
    cpa_nm: NotNegative = 0.05  # distance of closest approach (CPA) below which two vessels are too close; 0: no such alarm
    tcpa_min: Annotated[float, Field(gt=0.0, le=60.0)] = 3.0  # time to closest approach (TCPA) within which the alarm begins
    cpa_open_s: NotNegative = 60.0  # in place of `open_s`: a turn must not raise alarms
    cpa_oldest_s: NotNegative = 60.0  # a pair raises no alarm if the newest report of one of the two is older
    cpa_hold_factor: Annotated[float, Field(ge=1.0, le=3.0)] = 1.5  # the alarm lasts within so many times both limits
    cpa_relative_kn: NotNegative = 3.0  # least relative speed: vessels in company are no danger to each other
    cpa_under_way_kn: NotNegative = 3.0  # least speed of each of the two, or of one of them with `cpa_at_rest`
    cpa_at_rest: bool = False  # also between a vessel under way and one that is stationary, anchored or moored
    cpa_known_s: NotNegative = 60.0  # each of the two must have been in the picture for so long
    swing_m: NotNegative = 200.0  # largest radius of the swing circle of an anchored vessel; 0: no alarm for dragging
    settle_s: NotNegative = 600.0  # the anchorage is the mean position of so long after the vessel came to rest
    rest_s: NotNegative = 3600.0  # what has no status "at anchor" must have been stationary for so long
    drag_kn: Annotated[float, Field(gt=0.0)] = 3.0  # what is faster is under way, whatever its status says
    lost_after_s: NotNegative = 120.0  # without a track; 0: no alarm for lost vessels
    lost_for_s: NotNegative = 1800.0  # the alarm ends if the vessel has not returned so long after its last track
    lost_known_s: NotNegative = 300.0  # it must have been in the picture for so long
    lost_under_way_kn: NotNegative = 3.0  # it must have had this speed
    should_see: Annotated[float, Field(ge=0.0, le=1.0)] = 0.5  # least learnt probability of detection that counts as cover
    cover_looks: NotNegative = (
        24.0  # turns at AIS vessels in a cell of a radar, from which its learnt cover counts, not its range
    )
    cover_margin: Annotated[float, Field(gt=0.0, le=1.0)] = 0.9  # share of a sensor's range that counts as cover


@dataclass(frozen=True, eq=False)
class Lasting(Batch):
    """Conditions that hold, or held lately. D rows, each key and subject once, sorted by them."""

    key: Ints = column(np.int64, "D")
    subject: Ints = column(np.int64, "D")
    held_s: Floats = column(np.float64, "D")  # how long it has held, without a break while it was not open
    missed_s: Floats = column(np.float64, "D")  # since it held last, but for cycles in which nothing was known of it
    open: Bools = column(np.bool_, "D")
    since_s: Floats = column(np.float64, "D")  # when it began to hold
    at_s: Floats = column(np.float64, "D")  # the newest cycle
    mark: Bools = column(np.bool_, "D")  # as given when it began

    @property
    def vessel_id(self) -> Ints:
        """(D,)"""
        return self.key // KEYS


@dataclass(frozen=True, eq=False)
class Holding(Batch):
    """The conditions of one cycle. C rows, each key and subject once, sorted by them."""

    key: Ints = column(np.int64, "C")
    subject: Ints = column(np.int64, "C")
    strong: Bools = column(np.bool_, "C")  # it holds; else it keeps an open condition from ending, and no more
    mark: Bools = column(np.bool_, "C")  # for those that begin


def extend(
    before: Lasting, now: Holding, frozen: Ints, open_s: float, close_s: float, time_s: float
) -> tuple[Lasting, Lasting]:
    """The conditions after a cycle, and those open ones that have ended with it.

    Args: frozen: (F,) ascending vessel ids: of these nothing is known now, so their conditions stay as they are; open_s: how long a
    condition must hold before it is open; close_s: how long an open one must not hold before it ends.
    """
    before_s = time_s - before.at_s
    old, new = joint_keys((before.key, before.subject), (now.key, now.subject))
    at = find(old, new)
    was_open = np.zeros(len(new), np.bool_)
    was_open[at >= 0] = before.open[at[at >= 0]]
    kept = now.strong | was_open
    rows, at, was_open = np.flatnonzero(kept), at[kept], was_open[kept]
    lasted, strong = at >= 0, now.strong[rows]
    zero, at_s = np.zeros(len(rows)), np.full(len(rows), float(time_s))
    held_s, since_s, mark = zero.copy(), at_s.copy(), now.mark[rows]
    held_s[lasted] = before.held_s[at[lasted]] + np.where(strong[lasted], before_s[at[lasted]], 0.0)
    since_s[lasted], mark[lasted] = before.since_s[at[lasted]], before.mark[at[lasted]]
    is_open = was_open | (held_s >= open_s - SLACK_S)
    holds = Lasting(now.key[rows], now.subject[rows], held_s, zero, is_open, since_s, at_s, mark)

    rest = np.ones(len(old), np.bool_)
    rest[at[lasted]] = False
    gone = before.take(rest)
    waits = find(frozen, gone.vessel_id) >= 0
    missed_s = gone.missed_s + np.where(waits, 0.0, before_s[rest])
    stays = waits | (gone.open & (missed_s < close_s - SLACK_S))
    gone = replace(gone, missed_s=missed_s, at_s=np.full(len(missed_s), float(time_s)))
    lasting = Lasting.join([holds, gone.take(stays)])
    return lasting.take(np.lexsort((lasting.subject, lasting.key))), gone.take(~stays & gone.open)


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
    def of(cls, kind: AlarmKind, vessel_id: Ints, subject: Ints | None = None, **values: Floats) -> Raised:
        """Alarms of a kind. Args: values: columns by name."""
        unknown = np.full(len(vessel_id), np.nan)
        names = ("distance_m", "range_m", "interval_s", "to_right")
        columns = {name: np.asarray(values.get(name, unknown), np.float64) for name in names}
        return cls(kind, vessel_id, np.zeros(len(vessel_id), np.int64) if subject is None else subject, **columns)
