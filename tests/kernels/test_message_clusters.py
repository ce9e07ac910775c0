"""Messages in turn: those that may meet keep their order, and all others are taken together."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, strategies as st

from coastwatch.kernels.tracks import message_clusters

pytestmark = pytest.mark.oracle


def rounds(nodes: list[list[int]], close: list[tuple[int, int]]):
    """As the kernel. Args: nodes: of each message; close: pairs of messages, the earlier one first."""
    message = np.repeat(np.arange(len(nodes)), [len(own) for own in nodes])
    pairs = np.array(sorted(close, key=lambda pair: pair[1]), np.int64).reshape(-1, 2)
    return message_clusters.rounds(len(nodes), message, np.array([node for own in nodes for node in own], np.int64), 10, pairs)


def test_messages_around_one_are_taken_together():
    """Two vessels on either side of a third share a track with it, and not with each other."""
    assert rounds([[0], [1], [0, 1], [0], [1]], []).tolist() == [0, 0, 1, 2, 2]
    assert rounds([[0], [1], [2]], [(0, 2)]).tolist() == [0, 0, 1]
    assert rounds([], []).tolist() == []


@given(st.lists(st.lists(st.integers(0, 9), max_size=4, unique=True), max_size=12), st.integers(0, 10**6))
def test_a_message_is_later_than_each_before_it_that_it_may_meet_and_no_later_than_needed(nodes, seed):
    rng, count = np.random.default_rng([seed, 41]), len(nodes)
    close = [(i, j) for j in range(count) for i in range(j) if rng.uniform() < 0.1]
    got = rounds(nodes, close)
    for j in range(count):
        before = [i for i in range(j) if (i, j) in close or set(nodes[i]) & set(nodes[j])]
        assert got[j] == max([got[i] + 1 for i in before], default=0)
