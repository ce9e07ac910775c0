"""Messages of CAT 240 of one radar, joined to spokes: what came, what did not, and when the beam was there.

A message is a spoke, or a part of one. Parts have one azimuth, and follow each other in the count of the radar.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from coastwatch.batches import Array, Floats, RadarVideo
from coastwatch.formats.asterix.beam_time import FULL_TURN, BeamTime
from coastwatch.formats.asterix.video import MOST_CELLS, VideoMessage
from coastwatch.formats.video_state import VideoState

HALF_LIGHT_M_FS = 0.5 * 299_792_458.0e-15  # range of a femtosecond
BACK = FULL_TURN // 36  # a spoke that is less than this behind the one before stepped back
WIDEST = FULL_TURN // 18  # step between spokes
STEPS = 64.0  # whose mean is the usual one
GAP = 1.75  # usual steps; a longer one is a gap, where the radar does not count its messages
CHANGED = 16  # longer steps in a row, each as long as the one before: the radar sends fewer spokes a turn
SAME_SHARE = 0.1  # by which such steps differ at most
MOST_JUMP = 1 << 20  # messages lost at a time; more, and the radar counts anew
REORDERED = 64  # a message that is so much before the newest came late
MOST_PARTS = 256  # of a spoke: each new one is compared to all of them
SHRUNK = 8  # whole spokes in a row with fewer cells than those before: a new range scale
STEP_SHARE = 2.0  # a message that says it is wider than so many steps says nothing
BACKWARD_SPOKES, BACKWARD_SHARE = (
    256.0,
    0.9,
)  # in the mean over so many spokes, so many step back: azimuths go counter-clockwise


class Spoke(NamedTuple):
    """One spoke."""

    start: int  # azimuth, 1/65536 turn
    end: int
    time_s: float
    level: Array  # (C,) uint8
    missing: tuple[int, int]  # first cell and end of what did not come


class SpokeJoiner:
    """The spokes of one radar. Batches of them are in `take`."""

    def __init__(self, radar: int, site_deg: Floats, state: VideoState) -> None:
        """Args: radar: index into the scenario's radars; site_deg: (2,) of its antenna; state: is kept up to date."""
        self.state = state
        self._radar, self._site_deg = radar, site_deg
        self._beam = BeamTime()
        self._scale = (0, 0, 0, 0)  # duration of a cell in fs, bits, first cell, end
        self._smaller = [0, 1 << 30, 0]  # whole spokes in a row with fewer cells than the scale; their first cell, and end
        self._open: list[VideoMessage] = []  # parts of the spoke that is not complete
        self._held = 0  # cells of them
        self._open_s = 0.0  # when the beam was there
        self._has_gap = False  # messages were lost before it, or inside it
        self._number = -1  # of the newest message
        self._counts = True  # whether the radar counts its messages
        self._start, self._angle = -1, 0  # of the newest spoke; its azimuth, growing from turn to turn
        self._step = 0.0  # usual, between spokes
        self._backward = 0.0  # share of the newest spokes that step back
        self._ahead_s = math.inf  # least time by which stamps of this turn are ahead of their arrival
        self._longer = (0, 0)  # gaps in a row that are as long as each other; the newest
        self._turn, self._turn_s, self._turn_spokes = -1, math.nan, 0  # this turn: number, when it began, spokes that came
        self._spokes: list[Spoke] = []
        self.cells = 0  # of the spokes that are complete and not taken
        self._videos: list[RadarVideo] = []

    @property
    def waiting(self) -> int:
        """Messages of a spoke that is not complete."""
        return len(self._open)

    def add(self, message: VideoMessage, time_s: float, arrived_s: float) -> bool:
        """Take the next message of the radar. Returns: whether it is used. Args: time_s: as it is stamped, or of arrival."""
        lost = self._lost_before(message)
        if lost < 0:
            self.state.out_of_order += 1
            return False
        state = self.state
        state.messages += 1
        is_part = bool(self._open) and self._continues(message)
        if is_part:
            self._has_gap |= lost > 0
            self._open.append(message)
            self._held += len(message.level)
        else:
            if self._open:
                self._close(lost > 0)
            self._begin(message, time_s, arrived_s, lost)
        duration_fs, bits, first, end = self._scale
        if self._held == end - first > 0 and (message.duration_fs, message.bits) == (duration_fs, bits):
            self._close(False)
        return True

    def take(self, *, all_of_them: bool = False) -> list[RadarVideo]:
        """The spokes so far, in order; each batch is of one range scale, and its times do not fall.

        Args: all_of_them: the one too of which parts may come.
        """
        if all_of_them and self._open:
            self._close(False)
        self._flush()
        videos, self._videos, self.cells = self._videos, [], 0
        return videos

    def _lost_before(self, message: VideoMessage) -> int:
        """How many messages were lost before this one; -1: it is older than the newest one, or the same."""
        before, self._number = self._number, message.number
        ahead = (message.number - before) % (1 << 32)
        if before < 0 or 0 < ahead <= MOST_JUMP:
            self._counts = self._counts or (before >= 0 and ahead == 1)
            return ahead - 1 if before >= 0 and self._counts else 0
        if ahead == 0:
            if not (self._open and self._continues(message)) and self._counts:
                if message.start == self._start:
                    return -1
                self._counts = False
        elif (before - message.number) % (1 << 32) <= REORDERED and self._counts:
            self._number = before
            return -1
        return 0

    def _continues(self, message: VideoMessage) -> bool:
        """Whether a message is a part of the open spoke."""
        first = self._open[0]
        is_other = (message.start, message.duration_fs, message.bits) != (first.start, first.duration_fs, first.bits)
        if is_other or len(self._open) >= MOST_PARTS:
            return False
        end = message.first_cell + len(message.level)
        return all(message.first_cell >= part.first_cell + len(part.level) or end <= part.first_cell for part in self._open)

    def _begin(self, message: VideoMessage, time_s: float, arrived_s: float, lost: int) -> None:
        """Begin a spoke. Args: lost: messages before it."""
        state, forward = self.state, (message.start - self._start) % FULL_TURN if self._start >= 0 else 0
        if forward > FULL_TURN - BACK:
            forward -= FULL_TURN
        self._backward += ((forward < 0) - self._backward) / BACKWARD_SPOKES
        state.counter_clockwise = self._backward > BACKWARD_SHARE
        steps = round(forward / self._step) - 1 if self._step else 0
        if lost:
            in_a_turn = state.parts > 1 and self._step and lost * self._step < state.parts * FULL_TURN
            state.spokes_lost += min(max(steps, 0), lost) if in_a_turn else lost // state.parts
        elif not self._counts and self._step and forward > GAP * self._step:
            state.spokes_lost += steps
            count, before = self._longer
            self._longer = (count + 1 if abs(forward - before) <= 1 + SAME_SHARE * forward else 1, forward)
            if self._longer[0] >= CHANGED and forward < WIDEST:
                self._step = float(forward)
        elif 0 < forward < WIDEST:
            self._step += (forward - self._step) / STEPS if self._step else forward
            self._longer = (0, 0)
        self._angle += forward if self._start >= 0 else message.start
        self._start = message.start
        self._open, self._held, self._has_gap = [message], len(message.level), lost > 0
        self._open_s = self._beam.time_s(self._angle, time_s, arrived_s)
        state.clock_stuck = self._beam.clock_stuck
        self._ahead_s = min(self._ahead_s, time_s - arrived_s)  # NaN, where it is not known, is never less
        if self._beam.paused:
            self._turn_s = math.nan  # turns are missing
        turn = self._angle // FULL_TURN
        if turn > self._turn:
            if turn == self._turn + 1 and math.isfinite(self._turn_s):
                state.turns += 1
                state.period_s, state.spokes_a_turn = self._open_s - self._turn_s, self._turn_spokes
            self._turn_s = math.nan if self._turn < 0 or self._beam.paused else self._open_s  # the first turn is not whole
            state.ahead_s = self._ahead_s if math.isfinite(self._ahead_s) else 0.0
            self._turn, self._turn_spokes, self._ahead_s = turn, 0, math.inf
        self._turn_spokes += 1

    def _close(self, lost: bool) -> None:
        """The open spoke is complete, or its other parts do not come. Args: lost: messages after it did not come."""
        parts, self._open = self._open, []
        state, key = self.state, (parts[0].duration_fs, parts[0].bits)
        first, end = min(part.first_cell for part in parts), max(part.first_cell + len(part.level) for part in parts)
        covered = self._held
        whole = covered == end - first and not lost and not self._has_gap
        low, high = self._scale[2:]
        if key != self._scale[:2] or max(end, high) - min(first, low) > MOST_CELLS:
            self._rescale(key, first, end)
        elif first < low or end > high:
            self._rescale(key, min(first, low), max(end, high))
        elif whole and (first > low or end < high):
            smaller = self._smaller
            self._smaller = smaller = [smaller[0] + 1, min(smaller[1], first), max(smaller[2], end)]
            if smaller[0] >= SHRUNK:
                self._rescale(key, smaller[1], smaller[2])
        low, high = self._scale[2:]
        state.spokes += 1
        if covered == high - low:
            self._smaller = [0, 1 << 30, 0]
            state.parts, state.compressed = len(parts), parts[0].compressed
        elif not whole:
            state.parts_lost += max(state.parts - len(parts), 1)
        level, missing = parts[0].level, (0, 0)
        if len(parts) > 1 or covered < high - low:
            level, came = np.zeros(high - low, np.uint8), np.zeros(high - low, np.bool_)
            for part in parts:
                cells = slice(part.first_cell - low, part.first_cell - low + len(part.level))
                level[cells], came[cells] = part.level, True
            if covered < high - low:
                missing = int(came.argmin()), high - low - int(came[::-1].argmin())
        if self._spokes and self._open_s < self._spokes[-1].time_s:
            self._flush()
        self.cells += len(level)
        self._spokes.append(Spoke(parts[0].start, parts[0].end, self._open_s, level, missing))

    def _rescale(self, key: tuple[int, int], first: int, end: int) -> None:
        """Begin a batch of another range scale."""
        self._flush()
        self._scale, self._smaller = (*key, first, end), [0, 1 << 30, 0]
        state, cell_m = self.state, key[0] * HALF_LIGHT_M_FS
        state.first_m, state.cell_m, state.cells, state.bits = first * cell_m, cell_m, end - first, key[1]

    def _flush(self) -> None:
        """Make a batch of the spokes so far."""
        spokes, self._spokes = self._spokes, []
        if not spokes:
            return
        start, end = np.array([(spoke.start, spoke.end) for spoke in spokes], np.int64).T
        width = (end - start) % FULL_TURN
        step = self._step or 1.0
        width = np.where((width > 0) & (width <= STEP_SHARE * step), width, step)
        time_s = np.array([spoke.time_s for spoke in spokes])
        state = self.state
        self._videos.append(
            RadarVideo(
                sensor=self._radar,
                first_m=state.first_m,
                cell_m=state.cell_m,
                time_s=time_s,
                received_s=time_s.copy(),
                azimuth_rad=(start + 0.5 * width) % FULL_TURN * (2.0 * np.pi / FULL_TURN),
                site_deg=np.tile(self._site_deg, (len(spokes), 1)),
                level=np.stack([spoke.level for spoke in spokes]),
                bits=state.bits,
                missing=np.array([spoke.missing for spoke in spokes], np.int64),
            )
        )
