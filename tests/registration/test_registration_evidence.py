"""Evidence for a bias: reference cells, e-values, the decision, and what is shown of it."""

from __future__ import annotations

import numpy as np
import pytest
import registration_world as world

from coastwatch.batches import RegistrationState
from coastwatch.registration import OnlineRegistration
from coastwatch.registration.evidence import MOST_AT_REST, MOST_UNDER_WAY, decide, evidence
from coastwatch.registration.polar import Pairs
from coastwatch.registration.reference_cells import (
    MOST_REFERENCE_CELLS,
    SQUARE_M,
    Counts,
    Grid,
    Hits,
    ReferenceCells,
    Seen,
    count_looks,
    counted,
    squares,
)

pytestmark = pytest.mark.contract

GRID = Grid(np.radians(20.0), 150.0, np.radians(0.75))
SIGMA = np.radians(1.3)
PERIOD_S = 2.5


def seen(at_m, at_rest=False, first=0):
    at_m = np.atleast_2d(np.asarray(at_m, float))
    n = len(at_m)
    return Seen(np.arange(first, first + n), at_m, squares(at_m), np.full(n, at_rest))


def pairs_of(vessel, range_m, azimuth_rad):
    n = len(vessel)
    zero, number = np.zeros(n), np.arange(n)
    return Pairs(
        number,
        np.asarray(vessel, np.int64),
        number * 0,
        np.asarray(range_m, float),
        np.asarray(azimuth_rad, float),
        *[zero] * 5,
    )


def looked(vessels, pairs, stamp_s, reference_cells=None):
    reference_cells = ReferenceCells.empty() if reference_cells is None else reference_cells
    return count_looks(reference_cells, vessels, pairs, np.asarray(stamp_s, float), 1.0, PERIOD_S, GRID)


def reference_cells_of(histogram, looks, cell, group):
    """Reference cells with these histograms. Args: (N, D, A)"""
    n = len(histogram)
    reference_cell, at = np.nonzero(histogram.reshape(n, -1))
    counts = Counts(reference_cell.astype(np.int32), at.astype(np.int32), histogram.reshape(n, -1)[reference_cell, at])
    return ReferenceCells(Hits.empty(), counts, np.arange(n), cell, group, np.full(n, looks), np.zeros(n))


def histograms(reference_cells):
    return reference_cells.histograms(np.arange(len(reference_cells)), GRID)


def random_histograms(rng, reference_cells, turns, echoes):
    """Reference cells among plots that have nothing to do with them: clusters at a random angle of each reference cell."""
    n = len(GRID.azimuth_rad)
    histogram = rng.poisson(0.01 * turns, (reference_cells, *GRID.shape)).astype(np.float32)
    for k in range(reference_cells):
        middle = rng.integers(n)
        for _ in range(echoes):  # a quay: many plots at one place
            histogram[k, rng.integers(GRID.shape[0]), np.clip(middle + rng.integers(-2, 3), 0, n - 1)] += rng.binomial(
                turns, 0.5
            )
    number = np.arange(reference_cells)
    return reference_cells_of(histogram, float(turns), 2 * number, number)


def test_a_vessel_has_a_new_reference_cell_in_each_cell_and_one_at_rest_counts_with_its_square():
    reference_cells = looked(seen([[3000.0, 0.0]]), pairs_of([], [], []), [])
    reference_cells = looked(seen([[3010.0, 0.0]]), pairs_of([], [], []), [], reference_cells)
    assert len(reference_cells) == 1, "still in its cell"
    reference_cells = looked(seen([[3700.0, 0.0]]), pairs_of([], [], []), [], reference_cells)
    assert len(reference_cells) == 2
    assert reference_cells.new_looks.tolist() == [2.0, 1.0]
    at_rest = looked(seen([[3100.0, 100.0], [3200.0, 200.0], [3100.0, 1100.0]], at_rest=True), pairs_of([], [], []), [])
    assert at_rest.group[0] == at_rest.group[1] != at_rest.group[2]
    assert (at_rest.group < 0).all()
    assert (squares(np.array([[0.0, 0.0], [SQUARE_M, 0.0], [0.0, -1.0]])) < 0).all()


