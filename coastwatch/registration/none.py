"""No online registration: only the settings of `[plots]` correct radars."""

from __future__ import annotations

from typing import Literal

from coastwatch.batches import RadarCorrections
from coastwatch.registration.inputs import RegistrationInput
from coastwatch.stage import Method, NoMemory


class NoRegistration(Method):
    """Estimates no registration errors."""

    method: Literal["none"] = "none"

    def init(self) -> NoMemory:
        return NoMemory()

    def step(self, memory: NoMemory, given: RegistrationInput) -> tuple[NoMemory, RadarCorrections]:
        """Unchanged memory; every correction is zero."""
        return memory, RadarCorrections.empty(R=len(given.sensors.radars))
