"""The filters of the tracks: settings of each kind of bank, one union."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from coastwatch.stage import Settings
from coastwatch.tracks.radar.bank.compiled import CompiledBank
from coastwatch.tracks.radar.bank.particles import ParticleBank
from coastwatch.tracks.radar.motion import Prior
from coastwatch.tracks.radar.parts import FilterBank


class Compiled(Settings):
    """Filters by the compiled kernels."""

    upkeep: ClassVar[tuple[str, ...]] = ("hits", "existence")
    method: Literal["compiled"] = "compiled"

    def of(self, motion: Prior) -> CompiledBank:
        """The filters with these models of motion."""
        return CompiledBank(motion)


class Filterpy(Settings):
    """Filters by filterpy, one `IMMEstimator` a track: slow, the reference for `compiled`. Each track takes one plot.

    Of a paper, for comparison.
    """

    upkeep: ClassVar[tuple[str, ...]] = ("hits",)
    method: Literal["filterpy"] = "filterpy"

    def of(self, motion: Prior) -> FilterBank:
        """The filters with these models of motion."""
        from coastwatch.tracks.radar.bank.filterpy import FilterpyBank  # filterpy is slow to import, and few runs use it

        return FilterpyBank(motion)


class Particles(Settings):
    """Clouds of particles, with one model of motion, and positions alone of messages: slow, a baseline. Of a paper, for comparison."""

    upkeep: ClassVar[tuple[str, ...]] = ("existence",)
    method: Literal["particles"] = "particles"
    particles: Annotated[int, Field(ge=10, le=100_000)] = 3000  # of each track
    seed: Annotated[int, Field(ge=0)] = 0  # whole number that all randomness starts from

    def of(self, motion: Prior) -> ParticleBank:
        """The filters with this model of motion."""
        return ParticleBank(motion, self.particles, self.seed)


Bank = Annotated[Compiled | Filterpy | Particles, Field(discriminator="method")]
