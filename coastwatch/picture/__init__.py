"""Each vessel once, with a stable identity, sources, flags and alarms: the methods of the stage."""

from coastwatch.picture.alarms import AlarmRules, Numbered, Zone, numbered
from coastwatch.picture.identity import Identity

__all__ = ["AlarmRules", "Identity", "Numbered", "Zone", "numbered"]
