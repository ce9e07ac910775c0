"""Ids of vessels by their messages: the update of a few slots and a lump against Bayes' rule over every id by name."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, strategies as st

from coastwatch.kernels.tracks.columns import NAMES, VesselIds
from coastwatch.kernels.tracks.vessel_ids import IDS, likelihoods, update

pytestmark = pytest.mark.oracle

CORRECT = 0.9
ROUNDING = 1e-6  # the kernel counts one id more or less among the others, of 1e9


def textbook(prior, messages):
    """Probability of each id, and of none, after messages (id, share of the message that is of the track); and f of each message.

    Args: prior: probability by id; None: it sends nothing; "other": all ids that nobody named.
    """
    found = []
    for mmsi, share in messages:
        prior = dict(prior)
        if mmsi not in prior:
            prior[mmsi] = prior["other"] / IDS
        given = {name: (CORRECT if name == mmsi else (1.0 - CORRECT) / (IDS - 2.0)) for name in prior}
        given[None] = 0.0
        f = sum(prior[name] * given[name] for name in prior)
        found.append(f)
        prior = {name: p * ((1.0 - share) + share * given[name] / f) for name, p in prior.items()}
    return prior, found


@given(st.lists(st.tuples(st.integers(1, 5), st.floats(0.05, 1.0)), min_size=1, max_size=4), st.floats(0.05, 0.95))
def test_a_row_of_messages_is_bayes_rule(messages, silent):
    """Each message in a batch of its own."""
    ids = VesselIds(np.full((1, NAMES), -1), np.zeros((1, NAMES + 2)))
    ids.probability[0, 0], ids.probability[0, NAMES + 1] = silent, 1.0 - silent
    want, f = textbook({None: silent, "other": 1.0 - silent}, messages)
    for (mmsi, share), expected in zip(messages, f, strict=True):
        row, one = np.array([0]), np.array([mmsi])
        np.testing.assert_allclose(likelihoods(ids, row, one, CORRECT), expected, rtol=ROUNDING)
        update(ids, row, np.array([0, 1]), one, np.array([share]), CORRECT)
    for name, probability in zip(ids.name[0].tolist(), ids.probability[0, 1:-1].tolist(), strict=True):
        if name >= 0:
            np.testing.assert_allclose(probability, want[name], rtol=1e-4, atol=1e-9)
    np.testing.assert_allclose(ids.probability[0, 0], want[None], rtol=1e-4, atol=1e-12)


def test_two_messages_of_one_batch_are_shares_of_a_mixture():
    """A track known by 1 weighs a message of 1 and one of 2: the mixture of both posteriors and of "neither"."""
    ids = VesselIds(np.full((1, NAMES), -1), np.zeros((1, NAMES + 2)))
    ids.name[0, 0] = 1
    ids.probability[0, [0, 1, NAMES + 1]] = 0.1, 0.8, 0.1
    prior = {None: 0.1, 1: 0.8, "other": 0.1}
    update(ids, np.array([0]), np.array([0, 2]), np.array([1, 2]), np.array([0.6, 0.3]), CORRECT)
    parts = [textbook(prior, [(mmsi, 1.0)])[0] for mmsi in (1, 2)]
    want = 0.1 * 0.8 + 0.6 * parts[0][1] + 0.3 * parts[1][1]
    np.testing.assert_allclose(ids.probability[0, 1], want, rtol=ROUNDING)
    np.testing.assert_allclose(ids.probability[0, 2], 0.3 * parts[1][2], rtol=1e-4)
    np.testing.assert_allclose(ids.probability.sum(), 1.0)


def test_the_least_probable_name_makes_room():
    ids = VesselIds(np.arange(NAMES)[None] + 1, np.zeros((1, NAMES + 2)))
    ids.probability[0, 1:] = 0.4, 0.3, 0.1, 0.15, 0.05
    update(ids, np.array([0]), np.array([0, 1]), np.array([77]), np.array([0.01]), CORRECT)
    assert ids.name[0].tolist() == [1, 2, 77, 4]
    np.testing.assert_allclose(ids.probability.sum(), 1.0)
