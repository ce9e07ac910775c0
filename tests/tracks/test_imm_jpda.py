"""IMM-JPDA, literal and with the motion models of Coastwatch: M of N, the end of tracks, vessels that pass, resumes, refusals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from pydantic import ValidationError
from radar_world import ORIGIN_DEG, PERIOD_S, cut, plots_of, run, two_radars, world

from coastwatch.batches import Plots, Sensors, Tracks
from coastwatch.geodesy import to_plane
from coastwatch.server.checkpoint import load, save
from coastwatch.tracks import ImmJpdaLiteral, RegionInput, TableTracker

pytestmark = pytest.mark.contract

LITERAL = ImmJpdaLiteral()
JPDA = TableTracker(method="imm_jpda")
VARIANTS = [
    LITERAL,
    ImmJpdaLiteral(start="literal_start"),
    ImmJpdaLiteral(stamp="frame_time"),
    ImmJpdaLiteral(mixing="zero_padding"),
    ImmJpdaLiteral(clutter={"learnt": False}),
    JPDA,
]
NAMES = ["literal", "literal_start", "frame_time", "zero_padding", "constant clutter", "imm_jpda"]


def one_radar() -> Sensors:
    """The radar of 20 turns a minute, in the middle."""
    both = two_radars()
    radars = both.radars.take(slice(1, 2))
    return replace(both, radars=replace(radars, site_deg=ORIGIN_DEG[None].copy()))


SENSORS = one_radar()


@pytest.fixture(scope="module")
def dense() -> Plots:
    """Twelve vessels in 3 NM, with misses and clutter."""
    truth = world(12, 7, side_nm=3.0, turning=True)
    return plots_of(truth, SENSORS, 90.0, 7, detection=0.9, clutter_per_m2=1e-7)


@pytest.mark.parametrize("method", VARIANTS, ids=NAMES)
def test_it_resumes_to_the_bit_and_takes_plots_in_any_order(method, dense):
    _, out = run(method, dense, 16, SENSORS)
    half, _ = run(method, dense, 8, SENSORS)
    shuffled = dense.take(np.random.default_rng([9]).permutation(len(dense)))
    _, rest = run(method, shuffled, 8, SENSORS, memory=load(save(half)), first=8)
    assert len(out[-1]) > 5
    for name in Tracks.__dataclass_fields__:
        np.testing.assert_array_equal(getattr(rest[-1], name), getattr(out[-1], name), err_msg=name)


@pytest.mark.parametrize(
    "method", [LITERAL, ImmJpdaLiteral(mixing="zero_padding"), JPDA], ids=["literal", "zero_padding", "imm_jpda"]
)
def test_vessels_have_a_track_each_near_them(method, dense):
    truth = world(12, 7, side_nm=3.0, turning=True)
    _, out = run(method, dense, 30, SENSORS)
    tracks = out[-1]
    own = tracks.origin >= 0
    assert len(np.unique(tracks.origin[own])) == own.sum() >= 11
    where, _ = truth.at(tracks.origin[own], np.full(own.sum(), 30 * PERIOD_S))
    assert np.hypot(*(to_plane(tracks.position_deg[own], ORIGIN_DEG) - where).T).max() < 60.0
    assert (~own).sum() <= 1
    assert np.linalg.eigvalsh(tracks.covariance).min() > 0.0


def lone(cycles: tuple[int, ...]) -> Plots:
    """A vessel that is seen in these turns alone, at 3 m/s on 090."""
    parts = []
    for cycle in cycles:
        time = np.array([PERIOD_S * cycle + 0.5])
        place = np.column_stack([-500.0 + 3.0 * time, 1500.0 + 0.0 * time])
        none = np.zeros(1, np.int64)
        site, away = np.zeros((1, 2)), np.hypot(*place.T)
        parts.append(
            Plots(none, none, time, place, 100.0 * np.eye(2)[None], site, away, np.arctan2(place[:, 0], place[:, 1]), none)
        )
    return Plots.join([*parts, *(ticks(c) for c in range(60))])


def ticks(cycle: int) -> Plots:
    """A false plot of each turn at another place, by which looks are counted."""
    angle = 2.4 * cycle
    place = 4000.0 * np.array([[np.sin(angle), np.cos(angle)]])
    none = np.zeros(1, np.int64)
    time = np.array([PERIOD_S * cycle + 1.5])
    return Plots(
        none, none, time, place, 100.0 * np.eye(2)[None], np.zeros((1, 2)), np.full(1, 4000.0), np.array([angle]), none - 1
    )


@pytest.mark.parametrize(
    ("seen", "from_cycle"),
    [((0, 1, 2, 3, 4), 4), ((0, 1, 2, 4, 5), 5), ((0, 1, 3, 4, 5), 5), ((0, 1, 4, 5, 6), None), ((0, 2, 4, 6), None)],
)
def test_two_plots_and_three_of_four_confirm_a_track(seen, from_cycle):
    """The first two in successive turns: tentative, preliminary; then 3 of the next 4."""
    _, out = run(LITERAL, lone(seen), 8, SENSORS)
    first = next((cycle for cycle, tracks in enumerate(out) if len(tracks)), None)
    assert first == from_cycle


def test_a_track_outlives_an_occlusion_and_ends_by_thirty_misses():
    back = tuple(range(8)) + tuple(range(15, 20))
    _, out = run(LITERAL, lone(back), 20, SENSORS)
    assert {tracks.track_id.tolist()[0] for tracks in out[6:]} == {out[6].track_id[0]}
    short = LITERAL.model_copy(update={"end_misses": 5, "end_looks": 6})
    _, out = run(short, lone(tuple(range(8))), 20, SENSORS)
    assert [len(tracks) for tracks in out[6:]] == [1] * 6 + [0] * 8


@pytest.mark.parametrize("case", ["out of range", "silent radar"])
def test_a_track_without_looks_ends_after_as_many_turns(case):
    short = LITERAL.model_copy(update={"end_misses": 5, "end_looks": 6})
    plots, radars = lone(tuple(range(8))), SENSORS.radars
    if case == "out of range":
        sensors = replace(SENSORS, radars=replace(radars, range_m=np.full(1, 100.0)))
    else:
        sensors, plots = SENSORS, plots.take(plots.time_s < 8.0 * PERIOD_S)
    _, out = run(short, plots, 20, sensors)
    assert [len(tracks) for tracks in out[6:]] == [1] * 8 + [0] * 6


def test_what_is_too_uncertain_ends():
    unsure = LITERAL.model_copy(update={"end_m": 30.0})
    _, out = run(unsure, lone(tuple(range(8))), 30, SENSORS)
    gone = next(cycle for cycle, tracks in enumerate(out) if cycle > 8 and not len(tracks))
    assert 9 < gone < 28, "before its misses ended it"


def test_old_repeated_and_odd_plots_do_no_harm(dense):
    """Every plot twice, and a minute old; one that is no number; then a pause of an hour, after which no track is left."""
    memory, out = run(LITERAL, dense, 12, SENSORS)
    plots = cut(dense, 12)
    old, odd = replace(plots, time_s=plots.time_s - 60.0), replace(plots.take(slice(0, 1)), position_m=np.full((1, 2), np.nan))
    every = Plots.join([plots, old, plots, odd])
    memory, found = LITERAL.step(memory, RegionInput.of_plots(every, 13 * PERIOD_S, SENSORS))
    assert found.dropped == 1
    assert np.isfinite(found.tracks.covariance).all()
    assert np.isin(out[-1].track_id, found.tracks.track_id).mean() > 0.8
    late = replace(plots, time_s=plots.time_s + 3600.0)
    memory, found = LITERAL.step(memory, RegionInput.of_plots(late, 13 * PERIOD_S + 3600.0, SENSORS))
    assert len(found.tracks) == 0
    assert len(memory.tentative) > 0


@pytest.mark.parametrize("method", [LITERAL, JPDA], ids=["literal", "imm_jpda"])
def test_two_vessels_side_by_side_share_their_plots_and_keep_two_tracks(method):
    """Two vessels 40 m apart for a minute, with misses: shared plots make no third track, and none is lost."""
    rng, parts = np.random.default_rng([31]), []
    for cycle in range(40):
        gap = max(40.0, 100.0 - 4.0 * cycle)
        for vessel in (0, 1):
            if cycle > 6 and rng.random() > 0.85:
                continue
            time = np.array([PERIOD_S * cycle + 0.5])
            place = np.column_stack([-300.0 + 4.0 * time, 1500.0 + gap * vessel + 0.0 * time]) + rng.normal(0.0, 6.0, (1, 2))
            none = np.zeros(1, np.int64)
            away, angle = np.hypot(*place.T), np.arctan2(place[:, 0], place[:, 1])
            parts.append(Plots(none, none, time, place, 36.0 * np.eye(2)[None], np.zeros((1, 2)), away, angle, none + vessel))
    _, out = run(method, Plots.join(parts), 40, SENSORS)
    assert [len(tracks) for tracks in out[6:]] == [2] * 34
    assert len({number for tracks in out for number in tracks.track_id.tolist()}) == 2


def test_the_end_of_a_jump_and_other_radars():
    plots = lone(tuple(range(8)))
    memory, out = run(LITERAL, plots, 8, SENSORS)
    given = RegionInput.of_plots(cut(plots, 8), 9 * PERIOD_S, SENSORS)
    with pytest.raises(ValueError, match="got 1 radars, needed 2"):
        LITERAL.step(memory, RegionInput.of_plots(Plots.empty(), 30.0, two_radars()))
    memory, found = LITERAL.step(memory, given._replace(jumped=np.ones(1, np.bool_)))
    assert len(found.tracks) == 0
    assert memory.next_number == out[-1].track_id[0] + 1


def test_settings_that_do_not_fit_are_refused():
    with pytest.raises(ValidationError, match="confirm_hits: got 5, needed at most confirm_looks = 4"):
        ImmJpdaLiteral(confirm_hits=5)
    with pytest.raises(ValidationError, match="end_misses"):
        ImmJpdaLiteral(end_misses=40)
    with pytest.raises(ValidationError, match=r"bank\.method: got 'filterpy', needed 'compiled'"):
        TableTracker(method="imm_jpda", bank={"method": "filterpy"})
