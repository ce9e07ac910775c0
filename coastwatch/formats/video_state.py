"""State of a radar that sends video: turns, spokes, losses, clock and senders."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass
class VideoState:
    """State of one radar since its first message. The decoder writes it; other threads may read it meanwhile."""

    name: str  # of the radar in the scenario, or its SAC and SIC
    sac: int
    sic: int
    messages: int = 0  # number of messages in use
    spokes: int = 0  # number of spokes received, complete or incomplete
    spokes_lost: int = 0  # number of spokes of which no message was received
    parts_lost: int = 0  # number of missing messages of incomplete spokes
    out_of_order: int = 0  # number of messages received after a later one, or twice; not in use
    turns: int = 0  # number of complete turns
    period_s: float = math.nan  # of the last complete turn; NaN: none yet
    spokes_a_turn: int = 0  # received in the last complete turn
    first_m: float = math.nan  # range of the near edge of the first cell; NaN: no spoke yet
    cell_m: float = math.nan  # length of a cell; NaN: no spoke yet
    cells: int = 0  # in a complete spoke
    bits: int = 0  # in a cell
    parts: int = 1  # messages of a complete spoke
    compressed: bool = False  # whether the cells are compressed by zlib
    has_time_of_day: bool = True  # whether the newest message has a time of day
    untimed_s: float = math.nan  # Unix time of its first message in use without a time of day; NaN: all had one
    clock_stuck: bool = False  # whether its time of day does not advance; the time of arrival is in use then
    ahead_s: float = 0.0  # by which all stamps of the last turn were ahead of their arrival, at least; negative: behind
    counter_clockwise: bool = False  # whether its azimuths go down from spoke to spoke
    heard_s: float = -math.inf  # Unix time of the newest message in use; before one, of the first message
    text: str = ""  # of its newest summary
    senders: tuple[str, str] | None = None  # of one SAC and SIC: the one in use, the other one; None: one sends
    second_s: float = -math.inf  # Unix time of the newest message of the other one
    second_messages: int = 0  # number of messages of the other one; not in use

    @property
    def range_m(self) -> float:
        """Range of the far edge of the last cell; NaN: no spoke yet."""
        return self.first_m + self.cells * self.cell_m
