"""The table of kinds: every flag of a vessel and every alarm, with number, name, subject, priority, meaning and evidence.

A new alarm has a row here, a rule in `coastwatch/alarms`, and its call in `rules.step`. New evidence has a row in `events.FIELDS`, and a
kind of zones begins with `zone_` or `line_`.
"""

from __future__ import annotations

from enum import IntEnum, IntFlag, StrEnum

import numpy as np

DISTRESS, SENSORS, DANGER, SUSPICION, NOTICE = range(5)
"""Priorities of alarms, the most urgent first. Lists, streams and web hooks go by priority, then by time."""


class Subject(StrEnum):
    """What the subject of an event is a number of."""

    NONE = "none"  # the number is 0
    ZONE = "zone"  # number of the zone or line
    VESSEL = "other vessel"  # its id
    STATION = "AIS station"  # from 1 on; 0: AIS as a whole
    RADAR = "radar"  # from 1 on
    SOURCE = "track source"  # from 1 on


STATUS = "{tracks}{status}"
SILENT = "{sensor} is silent: no {report} for {interval_s:.0f} s{habit}{reach}; no flag and no loss follows from its silence"


class Flag(IntFlag):
    """What an operator should look at. The number of its events is that of its bit.

    Columns: bit, priority, when it is set, evidence; and whether its events are alarms. `alarms.events.FIELDS` has the fields of evidence.
    """

    priority: int
    text: str
    evidence: str
    is_alarm: bool

    DARK = 1, SUSPICION, "radar sees it inside AIS coverage, no AIS", "{ais_silence}; {tracks}"
    AIS_WITHOUT_RADAR = 2, SUSPICION, "AIS says it is there, a radar that should see it does not", "{radar_silence}; {tracks}"
    AIS_CONTRADICTED = 4, SUSPICION, "AIS and radar of one vessel have come apart"
    MMSI_TWICE = 8, SUSPICION, "its MMSI is received from two places", "{tracks}{same_mmsi}"
    IMPOSSIBLE_SPEED = 16, SUSPICION, "AIS reports state or need a speed no ship has"
    COASTING = 32, NOTICE, "it has no track with a position now: it is predicted, or bearings hold it", "{tracks}", False
    ODD_MMSI = 64, NOTICE, "its MMSI is not one that a vessel has (ITU-R M.585)"
    AIS_SART = 128, DISTRESS, 'a distress transmitter: its MMSI begins with 970, or its status is "AIS-SART active"', STATUS
    MAN_OVERBOARD = 256, DISTRESS, "its MMSI begins with 972", STATUS
    EPIRB = 512, DISTRESS, "an emergency beacon: its MMSI begins with 974", STATUS
    NOT_UNDER_COMMAND = 1024, DANGER, "its navigational status says so", STATUS
    AGROUND = 2048, DANGER, "its navigational status says so", STATUS
    STATIONARY = 4096, NOTICE, "it stays in one place: a moored or anchored vessel, a quay, a buoy", "{tracks}", False

    def __new__(
        cls, value: int, priority: int = NOTICE, text: str = "", evidence: str = "{tracks}", is_alarm: bool = True
    ) -> Flag:
        out = int.__new__(cls, value)
        out._value_ = value
        out.priority, out.text, out.evidence, out.is_alarm = priority, text, evidence, is_alarm
        return out

    @property
    def number(self) -> int:
        """The number of its events."""
        return self.value.bit_length() - 1

    @property
    def subject(self) -> Subject:
        return Subject.NONE


