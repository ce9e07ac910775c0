"""The load of the whole chain: its plots, AIS and bearings against the truth, its scores against a count, its command."""

from __future__ import annotations

import json
import sys
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from coastwatch.batches import RadarReports, Reports, Tracks
from coastwatch.centre import Cycle
from coastwatch.geodesy import KNOT_M_S, difference_m, offset_deg, to_plane, wrap_rad
from coastwatch.scenario import ScenarioError, load_scenario
from coastwatch.sensors.simulated.ais import CLASS_A, CLASS_B
from scaling.load import baseline
from scaling.load.chain import command
from scaling.load.chain import scores as quality
from scaling.load.chain.reports import initial_state, next_cycle
from scaling.load.chain.run import Load, run_cycles
from scaling.load.chain.world import Size, World, build_world

pytestmark = pytest.mark.contract

EXACT = {"input.radar.noise_factor": "0", "input.radar.detection_probability": "1", "input.sonar.noise_factor": "0"}
PERIOD_S, CYCLES = 3.0, 12
BEAM_S = 1e-3  # error of the beam time of a plot, which comes from a position at a constant velocity


@cache
def exact() -> tuple[World, Reports]:
    """A coast of three regions without noise, misses and clutter, and all its reports."""
    world = build_world(Size(900, CYCLES, 300, radars=3, clutter_per_m2=0.0), EXACT, 7)
    state, parts = initial_state(world), []
    for _ in range(CYCLES):
        state, reports = next_cycle(world, state)
        parts.append(reports)
    kinds = ("radar", "ais", "statics", "bearing")
    return world, Reports(*(type(getattr(parts[0], k)).join([getattr(p, k) for p in parts]) for k in kinds))


def plots_of(radar: int) -> tuple[World, RadarReports]:
    """The plots of one radar."""
    world, reports = exact()
    return world, reports.radar.take(reports.radar.sensor == radar)


@pytest.mark.parametrize("radar", [0, 4, 8])
def test_plots_are_where_the_vessels_were_when_the_beam_passed(radar: int) -> None:
    world, plots = plots_of(radar)
    at = to_plane(world.vessels.position(plots.origin, plots.time_s), world.sensors.radars.site_deg[radar])
    azimuth = np.arctan2(at[:, 0], at[:, 1])
    np.testing.assert_allclose(plots.range_m, np.hypot(at[:, 0], at[:, 1]), atol=1e-6)
    np.testing.assert_allclose(wrap_rad(np.radians(plots.azimuth_deg) - azimuth), 0.0, atol=1e-9)
    period_s = world.sensors.radars.period_s[radar]
    north = (plots.time_s - world.plan.start_s) / period_s - azimuth / (2.0 * np.pi)
    off = (north - north[0] + 0.5) % 1.0 - 0.5
    far = plots.range_m > 300.0
    assert np.abs(off[far] - np.median(off)).max() * period_s < BEAM_S
    assert len(plots) > 500


@pytest.mark.parametrize("radar", [0, 4, 8])
def test_a_vessel_in_range_is_seen_once_in_each_turn_also_from_the_next_region(radar: int) -> None:
    world, plots = plots_of(radar)
    radars = world.sensors.radars
    rows, span_s = np.arange(world.count), CYCLES * PERIOD_S
    ends = [world.plan.start_s, world.plan.start_s + span_s]
    near = [np.hypot(*to_plane(world.vessels.position(rows, np.full(len(rows), t)), radars.site_deg[radar]).T) for t in ends]
    inside = np.flatnonzero(np.maximum(*near) < radars.range_m[radar] - 50.0)
    beyond = np.minimum(*near) > radars.range_m[radar] + 50.0
    seen = np.bincount(plots.origin, minlength=world.count)
    turns = span_s / radars.period_s[radar]
    assert set(seen[inside]) <= {int(np.floor(turns)), int(np.ceil(turns))}
    assert not seen[beyond].any()
    order = np.lexsort((plots.time_s, plots.origin))
    step_s = np.diff(plots.time_s[order])[np.diff(plots.origin[order]) == 0]
    far = plots.range_m[order][1:][np.diff(plots.origin[order]) == 0] > 300.0
    np.testing.assert_allclose(step_s[far], radars.period_s[radar], rtol=0.05)
    home = np.arange(world.count) // 300
    assert (home[inside] != radars.region[radar]).any()