def test_a_bin_has_one_hit_a_turn_whatever_the_order_and_the_cycle():
    vessels, stamps = seen([[3000.0, 0.0], [0.0, 4000.0]]), np.array([0.1, 0.2, 2.6, 0.3])
    hits = pairs_of([0, 0, 0, 1], [0.0, 1.0, 0.0, 50.0], [0.0, 0.001, 0.0, 0.1])
    once = counted(looked(vessels, hits, stamps), 1.0, GRID)
    assert histograms(once).sum(axis=(1, 2)).tolist() == [2.0, 1.0]
    order = [3, 2, 1, 0]
    mixed = counted(looked(vessels, hits.take(np.array(order)), stamps[order]), 1.0, GRID)
    assert np.array_equal(histograms(once), histograms(mixed))
    first, second = np.array([0, 3]), np.array([1, 2])
    split = looked(vessels, hits.take(first), stamps[first])
    split = counted(looked(vessels, hits.take(second), stamps[second], split), 1.0, GRID)
    assert np.array_equal(histograms(once), histograms(split)), "of one turn that two cycles share"


def test_old_hits_count_less_and_reference_cells_are_bounded():
    vessels = seen([[3000.0, 0.0]])
    reference_cells = counted(looked(vessels, pairs_of([0], [0.0], [0.0]), [0.1]), 1.0, GRID)
    half = counted(looked(vessels, pairs_of([], [], []), [], reference_cells), 0.5, GRID)
    assert histograms(half).max() == 0.5
    assert half.looks.tolist() == [1.5]
    assert len(counted(half, 0.1, GRID)) == 0
    many = ReferenceCells.empty()
    for k in range(12):
        turned = 0.1 + 0.5 * k
        at = 5000.0 * np.tile([np.sin(turned), np.cos(turned)], (450, 1))
        many = looked(seen(at, first=450 * k), pairs_of([], [], []), [], many)
    assert len(many) == MOST_REFERENCE_CELLS
    assert len(counted(many, 1.0, GRID)) < MOST_REFERENCE_CELLS, "room for new ones"


def test_evidence_without_a_bias_is_one_on_average():
    """The mean of the e-value over biases is 1 for each reference cell, and that of their product over many seas is no more than 1."""
    means = []
    for seed in range(60):
        reference_cells = random_histograms(np.random.default_rng([seed, 9]), 4, 20, 3)
        field = evidence(reference_cells, SIGMA, GRID)
        means.append(float(np.exp(np.minimum(field.log_evidence, 30.0)).mean()))
    assert np.mean(np.minimum(means, 1e3)) < 3.0
    assert sum(m > 100.0 for m in means) <= 1


def test_no_group_counts_more_than_its_share():
    histogram = np.zeros((8, *GRID.shape), np.float32)
    histogram[:, 6, 47] = 300.0
    group, number = np.repeat([-5, 8], 4), np.arange(8)
    reference_cells = reference_cells_of(histogram, 400.0, 2 * number, group)
    field = evidence(reference_cells, SIGMA, GRID)
    assert field.by_group.max(axis=(1, 2)) == pytest.approx([MOST_AT_REST, MOST_UNDER_WAY], rel=1e-5)


def test_vessels_in_one_cell_count_as_their_mean():
    """They see the same background: ten of them in one cell are one group, each with a tenth."""
    one = random_histograms(np.random.default_rng(4), 1, 20, 3)
    histogram = np.repeat(histograms(one), 10, axis=0)
    number = np.arange(10)
    ten = reference_cells_of(histogram, 20.0, number * 0, number)
    assert evidence(ten, SIGMA, GRID).by_group.sum(axis=0) == pytest.approx(evidence(one, SIGMA, GRID).by_group[0], abs=1e-4)
    apart = reference_cells_of(histogram, 20.0, 2 * number, number)
    assert evidence(apart, SIGMA, GRID).log_evidence.max() > 2.0 * evidence(one, SIGMA, GRID).log_evidence.max()


