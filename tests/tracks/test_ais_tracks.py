"""AIS tracks, every method: pure, resumable, blind to the order of arrival; bad, late and repeated reports."""

import numpy as np
import pytest
from ais_world import HOME, SENSORS, START_S, fleet, reports, run, sail, same
from hypothesis import given, strategies as st
from pydantic import TypeAdapter

from coastwatch.batches import AisReports
from coastwatch.geodesy import KNOT_M_S
from coastwatch.server.checkpoint import load, save
from coastwatch.tracks import AisDeadReckoning, AisFilter, AisInput, AisTracker

pytestmark = pytest.mark.contract

METHODS = [AisFilter(), AisDeadReckoning(), AisDeadReckoning(aligned=False)]
every_method = pytest.mark.parametrize("method", METHODS, ids=["ais_filter", "dead_reckoning", "not aligned"])


@every_method
def test_step_writes_nothing_it_was_given(method):
    rows = fleet()
    memory, _, _ = run(method, rows, 8)
    before = save(memory)
    run(method, rows, 1, memory, 8)
    assert save(memory) == before


@every_method
def test_saved_in_mid_run_it_resumes_bit_for_bit(method):
    rows = fleet()
    memory, _, _ = run(method, rows, 9)
    _, one, alarms = run(method, rows, 8, memory, 9)
    _, two, alarms_too = run(method, rows, 8, load(save(memory)), 9)
    assert same(one, two)
    assert same(alarms, alarms_too)


@every_method
def test_order_of_arrival_within_a_cycle_does_not_matter(method):
    every = reports(fleet())
    order = np.random.default_rng([1, 2]).permutation(len(every))
    _, (one, *_) = method.step(method.init(), AisInput(every, START_S + 60.0, SENSORS))
    _, (two, *_) = method.step(method.init(), AisInput(every.take(order), START_S + 60.0, SENSORS))
    assert len(one) == 12
    assert same(one, two)


@pytest.mark.parametrize("method", [AisFilter(lateness_s=4.0, time_jitter_s=0.7), AisDeadReckoning(lateness_s=4.0)])
def test_settings_make_the_round_trip(method):
    assert TypeAdapter(AisTracker).validate_json(method.model_dump_json()) == method


@st.composite
def disorder(draw):
    """Vessels, some with a twin or an outlier, and delays within the lateness."""
    rows = []
    for i in range(draw(st.integers(1, 3))):
        mmsi = 235000001 + i
        times = START_S + np.cumsum(draw(st.lists(st.sampled_from([0.0, 0.5, 2.0, 3.0, 6.0]), min_size=2, max_size=14))) + 0.5
        delay = draw(st.lists(st.sampled_from([0.0, 0.1, 4.0, 9.5]), min_size=len(times), max_size=len(times)))
        rows += sail(mmsi, times, HOME + 0.01 * i, delay=delay, seed=i)
        if draw(st.booleans()):
            lag = draw(st.lists(st.sampled_from([0.0, 7.0, 9.9]), min_size=len(times), max_size=len(times)))
            count = draw(st.integers(1, len(times)))
            rows += sail(mmsi, times[:count] + 0.25, HOME + 0.3, delay=lag[:count], seed=i + 10)
    return rows


@given(disorder())
def test_late_reports_give_the_bits_of_reports_in_order(rows):
    method = AisFilter(repeat_s=0.3)
    cycles = 32  # the last report is made before 85 s, and is there before 95 s
    late, shown_late, alarms_late = run(method, rows, cycles)
    timely, shown, alarms = run(method, [(r[0], *r[:1], *r[2:]) for r in rows], cycles)
    assert same(shown, shown_late, but=("track_id",))
    assert same(alarms, alarms_late, but=("track_id",))
    for name in timely.now.tracks.dtype.names:
        if name != "number":
            assert timely.now.tracks[name].tobytes() == late.now.tracks[name].tobytes(), name
    assert len(np.unique(shown_late.track_id)) == len(shown_late)


@every_method
def test_late_reports_keep_the_track_id(method):
    times = START_S + 1.0 + np.arange(0.0, 40.0, 2.0)
    delay = np.where(np.arange(20) % 3 == 1, 9.0, 0.0)
    delay[0] = 5.0  # the second report comes before the first
    outputs = []
    memory, tracks, _ = run(method, sail(235000001, times, delay=delay), 20, outputs=outputs)
    assert {int(i) for t, _ in outputs for i in t.track_id} == {2 * 2**40}
    assert tracks.started_s[0] == times[0]
    assert memory.counter == 1


@every_method
def test_later_than_the_lateness_is_dropped_and_counted(method):
    rows = sail(235000001, START_S + 1.0 + np.arange(0.0, 30.0, 3.0))
    late = sail(235000001, [START_S + 5.5], delay=[10.5])
    memory, tracks, _ = run(method, rows + late, 12)
    _, clean, _ = run(method, rows, 12)
    assert memory.refused == {"too late": 1}
    assert same(tracks, clean)