def test_ais_reports_have_the_intervals_of_their_class_and_arrive_late() -> None:
    world, reports = exact()
    ais = reports.ais
    order = np.lexsort((ais.time_s, ais.origin))
    same = np.diff(ais.origin[order]) == 0
    step_s, first = np.diff(ais.time_s[order])[same], order[:-1][same]
    _, velocity = world.vessels.state(ais.origin[first], ais.time_s[first])
    knots = np.hypot(velocity[:, 0], velocity[:, 1]) / KNOT_M_S
    for class_b, table in ((False, CLASS_A), (True, CLASS_B)):
        mine = ais.class_b[first] == class_b
        wanted = np.select([knots[mine] < limit for limit, *_ in table], [s for _, s, _ in table])
        whole = np.isclose(step_s[mine] % wanted, 0.0, atol=1e-6) | np.isclose(step_s[mine] % wanted, wanted, atol=1e-6)
        assert whole.mean() > 0.98  # a kick is a turn of a moment, and a missing report may hide a change of speed
        assert mine.sum() > 10
    delay_s = ais.received_s - ais.time_s
    assert delay_s.min() >= 1.0
    assert delay_s.mean() == pytest.approx(2.0, abs=0.2)  # 1 s and an exponential part of 1 s; the run cuts off the latest
    assert (np.diff(ais.received_s) >= 0.0).all()
    assert len(np.unique(ais.mmsi)) == len(np.unique(ais.origin))
    error_m = np.hypot(*difference_m(ais.position_deg, world.vessels.position(ais.origin, ais.time_s)).T)
    assert np.sqrt((error_m**2).mean()) == pytest.approx(np.sqrt(2.0) * 3.33, rel=0.1)


def test_about_half_of_the_vessels_carry_ais_and_some_of_them_class_b() -> None:
    world, _ = exact()
    assert len(world.senders.row) == 450
    assert world.senders.class_b.sum() == 135
    assert world.heard.all()


def test_bearings_point_at_their_vessels() -> None:
    world, reports = exact()
    bearing = reports.bearing
    at = to_plane(world.vessels.position(bearing.origin, bearing.time_s), bearing.site_deg)
    error_rad = wrap_rad(np.radians(bearing.bearing_deg) - np.arctan2(at[:, 0], at[:, 1]))
    np.testing.assert_allclose(error_rad, 0.0, atol=1e-9)
    assert len(np.unique(bearing.sensor)) == 3
    assert len(bearing) > 1000


def test_misses_noise_and_clutter_are_as_many_as_set() -> None:
    world = build_world(Size(2000, 8, clutter_per_m2=1e-6), {}, 3)
    state, parts = initial_state(world), []
    for _ in range(8):
        state, reports = next_cycle(world, state)
        parts.append(reports.radar)
    plots = RadarReports.join(parts)
    radars = world.sensors.radars
    turns = 8 * PERIOD_S / radars.period_s
    clutter = plots.take(plots.origin < 0)
    wanted = (1e-6 * np.pi * radars.range_m**2 * turns).sum()
    assert len(clutter) == pytest.approx(wanted, abs=5.0 * np.sqrt(wanted))
    inner = (clutter.range_m < radars.range_m[clutter.sensor] / np.sqrt(2.0)).mean()
    assert inner == pytest.approx(0.5, abs=2.5 / np.sqrt(len(clutter)))  # uniform over the disc
    real = plots.take(plots.origin >= 0)
    at = to_plane(world.vessels.position(real.origin, real.time_s), radars.site_deg[real.sensor])
    error_m = real.range_m - np.hypot(at[:, 0], at[:, 1])
    assert error_m.std() == pytest.approx(10.0, rel=0.05)
    error_deg = np.degrees(wrap_rad(np.radians(real.azimuth_deg) - np.arctan2(at[:, 0], at[:, 1])))
    assert error_deg.std() == pytest.approx(0.3, rel=0.05)
    always = build_world(Size(2000, 8, clutter_per_m2=1e-6), {"input.radar.detection_probability": "1"}, 3)
    _, every = next_cycle(always, initial_state(always))
    assert (parts[0].origin >= 0).sum() / (every.radar.origin >= 0).sum() == pytest.approx(0.9, abs=0.03)


def test_the_input_is_the_same_to_the_bit_for_the_same_seed() -> None:
    def plots(seed: int) -> RadarReports:
        world = build_world(Size(500, 3), {}, seed)
        state, _ = next_cycle(world, initial_state(world))
        return next_cycle(world, state)[1].radar

    first, second, other = plots(1), plots(1), plots(2)
    for name in ("time_s", "range_m", "azimuth_deg", "origin"):
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name))
    assert len(other) != len(first) or (other.range_m != first.range_m).any()


