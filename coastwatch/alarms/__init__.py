"""Alarms beside the flags of the picture, and from when until when each flag and alarm holds, with its evidence."""

from coastwatch.alarms.events import EventMemory, EvidenceContext, expected_sensors, next_events
from coastwatch.alarms.rules import AlarmInput, AlarmMemory, AlarmRules
from coastwatch.alarms.zone_alarms import Numbered, Zone, numbered

__all__ = [
    "AlarmInput",
    "AlarmMemory",
    "AlarmRules",
    "EventMemory",
    "EvidenceContext",
    "Numbered",
    "Zone",
    "expected_sensors",
    "next_events",
    "numbered",
]
