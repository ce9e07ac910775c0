"""A new association needs its module and its name in the union: the region and the tracker ask it, and name none."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
from radar_world import PERIOD_S, cut, plots_of, two_radars, world
from test_ais_in_radar_tracks import messages_of
from unions import kinds_in

from coastwatch.tracks import RegionInput, TableTracker
from coastwatch.tracks.radar import region, tracker
from coastwatch.tracks.radar.association import Association, Jipda

pytestmark = pytest.mark.contract

CYCLES = 10
ELSEWHERE_M = 123.0
CALLS: Counter[str] = Counter()
VERBS = {"take_messages", "track_batch", "end_slice", "end_cycle", "leave_messages", "predict"}


class Watched(Jipda):
    """As `jipda`, but it counts what it is asked, takes messages of one method alone, and is sure of no place."""

    messages = ("sequential", "none")
    banks = ("compiled",)

    def take_messages(self, *given):
        CALLS["take_messages"] += 1
        return super().take_messages(*given)

    def track_batch(self, *given):
        CALLS["track_batch"] += 1
        return super().track_batch(*given)

    def end_slice(self, *given):
        CALLS["end_slice"] += 1
        return super().end_slice(*given)

    def end_cycle(self, *given):
        CALLS["end_cycle"] += 1
        return super().end_cycle(*given)

    def leave_messages(self, *given):
        CALLS["leave_messages"] += 1
        return super().leave_messages(*given)

    def predict(self, *given):
        CALLS["predict"] += 1
        now, _ = super().predict(*given)
        return now, np.full(len(now.mean), ELSEWHERE_M)


def with_association(method: str) -> TableTracker:
    return TableTracker(method=method).model_copy(update={"association": Watched()})


def test_a_region_asks_an_association_that_it_does_not_know():
    truth, sensors = world(6, 5, side_nm=4.0), two_radars()
    plots, messages = plots_of(truth, sensors, PERIOD_S * CYCLES, 5), messages_of(truth, range(3), 5)
    CALLS.clear()
    shown = []
    for method in (with_association("vimmjipda_sequential"), TableTracker(method="vimmjipda_sequential")):
        memory = method.init()
        for cycle in range(CYCLES):
            now = messages.take((messages.time_s > PERIOD_S * cycle) & (messages.time_s <= PERIOD_S * (cycle + 1)))
            given = RegionInput.of_plots(cut(plots, cycle), PERIOD_S * (cycle + 1), sensors)
            memory, found = method.step(memory, given._replace(messages=now))
        shown.append(found.tracks)
    assert set(CALLS) == VERBS
    assert CALLS["end_cycle"] == CALLS["leave_messages"] == CALLS["predict"] == CYCLES
    new, plain = shown
    assert len(new) >= 2
    assert np.array_equal(new.track_id, plain.track_id)
    assert np.array_equal(new.position_deg, plain.position_deg)
    assert (new.alternative_m == ELSEWHERE_M).all()
    assert np.isnan(plain.alternative_m).all()


@pytest.mark.parametrize(
    ("method", "refusal"),
    [
        ("vimmjipda_noisy_batch", r"messages\.method: got 'noisy_batch', needed 'sequential' or 'none'"),
        ("bp_particles", r"messages\.method: got 'noisy_batch', needed"),
        ("sided_imm", r"upkeep\.method: got 'hits', needed 'existence'"),
    ],
)
def test_a_tracker_checks_its_parts_by_what_the_association_says(method, refusal):
    with pytest.raises(ValueError, match=refusal):
        with_association(method)._parts_fit_together()
    assert with_association("vimmjipda_sequential")._parts_fit_together()


def test_region_and_tracker_name_no_association_but_the_default():
    default = type(TableTracker.model_fields["association"].default)
    for module, known in ((region, set()), (tracker, {default})):
        named = {kind for kind in vars(module).values() if isinstance(kind, type)} & set(kinds_in(Association))
        assert named == known, module.__name__
