"""Convoys keep their line, passings come as close as set, and other vessels sail as if neither were there."""

from __future__ import annotations

import numpy as np
import pytest
from pydantic import ValidationError
from simulated_world import CENTRE_DEG, START_S, recorded, simulated

from coastwatch.batches import Trajectories
from coastwatch.geodesy import difference_m
from coastwatch.sensors.simulated.formations import Convoys, Passings, in_formation
from coastwatch.sensors.simulated.trajectories import VesselMotion, draw_motion

pytestmark = pytest.mark.contract

SPREAD_M = 0.5  # planes of anchors up to 10 km apart turn against each other: by so much over a few minutes' sailing
SAMPLE_M = 1.0  # the truth is sampled every 3 s and straight between kicks; the closest approach lies between two samples


def company(**settings) -> Trajectories:
    truth = recorded(count=90, cycles=60, seed=3, **settings).truth
    assert truth is not None
    return truth


def between(truth: Trajectories, a: int, b: int) -> np.ndarray:
    return difference_m(truth.position_deg[b], truth.position_deg[a])


def neighbours(truth: Trajectories, within_m: float) -> list[tuple[int, int]]:
    """Pairs no farther apart than this at every instant."""
    count = len(truth.vessel)
    pairs = [(a, b) for a in range(count) for b in range(a + 1, count)]
    return [p for p in pairs if np.hypot(*between(truth, *p).T).max() <= within_m]


def test_without_company_voyages_are_those_that_were_drawn():
    vessels = draw_motion(VesselMotion(), np.tile(CENTRE_DEG, (40, 1)), START_S, 180.0, 5)
    assert in_formation(Convoys(), Passings(), vessels, 180.0, 5) is vessels


def test_every_ship_of_a_convoy_keeps_its_place():
    truth = company(convoys=Convoys(share=0.7, spacing_from_m=60.0, spacing_to_m=120.0))
    pairs = neighbours(truth, 121.0)
    assert len(pairs) == 2 * 21, "21 convoys of three: neighbours in line, two pairs each"
    for a, b in pairs:
        gap = np.hypot(*between(truth, a, b).T)
        assert gap.max() - gap.min() < SPREAD_M
        assert 60.0 - SPREAD_M < gap.mean() < 120.0 + SPREAD_M
        np.testing.assert_allclose(truth.velocity_m_s[a], truth.velocity_m_s[b], atol=0.01)
    assert len(np.unique(pairs)) == 63


@pytest.mark.parametrize(("line", "along"), [("astern", 1.0), ("abreast", 0.0)])
def test_the_line_lies_as_set(line, along):
    truth = company(convoys=Convoys(share=1.0, ships=2, line=line), motion={"process_noise": "none"})
    pairs = neighbours(truth, 160.0)
    assert len(pairs) == 45
    for a, b in pairs:
        gap, velocity = between(truth, a, b)[0], truth.velocity_m_s[a, 0]
        cosine = gap @ velocity / np.linalg.norm(gap) / np.linalg.norm(velocity)
        assert abs(cosine) == pytest.approx(along, abs=0.02)


@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
def test_pairs_pass_as_close_as_set(share):
    truth = company(passings=Passings(share=0.8, distance_m=30.0, overtaking_share=share), motion={"process_noise": "none"})
    count = len(truth.vessel)
    met, same_way = [], 0
    for a in range(count):
        for b in range(a + 1, count):
            gap = between(truth, a, b)
            if abs(_closest_m(gap) - 30.0) < SAMPLE_M:
                cosine = truth.velocity_m_s[a, 0] @ truth.velocity_m_s[b, 0]
                cosine /= np.linalg.norm(truth.velocity_m_s[a, 0]) * np.linalg.norm(truth.velocity_m_s[b, 0])
                if abs(cosine) > 0.9999:
                    met.append((a, b))
                    same_way += cosine > 0.0
    assert len(met) == 36
    assert same_way == round(share * 36)


def _closest_m(gap: np.ndarray) -> float:
    """The least distance from zero of a path of straight pieces."""
    step = np.diff(gap, axis=0)
    at = np.clip(-(gap[:-1] * step).sum(axis=1) / np.maximum((step**2).sum(axis=1), 1e-12), 0.0, 1.0)
    return float(np.hypot(*(gap[:-1] + at[:, None] * step).T).min())


def test_others_sail_as_before():
    alone, together = company(), company(convoys=Convoys(share=0.2), passings=Passings(share=0.2))
    same = (alone.position_deg == together.position_deg).all(axis=(1, 2))
    assert same.sum() == 90 - 18 + 6 - 18 // 2, "18 in convoys, of which 6 lead; 9 of those that pass were moved"


def test_company_is_the_same_for_the_same_seed():
    made = [company(convoys=Convoys(share=0.3), passings=Passings(share=0.5)) for _ in range(2)]
    np.testing.assert_array_equal(made[0].position_deg, made[1].position_deg)


def test_no_vessel_and_too_few_for_a_convoy():
    for count in (0, 1, 2):
        both = {"convoys": Convoys(share=0.5), "passings": Passings(share=0.5)}
        assert len(recorded(count=count, cycles=3, **both).truth.vessel) == count


@pytest.mark.parametrize(
    ("made", "words"),
    [
        (lambda: Convoys(spacing_from_m=200.0), "spacing_from_m: got 200.0, needed at most spacing_to_m = 150.0"),
        (lambda: simulated(convoys=Convoys(share=0.7), passings=Passings(share=0.4)), "got 0.7 \\+ 0.4, needed at most 1"),
        (lambda: Passings(distance_m=-1.0), "greater than or equal to 0"),
        (lambda: Convoys(ships=1), "greater than or equal to 2"),
    ],
)
def test_what_cannot_be_is_refused(made, words):
    with pytest.raises(ValidationError, match=words):
        made()
