"""Alarms beside the flags of the picture, and from when until when each flag and alarm holds, with its evidence."""

from coastwatch.alarms.events import EventMemory, next_events
from coastwatch.alarms.evidence import Evidence, expected_sensors
from coastwatch.alarms.rules import AlarmRules
from coastwatch.alarms.zones import Numbered, Zone, numbered

__all__ = ["AlarmRules", "EventMemory", "Evidence", "Numbered", "Zone", "expected_sensors", "next_events", "numbered"]
