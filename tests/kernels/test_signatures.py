"""Classes of vessels by their sound: the likelihood of what is said, ship types by MMSI, and what a pair gains."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from coastwatch.associations.bearing_sensors import ShipTypes, class_log_odds
from coastwatch.batches import CLASS_OF_TYPE, CLASSES, AisStatics, VesselClass
from coastwatch.kernels.bearings.signatures import check_confusion, even_confusion, log_likelihood

pytestmark = pytest.mark.oracle

SKEW = np.array([[0.7, 0.2, 0.1], [0.3, 0.6, 0.1], [0.05, 0.15, 0.8]])  # asymmetric: rows are true, columns said
ROUNDING = 1e-12


def by_hand(looks: list[int], confusion: np.ndarray, habit: float, true: int) -> float:
    """The probability of these looks: every habitual answer, and each look either repeats it or not."""
    total = 0.0
    for answer in range(len(confusion)):
        for repeats in product((True, False), repeat=len(looks)):
            term = confusion[true, answer]
            for said, repeat in zip(looks, repeats, strict=True):
                term *= habit * (said == answer) if repeat else (1.0 - habit) * confusion[true, said]
            total += term
    return total


@pytest.mark.parametrize("habit", [0.0, 0.4, 0.95])
@pytest.mark.parametrize("looks", [[0], [1, 1], [0, 2, 2, 1], [2, 2, 2, 2, 2]])
def test_likelihood_is_the_sum_over_habitual_answers(looks: list[int], habit: float) -> None:
    counts = np.bincount(looks, minlength=3)[None]
    expected = [np.log(by_hand(looks, SKEW, habit, k)) for k in range(3)]
    np.testing.assert_allclose(log_likelihood(counts, SKEW, habit)[0], expected, rtol=ROUNDING)


def test_likelihood_of_nothing_said_and_of_a_sensor_that_never_errs() -> None:
    counts = np.array([[0, 0, 0], [0, 4, 0], [1, 1, 0]])
    out = log_likelihood(counts, np.eye(3), 0.5)
    assert out[0].tolist() == [0.0, 0.0, 0.0]
    assert out[1, 1] == pytest.approx(0.0, abs=1e-6)
    assert (out[1, [0, 2]] < -20.0).all()
    assert np.isfinite(out).all()
    assert log_likelihood(counts[1:2], SKEW, 0.5)[0] == pytest.approx(log_likelihood(counts, SKEW, 0.5)[1], rel=0, abs=0)


def test_independent_looks_add_up_and_habits_do_not() -> None:
    counts = np.array([[1, 0, 0], [40, 0, 0]])
    one, forty = np.diff(log_likelihood(counts, SKEW, 0.0)[:, :2], axis=1)[:, 0]
    assert forty == pytest.approx(40.0 * one)
    one, forty = np.diff(log_likelihood(counts, SKEW, 0.99)[:, :2], axis=1)[:, 0]
    assert abs(forty) < 1.5 * abs(one)


def test_confusion_by_hand_is_checked() -> None:
    check_confusion("here", (), 3)
    check_confusion("here", tuple(map(tuple, SKEW.tolist())), 3)
    for wrong in (((1.0,),), ((0.5, 0.5, 0.1),) * 3, ((0.5, 0.5),) * 3):
        with pytest.raises(ValueError, match="here: got rows"):
            check_confusion("here", wrong, 3)
    np.testing.assert_allclose(even_confusion(0.7, 7).sum(axis=1), 1.0)


def statics(received_s: list[float], mmsi: list[int], ship_type: list[int]) -> AisStatics:
    n = len(mmsi)
    blank, none = np.full(n, "", "U7"), np.full(n, np.nan)
    return AisStatics(np.array(received_s), np.array(mmsi), blank.astype("U20"), blank, np.array(ship_type), none, none)


def test_the_last_type_that_tells_a_class_stands() -> None:
    types = ShipTypes.empty().updated(statics([1.0, 2.0, 3.0, 3.0], [5, 7, 5, 9], [70, 30, 81, 0]))
    assert types.of(np.array([9, 7, 5, -1])).tolist() == [-1, VesselClass.FISHING, VesselClass.TANKER, -1]
    later = types.updated(statics([4.0, 5.0, 6.0], [7, 5, 9], [0, -1, 90])).updated(statics([7.0], [7], [36]))
    assert later.of(np.array([5, 7, 9])).tolist() == [VesselClass.TANKER, VesselClass.PLEASURE, -1]
    assert types.of(np.array([7])).tolist() == [VesselClass.FISHING]
    assert ShipTypes.empty().of(np.array([7])).tolist() == [-1]

    assert types.updated(statics([9.0, 9.0], [1, 2], [100, -5])).mmsi.tolist() == [5, 7]


def test_types_are_bounded_and_those_that_were_heard_last_stay(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("coastwatch.associations.bearing_sensors.MOST_TYPES", 100)
    types = ShipTypes.empty()
    for k in range(40):
        mmsi = [1, *range(10 + 20 * k, 30 + 20 * k)]
        types = types.updated(statics([float(k)] * 21, mmsi, [70] * 21))
        assert len(types.mmsi) <= 100
        assert (np.diff(types.mmsi) > 0).all()
    of_cargo = types.of(np.array([1]))[0]
    assert types.of(np.array([1, 10, 809])).tolist() == [of_cargo, -1, of_cargo]
    assert types.updated(statics([50.0], [1], [30])).of(np.array([1, 809])).tolist() == [CLASS_OF_TYPE[30], of_cargo]


def test_types_of_the_recommendation() -> None:
    named = {
        0: -1,
        30: 3,
        31: 4,
        35: 6,
        36: 5,
        37: 5,
        40: 2,
        52: 4,
        55: 6,
        60: 2,
        69: 2,
        70: 0,
        79: 0,
        80: 1,
        89: 1,
        90: -1,
        99: -1,
    }
    assert {code: int(CLASS_OF_TYPE[code]) for code in named} == named


def test_a_pair_gains_where_type_and_sound_agree_and_nothing_where_either_is_silent() -> None:
    signatures = np.zeros((2, CLASSES), np.int64)
    signatures[1, VesselClass.SERVICE] = 4
    known = np.array([-1, 0, 0, 1, 4])
    gain = class_log_odds(signatures, known, even_confusion(0.7, CLASSES), 0.8, 0.05)
    assert (gain[0] == 0.0).all()
    assert gain[1, -1] == 0.0
    assert gain[1, VesselClass.SERVICE] > 1.0
    assert gain[1, VesselClass.CARGO] < -1.0
    assert gain[1].min() > np.log(0.05)  # a ship may lie
    weight = (np.bincount(known[1:], minlength=CLASSES) + 1.0) / (len(known) - 1 + CLASSES)
    surely = class_log_odds(signatures, known, even_confusion(0.7, CLASSES), 0.8, 1e-9)
    assert np.exp(surely[1, :CLASSES]) @ weight == pytest.approx(1.0)  # what agreement gains, disagreement pays
