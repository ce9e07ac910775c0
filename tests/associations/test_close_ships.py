"""Association where it is hard: a cold start, convoys, passings, and any number of spots over a thousand vessels."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from coastwatch.associations import AssociationInput, WindowedCovariance
from coastwatch.batches import Associations, Ints, RadarCorrections, Tracks
from coastwatch.scenario import load_scenario
from coastwatch.scores.confusion import Confusion, association
from coastwatch.spots import KMeansSpots
from coastwatch.stage import serial
from coastwatch.tracks import AisInput, RegionInput

pytestmark = pytest.mark.contract

SEED = 2003  # no setting was chosen on it
HEARD_S = 9.0  # after the start of a run
COLD = (
    0.995  # one seed has about 250 partners, and two wrong decisions at 9 s are 0.4 %; the table of accuracy has 0.999 over ten
)


@cache
def tracks_of(cycles: int, *settings: str) -> tuple[tuple[Tracks, ...], Ints]:
    """The tracks of every cycle, the first at the start of the run, and the kind of each source."""
    made = dict(pair.split("=", 1) for pair in (*settings, "sonars=[]", "warmup_s=0", f"cycles={cycles}"))
    s = load_scenario("context-driven-1000", made)
    sensors, plan = s.sensors(), s.plan()
    reports = s.input.load(sensors, SEED, plan).reports
    plots, tracker, ais = s.plots.init(), s.tracks.init(), s.ais_tracks.init()
    out, before_s = [], -np.inf
    for cycle in range(cycles):
        now_s = plan.instant_s(cycle)
        part = reports.between(before_s, now_s)
        plots, echoes = s.plots.step(plots, part.radar, sensors, RadarCorrections.empty(R=len(sensors.radars)))
        tracker, (radar, *_) = s.tracks.step(tracker, RegionInput.of_plots(echoes, now_s, sensors))
        ais, (named, *_) = s.ais_tracks.step(ais, AisInput(part.ais, now_s, sensors))
        out.append(Tracks.join([radar, named]))
        before_s = now_s
    return tuple(out), sensors.source_kinds


@cache
def associated(tracks: tuple[Tracks, ...], spots: KMeansSpots) -> list[Associations]:
    method = WindowedCovariance()
    memory, grouped, out = method.init(), spots.init(), []
    for now in tracks:
        grouped, found = spots.step(grouped, now)
        memory, pairs = method.step(memory, AssociationInput(now, found, serial))
        out.append(pairs)
    return out


def decided(cycles: int, after: int, *settings: str) -> Confusion:
    """All decisions from a cycle on."""
    tracks, kinds = tracks_of(cycles, *settings)
    made = associated(tracks, KMeansSpots(count=1))
    return sum((association(t, a, kinds) for t, a in zip(tracks[after:], made[after:], strict=True)), Confusion())


@pytest.mark.parametrize("count", [5, 10, 20, 50])
@pytest.mark.parametrize("fit_every", [1, 20])
def test_any_number_of_spots_of_any_age_gives_the_same_pairs(count, fit_every):
    """20 cycles of 3 s: centroids up to 60 s old."""
    tracks, _ = tracks_of(22)
    for one, many in zip(
        *(associated(tracks, s) for s in (KMeansSpots(count=1), KMeansSpots(count=count, fit_every=fit_every))), strict=True
    ):
        for name in ("first", "second", "statistic", "vessel"):
            np.testing.assert_array_equal(getattr(one, name), getattr(many, name), err_msg=name)


def test_centroids_move_only_when_they_are_old_enough():
    tracks, _ = tracks_of(22)
    spots, memory, centres = KMeansSpots(count=10, fit_every=20), KMeansSpots().init(), []
    for now in tracks:
        memory, found = spots.step(memory, now)
        centres.append(found.centre_m)
    moved = [k for k in range(1, 22) if not np.array_equal(centres[k], centres[k - 1])]
    assert moved == [20]


def test_a_cold_start_is_over_after_nine_seconds():
    cycle = int(HEARD_S / 3.0) - 1
    tracks, kinds = tracks_of(22)
    made = associated(tracks, KMeansSpots(count=1))
    for k in range(cycle, 22):
        assert association(tracks[k], made[k], kinds).as_dict()["f1"] >= COLD, f"{3.0 * (k + 1):g} s after the start"


@pytest.mark.parametrize(
    "settings",
    [
        ("input.convoys.share=1.0",),
        ("input.passings.share=1.0", "input.passings.overtaking_share=0"),
        ("input.passings.share=1.0", "input.passings.overtaking_share=1"),
    ],
    ids=["convoys of 50 to 150 m", "head-on at 30 m", "overtaking at 30 m"],
)
def test_ships_close_by_are_told_apart(settings):
    made = decided(50, 25, "input.count=200", *settings).as_dict()
    assert made["tp"] > 1000
    assert made["f1"] >= 0.998
