"""Is the global hypothesis as cheap as that of an integer program, and how much faster? `python -m scaling.decisions.global_choice`.

The kernel `global_hypothesis` stands beside HiGHS (`scipy.optimize.milp`), which judges it and is not in the product. Small clusters have
2 to 6 trees with up to `--most` leaves that want up to three of `--resources`. Large ones are 44 to 50 vessels that meet, with 20 leaves
each, as the tests of the kernel have them. Asked: the same cost in all small clusters, 100 times faster; in large ones a median excess of
2 and a worst of 20, in 40 ms. Times are wall times of one thread; those of HiGHS include its matrices. A cost of 1 is one log-likelihood.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple, TypeVar

import numpy as np

from coastwatch.batches import Floats, Ints
from coastwatch.kernels.association.global_hypothesis import Choice, choose
from coastwatch.tracks.radar.multi_hypothesis import MultiHypothesis

TESTS = Path(__file__).parents[2] / "tests"
SAME = 1e-6  # two sums of costs; HiGHS stops at 1e-7
LARGE = 44, 51  # trees

T = TypeVar("T")


class Compared(NamedTuple):
    """The choice of the kernel in one cluster beside that of HiGHS."""

    excess: float  # of its cost over the least
    bound: float  # what the kernel says of the excess, 0: it is proven
    kernel_ms: float
    highs_ms: float


def timed(work: Callable[[], T], times: int) -> tuple[T, float]:
    """What a function returns, and the least of its wall times in ms."""
    least = np.inf
    for _ in range(times):
        begin = time.perf_counter()
        made = work()
        least = min(least, 1e3 * (time.perf_counter() - begin))
    return made, least


def compared(start: Ints, cost: Floats, resource: Ints, rounds: int, nodes: int) -> Compared:
    """Both choices in one cluster, where no vessel costs nothing. Args: of the cluster; rounds, nodes: limits of the kernel."""
    from global_hypothesis_textbook import by_milp

    null, resources = np.zeros(len(start) - 1), int(resource.max(initial=-1)) + 1
    choice: Choice
    choice, kernel_ms = timed(lambda: choose(start, cost, resource, resources, null, rounds, nodes), 3)
    best, highs_ms = timed(lambda: by_milp(start, cost, resource, resources, null), 1)
    got = float(np.where(choice.leaf >= 0, cost[choice.leaf], null).sum())
    return Compared(got - best, float(choice.excess.sum()), kernel_ms, highs_ms)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--small", type=int, default=1000, help="clusters of 2 to 6 trees")
    parser.add_argument("--most", type=int, default=20, help="leaves of a tree in them")
    parser.add_argument("--resources", type=int, default=8, help="measurements of such a cluster")
    parser.add_argument("--large", type=int, default=28, help="clusters of 44 to 50 trees")
    defaults = MultiHypothesis()
    parser.add_argument("--rounds", type=int, default=defaults.price_rounds, help="`price_rounds` of the tracker")
    parser.add_argument("--nodes", type=int, default=defaults.search_nodes, help="`search_nodes` of the tracker")
    asked = parser.parse_args()
    limits = asked.rounds, asked.nodes
    sys.path += [str(TESTS / folder) for folder in ("oracles", "worlds")]
    from hypothesis_clusters import forest, meeting

    compared(*forest(0, 3, asked.most, asked.resources), *limits)  # compiles
    small = [compared(*forest(seed, 2 + seed % 5, asked.most, asked.resources), *limits) for seed in range(asked.small)]
    excess, bound, kernel_ms, highs_ms = np.array(small).T
    print(f"{len(small)} clusters of 2 to 6 trees: {np.count_nonzero(abs(excess) <= SAME)} of equal cost (asked: all)")
    print(f"  kernel {kernel_ms.mean():.4f} ms, HiGHS {highs_ms.mean():.2f} ms on average", end="")
    print(f": {highs_ms.sum() / kernel_ms.sum():.0f} times faster (asked: 100); {np.count_nonzero(bound)} unproven")
    if not asked.large:
        return
    large = [compared(*meeting(seed, LARGE[0] + seed % (LARGE[1] - LARGE[0])), *limits) for seed in range(asked.large)]
    excess, bound, kernel_ms, highs_ms = np.array(large).T
    print(
        f"{len(large)} meetings of 44 to 50 trees: excess median {np.median(excess):.2f}, worst {excess.max():.2f} (asked: 2, 20)"
    )
    print(
        f"  {np.count_nonzero(bound)} unproven, of a bound of {np.median(bound):.1f} in the median, {bound.max():.1f} at worst"
    )
    print(f"  kernel {np.median(kernel_ms):.1f} ms, worst {kernel_ms.max():.1f} (asked: 40); ", end="")
    print(f"HiGHS {np.median(highs_ms):.0f} ms, worst {highs_ms.max():.0f}")


if __name__ == "__main__":
    main()
