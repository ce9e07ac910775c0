"""The tracker of radar plots that keeps tracks in a table: composed of an association, a motion, messages, filters and an upkeep."""

from __future__ import annotations

from typing import Self, get_args

from pydantic import model_validator

from coastwatch.tracks.radar.association import Association, NearestNeighbour
from coastwatch.tracks.radar.bank import Bank, Compiled, Particles
from coastwatch.tracks.radar.clutter import ClutterSettings
from coastwatch.tracks.radar.life import TrackManagement, Upkeep
from coastwatch.tracks.radar.messages import Guiding, MessageUpdate, NoMessages
from coastwatch.tracks.radar.motion import Manoeuvres, MotionModels
from coastwatch.tracks.radar.parts import Parts
from coastwatch.tracks.radar.presets import TAGS, Name, expanded, settings_of
from coastwatch.tracks.radar.region import RadarMethod, RegionInput, RegionOutput, update_region
from coastwatch.tracks.radar.table import RadarMemory

UPKEEP_OF = {part.model_fields["method"].default: part.upkeep for part in get_args(get_args(Association)[0])}


class TableTracker(RadarMethod):
    """Tracks of the plots of a region, each in a slot of a table: an association, models of motion, messages and filters.

    A `method` other than `table` is the name of a choice of parts: `sided_imm`, `imm`, `filterpy_imm`, `vimmjipda`, `sided_vimmjipda`,
    `vimmjipda_literal`, `vimmjipda_sequential`, `vimmjipda_precise_batch`, `vimmjipda_noisy_batch`, `guided_vimmjipda`,
    `imm_jpda`, `multi_hypothesis`, `sided_multi_hypothesis`, `bp_particles`. A part that is given replaces the one of this choice.

    Short settings:
    `plot_origin` ("known": the association `known_origin`) of the first three and of `guided_vimmjipda`, which is then as `sided_imm`;
    `message_velocities` (`messages.velocities`) of the methods with messages; `particles` and `seed` (of `bank`) of `bp_particles`.

    Source of IMM filters: H. A. P. Blom, Y. Bar-Shalom, The interacting multiple model algorithm for systems with Markovian switching
    coefficients, IEEE Trans. AC 33(8), 1988.
    """

    method: Name = "table"
    association: Association = NearestNeighbour()
    motion: MotionModels = Manoeuvres()
    messages: MessageUpdate = NoMessages()
    bank: Bank = Compiled()
    upkeep: Upkeep = TrackManagement()
    clutter: ClutterSettings = ClutterSettings()

    @model_validator(mode="before")
    @classmethod
    def _has_the_parts_of_its_method(cls, data: object) -> object:
        defaults = {part: getattr(cls.model_fields[part].default, tag) for part, tag in TAGS.items()}
        return expanded(data, defaults, UPKEEP_OF) if isinstance(data, dict) else data

    @model_validator(mode="after")
    def _parts_fit_together(self) -> Self:
        needed, association = self.association.upkeep, f"with association.method = {self.association.method!r}"
        if self.upkeep.method != needed:
            raise ValueError(f"upkeep.method: got {self.upkeep.method!r}, needed {needed!r} {association}")
        if needed not in self.bank.upkeep:
            raise ValueError(f"bank.method: got {self.bank.method!r}, needed 'compiled' {association}")
        if needed != "existence" and not isinstance(self.messages, NoMessages):
            raise ValueError(f"messages.method: got {self.messages.method!r}, needed 'none' {association}")
        of_messages, of_bank = (self.messages.method, self.association.messages), (self.bank.method, self.association.banks)
        for part, (got, fitting) in {"messages": of_messages, "bank": of_bank}.items():
            if fitting and got not in fitting:
                raise ValueError(f"{part}.method: got {got!r}, needed {' or '.join(map(repr, fitting))} {association}")
        if isinstance(self.messages, Guiding) and not isinstance(self.bank, Compiled):
            raise ValueError(f"bank.method: got {self.bank.method!r}, needed 'compiled' with messages.method = 'guiding'")
        models = len(self.motion.table())
        if isinstance(self.bank, Particles) and models != 1:
            raise ValueError(f"motion.models: got {models}, needed 1 with bank.method = 'particles'")
        return self

    @property
    def takes_messages(self) -> bool:
        return not isinstance(self.messages, NoMessages)

    @property
    def holds_messages(self) -> bool:
        return not (isinstance(self.messages, NoMessages) or self.messages.guides)

    @property
    def tests_messages(self) -> bool:
        """Tracks leave messages that contradict their plots. Particles take every message."""
        return not isinstance(self.messages, NoMessages) and self.messages.trust == "tested" and isinstance(self.bank, Compiled)

    @classmethod
    def settings_of(cls, method: str) -> set[str]:
        """The settings that this method, one of the names, is usually given."""
        return settings_of(method, set(cls.model_fields))

    def init(self) -> RadarMemory:
        bank = self.bank.of(self.motion)
        return RadarMemory.empty(J=len(bank.models), P=bank.particles)

    def step(self, memory: RadarMemory, given: RegionInput) -> tuple[RadarMemory, RegionOutput]:
        """The confirmed tracks of one region at the end of a cycle.

        Raises: ValueError where the memory is of a scenario with other radars.
        """
        registration = self.messages.registration if isinstance(self.messages, Guiding) else 0.0
        parts = Parts(self.bank.of(self.motion), self.upkeep, self.clutter, given.sensors, given.region, registration)
        rules = None if isinstance(self.messages, NoMessages) else self.messages
        return update_region(self.association, rules, parts, memory, given, self.tests_messages)