def test_one_region_of_a_thousand_vessels_has_the_geometry_of_its_scenario() -> None:
    shipped = load_scenario("context-driven-1000").sensors()
    ours = build_world(Size(1000, 3), {}, 1).sensors
    apart_m = difference_m(ours.radars.site_deg, shipped.radars.site_deg)
    assert np.abs(apart_m).max() < 300.0
    np.testing.assert_allclose(ours.radars.range_m, shipped.radars.range_m)
    np.testing.assert_allclose(ours.radars.period_s, shipped.radars.period_s)
    np.testing.assert_allclose(ours.sonars.range_m, shipped.sonars.range_m)


def test_regions_grow_in_number_or_one_region_in_range() -> None:
    many, one = Size(1000, 1, 400), Size(1000, 1, 1000)
    assert (many.regions, one.regions) == (3, 1)
    small, large = (build_world(size, {}, 1) for size in (many, one))
    assert len(small.sensors.radars) == 6
    np.testing.assert_allclose(large.sensors.radars.range_m[0] / small.sensors.radars.range_m[0], np.sqrt(3.0))
    apart = build_world(Size(900, 1, 300, apart=True), {}, 1)
    seen = [set(rows // 300) for rows in apart.seen]
    assert seen == [{k // 2} for k in range(6)]


def test_a_setting_that_the_load_does_not_obey_is_refused() -> None:
    with pytest.raises(ScenarioError, match=r"input\.convoys: .* does not obey it"):
        build_world(Size(100, 1), {"input.convoys.share": "0.5"}, 1)
    with pytest.raises(ScenarioError, match=r"input\.radar\.blind_to_deg: got 90\.0"):
        build_world(Size(100, 1), {"input.radar.blind_to_deg": "90"}, 1)
    with pytest.raises(ScenarioError, match=r"input\.count: got 5, needed --vessels"):
        build_world(Size(100, 1), {"input.count": "5"}, 1)


def test_tracks_are_scored_as_a_count_by_hand() -> None:
    world, _ = exact()
    truth = quality.truth_at(world, world.plan.instant_s(0))
    at_m = to_plane(truth.position_deg, world.sensors.radars.site_deg[0])
    middle = np.flatnonzero(np.hypot(at_m[:, 0], at_m[:, 1]) < 0.5 * world.sensors.radars.range_m[0])[:10]
    off_m = np.zeros((14, 2))
    off_m[:10, 0], off_m[13, 1] = 30.0, 5000.0
    rows = np.concatenate([middle, middle[[0, 1, 2, 3]]])  # a second track, two of clutter, one far away
    tracks = Tracks(
        track_id=np.arange(14),
        source=np.zeros(14, np.int64),
        time_s=truth.time_s[rows],
        position_deg=offset_deg(truth.position_deg[rows], off_m),
        velocity_m_s=truth.velocity_m_s[rows] + np.array([0.6, 0.8]),
        covariance=np.zeros((14, 4, 4)),
        report_covariance=np.zeros((14, 2, 2)),
        updated_s=truth.time_s[rows],
        started_s=truth.time_s[rows],
        mmsi=np.full(14, -1),
        origin=np.concatenate([truth.vessel[rows[:11]], [-1, -1], truth.vessel[rows[13:]]]),
    )
    made = quality.track_quality(world, truth, tracks)
    assert (made.tracks, made.false, made.with_track, made.own) == (14, 4, 10, 10)
    figures = made.as_dict(1)
    assert figures["position_rmse_m"] == pytest.approx(30.0, rel=1e-4)
    assert figures["velocity_rmse_m_s"] == pytest.approx(1.0)
    assert 0.0 < figures["completeness"] == 10 / made.in_cover < 0.2


@cache
def picture_of(method: str, workers: int) -> tuple[list[Cycle], dict[str, object]]:
    """The cycles of a short run over two regions, and its scores."""
    load = Load(Size(500, 10, 250), warmup=7, workers=workers, seed=4, settings={"workers.method": method})
    cycles: list[Cycle] = []
    world = build_world(load.size, load.settings, load.seed)
    last = list(run_cycles(load, world, cycles.append))[-1]
    assert last.tally is not None
    return cycles, quality.result(last.tally, world, quality.sample_of(world))


@pytest.mark.parametrize(("method", "workers"), [("threads", 2), pytest.param("processes", 2, marks=pytest.mark.slow)])
def test_all_workers_make_the_same_picture(method: str, workers: int) -> None:
    alone, together = picture_of("threads", 1)[0], picture_of(method, workers)[0]
    for a, b in zip(alone, together, strict=True):
        for name in ("vessel_id", "mmsi", "flags", "origin"):
            np.testing.assert_array_equal(getattr(a.picture, name), getattr(b.picture, name))
        np.testing.assert_array_equal(a.tracks.track_id, b.tracks.track_id)
        np.testing.assert_array_equal(a.associations.vessel, b.associations.vessel)
        np.testing.assert_allclose(a.picture.position_deg, b.picture.position_deg, rtol=0.0, atol=1e-9)
    assert len(alone[-1].picture) > 200


def test_scores_are_those_of_a_picture_that_is_nearly_right() -> None:
    scores = picture_of("threads", 1)[1]
    tracks, fused = scores["tracks"], scores["fused_tracks"]
    assert isinstance(tracks, dict)
    assert isinstance(fused, dict)
    assert tracks["completeness"] > 0.9
    assert tracks["false_tracks"] < 20.0
    assert 1.0 < tracks["over_bound"] < 2.0
    assert 1.0 < fused["over_bound"] < 2.0
    assert fused["position_rmse_m"] < 0.6 * tracks["position_rmse_m"]
    assert scores["associations"]["f1"] > 0.9  # type: ignore[index]


def test_the_command_prints_its_figures(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: object
) -> None:
    words = "chain --vessels 300 --region-vessels 150 --cycles 2 --warmup 6 --workers 1 --method threads --json"
    monkeypatch.setattr(sys, "argv", [*words.split(), "--store", f"sqlite:///{tmp_path}/chain.db"])
    command.main()
    figures = json.loads(capsys.readouterr().out)
    assert figures["load"]["regions"] == 2
    assert {"tracks", "ais_tracks", "associations", "registration", "store"} <= set(figures["stages_s"])
    compute = figures["compute_s"]
    assert figures["cycle_s"]["median"] >= compute["median"] > 0.0
    shares = [t["share"] for t in figures["stages_s"].values() if t["share"] is not None]
    assert sum(shares) == pytest.approx(1.0)
    assert figures["plots_per_vessel"] == pytest.approx(figures["plots"] / 300)
    assert figures["rows_written"] > 0
    assert figures["quality"]["tracks"]["completeness"] > 0.5
    printed = command.text(figures)
    assert "2 regions, 4 radars; 2 cycles after 6, 1 workers (threads), store sqlite" in printed
    assert "input.ais.intervals=itu" in printed
    assert "completeness" in printed


def test_a_ramp_fits_the_exponent_of_each_cost() -> None:
    runs = [
        {
            "load": {"vessels": n},
            "compute_s": {"median": 1e-6 * n},
            "compute_cpu_s": 1e-6 * n,
            "stages_cpu_s": {"tracks": 1e-6 * n**1.5},
        }
        for n in (1000, 4000, 16_000)
    ]
    fitted = command.exponents(runs)
    assert fitted["exponent"] == pytest.approx({"compute_s": 1.0, "compute_cpu_s": 1.0, "stages_cpu_s.tracks": 1.5})
    assert fitted["local"]["stages_cpu_s.tracks"] == pytest.approx([1.5, 1.5])


def test_a_baseline_gives_times_and_quality_of_both(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    good = picture_of("threads", 1)[1]

    def figures(checkout: Path, arguments: list[str], module: str) -> dict[str, object]:
        assert (module, arguments[:2], arguments[-1]) == ("scaling.load.chain", ["--vessels", "500"], "--apart")
        s = 0.2 if checkout == baseline.CHECKOUT else 0.1
        times = {"compute_s": {"median": s}, "compute_cpu_s": s, "stages_s": {"tracks": {"median": s}}}
        return times | {"stages_cpu_s": {"tracks": 0.5 * s}, "quality": good}

    monkeypatch.setattr(baseline, "figures", figures)
    monkeypatch.setattr(baseline, "python_of", lambda checkout: Path(sys.executable))
    monkeypatch.setattr(sys, "argv", f"chain --vessels 500 --apart --baseline {baseline.CHECKOUT / 'tests'} --turns 2".split())
    command.main()
    out = capsys.readouterr().out
    assert out.count("ratio 2.000") == 4
    assert out.count("completeness") == 2
