"""How many alarms a watch officer gets in an hour of a scenario, by kind, and what settings change.

    python -m scaling.decisions.alarm_rate SCENARIO [--cycles N] [--seed S] [--set KEY=VALUE ...] [--try KEY=VALUE,...]

The scenario runs once. Its pictures then go through the alarms with the settings of the scenario, and once more for each `--try`
(settings of [alarms]). Each gives one line. It has events an hour by kind, as the store counts them (`store.event_gap_s`). Then follow
how many last at the end, the most that last at a time, and milliseconds of processor a cycle. The last line has the dark alarms by
the AIS of their true vessels.
"""

from __future__ import annotations

import argparse
import time
from contextlib import nullcontext
from typing import NamedTuple

import numpy as np

from coastwatch.alarms import AlarmInput, AlarmRules, EventMemory, EvidenceContext, expected_sensors, next_events, numbered
from coastwatch.alarms.lasting import KEYS
from coastwatch.batches import (
    AisReports,
    BearingAssociations,
    BearingTracks,
    EventChanges,
    Flag,
    Members,
    Picture,
    RadarCover,
    Reports,
    Sensors,
    Tracks,
    VesselAlarms,
)
from coastwatch.batches.kinds import EVENT_KINDS, IS_ALARM
from coastwatch.cycle import run_cycle, start_run
from coastwatch.operators.cli.arguments import names, pair
from coastwatch.scenario import Scenario, load_scenario
from coastwatch.scores.dark import SILENT_FOR_S
from coastwatch.stage import serial

NONE = np.zeros(0, np.int64)
DARK = int(Flag.DARK).bit_length() - 1
"""Bit of the flag."""

COVER_CYCLES = 20


class Made(NamedTuple):
    """What a cycle gave that alarms need."""

    time_s: float
    picture: Picture
    members: Members
    cover: RadarCover


def pictures_of(scenario: Scenario, sensors: Sensors, reports: Reports) -> list[Made]:
    """Every cycle. The cover is of the newest of every COVER_CYCLES cycles: each has its own arrays."""
    plan = scenario.plan()
    memory, before_s, out = start_run(scenario, sensors), -np.inf, []
    cover = memory.radar_cover
    for number in range(plan.cycles):
        now_s = plan.instant_s(number)
        part = reports.between(before_s, now_s)
        cover = memory.radar_cover if number % COVER_CYCLES == 0 else cover
        memory, cycle = run_cycle(scenario, sensors, memory, part, now_s, serial, lambda _: nullcontext(), zones=())
        out.append(Made(now_s, cycle.picture, cycle.members, cover))
        before_s = now_s
    return out


def events_after(
    scenario: Scenario, sensors: Sensors, memory: EventMemory, picture: Picture, alarms: VesselAlarms, time_s: float
) -> tuple[EventMemory, EventChanges]:
    """The events after a cycle, without the tracks in their evidence."""
    none = Tracks.empty(), Members.empty(), BearingTracks.empty(), BearingAssociations(NONE, NONE, np.zeros(0), np.zeros(0))
    expected = expected_sensors(
        sensors, scenario.picture.cover_margin, scenario.picture.dark_after_s, scenario.picture.unseen_after_s
    )
    evidence = EvidenceContext(*none, sensors.source_names, *expected, np.full(len(picture), -np.inf))
    return next_events(memory, picture, alarms, time_s, scenario.store.event_gap_s, evidence)


def rate(scenario: Scenario, rules: AlarmRules, sensors: Sensors, made: list[Made]) -> str:
    """One line of figures."""
    memory, events = rules.init(), EventMemory.none()
    count, most, spent_s, zones = dict.fromkeys(EVENT_KINDS.values(), 0), 0, [], numbered(scenario.zones)
    for now_s, picture, members, cover in made:
        begun = time.process_time()
        memory, alarms = rules.step(memory, AlarmInput(picture, members, now_s, sensors, zones, cover))
        spent_s.append(time.process_time() - begun)
        events, changes = events_after(scenario, sensors, events, picture, alarms, now_s)
        for kind in changes.begun.kind[IS_ALARM[changes.begun.kind]].tolist():
            count[EVENT_KINDS[kind]] += 1
        last = int((np.isnan(events.end_s) & IS_ALARM[events.key % KEYS]).sum())
        most = max(most, last)
    hours = (made[-1].time_s - made[0].time_s) / 3600.0
    rates = {kind: found / hours for kind, found in count.items() if found}
    said = ", ".join(f"{kind} {value:.1f}" for kind, value in rates.items())
    return (
        f"{hours:.2f} h, {np.mean([len(cycle.picture) for cycle in made]):.0f} vessels: {sum(rates.values()):.1f} alarms an hour: "
        f"{said}; {last} last at the end, {most} at most; {1e3 * np.median(spent_s):.2f} ms a cycle"
    )


def dark_alarms(scenario: Scenario, ais: AisReports, made: list[Made]) -> str:
    """The dark alarms by the AIS of their true vessels."""
    sensors, events = scenario.sensors(), EventMemory.none()
    said = "that never sends AIS", "that never sends again", "silent for 60 s then", "that is not silent"
    count = dict.fromkeys((*(f"a vessel {one}" for one in said), "no true vessel"), 0)
    never, silent, paused, wrong, no_vessel = count
    for now_s, picture, *_ in made:
        events, changes = events_after(scenario, sensors, events, picture, VesselAlarms.empty(), now_s)
        dark = changes.begun.vessel_id[changes.begun.kind == DARK]
        for origin in picture.origin[np.searchsorted(picture.vessel_id, dark)].tolist():
            sent_s = ais.received_s[ais.origin == origin]
            heard, later = (sent_s > now_s - SILENT_FOR_S) & (sent_s <= now_s), sent_s > now_s
            kind = wrong if heard.any() else never if not len(sent_s) else paused if later.any() else silent
            count[no_vessel if origin < 0 else kind] += 1
    return f"{sum(count.values())} dark alarms: " + ", ".join(f"{found} of {kind}" for kind, found in count.items())


def settings_of(text: str) -> dict[str, str]:
    """The settings in KEY=VALUE,KEY=VALUE."""
    return dict(map(pair, names(text)))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenario")
    parser.add_argument("--cycles", type=int)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", type=pair, help="a setting of the scenario")
    parser.add_argument(
        "--try", action="append", default=[], metavar="KEY=VALUE,...", type=settings_of, dest="tried", help="of [alarms]"
    )
    options = parser.parse_args()
    changes = dict(options.set)
    if options.cycles:
        changes["cycles"] = str(options.cycles)
    scenario = load_scenario(options.scenario, changes)
    sensors = scenario.sensors()
    reports = scenario.input.load(sensors, options.seed, scenario.plan()).reports
    if not isinstance(reports, Reports):
        parser.error(f"SCENARIO: got {options.scenario!r}, whose reports come as a stream, needed one that is read at once")
    made = pictures_of(scenario, sensors, reports)
    for given in [{}, *options.tried]:
        tried = ",".join(f"{key}={value}" for key, value in given.items())
        rules = AlarmRules.model_validate({**scenario.alarms.model_dump(), **given})
        print(f"{tried or 'as set'}: {rate(scenario, rules, sensors, made)}", flush=True)
    print(dark_alarms(scenario, reports.ais, made))


if __name__ == "__main__":
    main()
