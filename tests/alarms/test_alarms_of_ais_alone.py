"""Alarms of a run of AIS alone, from the file to the event: lost vessels and close approaches, at periods of 1, 3 and 10 s."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest

from coastwatch.batches import BegunEvents, Floats
from coastwatch.batches.kinds import EVENT_KINDS
from coastwatch.cycle import run_cycle, start_run
from coastwatch.geodesy import KNOT_M_S, offset_deg
from coastwatch.operators import recorded
from coastwatch.scenario import Scenario, make_scenario
from coastwatch.stage import serial

pytestmark = pytest.mark.whole

BEGIN_S = 1_780_000_000.0
STATION = np.array([-22.9, -43.1])
REPORTS_S = 10.0
"""Between the reports of a class A vessel of 0 to 14 kn."""

Way = Callable[[float], tuple[Floats, Floats]]
"""Metres east and north of the station, and m/s, at seconds after the begin; without a report where the position is NaN."""


def straight(from_m: tuple[float, float], knots: float, course_deg: float, silent_s: tuple[float, float] = (0.0, 0.0)) -> Way:
    course = np.radians(course_deg)
    velocity = knots * KNOT_M_S * np.array([np.sin(course), np.cos(course)])

    def way(after_s: float) -> tuple[Floats, Floats]:
        silent = silent_s[0] <= after_s < silent_s[1]
        return np.array(from_m) + velocity * after_s + (np.nan if silent else 0.0), velocity

    return way


def scenario_of(folder: Path, ways: list[Way], last_s: float, period_s: float) -> Scenario:
    """A scenario of one table of AIS and one station, as `coastwatch fuse` makes it."""
    rows = []
    for k, way in enumerate(ways):
        for after_s in np.arange(0.37 * k % REPORTS_S, last_s, REPORTS_S).tolist():
            at_m, velocity = way(after_s)
            if np.isfinite(at_m).all():
                lat, lon = offset_deg(STATION, at_m)
                knots, course = np.hypot(*velocity) / KNOT_M_S, np.degrees(np.arctan2(*velocity)) % 360.0
                rows.append((BEGIN_S + after_s, 710_000_001 + k, lat, lon, knots, course))
    path = folder / "ais.csv"
    lines = (f"{t:.2f},{mmsi},{lat:.6f},{lon:.6f},{sog:.1f},{cog:.1f}\n" for t, mmsi, lat, lon, sog, cog in sorted(rows))
    path.write_text("time,mmsi,latitude,longitude,sog,cog\n" + "".join(lines))
    station = {"name": "hill", "latitude_deg": STATION[0], "longitude_deg": STATION[1], "range_nm": 20.0}
    files = recorded.Files((str(path),), None, None, (), {})
    sensors = {"radars": [], "stations": [station], "sonars": [], "track_sources": []}
    return recorded.framed(make_scenario(recorded.document(files, sensors, period_s), "test", {}))


def begun(scenario: Scenario, merged: int = 1) -> Iterator[BegunEvents]:
    """The events that begin in each cycle. Args: merged: cycles that are computed as one, as by a server that is behind."""
    sensors, plan = scenario.sensors(), scenario.plan()
    reports = scenario.input.load(sensors, 0, plan).reports
    memory, before_s = start_run(scenario, sensors), -np.inf
    for number in range(0, plan.cycles, merged):
        now_s = plan.instant_s(number)
        part = reports.between(before_s, now_s)
        memory, cycle = run_cycle(scenario, sensors, memory, part, now_s, serial, lambda _: nullcontext())
        yield cycle.events.begun
        before_s = now_s


def events_of(kind: str, found: Iterator[BegunEvents]) -> list[tuple[float, str]]:
    """Seconds after the begin and evidence of each event of a kind."""
    out = []
    for events in found:
        rows = [row for row, number in enumerate(events.kind.tolist()) if EVENT_KINDS[number] == kind]
        out += [(float(events.start_s[row]) - BEGIN_S, str(events.evidence[row])) for row in rows]
    return out


@pytest.mark.parametrize("period_s", [3.0, 10.0])
def test_a_vessel_that_stops_sending_within_range_is_lost_once(period_s: float, tmp_path: Path) -> None:
    """20 vessels at 10 kn; one sends nothing for 6 minutes, and then goes on."""
    ways = [straight((-4000.0, 600.0 * k - 6000.0), 10.0, 90.0, (300.0, 660.0) if k == 7 else (0.0, 0.0)) for k in range(20)]
    scenario = scenario_of(tmp_path, ways, 750.0, period_s)
    found = events_of("lost", begun(scenario))
    assert len(found) == 1
    patience_s = scenario.ais_tracks.patience_s + scenario.ais_tracks.patience_intervals * REPORTS_S
    assert 0.0 < found[0][0] - 300.0 - scenario.alarms.lost_after_s <= patience_s + 2.0 * period_s
    assert "under way at 10.0 kn before" in found[0][1]


@pytest.mark.parametrize(("period_s", "merged"), [(1.0, 1), (3.0, 1), (10.0, 1), (1.0, 10)])
def test_two_ships_on_collision_course_sound_more_than_a_minute_before(period_s: float, merged: int, tmp_path: Path) -> None:
    """They meet after 300 s. The third one crosses ahead of them by a mile."""
    knots, meet_s = 12.0, 300.0
    away_m = knots * KNOT_M_S * meet_s
    ways = [straight((-away_m, 0.0), knots, 90.0), straight((0.0, -away_m), knots, 0.0), straight((0.0, 1852.0), knots, 90.0)]
    ((sounded_s, said),) = events_of("close_approach", begun(scenario_of(tmp_path, ways, meet_s, period_s), merged))
    assert 60.0 < meet_s - sounded_s <= 180.0
    ages = [float(word) for word in said.split("positions ")[1].split(" s old")[0].split(" and ")]
    assert len(ages) == 2
    assert max(ages) <= REPORTS_S + period_s


def test_a_pair_whose_positions_are_old_raises_no_close_approach(tmp_path: Path) -> None:
    """The second ship is silent from 330 s on, half a minute after the pair is within the limits. It is predicted for longer."""
    knots, meet_s = 12.0, 480.0
    away_m = knots * KNOT_M_S * meet_s
    first, second = straight((-away_m, 0.0), knots, 90.0), straight((0.0, -away_m), knots, 0.0, (330.0, 1e9))
    scenario = scenario_of(tmp_path, [first, second], meet_s, 3.0)
    tracks = scenario.ais_tracks.model_copy(update={"patience_s": 300.0})
    for oldest_s, sounds in ((25.0, 0), (300.0, 1)):
        alarms = scenario.alarms.model_copy(update={"cpa_oldest_s": oldest_s})
        given = scenario.model_copy(update={"alarms": alarms, "ais_tracks": tracks})
        assert len(events_of("close_approach", begun(given))) == sounds
