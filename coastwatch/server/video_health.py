"""The health of radars that send video: turns, spokes, losses and plots, for operators."""

from __future__ import annotations

import math
from collections import defaultdict, deque
from collections.abc import Sequence
from typing import Any, TypedDict

import numpy as np

from coastwatch.batches import COVER_RANGES, Floats, RadarCover, Sensors
from coastwatch.centre import Cycle
from coastwatch.formats.video_state import VideoState
from coastwatch.geodesy import NAUTICAL_MILE_M
from coastwatch.server.link import WITHIN_S, FeedState, LastMinute, RadarState
from coastwatch.store import VIDEO_VALUES

STOPPED_TURNS, STOPPED_S = 3.0, 10.0  # without a message, the larger one: the video has stopped
LOST_SHARE, LEAST_LOST = 0.01, 20  # of the spokes of a minute, and so many, are a trouble
AHEAD_S = 2.0  # a spoke cannot come before it was sent
OTHER_TURN, SHORT_RANGE, LONG_RANGE = 0.1, 0.7, 1.5  # the turn, or the range, is another one than in the scenario
SECOND_SHOWN_S = 60.0  # for how long after it a second sender is shown

UNTIMED_SHOWN_S = 600.0  # for how long it is said, once, that a radar sends no time of day, which it may


class VideoHealth:
    """Of the radars of one feed."""

    def __init__(self, radars: dict[str, VideoState]) -> None:
        """Args: radars: by name, kept up to date by the decoder."""
        self._radars = radars
        self._last_minute = defaultdict[str, LastMinute](LastMinute)  # by radar

    def look(self, at_s: float) -> None:
        """Note the counts. Args: at_s: now."""
        for name, state in list(self._radars.items()):
            # It begins anew where the radar is heard under another SAC and SIC.
            self._last_minute[name].note(at_s, spokes=state.spokes, lost=state.spokes_lost + state.parts_lost)

    def states(self, now_s: float) -> list[RadarState]:
        """The radars as the API answers them."""
        radars = self._radars.copy()  # another thread adds some
        return [self._state(radars[name], now_s) for name in sorted(radars)]

    def _state(self, s: VideoState, now_s: float) -> RadarState:
        change = self._last_minute.get(s.name, LastMinute()).change()  # it may be newer than the last look
        spokes, lost = change["spokes"], change["lost"]
        silent_s = max(now_s - s.heard_s, 0.0)
        return {
            "name": s.name,
            "sac": s.sac,
            "sic": s.sic,
            "text": s.text,
            "silent_s": round(silent_s, 1),
            "turn_s": _known(s.period_s, 4),
            "spokes_a_turn": s.spokes_a_turn if s.turns else None,
            "cells": s.cells,
            "cell_m": _known(s.cell_m, 3),
            "range_m": _known(s.range_m, 1),
            "bits": s.bits,
            "compressed": s.compressed,
            "parts": s.parts,
            "time_of_day": s.has_time_of_day and not s.clock_stuck,
            "spokes": s.spokes,
            "spokes_lost": s.spokes_lost,
            "parts_lost": s.parts_lost,
            "out_of_order": s.out_of_order,
            "second_sender": s.second_messages,
            "lost_share": round(lost / max(spokes + lost, 1), 5),
            "plots_a_turn": None,
            "threshold_db": None,
            "detection_probability": None,
            "false_plots_a_turn": None,
            "troubles": _troubles(s, silent_s, (spokes, lost), now_s),
        }


def _troubles(s: VideoState, silent_s: float, counts: tuple[int, int], now_s: float) -> list[str]:
    """What is wrong with the video of a radar. Args: counts: spokes of the last minute, and those lost."""
    sentences, (spokes, lost) = [], counts
    turn_s = s.period_s if math.isfinite(s.period_s) else 0.0
    if silent_s > max(STOPPED_S, STOPPED_TURNS * turn_s):
        sentences.append(f"its video has stopped: nothing has come for {silent_s:.0f} s")
    if lost >= LEAST_LOST and lost > LOST_SHARE * (spokes + lost):
        sentences.append(f"{lost} of {spokes + lost} spokes of the last minute were lost, or a part of them")
    if s.clock_stuck:
        sentences.append("its time of day does not go on: the time of arrival is taken")
    if s.ahead_s >= AHEAD_S and s.has_time_of_day and not s.clock_stuck:
        sentences.append(f"its clock is {s.ahead_s:.0f} s ahead: its vessels lie where they were so long ago, beside their AIS")
    if s.counter_clockwise:
        sentences.append("its azimuths go counter-clockwise, which is not supported: it must count clockwise from north")
    if not s.has_time_of_day and now_s - s.untimed_s < UNTIMED_SHOWN_S:
        sentences.append("it sends no time of day: the time of arrival is taken")
    if s.senders is not None and now_s - s.second_s < SECOND_SHOWN_S:
        used, other = s.senders
        sentences.append(f"two senders have its SAC {s.sac}, SIC {s.sic}: {used}, which is used, and {other}, which is not")
    return sentences


class Made(TypedDict, total=False):
    """Fields of `RadarState` that are of a run. None: not known."""

    plots_a_turn: float | None
    threshold_db: float | None
    detection_probability: float | None
    false_plots_a_turn: float | None