class AlarmKind(IntEnum):
    """What an alarm is raised for that no flag says. Events have kinds of both, so these numbers are above every bit of `Flag`.

    Columns: number, subject, priority, when it holds, evidence. `alarms.events.FIELDS` has the fields of evidence.
    """

    subject: Subject
    priority: int
    text: str
    evidence: str

    ZONE_ENTER = (
        32, Subject.ZONE, SUSPICION,
        "while a vessel is inside that was seen outside before, or first seen inside `first_seen_s` ago; with `enter`",
        "zone {name}; {tracks}",
    )  # fmt: skip
    ZONE_LEAVE = (
        33, Subject.ZONE, SUSPICION,
        "for `moment_s` after a vessel has left, seen outside; with `leave`",
        "zone {name}; {tracks}",
    )  # fmt: skip
    ZONE_DWELL = (
        34, Subject.ZONE, SUSPICION,
        "while a vessel is inside, after `dwell_s`",
        "zone {name}, inside for {interval_s:.0f} s; {tracks}",
    )  # fmt: skip
    ZONE_SPEED = (
        35, Subject.ZONE, SUSPICION,
        "while a vessel inside is slower than `min_speed_kn` or faster than `max_speed_kn`",
        "zone {name}, {speed_kn:.1f} kn; {tracks}",
    )  # fmt: skip
    LINE_CROSSED = (
        36, Subject.ZONE, SUSPICION,
        "for `moment_s` after a vessel has crossed in a direction that counts; with `crossing`",
        "line {name}, to its {side}; {tracks}",
    )  # fmt: skip
    CLOSE_APPROACH = (
        37, Subject.VESSEL, DANGER,
        "while CPA and TCPA of two vessels are below `cpa_nm` and `tcpa_min`; of the pair, under the lower id",
        "with {other}, CPA {distance_nm:.2f} NM in {interval_min:.1f} min, range {range_nm:.2f} NM{ages}; {tracks}",
    )  # fmt: skip
    ANCHOR_DRAG = (
        38, Subject.NONE, DANGER,
        "while a vessel at anchor, or at rest for `rest_s`, is out of its swing circle `swing_m` and slower than `drag_kn`",
        "{distance_m:.0f} m from where it lay for {interval_min:.0f} min; {tracks}",
    )  # fmt: skip
    LOST = (
        39, Subject.NONE, DANGER,
        "after a vessel under way has had no track for `lost_after_s` where a sensor of its kind covers, until it returns",
        "no track for {interval_s:.0f} s, under way at {speed_kn:.1f} kn before; {tracks}",
    )  # fmt: skip
    AIS_SILENT = 40, Subject.STATION, SENSORS, "while nothing comes of AIS as a whole, else of one of several stations", SILENT
    RADAR_SILENT = 41, Subject.RADAR, SENSORS, "while a radar sends no plot", SILENT
    SOURCE_SILENT = 42, Subject.SOURCE, SENSORS, "while a track source sends no track", SILENT

    def __new__(cls, value: int, subject: Subject, priority: int, text: str, evidence: str) -> AlarmKind:
        out = int.__new__(cls, value)
        out._value_ = value
        out.subject, out.priority, out.text, out.evidence = subject, priority, text, evidence
        return out

    @property
    def number(self) -> int:
        """The number of its events."""
        return self.value

    @property
    def is_alarm(self) -> bool:
        return True


KINDS: dict[int, Flag | AlarmKind] = {kind.number: kind for kind in (*Flag, *AlarmKind)}
"""Number of the kind of an event -> its row of the table."""

FLAG_NUMBERS = np.array([flag.number for flag in Flag], np.int64)

EVENT_KINDS = {number: str(kind.name).lower() for number, kind in KINDS.items()}
"""Number of a flag, or of a kind of alarm -> kind of its events."""

PRIORITIES = {EVENT_KINDS[number]: kind.priority for number, kind in KINDS.items()}
"""Kind of event -> its priority."""

ALARM_KINDS = tuple(EVENT_KINDS[number] for number, kind in KINDS.items() if kind.is_alarm)
"""What an alarm may be: most flags, and what no flag says."""

ZONE_KINDS = tuple(EVENT_KINDS[number] for number, kind in KINDS.items() if kind.subject == Subject.ZONE)
"""Kinds of alarms whose subject is a zone."""

IS_ALARM = np.array([number in KINDS and KINDS[number].is_alarm for number in range(max(KINDS) + 1)])
"""Whether each number of a kind is of an alarm."""