@every_method
def test_a_report_later_than_the_lateness_is_taken_if_it_is_the_newest_of_its_vessel(method):
    """A vessel whose reports all come 40 s late is there with the tracks of one in time, as long as it is predicted for that time."""
    times = START_S + 1.0 + np.arange(0.0, 60.0, 6.0)
    others = sail(235000002, START_S + 1.0 + np.arange(0.0, 120.0, 3.0), HOME + 0.1)
    late, timely, outputs = sail(235000001, times, delay=np.full(10, 40.0)), sail(235000001, times), []
    memory, _, _ = run(method, late + others, 33, outputs=outputs)
    known, _, _ = run(method, timely + others, 33)
    assert memory.refused == {}
    assert [len(tracks) for tracks, _ in outputs] == [1] * 13 + [2] * 20
    assert len(np.unique(outputs[-1][0].track_id)) == 2
    for name in known.now.tracks.dtype.names:
        if name != "number":
            assert known.now.tracks[name].tobytes() == memory.now.tracks[name].tobytes(), name
    behind = sail(235000001, times[-2:-1] + 1.0, delay=[60.0])
    assert run(method, late + others + behind, 40)[0].refused == {"too late": 1}


@every_method
def test_a_first_report_older_than_a_silent_vessel_is_predicted_is_dropped(method):
    rows = sail(235000001, [START_S - 600.0], speed_kn=0.0, delay=[601.0])
    memory, tracks, _ = run(method, rows, 2)
    assert memory.refused == {"too late": 1}
    assert len(tracks) == 0


@every_method
def test_duplicates_are_dropped_and_counted(method):
    rows = sail(235000001, START_S + 1.0 + np.arange(0.0, 30.0, 3.0))
    again = [(r[0], r[0] + d, *r[2:]) for r, d in ((rows[2], 0.0), (rows[3], 4.0), (rows[4], 7.0))]
    memory, tracks, _ = run(method, rows + again, 12)
    _, clean, _ = run(method, rows, 12)
    assert memory.refused == {"duplicate": 3}
    assert same(tracks, clean)


@every_method
def test_a_fix_said_twice_is_taken_once(method):
    rows = sail(235000001, START_S + 1.0 + np.arange(0.0, 30.0, 3.0))
    again = [(rows[4][0] + 1.0, rows[4][0] + 1.0, *rows[4][2:])]
    memory, tracks, _ = run(method, rows + again, 12)
    _, clean, _ = run(method, rows, 12)
    assert memory.refused == {"repeated position": 1}
    assert same(tracks, clean)


@every_method
def test_bad_rows_are_counted_by_kind_and_do_no_harm(method):
    good = sail(235000001, START_S + 1.0 + np.arange(0.0, 30.0, 3.0))
    t = START_S + 10.0
    bad = [
        (t, t, 235000001, 91.0, 0.0, 1.0, 0.0),
        (t, t, 235000001, np.nan, 0.0, 1.0, 0.0),
        (t, t, 235000001, 50.0, 181.0, 1.0, 0.0),
        (np.nan, t, 235000001, 50.0, 0.0, 1.0, 0.0),
        (t, t, -2, 50.0, 0.0, 1.0, 0.0),
        (t + 60.0, t, 235000001, 50.0, 0.0, 1.0, 0.0),
    ]
    memory, tracks, _ = run(method, good + bad, 12)
    _, clean, _ = run(method, good, 12)
    assert memory.refused == {"not a position": 3, "time not finite": 1, "not an MMSI": 1, "from the future": 1}
    assert same(tracks, clean)


@every_method
def test_a_report_of_a_time_to_come_waits_for_it(method):
    rows = sail(235000001, START_S + 1.0 + np.arange(0.0, 30.0, 3.0))
    early = [(r[0], r[0] - 2.5 if k == 5 else r[0], *r[2:]) for k, r in enumerate(rows)]
    _, tracks, _ = run(method, early, 12)
    _, clean, _ = run(method, rows, 12)
    assert same(tracks, clean)


@every_method
def test_no_report_and_no_vessel(method):
    memory, tracks, alarms = run(method, [], 3)
    assert len(tracks) == len(alarms) == 0
    assert memory.refused == {}


@pytest.mark.parametrize(
    ("sog", "cog"), [(np.inf, 10.0), (102.3, 10.0), (-1.0, 10.0), (np.nan, 10.0), (9.0, np.nan), (9.0, 360.0)]
)
def test_speed_or_course_that_says_nothing_is_not_taken(sog, cog):
    rows = [(*r[:5], sog, cog) for r in sail(235000001, START_S + 1.0 + np.arange(0.0, 30.0, 3.0))]
    _, tracks, _ = run(AisFilter(), rows, 10)
    _, silent, _ = run(AisFilter(), [(*r[:5], np.nan, np.nan) for r in rows], 10)
    assert same(tracks, silent)
    assert np.isfinite(tracks.covariance).all()


def test_no_course_at_rest_is_a_vessel_at_rest():
    rows = [(*r[:5], 0.1, np.nan) for r in sail(235000001, START_S + 1.0 + np.arange(0.0, 30.0, 3.0), speed_kn=0.0)]
    _, tracks, _ = run(AisFilter(), rows, 10)
    assert np.hypot(*tracks.velocity_m_s[0]) < 0.1 * KNOT_M_S
    assert tracks.covariance[0, 2, 2] < (0.2 * KNOT_M_S) ** 2


@every_method
def test_time_must_go_on(method):
    memory, _, _ = run(method, [], 2)
    with pytest.raises(ValueError, match="time_s"):
        method.step(memory, AisInput(AisReports.empty(), START_S, SENSORS))


def test_lateness_must_be_remembered():
    with pytest.raises(ValueError, match="return_s"):
        AisFilter(lateness_s=100.0, return_s=150.0)