class PlotsOfVideo:
    """What a run makes of the video of each radar."""

    def __init__(self) -> None:
        self._cycles: dict[str, deque[tuple[float, int]]] = {}  # by radar, of the last minute: time of the cycle, and plots
        self._time_s = -math.inf  # of the newest cycle
        self._stated: dict[str, tuple[float, float]] = {}  # by radar: seconds of a turn and range in m, as in the scenario
        self._threshold_db: dict[str, float] = {}
        self._cover: tuple[RadarCover, list[str]] | None = None  # and the names of its radars

    def note(self, cycle: Cycle, sensors: Sensors) -> None:
        """Note what was made of a cycle."""
        found, radars = cycle.extractions, sensors.radars
        self._time_s = cycle.time_s
        for radar, plots, threshold_db in zip(
            found.radar.tolist(), found.plots.tolist(), found.threshold_db.tolist(), strict=True
        ):
            name = str(radars.name[radar])
            self._threshold_db[name] = threshold_db
            self._stated[name] = float(radars.period_s[radar]), float(radars.range_m[radar])
            cycles = self._cycles.setdefault(name, deque())
            cycles.append((cycle.time_s, plots))
            while cycles[0][0] < cycle.time_s - WITHIN_S:
                cycles.popleft()
        if len(found) and len(cycle.radar_cover) == len(radars):
            self._cover = cycle.radar_cover, [str(name) for name in radars.name]

    def added_to(self, feeds: Sequence[FeedState]) -> Sequence[FeedState]:
        """The feeds, with what is made of the video of their radars. It writes into them."""
        for feed in feeds:
            for radar in feed.get("radars", ()):
                made = self._made(radar["name"], radar["turn_s"])
                radar["plots_a_turn"], radar["threshold_db"] = made.get("plots_a_turn"), made.get("threshold_db")
                radar["detection_probability"] = made.get("detection_probability")
                radar["false_plots_a_turn"] = made.get("false_plots_a_turn")
                radar["troubles"] += self._other_than_stated(radar)
        return feeds

    def _other_than_stated(self, radar: RadarState) -> list[str]:
        """What is not as the scenario says: trackers take its turn for that of the radar, and its range for what radars see."""
        stated_s, stated_m = self._stated.get(radar["name"], (math.nan, math.nan))
        turn_s, range_m, sentences = radar["turn_s"] or math.nan, radar["range_m"] or math.nan, []
        if abs(turn_s - stated_s) > OTHER_TURN * stated_s:
            sentences.append(f"it turns in {turn_s:.2f} s, the scenario says {stated_s:.2f} s: set rpm = {60.0 / turn_s:.1f}")
        if not SHORT_RANGE * stated_m <= range_m <= LONG_RANGE * stated_m and math.isfinite(range_m + stated_m):
            range_nm, stated_nm = range_m / NAUTICAL_MILE_M, stated_m / NAUTICAL_MILE_M
            sentences.append(f"its video reaches {range_nm:.1f} nm, the scenario says range_nm = {stated_nm:.1f}")
        return sentences

    def stored(self, feeds: Sequence[FeedState], sensors: Sensors) -> Floats:
        """What is stored of each radar, (R, 9) in the order of `store.VIDEO_VALUES`, NaN: not known; no rows: no radar sends video.

        Args: feeds: without what is made of their video. Of a radar in two feeds it is that which was heard last.
        """
        states = sorted((radar for feed in feeds for radar in feed.get("radars", ())), key=lambda radar: -radar["silent_s"])
        heard = {radar["name"]: radar for radar in states}
        if not heard and not self._cycles:
            return np.empty((0, len(VIDEO_VALUES)))
        values = np.full((len(sensors.radars), len(VIDEO_VALUES)), np.nan)
        for row, name in zip(values, map(str, sensors.radars.name), strict=True):
            state: dict[str, Any] = dict(heard.get(name, {}))
            state |= self._made(name, state.get("turn_s"))
            row[:] = [math.nan if (value := state.get(column)) is None else value for column in VIDEO_VALUES]
        return values

    def _made(self, name: str, turn_s: float | None) -> Made:
        """What is made of the video of a radar; empty: nothing yet, or no more. Args: turn_s: measured."""
        cycles = list(self._cycles.get(name, ()))
        if len(cycles) < 2:
            return {}
        turn_s = turn_s or self._stated[name][0]
        if self._time_s - cycles[-1][0] > max(STOPPED_S, STOPPED_TURNS * turn_s):
            return {}
        span_s = cycles[-1][0] - cycles[0][0]
        made: Made = {
            "plots_a_turn": round(sum(plots for _, plots in cycles[1:]) * turn_s / span_s, 1) if span_s > 0.0 else None,
            "threshold_db": _known(self._threshold_db[name], 2),
        }
        if self._cover is not None and name in self._cover[1]:
            detection, false = _learnt(self._cover[0], self._cover[1].index(name))
            made["detection_probability"], made["false_plots_a_turn"] = _known(detection, 3), _known(false, 2)
        return made


def _learnt(cover: RadarCover, radar: int) -> tuple[float, float]:
    """The mean probability of detection by looks, NaN: none, and false plots a turn, of a radar."""
    looks = cover.track_looks[radar]
    total = float(looks.sum())
    detection = float((cover.track_detection[radar] * looks).sum()) / total if total > 0.0 else math.nan
    edges_m = np.linspace(0.0, 1.0, COVER_RANGES + 1) * float(cover.range_m[radar])
    density: Floats = cover.false_plots_per_m2[radar]
    area_m2 = np.pi * np.diff(edges_m**2) / density.shape[0]
    return detection, float((density * area_m2).sum()) if cover.turns[radar] > 0.0 else math.nan


def _known(value: float, digits: int) -> float | None:
    """A number that JSON can say; none: it is not known."""
    return round(value, digits) if math.isfinite(value) else None
