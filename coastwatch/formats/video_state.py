"""What a radar that sends video does: its turns, its spokes, and what was lost of them."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass
class VideoState:
    """Of one radar, since its feed began. Those who read it while it changes see whole numbers of some instant."""

    name: str  # of the radar in the scenario, or its SAC and SIC
    sac: int
    sic: int
    messages: int = 0  # used
    spokes: int = 0  # whole or with parts that did not come
    spokes_lost: int = 0
    parts_lost: int = 0  # of spokes of which another part came
    out_of_order: int = 0  # messages that came after later ones: they are not used
    turns: int = 0
    period_s: float = math.nan  # of the newest whole turn
    spokes_a_turn: int = 0  # that came in it
    first_m: float = math.nan  # range of the near edge of the first cell
    cell_m: float = math.nan
    cells: int = 0
    bits: int = 0  # of a cell
    parts: int = 1  # messages of a whole spoke
    compressed: bool = False
    has_time_of_day: bool = True
    clock_stands: bool = False  # its time of day does not go on: that of arrival is taken
    heard_s: float = -math.inf  # when the newest message came that is of use; before one, the first message
    text: str = ""  # the newest summary that it sent
    senders: tuple[str, str] | None = None  # two that sent under its SAC and SIC at the same time
    second_s: float = -math.inf  # when the second one was heard last
    second_messages: int = 0  # of the second one: they are not used

    @property
    def range_m(self) -> float:
        """Of the far edge of the last cell."""
        return self.first_m + self.cells * self.cell_m
