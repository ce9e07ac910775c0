"""The literal multiple hypothesis tracker: it chooses as recursive trees and an integer program do; the example of its initiator."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from as_bytes import same
from hypotheses_textbook import look, root
from radar_world import PERIOD_S, cut, plots_of, two_radars, world

from coastwatch.batches import Messages, Plots, Sensors, Unproven
from coastwatch.geodesy import KNOT_M_S, to_plane
from coastwatch.kernels.filters.gaussian import gate
from coastwatch.scenario import load_scenario
from coastwatch.server.checkpoint import load, save
from coastwatch.tracks import MultiHypothesisLiteral, RegionInput
from coastwatch.tracks.radar.multi_hypothesis_literal.initiation import paired

pytestmark = pytest.mark.oracle

DETECTION, CLUTTER_PER_M2, REACH_M, LOOKS = 0.7, 2e-6, 5500.0, 14
NO_NEW = {"confirm_plots": 99, "confirm_looks": 1}  # no track begins
SAME_M = 1e-6
INPUT = {"detection_probability": DETECTION, "clutter_per_m2": CLUTTER_PER_M2, "plot_sigma_m": 2.5}


def scene(transponders: str) -> tuple[np.ndarray, list[tuple[float, np.ndarray, Messages]], Sensors, float]:
    """States at the start; time, plots sorted by east, and messages since the look before; of the scenario of the thesis."""
    given = {f"input.{key}": str(value) for key, value in {**INPUT, "transponders": transponders, "lead_in": 0}.items()}
    scenario = load_scenario("liland-tracking", {**given, "cycles": str(LOOKS + 1)})
    sensors, plan = scenario.sensors(), scenario.plan()
    recording, origin_deg = scenario.input.load(sensors, 3, plan), sensors.region_origin_deg[0]
    truth = recording.truth.at(plan.instant_s(0))
    start, looks = np.hstack([to_plane(truth.position_deg, origin_deg), truth.velocity_m_s]), []
    for cycle in range(1, LOOKS + 1):
        now_s = plan.instant_s(cycle)
        reports = recording.reports.between(plan.instant_s(cycle - 1), now_s)
        azimuth, ais = np.radians(reports.radar.azimuth_deg), reports.ais
        place = reports.radar.range_m[:, None] * np.column_stack([np.sin(azimuth), np.cos(azimuth)])
        course = np.radians(ais.cog_deg)
        velocity = KNOT_M_S * ais.sog_kn[:, None] * np.column_stack([np.sin(course), np.cos(course)])
        messages = Messages(
            ais.time_s,
            to_plane(ais.position_deg, origin_deg),
            ais.covariance,
            ais.mmsi,
            ais.origin,
            velocity,
            np.tile(np.eye(2), (len(ais), 1, 1)),
        )
        looks.append((now_s, place[np.lexsort((place[:, 1], place[:, 0]))], messages))
    return start, looks, sensors, plan.instant_s(0)


def as_plots(place: np.ndarray, time_s: float) -> Plots:
    n = len(place)
    zero, number = np.zeros(n), np.zeros(n, np.int64)
    spread, site = np.tile(np.eye(2), (n, 1, 1)), np.zeros((n, 2))
    return Plots(number, number, np.full(n, time_s), place, spread, site, zero, zero, number - 1)


@pytest.mark.parametrize(("transponders", "window"), [("S0", 1), ("S0", 3), ("S4", 1), ("S4", 3)])
def test_every_look_chooses_what_recursive_trees_and_an_integer_program_choose(transponders, window):
    start, looks, sensors, before_s = scene(transponders)
    settings = {"window": window, "detection_probability": DETECTION, "clutter_per_m2": CLUTTER_PER_M2, **NO_NEW}
    method = MultiHypothesisLiteral(**settings)
    memory, trees = method.begun(start, before_s), [root(k + 1, state) for k, state in enumerate(start)]
    taken = set()
    for now_s, place, messages in looks:
        assert len(np.unique(messages.mmsi)) == len(messages), "one report of a vessel in a look"
        order = np.argsort(messages.mmsi)
        reports = [
            (k, now_s - messages.time_s[i], int(messages.mmsi[i]), np.append(messages.position_m[i], messages.velocity_m_s[i]),
             messages.covariance[i, 0, 0])
            for k, i in enumerate(order.tolist())
        ]  # fmt: skip
        rules = {"detection": DETECTION, "clutter": CLUTTER_PER_M2, "range": REACH_M}
        rules["foreign"] = 0.5 * len(trees) / (np.pi * REACH_M**2)
        trees, want = look(trees, place, now_s - before_s, reports, rules, window)
        first = memory.next_plot, memory.next_message
        given = RegionInput.of_plots(as_plots(place, now_s), now_s, sensors)
        memory, (tracks, *_) = method.step(memory, given._replace(messages=messages))
        before_s, chosen = now_s, memory.leaves.take(memory.best)
        assert memory.trees.number.tolist() == sorted(want)
        for k, number in enumerate(memory.trees.number.tolist()):
            state, used = want[number]
            assert chosen.state[k] == pytest.approx(state, abs=SAME_M)
            got = [("report", m) for m in chosen.message[k, -1:] - first[1] if m >= 0]
            got += [("plot", m) for m in chosen.plot[k, -1:] - first[0] if m >= 0]
            assert tuple(got) == used
            taken.add(tuple(kind for kind, _ in used))
        assert len(tracks) == len(trees)
    both = {("report",), ("report", "plot")} if transponders == "S4" else set()
    assert taken >= {(), ("plot",), *both}
    assert len(trees) >= (12 if window > 1 else 4)


@pytest.mark.golden
@pytest.mark.parametrize(
    ("pairing", "pairs"),
    [("hungarian", {(0, 0), (1, 1)}), ("shortest_first", {(0, 1)}), ("in_turn", {(0, 1)})],
)
def test_the_example_of_the_initiator(pairing, pairs):
    """Figure 4.2: distances (4.6), of which the gate of 4 leaves (4.8). Only the Hungarian method pairs both."""
    distance = np.array([[3.0, 1.0, 5.0], [7.0, 2.0, 6.0]])
    first, second = np.nonzero(distance <= 4.0)
    won = paired(first, second, distance[first, second], pairing)
    assert set(zip(first[won].tolist(), second[won].tolist(), strict=True)) == pairs


@pytest.mark.golden
def test_the_gates_are_those_of_tables_4_1_and_4_2():
    confidence = 0.7, 0.8, 0.9, 0.95, 0.975, 0.99, 0.995
    for dimensions, printed in (
        (2, (2.41, 3.22, 4.61, 5.99, 7.38, 9.21, 10.60)),
        (4, (4.88, 5.99, 7.78, 9.49, 11.14, 13.28, 14.86)),
    ):
        assert [gate(p, dimensions) for p in confidence] == pytest.approx(printed, abs=0.006)
    assert (MultiHypothesisLiteral().gate, MultiHypothesisLiteral().report_gate) == (5.99, 9.49)


def busy(transponders: str = "S4", **settings: object) -> tuple[MultiHypothesisLiteral, object, list[RegionInput]]:
    """A method, its memory with known tracks, and the input of each look."""
    start, looks, sensors, before_s = scene(transponders)
    given = {"detection_probability": DETECTION, "clutter_per_m2": CLUTTER_PER_M2, **settings}
    method = MultiHypothesisLiteral(**given)
    inputs = [
        RegionInput.of_plots(as_plots(place, now_s), now_s, sensors)._replace(messages=messages)
        for now_s, place, messages in looks
    ]
    return method, method.begun(start, before_s), inputs


def test_it_resumes_to_the_bit_and_shuffled_plots_are_of_no_matter():
    method, memory, inputs = busy()
    for given in inputs[:6]:
        memory, _ = method.step(memory, given)
    memory.check_rows()
    other, rng = load(save(memory)), np.random.default_rng(4)
    for given in inputs[6:10]:
        mixed = given._replace(plots=given.plots.take(rng.permutation(len(given.plots))))
        (memory, one), (other, two) = method.step(memory, given), method.step(other, mixed)
    assert same(memory, other)
    assert same(one.tracks, two.tracks)
    with pytest.raises(ValueError, match="window of 3, needed 4"):
        method.model_copy(update={"window": 4}).step(memory, inputs[10])


def test_choices_beyond_the_limit_of_nodes_are_counted():
    """Sixty vessels in half a mile; and the scene of the thesis, where all choices are proven."""
    crowd = plots_of(world(60, 5, side_nm=0.5), two_radars(), 40.0, 5, detection=0.8, clutter_per_m2=2e-6)
    method = MultiHypothesisLiteral(plot_sigma_m=30.0, clutter_per_m2=2e-6, nearest_new_m=50.0, gate=9.21)
    memory, counts = method.init(), []
    for cycle in range(6):
        memory, found = method.step(memory, RegionInput.of_plots(cut(crowd, cycle), PERIOD_S * (cycle + 1), two_radars()))
        counts.append(found.unproven.count)
        assert (found.unproven.excess > 0.0) == (found.unproven.count > 0)
    assert max(counts) >= 1
    method, memory, inputs = busy()
    for given in inputs[:6]:
        memory, found = method.step(memory, given)
        assert found.unproven == Unproven()


@pytest.mark.parametrize("column", ["plot", "message"])
@pytest.mark.parametrize("number", [10**6, -2])
def test_leaves_of_plots_and_reports_that_are_none_are_refused(column, number):
    method, memory, inputs = busy()
    for given in inputs[:3]:
        memory, _ = method.step(memory, given)
    getattr(memory.leaves, column).flat[-1] = number
    with pytest.raises(ValueError, match=rf"it is damaged: Leaves\.{column}: got .*{number}.*, needed -1 to \d+$"):
        load(save(memory))


@pytest.mark.parametrize(
    "settings",
    [
        {"ais_score": "zero"},
        {"known_mmsi": "every_report"},
        {"ais_gate": "look_time"},
        {"similar": True, "window": 6},
        {"most_leaves": 10, "window": 6},
        {"pairing": "in_turn"},
    ],
    ids=str,
)
def test_each_variant_holds_the_vessels_that_send_and_gives_no_measurement_twice(settings):
    method, memory, inputs = busy(**settings)
    for given in inputs[:8]:
        memory, (tracks, *_) = method.step(memory, given)
        best = memory.leaves.take(memory.best)
        for column in (best.plot, best.message):
            taken = column[column >= 0]
            assert len(np.unique(taken)) == len(taken)
    own = tracks.take(tracks.track_id <= 16)
    assert len(own) >= 15
    assert (own.held_mmsi >= 0).sum() >= 12
    if method.most_leaves:
        assert memory.trees.window.min() < 6
    if method.similar:
        wide, full, _ = busy(**{**settings, "similar": False})
        for given in inputs[:8]:
            full, _ = wide.step(full, given)
        assert len(memory.leaves) < len(full.leaves)


def test_tracks_begin_from_plots_and_are_ended_by_misses():
    sensors = two_radars()
    one = replace(sensors, radars=sensors.radars.take(slice(0, 1)))
    truth = world(12, 5, side_nm=4.0)
    plots = plots_of(truth, sensors, 60.0, 5)
    plots = plots.take(plots.sensor == 0)
    turn_s, method = 4.0, MultiHypothesisLiteral(plot_sigma_m=30.0, clutter_per_m2=1e-9, nearest_new_m=100.0, gate=9.21)
    memory, found = method.init(), []
    for cycle in range(14):
        now = plots.take((plots.time_s > turn_s * cycle) & (plots.time_s <= turn_s * (cycle + 1)))
        if cycle >= 9:
            now = now.take(slice(0, 0))
        memory, (tracks, *_) = method.step(memory, RegionInput.of_plots(now, turn_s * (cycle + 1), one))
        found.append(len(tracks))
    assert found[0] == found[1] == 0
    assert found[8] >= 7
    assert found[-1] == 0
