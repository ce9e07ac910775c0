"""From video to tracks: a regional centre extracts, the trackers of today follow, and a checkpoint changes nothing."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest

from coastwatch.batches import AzimuthReference, HeadingReports, Messages, RadarCorrections, RadarReports, Videos
from coastwatch.cycle import run_cycle, start_run
from coastwatch.geodesy import difference_m
from coastwatch.regional import reports_of_regions
from coastwatch.scenario import load_scenario
from coastwatch.server.checkpoint import load, save
from coastwatch.server.timing import Stopwatch
from coastwatch.stage import serial, serial_regions
from coastwatch.workers.region_processes import ProcessHosts
from coastwatch.workers.remote_regions import RemoteRegions

pytestmark = pytest.mark.contract

QUICK = {"radars.0.range_nm": "3.0", "input.cells": "512", "cycles": "15"}


def cycles(scenario, saved_at=None):
    """Yields the picture of each cycle and its truth."""
    sensors, plan = scenario.sensors(), scenario.plan()
    recording, memory = scenario.input.load(sensors, 2001, plan), start_run(scenario, sensors)
    for number in range(plan.cycles):
        reports = recording.reports.between(plan.start_s if number == 0 else plan.instant_s(number - 1), plan.instant_s(number))
        memory, cycle = run_cycle(scenario, sensors, memory, reports, plan.instant_s(number), serial, Stopwatch())
        if number == saved_at:
            memory = load(save(memory))
            recording = scenario.input.load(sensors, 2001, plan)
        yield cycle, recording.truth.at(cycle.time_s)


def test_two_tugs_are_found_in_video_and_followed():
    scenario = load_scenario("heymann-table-1", QUICK)
    found = list(cycles(scenario))
    for cycle, truth in found[8:]:
        assert len(cycle.tracks) == 2
        assert sorted(cycle.tracks.origin.tolist()) == [0, 1]
        off = difference_m(cycle.tracks.position_deg, truth.position_deg[np.argsort(np.argsort(cycle.tracks.origin))])
        assert np.hypot(*off.T).max() < 60.0
        assert len(cycle.picture) == 2


def test_a_run_that_is_saved_in_mid_turn_goes_on_to_the_bit():
    scenario = load_scenario("heymann-table-1", QUICK | {"period_s": "1.7", "cycles": "12"})
    want, got = list(cycles(scenario)), list(cycles(scenario, saved_at=5))
    for (one, _), (other, _) in zip(want, got, strict=True):
        assert np.array_equal(one.tracks.position_deg, other.tracks.position_deg)
        assert np.array_equal(one.picture.vessel_id, other.picture.vessel_id)


def test_video_of_a_ship_that_swings_is_followed_as_that_of_a_radar_on_land():
    scenario = load_scenario("heymann-table-1", QUICK)
    sensors, plan = scenario.sensors(), scenario.plan()
    radars = replace(sensors.radars, azimuth_reference=np.array([AzimuthReference.HEADING]))
    stream, memory = scenario.input.load(sensors, 2001, plan).reports, start_run(scenario, sensors)
    for number, (want, _) in enumerate(cycles(scenario)):
        since = plan.start_s if number == 0 else plan.instant_s(number - 1)
        reports = stream.between(since, plan.instant_s(number))
        swung = [
            replace(v, azimuth_rad=(v.azimuth_rad - np.radians(swinging_deg(v.time_s))) % (2.0 * np.pi))
            for v in reports.video.parts
        ]
        at_s = np.arange(np.ceil(10.0 * since), 10.0 * plan.instant_s(number)) / 10.0
        headings = HeadingReports(np.zeros(len(at_s), np.int64), at_s, at_s, swinging_deg(at_s))
        reports = replace(reports, video=Videos(tuple(swung)), headings=headings)
        of_ship = replace(sensors, radars=radars)
        memory, cycle = run_cycle(scenario, of_ship, memory, reports, plan.instant_s(number), serial, Stopwatch())
        if number == 5:
            memory = load(save(memory))
        assert len(cycle.tracks) == len(want.tracks)
        assert np.abs(difference_m(cycle.tracks.position_deg, want.tracks.position_deg)).max(initial=0.0) < 5.0
    assert memory.headings.left_out == 0


def swinging_deg(time_s):
    """The heading of a ship at anchor that yaws 8 deg to either side in 40 s, through north."""
    return (358.0 + 8.0 * np.sin(2.0 * np.pi * time_s / 40.0)) % 360.0


def test_each_region_is_given_the_video_of_its_own_radars():
    scenario = load_scenario("heymann-table-1", QUICK)
    radar = scenario.radars[0]
    others = (radar, radar.model_copy(update={"name": "far", "region": "other"}))
    scenario = scenario.model_copy(update={"radars": others})
    sensors, plan = scenario.sensors(), scenario.plan()
    video = scenario.input.load(sensors, 1, plan).reports.between(plan.start_s, plan.instant_s(0)).video
    assert {part.sensor for part in video.parts} == {0, 1}
    none = RadarCorrections.empty(R=2)
    given, _ = reports_of_regions(RadarReports.empty(), [Messages.empty()] * 2, none, plan.instant_s(0), sensors, video)
    assert [[part.sensor for part in one.video.parts] for one in given] == [[0], [0]]
    assert given[1].video.parts[0].level is not given[0].video.parts[0].level
    assert isinstance(given[0].video, Videos)


def test_tracks_go_on_where_a_radar_changes_its_range_in_mid_turn():
    near = load_scenario("heymann-table-1", QUICK)
    far = load_scenario("heymann-table-1", QUICK | {"input.cells": "320", "radars.0.range_nm": "3.75"})
    sensors, plan = near.sensors(), near.plan()
    changed_s = plan.start_s + 9.6 * plan.period_s  # between the tugs: each has been seen in this turn, or comes
    streams = [one.input.load(one.sensors(), 2001, plan) for one in (near, far)]
    memory, ids, parts = start_run(near, sensors), [], []
    for number in range(plan.cycles):
        after_s, now_s = plan.start_s if number == 0 else plan.instant_s(number - 1), plan.instant_s(number)
        first, second = (
            stream.reports.between(max(after_s, begin_s), min(now_s, end_s))
            for stream, begin_s, end_s in zip(streams, (-np.inf, changed_s), (changed_s, np.inf), strict=True)
        )
        reports = replace(first, video=Videos.merged([first.video, second.video]))
        parts.append(len(reports.video.parts))
        memory, cycle = run_cycle(near, sensors, memory, reports, now_s, serial, Stopwatch())
        ids.append(dict(zip(cycle.tracks.origin.tolist(), cycle.tracks.track_id.tolist(), strict=True)))
        truth = streams[0].truth.at(now_s)
        if number >= 8:
            assert sorted(ids[-1]) == [0, 1]
            assert ids[-1] == ids[8]
            off = difference_m(cycle.tracks.position_deg, truth.position_deg[cycle.tracks.origin])
            assert np.hypot(*off.T).max() < 60.0
    assert parts[9] == 2  # both scales in one cycle
    assert set(parts) == {1, 2}


def whole_run(scenario, recording, regions, order):
    """Every cycle of a run as bytes. Args: order: shuffles the parts of the video, or none; those of a radar keep their order."""
    sensors, plan = scenario.sensors(), scenario.plan()
    memory, out = start_run(scenario, sensors), []
    for number in range(plan.cycles):
        after_s, now_s = plan.start_s if number == 0 else plan.instant_s(number - 1), plan.instant_s(number)
        reports = recording.reports.between(after_s, now_s)
        if order is not None:
            reports = replace(reports, video=shuffled(reports.video, order))
        memory, cycle = run_cycle(scenario, sensors, memory, reports, now_s, serial, Stopwatch(), regions)
        batches = (cycle.tracks, cycle.picture, cycle.members, cycle.extractions)
        out.append([np.ascontiguousarray(getattr(b, f.name)).tobytes() for b in batches for f in fields(b)])
    assert len(cycle.tracks) >= 4
    return out


def shuffled(video, order):
    """The batches of each radar, cut in two, between those of others in any order."""
    queues = {}
    for part in video.parts:
        cut = int(order.integers(0, len(part) + 1))
        queues.setdefault(part.sensor, []).extend(v for v in (part.take(slice(cut)), part.take(slice(cut, None))) if len(v))
    turns = order.permutation([sensor for sensor, queue in queues.items() for _ in queue]).tolist()
    return Videos(tuple(queues[sensor].pop(0) for sensor in turns))


def test_workers_and_the_order_of_radars_and_batches_change_no_bit():
    scenario = load_scenario("heymann-table-1", QUICK | {"cycles": "8"})
    radar = scenario.radars[0]
    others = [
        radar.model_copy(update={"name": name, "region": region, "latitude_deg": 54.3 + north_deg})
        for name, region, north_deg in (("beside", "ship", 0.003), ("far", "other", -0.003))
    ]
    scenario = scenario.model_copy(update={"radars": (radar, *others)})
    recording = scenario.input.load(scenario.sensors(), 2001, scenario.plan())
    want = whole_run(scenario, recording, serial_regions, None)
    assert whole_run(scenario, recording, serial_regions, np.random.default_rng(1)) == want
    with ProcessHosts(2) as hosts:
        assert whole_run(scenario, recording, RemoteRegions(hosts), np.random.default_rng(2)) == want
