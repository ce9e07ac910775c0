"""Alarms beside the flags of the picture, and from when until when each flag and alarm holds, with its evidence."""

from coastwatch.alarms.events import (
    EventMemory as EventMemory,
    EvidenceContext as EvidenceContext,
    expected_sensors as expected_sensors,
    next_events as next_events,
)
from coastwatch.alarms.rules import AlarmInput as AlarmInput, AlarmMemory as AlarmMemory, AlarmRules as AlarmRules
from coastwatch.alarms.zone_alarms import Numbered as Numbered, Zone as Zone, numbered as numbered
