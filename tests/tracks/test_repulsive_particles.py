"""Repulsive particles: vessels found in video, each once; the same to the bit wherever the video is cut or saved; refusals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from coastwatch.batches import Messages, Plots, RadarCorrections, RadarExcess, Tracks
from coastwatch.geodesy import difference_m
from coastwatch.plots import ExtractionInput, over_background
from coastwatch.regional import RegionCycle, reports_of_regions, start_region, step_of_regions
from coastwatch.scenario import Scenario, load_scenario
from coastwatch.server.checkpoint import load, save
from coastwatch.tracks import RegionInput, RegionOutput, RepulsiveParticles
from coastwatch.tracks.radar.repulsive_particles.memory import ParticlesMemory, Window

pytestmark = pytest.mark.contract

QUICK = {"radars.0.range_nm": "2.5", "input.cells": "426", "input.spokes": "512", "cycles": "25"}


def scenario_of(method: RepulsiveParticles, **further: str) -> Scenario:
    return load_scenario("heymann-table-1", QUICK | further).model_copy(update={"tracks": method})


def run(scenario: Scenario, saved_at: Sequence[int] = ()) -> list[RegionCycle]:
    """Each cycle of the region."""
    sensors, plan = scenario.sensors(), scenario.plan()
    recording, none = scenario.input.load(sensors, 2001, plan), RadarCorrections.empty(R=1)
    step, memory, out = step_of_regions(scenario), start_region(scenario), []
    for cycle in range(plan.cycles):
        now_s = plan.instant_s(cycle)
        reports = recording.reports.between(plan.instant_s(cycle - 1) if cycle else plan.start_s, now_s)
        given, _ = reports_of_regions(reports.radar, [Messages.empty()], none, now_s, sensors, reports.video)
        memory, found = step(memory, given[0])
        out.append(found)
        if cycle in saved_at:
            memory = load(save(memory))
    return out


def test_two_tugs_are_found_and_followed_one_track_each():
    scenario = scenario_of(RepulsiveParticles())
    out = run(scenario)
    plan = scenario.plan()
    truth = scenario.input.load(scenario.sensors(), 2001, plan).truth
    first = next(k for k, found in enumerate(out) if len(found.tracks) == 2)
    assert 4 <= first < 15, "a filter has a vessel after five looks"
    for cycle in range(first, plan.cycles):
        tracks = out[cycle].tracks
        assert sorted(tracks.origin.tolist()) == [0, 1]
        true_deg = truth.at(plan.instant_s(cycle)).position_deg[tracks.origin]
        assert np.hypot(*difference_m(tracks.position_deg, true_deg).T).max() < 100.0
        assert np.linalg.eigvalsh(tracks.covariance).min() > 0.0
    assert len({number for found in out for number in found.tracks.track_id.tolist()}) == 2


def test_without_repulsion_filters_gather_on_the_same_vessels():
    one = RepulsiveParticles(repulsion="none")
    found = run(scenario_of(one))
    assert max(len(cycle.tracks) for cycle in found) > 2
    literal = run(scenario_of(RepulsiveParticles(repulsion="literal_equation")))
    assert [cycle.tracks.track_id.tolist() for cycle in literal] == [cycle.tracks.track_id.tolist() for cycle in found]


def test_it_resumes_to_the_bit_in_mid_turn():
    scenario = scenario_of(RepulsiveParticles(particles=300), period_s="1.7", cycles="20")
    want, got = run(scenario), run(scenario, saved_at=(3, 9, 10))
    assert len(want[-1].tracks) == 2
    for one, other in zip(want, got, strict=True):
        for name in Tracks.__dataclass_fields__:
            np.testing.assert_array_equal(getattr(one.tracks, name), getattr(other.tracks, name), err_msg=name)


def test_another_seed_has_other_particles_and_a_memory_of_others_is_refused():
    one, other = (run(scenario_of(RepulsiveParticles(particles=200, seed=seed), cycles="12"))[-1] for seed in (0, 1))
    assert not np.array_equal(one.tracks.covariance, other.tracks.covariance)
    scenario = scenario_of(RepulsiveParticles(particles=200), cycles="1")
    memory = RepulsiveParticles(particles=100).init()
    with pytest.raises(ValueError, match="got 100 a filter, needed 200"):
        scenario.tracks.step(memory, RegionInput.of_plots(Plots.empty(), 1.0, scenario.sensors()))


def excess(azimuth_deg: list[float], time_s: list[float], cells: int = 4) -> RadarExcess:
    count = len(azimuth_deg)
    levels = np.tile(np.arange(count, dtype=np.int8)[:, None], (1, cells))
    return RadarExcess(0, 0.0, 10.0, np.array(time_s), np.radians(azimuth_deg), np.zeros((count, 2)), levels)


def test_a_window_goes_on_over_north_and_begins_again_with_another_scale():
    first, second = excess([350.0, 355.0], [0.0, 0.1]), excess([2.0, 7.0], [0.2, 0.3])
    none = Window(0.0, 10.0, np.zeros(0), np.zeros(0), first.half_db[:0])
    window = none.with_spokes(first).with_spokes(second)
    np.testing.assert_allclose(np.degrees(window.angle), [350.0, 355.0, 362.0, 367.0])
    assert np.degrees(window.newest(np.radians(6.0)).angle).tolist() == pytest.approx([362.0, 367.0])
    assert len(window.with_spokes(excess([8.0], [0.4], cells=8))) == 1


def test_a_clock_that_is_set_back_begins_the_window_again():
    first, second = excess([10.0, 20.0, 30.0], [100.0, 100.1, 100.2]), excess([40.0, 50.0], [100.15, 70.0])
    none = Window(0.0, 10.0, np.zeros(0), np.zeros(0), first.half_db[:0])
    whole = none.with_spokes(first).with_spokes(excess([40.0], [100.15]))
    assert whole.time_s.tolist() == [100.0, 100.1, 100.2, 100.2], "jitter"
    window = none.with_spokes(first).with_spokes(second)
    assert (np.degrees(window.angle).round(9).tolist(), window.time_s.tolist()) == ([50.0], [70.0])


def turn(from_s: float, set_back_s: float = 0.0) -> RadarExcess:
    """One turn of 360 spokes in 2.4 s, with a ship at rest at 1,000 m on 090. Args: set_back_s: of the clock, in mid-turn."""
    azimuth_deg = np.arange(360.0)
    levels = np.zeros((360, 200), np.int8)
    levels[85:96, 95:106] = 30
    time_s = from_s + azimuth_deg / 150.0 - set_back_s * (azimuth_deg >= 180.0)
    site_deg = np.tile(SENSORS.radars.site_deg[0], (360, 1))
    return RadarExcess(0, 0.0, 10.0, time_s, np.radians(azimuth_deg), site_deg, levels)


def echo(time_s: float) -> Plots:
    """The plot of the ship."""
    none, at, site = np.zeros(1, np.int64), np.array([[1005.0, 0.0]]), np.zeros((1, 2))
    return Plots(none, none, np.full(1, time_s), at, 100.0 * np.eye(2)[None], site, np.full(1, 1005.0), np.full(1, 1.57), none)


def follow(turns: int) -> tuple[ParticlesMemory, RegionOutput]:
    """The memory and the tracks after so many turns of the ship."""
    memory = SMALL.init()
    for k in range(turns):
        given = RegionInput.of_plots(echo(2.4 * k + 0.6), 2.4 * (k + 1), SENSORS)
        memory, found = SMALL.step(memory, given._replace(video=(turn(2.4 * k),)))
    return memory, found


SMALL, SENSORS = RepulsiveParticles(particles=100), load_scenario("heymann-table-1", QUICK).sensors()


def test_a_filter_ends_five_turns_after_the_video_has_stopped():
    memory, found = follow(12)
    assert len(found.tracks) == 1
    seen = []
    for k in range(12, 24):
        memory, found = SMALL.step(memory, RegionInput.of_plots(Plots.empty(), 2.4 * (k + 1), SENSORS))
        seen.append(len(found.tracks))
    assert seen == [1] * 4 + [0] * 8


def test_filters_begin_again_where_the_clock_of_the_video_is_set_back():
    """First in mid-turn, then by a minute between two turns."""
    memory, _ = follow(12)
    for k, video in ((12, turn(28.8, set_back_s=20.0)), (13, turn(31.2 - 60.0))):
        given = RegionInput.of_plots(Plots.empty(), 2.4 * (k + 1), SENSORS)
        memory, found = SMALL.step(memory, given._replace(video=(video,)))
        assert len(found.tracks) == 0
        assert (np.diff(memory.windows[0].time_s) >= 0.0).all()


def test_a_first_spoke_alone_is_looked_at():
    video = turn(0.0)
    one = replace(
        video,
        **{name: getattr(video, name)[90:91] for name in ("time_s", "azimuth_rad", "site_deg", "half_db")},
    )
    given = RegionInput.of_plots(echo(0.6), 0.7, SENSORS)
    memory, found = SMALL.step(SMALL.init(), given._replace(video=(one,)))
    assert (len(found.tracks), len(memory.windows[0])) == (0, 1)


def test_levels_are_over_the_background_that_extraction_has_learnt():
    scenario = scenario_of(RepulsiveParticles(), cycles="3")
    sensors, plan = scenario.sensors(), scenario.plan()
    stream, memory = scenario.input.load(sensors, 5, plan).reports, scenario.extraction.init()
    for cycle in range(3):
        video = stream.between(plan.instant_s(cycle - 1) if cycle else plan.start_s, plan.instant_s(cycle)).video
        given = ExtractionInput(video, sensors)
        memory, _ = scenario.extraction.step(memory, given)
    (found,) = over_background(memory, given)
    assert found.half_db.shape == video.parts[0].level.shape
    assert abs(float(np.mean(found.half_db))) < 2.0, "noise and sea are about their background"
    near = np.isfinite(video.parts[0].vessel_m).any(axis=1)
    assert found.half_db[near].max() > 30
