"""AIS messages that guide the association of plots, and are not in the track that is reported."""

from __future__ import annotations

from typing import ClassVar, Literal

from coastwatch.stage import NotNegative
from coastwatch.tracks.radar.messages.sequential import Sequential


class Guiding(Sequential):
    """Each AIS message at its own time, as by `sequential`, for the association of plots alone.

    The filter of plots alone, with this association, is what a track reports: its errors stay independent of AIS.
    """

    guides: ClassVar[bool] = True
    method: Literal["guiding"] = "guiding"  # type: ignore[assignment]
    trust: Literal["tested"] = "tested"  # nothing else: a filter of plots alone is what it reports
    registration: NotNegative = 0.0
    """Share of a plot's covariance by which a radar may see a vessel beside its AIS. 0: radars have no bias; 1: one whose bias is not known
    yet makes fewer second tracks of vessels, and leaves an AIS that states a wrong position later."""
