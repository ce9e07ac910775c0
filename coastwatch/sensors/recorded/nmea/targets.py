"""Files of tracked targets, TTM and TLL, to track reports in order of arrival."""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
from pynmeagps import NMEAReader

from coastwatch.batches import FileContent, Floats, TrackReports, TrackSources
from coastwatch.formats.decoding import track_reports
from coastwatch.formats.intake.ais_validation import AisIntake
from coastwatch.formats.intake.faults import Ledger, Tally
from coastwatch.formats.intake.reception_time import LATE, TIME_MISSING, reception_times
from coastwatch.formats.nmea.sentences import OF_OWN_SHIP, wanted_sentences
from coastwatch.formats.nmea.targets import OWN_SHIP, TARGETS, State, TargetSentences, time_of_day_s
from coastwatch.sensors.recorded.nmea.feed import lines_of


def target_reports(
    path: Path, source: int, sources: TrackSources, assumed_s: float, intake: AisIntake, tally: Tally
) -> TrackReports:
    """The states of all targets in a file of sentences, in order of arrival. Other sentences are counted in the tally.

    Args: source: index of the track source that the file is of; assumed_s: a time near the first sentence, for sentences with a
    time of day and no date; NaN: none.
    Raises: OSError that names the file.
    """
    targets = TargetSentences(sources.site_deg[source], float(sources.heading_deg[source]), assumed_s, tally)
    states: list[State] = []
    lines: list[int] = []
    ledger = Ledger()
    for received in wanted_sentences(lines_of(path, tally), path.name, tally, TARGETS + OWN_SHIP, ledger):
        clock_s = received.clock_s if math.isnan(received.own_s) else received.own_s
        state = targets.state(received.sentence, clock_s, f"{path.name}:{received.line}")
        if state is not None:
            states.append(state)
            lines.append(received.line)
    ledger.beside[OF_OWN_SHIP] += targets.of_own_ship
    table = np.array(states, np.float64).reshape(-1, 7)
    times = reception_times(table[:, 2], intake.lateness_s, intake.longest_silence_s)
    for kind, mask in times.faults.items():
        tally.add_rows(kind, mask, lambda i: f"{path.name}:{lines[i]}", lambda i: "", used=kind == LATE)
    table, received_s = table[times.accepted], times.received_s[times.accepted]
    span = (float(table[:, 1].min()), float(table[:, 1].max())) if len(table) else (math.nan, math.nan)
    beside = tuple(ledger.beside.items())
    tally.add_file(FileContent(path.name, "track states", len(table), *span, read=ledger.read, beside=beside))
    reports = track_reports(source, table[:, 0], table[:, 1].copy(), table[:, 3:5], table[:, 5:7])
    return replace(reports, received_s=received_s)


def target_times(path: Path, assumed_s: float, intake: AisIntake, tally: Tally) -> Floats:
    """Reception times of the targets in a file. Lines that are no whole sentence are counted in the tally."""
    stamps: list[float] = []
    for received in wanted_sentences(lines_of(path, tally), path.name, tally, TARGETS):
        clock_s = received.clock_s if math.isnan(received.own_s) else received.own_s
        if math.isnan(clock_s) and not math.isnan(assumed_s):
            with suppress(Exception):  # counted when the file is read
                clock_s = assumed_s = time_of_day_s(getattr(NMEAReader.parse(received.sentence), "time", None), assumed_s)
        stamps.append(clock_s)
    stamps_known = np.array([s for s in stamps if not math.isnan(s)], np.float64)
    if len(stamps_known) < len(stamps):
        tally.add(TIME_MISSING, path.name, count=len(stamps) - len(stamps_known))
    return reception_times(stamps_known, intake.lateness_s, intake.longest_silence_s).received_s
