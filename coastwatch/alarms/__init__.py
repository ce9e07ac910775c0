"""Alarms beside the flags of the picture: zones and lines, close approaches, dragging anchors, lost vessels."""

from coastwatch.alarms.rules import AlarmRules
from coastwatch.alarms.zones import Numbered, Zone, numbered

__all__ = ["AlarmRules", "Numbered", "Zone", "numbered"]
