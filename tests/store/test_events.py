"""Every flag of a vessel is an event: from when until when, also after a kill, a restart from an older cycle, and when it flaps."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np
import past_world
import pytest
import store_world as world
from sqlalchemy import text

from coastwatch import store as kept
from coastwatch.alarms import EventMemory
from coastwatch.batches import AlarmKind, Flag, Picture, VesselAlarms
from coastwatch.errors import StoreError
from coastwatch.scenario import StoreSettings
from coastwatch.store import Store
from coastwatch.store.schema.database import reading
from coastwatch.store.schema.migrate import check
from coastwatch.store.write import write_cycle

pytestmark = pytest.mark.contract

CYCLES = 20
GAP_S = 12.0
KEEP = StoreSettings(event_gap_s=GAP_S)
ROWS = "SELECT vessel_id, kind, from_cycle, to_cycle, start_s, end_s FROM event ORDER BY vessel_id, kind, from_cycle"
GAPS = "SELECT vessel_id, kind, from_cycle, cycle, last_cycle, last_s FROM event_gap ORDER BY vessel_id, kind, cycle"


def flagged(seed: int, cycles: int = CYCLES) -> list[Picture]:
    """Vessels that come and go, and whose flags are set and cleared at random, some of them often."""
    rng = np.random.default_rng([seed, 17])
    flags, out = np.zeros((100, len(Flag)), np.bool_), []
    often = rng.choice([0.02, 0.4], (100, 1))
    for picture in past_world.pictures(5, cycles):
        flags = flags ^ (rng.random(flags.shape) < often)
        of = flags @ np.array([int(flag) for flag in Flag])
        out.append(replace(picture, flags=of[picture.vessel_id]))
    return out


def oracle(made: list[Picture], gap_s: float) -> tuple[list[tuple[Any, ...]], list[tuple[Any, ...]]]:
    """Events and gaps, one vessel and flag at a time."""
    events, gaps = [], []
    flags = [dict(zip(picture.vessel_id.tolist(), picture.flags.tolist(), strict=True)) for picture in made]
    for vessel in range(1, 101):
        for flag in Flag:
            cycles = [n for n, of_vessels in enumerate(flags) if of_vessels.get(vessel, 0) & flag]
            first = None
            for before, now in zip([None, *cycles], cycles, strict=False):
                kind = str(flag.name).lower()
                if before is None or (now != before + 1 and world.instant_s(now) - world.instant_s(before) > gap_s):
                    first = now
                    events.append([vessel, kind, now, now, world.instant_s(now), world.instant_s(now)])
                    continue
                if now != before + 1:
                    gaps.append((vessel, kind, first, now, before, world.instant_s(before)))
                events[-1][3], events[-1][5] = now, world.instant_s(now)
            if cycles and cycles[-1] == len(made) - 1:
                events[-1][3] = events[-1][5] = None
    return sorted(map(tuple, events), key=lambda e: e[:3]), sorted(gaps, key=lambda g: (g[0], g[1], g[3]))


def stored(store: Store, query: str) -> list[tuple[Any, ...]]:
    with reading(store) as connection:
        return [tuple(row) for row in connection.execute(text(query))]


@pytest.fixture(scope="module")
def sea(shared_url: str) -> Iterator[tuple[Store, int, list[Picture]]]:
    """A store with a run of flagged vessels, and the pictures of its cycles."""
    made = flagged(1)
    with kept.open_store(shared_url) as store:
        run = world.begin(store)
        past_world.write(store, run, made, keep=KEEP)
        yield store, run, made


def test_events_are_those_of_a_plain_loop(sea: tuple[Store, int, list[Picture]]) -> None:
    store, _, made = sea
    events, gaps = oracle(made, GAP_S)
    assert stored(store, ROWS) == events
    assert stored(store, GAPS) == gaps
    assert gaps


def test_without_a_gap_an_event_ends_with_the_first_cycle_that_lacks_it(url: str) -> None:
    made = flagged(1)
    with kept.open_store(url) as store:
        past_world.write(store, world.begin(store), made, keep=StoreSettings(event_gap_s=0.0))
        assert (stored(store, ROWS), stored(store, GAPS)) == (oracle(made, 0.0)[0], [])
    assert check(url) == []


def test_another_process_goes_on_with_the_events(url: str) -> None:
    made = flagged(2)
    with kept.open_store(url) as store:
        run = world.begin(store)
        for number, picture in enumerate(made):
            store.run_states.clear()  # as after a kill: all is read from the database
            past_world.write(store, run, [picture], number, KEEP)
        assert (stored(store, ROWS), stored(store, GAPS)) == oracle(made, GAP_S)


@pytest.mark.parametrize("back", [1, 15])
def test_events_are_those_of_a_run_that_never_went_back(url: str, back: int) -> None:
    """Cycles of another future are replaced from an older checkpoint on."""
    made, others = flagged(3), flagged(4)
    with kept.open_store(url) as store:
        run = world.begin(store)
        past_world.write(store, run, made[:back] + others[back:], keep=KEEP)
        store.run_states.clear()
        past_world.write(store, run, made[back:], back, KEEP)
        assert (stored(store, ROWS), stored(store, GAPS)) == oracle(made, GAP_S)


def test_no_change_of_flags_costs_no_row(url: str) -> None:
    made = [replace(picture, flags=np.full(len(picture), int(Flag.DARK))) for picture in [past_world.pictures(5, 1)[0]] * 4]
    with kept.open_store(url) as store:
        run = world.begin(store)
        past_world.write(store, run, made, keep=KEEP)
        assert stored(store, "SELECT count(*), min(to_cycle) FROM event") == [(len(made[0]), None)]


def test_old_events_go_and_lasting_ones_stay(url: str) -> None:
    made = flagged(5)
    hours = 10 * world.PERIOD_S / 3600.0
    with kept.open_store(url) as store:
        past_world.write(store, world.begin(store), made, keep=StoreSettings(event_gap_s=GAP_S, event_hours=hours))
        events, gaps = oracle(made, GAP_S)
        first = CYCLES - 10
        assert stored(store, ROWS) == [e for e in events if e[3] is None or e[3] >= first]
        assert stored(store, GAPS) == [g for g in gaps if g[3] >= first]
        assert len(events) > len(stored(store, ROWS)) > 0


def test_a_vessel_has_its_events(sea: tuple[Store, int, list[Picture]]) -> None:
    store, run, made = sea
    events, gaps = oracle(made, GAP_S)
    vessel = gaps[0][0]
    found = kept.track(store, run, vessel).events
    rows = [dict(zip(found.columns, row, strict=True)) for row in found.rows]
    assert sorted((row["kind"], row["start_s"], row["end_s"]) for row in rows) == sorted(
        ((e[1], e[4], e[5]) for e in events if e[0] == vessel), key=lambda e: e[:2]
    )
    assert sum(row["gaps"] for row in rows) == sum(g[0] == vessel for g in gaps)


def test_alarms_of_a_span_are_those_that_touch_it(sea: tuple[Store, int, list[Picture]]) -> None:
    store, _, made = sea
    from_s, to_s = world.instant_s(12), world.instant_s(15)
    found = kept.operator_query(store, "alarms", {"from_s": from_s, "to_s": to_s, "kind": "dark", "count": 10_000})
    wanted = [e for e in oracle(made, GAP_S)[0] if e[1] == "dark" and e[4] <= to_s and (e[5] is None or e[5] >= from_s)]
    assert sorted(found.column("vessel_id")) == sorted(e[0] for e in wanted)
    assert len(wanted) > 0


def raised(seed: int, cycles: int = CYCLES) -> list[VesselAlarms]:
    """Alarms that come and go at random, some of vessels that are not in the picture; several of a vessel and kind at a time."""
    rng, made = np.random.default_rng([seed, 19]), []
    kinds = [AlarmKind.ZONE_ENTER, AlarmKind.LINE_CROSSED, AlarmKind.CLOSE_APPROACH, AlarmKind.LOST]
    every = [(v, int(k), s) for v in range(1, 30) for k in kinds for s in ((0,) if k == AlarmKind.LOST else (1, 6, 1001))]
    on = np.zeros(len(every), np.bool_)
    for _ in range(cycles):
        on ^= rng.random(len(every)) < 0.1
        vessel, kind, subject = (
            np.array([row for row, shown in zip(every, on, strict=True) if shown], np.int64).reshape(-1, 3).T
        )
        n, unknown = len(vessel), np.full(int(on.sum()), 60.0)
        place = np.zeros((n, 2))
        made.append(VesselAlarms(vessel, kind, subject, np.full(n, "bar"), place, place, vessel, *([unknown] * 4)))
    return made


def oracle_of_alarms(made: list[VesselAlarms], gap_s: float) -> list[tuple[Any, ...]]:
    """Vessel, kind, subject, first and last cycle of each event, one alarm after the other."""
    sets = [set(zip(a.vessel_id.tolist(), a.kind.tolist(), a.subject.tolist(), strict=True)) for a in made]
    events: list[tuple[Any, ...]] = []
    for alarm in set().union(*sets):
        cycles = [number for number, found in enumerate(sets) if alarm in found]
        first = cycles[0]
        for before, now in zip(cycles, [*cycles[1:], None], strict=True):
            ends = now is None or world.PERIOD_S * (now - before) > max(gap_s, world.PERIOD_S)
            if ends:
                last = None if before == len(made) - 1 else before
                events.append((alarm[0], AlarmKind(alarm[1]).name.lower(), alarm[2], first, last))
                first = now if now is not None else first
    return sorted(events, key=lambda event: event[:4])


ALARMS = """
SELECT vessel_id, kind, subject, from_cycle, to_cycle FROM event
WHERE kind IN ('zone_enter', 'line_crossed', 'close_approach', 'lost') ORDER BY vessel_id, kind, subject, from_cycle
"""


def test_alarms_of_several_zones_and_pairs_are_events_also_after_kills_and_going_back(url: str) -> None:
    pictures, made, others = flagged(8), raised(1), raised(2)
    with kept.open_store(url) as store:
        run = world.begin(store)
        for first, of_alarms in ((0, made[:15] + others[15:19]), (15, made[15:])):
            for number, alarms in enumerate(of_alarms, first):
                store.run_states.clear()
                cycle = replace(world.cycle_of(number, 0, pictures[number]), vessel_alarms=alarms)
                world.write(store, run, number, cycle=cycle, keep=KEEP)
        assert stored(store, ALARMS) == oracle_of_alarms(made, GAP_S)
        assert stored(store, ROWS.replace("FROM event", "FROM event WHERE kind = 'dark'")) == [
            event for event in oracle(pictures, GAP_S)[0] if event[1] == "dark"
        ]
        said = {text for (text,) in stored(store, "SELECT evidence FROM event WHERE kind = 'close_approach' AND subject = 6")}
        assert any(
            re.match(
                r"with vessel 6 \(MMSI 710000005\), CPA 0.03 NM in 1.0 min, range 0.03 NM, positions \d+ and \d+ s old; seen by",
                text,
            )
            for text in said
        )
        with_it = kept.track(store, run, 6).events
        assert {row[0] for row in with_it.rows} > {"close_approach", "lost", "dark"}
    assert check(url) == []


def test_a_dark_vessel_says_when_it_was_last_heard_and_who_should_hear_it(url: str) -> None:
    """Vessel 1 never had AIS, vessel 2 had it 95 s ago, of vessel 4 no report is known since it came back; only 1 is in range."""
    made = past_world.pictures(5, 1)[0].take(np.array([0, 1, 2, 3]))
    far_deg = np.array([[-22.9, -43.2], [-20.0, -43.2], [-22.9, -43.1], [-20.0, -43.2]])
    flags = np.array([int(Flag.DARK), int(Flag.DARK), int(Flag.AIS_WITHOUT_RADAR), int(Flag.DARK)])
    mmsi, time_s = np.array([-1, 710_000_002, 710_000_003, 710_000_004]), world.instant_s(0)
    made = replace(made, position_deg=far_deg, flags=flags, mmsi=mmsi)
    heard_s = np.array([-np.inf, time_s - 95.0, time_s - 1.0, -np.inf])
    with kept.open_store(url) as store:
        run = world.begin(store)
        cycle = world.cycle_of(0, 0, made)
        _, events = world.events_of(EventMemory.none(), cycle, GAP_S, heard_s)
        world.write(store, run, 0, cycle=replace(cycle, events=events))
        said = [text.split("; seen by")[0] for (text,) in stored(store, "SELECT evidence FROM event ORDER BY vessel_id")]
    assert said == [
        "never heard on AIS; in range of AIS station hill; limit 60 s",
        "last AIS 2025-06-15 15:05:08 UTC, 95 s before; limit 60 s",
        "AIS goes on without a radar track; in range of radars fort, island; limit 45 s",
        "no AIS since it came back; limit 60 s",
    ]


def test_a_lost_vessel_that_has_left_the_picture_is_an_event_alone(url: str) -> None:
    """No other alarm begins in the cycle, and the vessel has neither a row of the picture nor a track."""
    picture, one = past_world.pictures(5, 1)[0], np.array([60.0])
    gone = VesselAlarms(
        vessel_id=np.array([10_000]), kind=np.array([int(AlarmKind.LOST)]), subject=np.array([0]), name=np.array([""]),
        position_deg=np.zeros((1, 2)), velocity_m_s=np.full((1, 2), 4.0), mmsi=np.array([-1]),
        distance_m=np.array([np.nan]), range_m=np.array([np.nan]), interval_s=one * 2.0, to_right=np.array([np.nan]),
    )  # fmt: skip
    with kept.open_store(url) as store:
        run = world.begin(store)
        past_world.write(store, run, [picture], 0, KEEP)
        cycle = replace(world.cycle_of(1, 0, picture), vessel_alarms=gone)
        world.write(store, run, 1, cycle=cycle, keep=KEEP)
        said = stored(store, "SELECT vessel_id, evidence FROM event WHERE kind = 'lost'")
    assert said == [(10_000, "no track for 120 s, under way at 11.0 kn before")]


def test_an_alarm_that_is_found_again_after_going_back_can_be_acknowledged_again(url: str) -> None:
    dark = [replace(past_world.pictures(5, 1)[0], flags=np.full(len(past_world.pictures(5, 1)[0]), int(Flag.DARK)))] * 3
    with kept.open_store(url) as store:
        run = world.begin(store)
        past_world.write(store, run, dark, keep=KEEP)
        by, all_dark = kept.Acknowledgement(1.0, "Ana", "", "loopback"), kept.Beginnings(["dark"], None, 0.0, 1e12)
        assert kept.acknowledge_all(store, run, all_dark, by) == len(dark[0])
        store.run_states.clear()
        past_world.write(store, run, dark, 0, KEEP)
        assert kept.acknowledge_all(store, run, all_dark, by) == len(dark[0])
        assert stored(store, "SELECT count(*) FROM acknowledgement") == [(len(dark[0]),)]
        assert kept.acknowledge_all(store, run, all_dark, by) == 0


def test_a_cycle_that_was_written_although_the_answer_was_lost_is_written_again(
    url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = flagged(6, 4)
    with kept.open_store(url) as store:
        run = world.begin(store)
        past_world.write(store, run, made[:2], keep=KEEP)
        true = write_cycle.database.writing

        @contextmanager
        def lost(store: Store) -> Iterator[Any]:
            with true(store) as connection:
                yield connection
            raise StoreError("the connection was lost")

        monkeypatch.setattr(write_cycle.database, "writing", lost)
        with pytest.raises(StoreError):
            past_world.write(store, run, [made[2]], 2, KEEP)
        monkeypatch.setattr(write_cycle.database, "writing", true)
        past_world.write(store, run, made[2:], 2, KEEP)
        assert (stored(store, ROWS), stored(store, GAPS)) == oracle(made, GAP_S)
