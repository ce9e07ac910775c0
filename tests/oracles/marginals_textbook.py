"""Association probabilities by the textbook: every joint assignment is written down, and sum-product with dense matrices.

Sources: Y. Bar-Shalom, X. R. Li, Multitarget-Multisensor Tracking, 1995, section 6.2; J. Williams, R. Lau, Approximate evaluation of
marginal association probabilities with belief propagation, IEEE Trans. AES 50(4), 2014, equations (30) and (31).
"""

from __future__ import annotations

from itertools import product

import numpy as np


def by_enumeration(weight):
    """The probability of each pair of a track and a plot (n, m). Args: weight: (n, m) over "missed, plot of none", 0 outside the gate."""
    n, m = weight.shape
    out, total = np.zeros((n, m)), 0.0
    for plots in product(range(-1, m), repeat=n):
        taken = [j for j in plots if j >= 0]
        if len(set(taken)) < len(taken):
            continue
        joint = np.prod([weight[i, j] for i, j in enumerate(plots) if j >= 0])
        total += joint
        for i, j in enumerate(plots):
            if j >= 0:
                out[i, j] += joint
    return out / total


def by_sum_product(weight, rounds=2000):
    """The same by sum-product: exact if the pairs form no loop."""
    from_plot = np.ones_like(weight)
    for _ in range(rounds):
        sums = (weight * from_plot).sum(axis=1, keepdims=True)
        to_plot = weight / (1.0 + sums - weight * from_plot)
        from_plot = 1.0 / (1.0 + to_plot.sum(axis=0, keepdims=True) - to_plot)
    value = weight * from_plot
    return value / (1.0 + value.sum(axis=1, keepdims=True))