def test_the_decision_names_candidate_odds_groups_and_rival():
    rng, n = np.random.default_rng(3), 12
    reference_cells = random_histograms(rng, n, 20, 0)
    column = int(np.abs(GRID.azimuth_rad - np.radians(6.0)).argmin())
    histogram, number = histograms(reference_cells), np.arange(n)
    histogram[:, 7, column] += 9.0
    reference_cells = reference_cells_of(histogram, 20.0, 2 * number, number)
    found = decide(evidence(reference_cells, SIGMA, GRID), SIGMA)
    assert np.degrees(found.azimuth_rad) == pytest.approx(6.0, abs=0.5)
    assert found.range_m == pytest.approx(25.0, abs=15.0)
    assert found.log_odds > np.log(1e5)
    assert found.groups == n
    assert found.rival_share < 0.01
    other = int(np.abs(GRID.azimuth_rad + np.radians(9.0)).argmin())
    histogram[:, 7, other] += 9.0
    twice = decide(evidence(reference_cells_of(histogram, 20.0, 2 * number, number), SIGMA, GRID), SIGMA)
    assert twice.rival_share > 0.1, "two biases with as much evidence"


def test_what_is_known_is_shown_from_the_first_decision_on():
    sea = world.Sea(21, vessels=40, ais=12, detection=0.1, errors=((5.0, 30.0, 0.0),))
    course = world.run(OnlineRegistration(), sea, 12)[2]
    for now in course:
        assert np.isfinite(
            [now.candidate_azimuth_rad[0], now.candidate_range_m[0], now.odds[0], now.voices[0], now.rival_share[0]]
        ).all()
        assert now.compared.tolist() == [pytest.approx(12, abs=2)]
    assert course[0].state.tolist() == [RegistrationState.ACQUIRING]
    assert course[0].azimuth_bias_rad.tolist() == [0.0]


def test_a_radar_without_ais_in_cover_says_so_and_is_found_later():
    sea = world.Sea(22, errors=((5.0, 0.0, 0.0),))
    sea.ais = 0
    memory, given, _ = world.run(OnlineRegistration(), sea, 3)
    assert given.state.tolist() == [RegistrationState.UNKNOWN]
    assert given.compared.tolist() == [0.0]
    sea.ais = 40
    _, given, _ = world.run(OnlineRegistration(), sea, 10, first=3, memory=memory, given=given)
    assert given.state[0] in (RegistrationState.FOUND, RegistrationState.SETTLED)
    assert given.found_odds[0] >= 1e5


def test_radars_do_not_change_each_other():
    errors = ((5.0, 0.0, 1.0), (-7.0, 40.0, 0.0))
    both = world.run(OnlineRegistration(), world.Sea(23, radars=2, errors=errors), 20)[1]
    other = world.run(OnlineRegistration(), world.Sea(23, radars=2, errors=(errors[0], (9.0, -40.0, 2.0))), 20)[1]
    for name in ("azimuth_bias_rad", "range_bias_m", "time_lag_s", "azimuth_sigma_rad", "odds", "candidate_azimuth_rad"):
        assert getattr(both, name)[0] == getattr(other, name)[0], name
    assert both.azimuth_bias_rad[1] != other.azimuth_bias_rad[1]


def test_few_of_many_vessels_seen_are_enough_in_minutes():
    """One vessel in seven is seen at a turn, among as many false plots: one cycle is not enough, minutes are."""
    sea = world.Sea(24, vessels=60, ais=40, detection=0.12, clutter=60, errors=((5.0, 30.0, 0.0),))
    course = world.run(OnlineRegistration(), sea, 60)[2]
    states = [int(c.state[0]) for c in course]
    assert states[0] == RegistrationState.ACQUIRING
    found = next(k for k, s in enumerate(states) if s in (RegistrationState.FOUND, RegistrationState.SETTLED))
    assert found > 0
    assert np.degrees(course[-1].azimuth_bias_rad[0]) == pytest.approx(5.0, abs=0.3)


def test_the_memory_keeps_its_size():
    """A reference cell that nobody looks at is forgotten, so a radar with passing traffic needs no more and more memory."""
    sea = world.Sea(25, speed_m_s=12.0)
    memory = world.run(OnlineRegistration(), sea, 60)[0]
    later = world.run(OnlineRegistration(), sea, 60, first=60, memory=memory)[0]
    assert len(later.reference_cells[0]) < 1.5 * len(memory.reference_cells[0])
    assert sum(array.nbytes for array in vars(later.reference_cells[0].counts).values()) < 2e5, "only bins with plots are kept"
