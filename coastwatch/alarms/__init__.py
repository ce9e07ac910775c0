"""Alarms beside the flags of the picture, and from when until when each flag and alarm holds, with its evidence."""

from coastwatch.alarms.events import EventMemory, next_events
from coastwatch.alarms.evidence import Evidence, expected_sensors
from coastwatch.alarms.inputs import AlarmInput
from coastwatch.alarms.rules import AlarmMemory, AlarmRules
from coastwatch.alarms.zones import Numbered, Zone, numbered

__all__ = [
    "AlarmInput",
    "AlarmMemory",
    "AlarmRules",
    "EventMemory",
    "Evidence",
    "Numbered",
    "Zone",
    "expected_sensors",
    "next_events",
    "numbered",
]
