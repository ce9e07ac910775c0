"""Track-oriented multiple hypothesis tracking by recursive trees of dictionaries; the global choice by an integer linear program.

Source: E. Liland, AIS aided multi hypothesis tracker, master thesis, NTNU, 2017, sections 4.4 to 4.9; constants of its program.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.optimize import LinearConstraint, milp

H = np.eye(2, 4)
SIGMA2, GATE, REPORT_GATE, NEW = 6.25, 5.99, 9.49, 2e-8
START = np.diag([6.25, 6.25, 1.875, 1.875])
END_SHARE, END_SCORE = 0.8, 3.0

Node = dict[str, Any]


def root(number: int, state: Any) -> Node:
    """A tree of one node."""
    return {
        "number": number,
        "x": np.array(state),
        "P": START,
        "mmsi": None,
        "score": 0.0,
        "life": 0.0,
        "used": (),
        "below": [],
    }


def predicted(x: Any, covariance: Any, time: float) -> tuple[Any, Any]:
    move = np.eye(4)
    move[0, 2] = move[1, 3] = time
    block = np.array([[time**4 / 4, time**3 / 3], [time**3 / 3, time**2]])
    return move @ x, move @ covariance @ move.T + np.kron(block, np.eye(2))


def updated(x: Any, covariance: Any, z: Any, h: Any, noise: Any) -> tuple[Any, Any, float, float]:
    """State and covariance after a measurement, its squared distance, and half the logarithm of |2 pi S|."""
    s = h @ covariance @ h.T + noise
    gap, gain = z - h @ x, covariance @ h.T @ np.linalg.inv(s)
    nis = float(gap @ np.linalg.inv(s) @ gap)
    return x + gain @ gap, covariance - gain @ h @ covariance, nis, 0.5 * float(np.log(np.linalg.det(2.0 * np.pi * s)))


def leaves(node: Node) -> list[Node]:
    return [leaf for child in node["below"] for leaf in leaves(child)] if node["below"] else [node]


def children(leaf: Node, plots: Any, time: float, reports: list[Any], rules: dict[str, float]) -> list[Node]:
    """Every way to give measurements of a look to a leaf. Args: reports: (number, age, mmsi, four-vector, variance)."""
    detection, clutter, foreign = rules["detection"], rules["clutter"] + NEW, rules["foreign"]

    def child(x: Any, covariance: Any, step: float, used: tuple[Any, ...], mmsi: Any) -> Node:
        score, life = leaf["score"] + step, leaf["life"] + step
        return {
            **leaf,
            "x": x,
            "P": covariance,
            "step": step,
            "score": score,
            "life": life,
            "used": used,
            "mmsi": mmsi,
            "below": [],
        }

    def with_plots(x: Any, covariance: Any, used: tuple[Any, ...], mmsi: Any, before: float | None) -> list[Node]:
        out = []
        near = np.flatnonzero(np.hypot(*(plots - x[:2]).T) < np.sqrt(GATE * (np.trace(covariance[:2, :2]) + 2 * SIGMA2)))
        for k in near.tolist():
            after, less, nis, volume = updated(x, covariance, plots[k], H, SIGMA2 * np.eye(2))
            if nis <= GATE:
                step = 0.5 * nis + np.log(clutter / detection) + volume
                out.append(child(after, less, step if before is None else 0.5 * (before + step), (*used, ("plot", k)), mmsi))
        return out

    x, covariance = predicted(leaf["x"], leaf["P"], time)
    out = [child(x, covariance, -np.log(1.0 - detection), (), leaf["mmsi"])]
    out += with_plots(x, covariance, (), leaf["mmsi"], None)
    for number, age, mmsi, z, variance in reports:
        if leaf["mmsi"] in (None, mmsi):
            at = predicted(leaf["x"], leaf["P"], time - age)
            x, covariance, nis, volume = updated(*at, z, np.eye(4), variance * np.eye(4))
            if nis <= REPORT_GATE:
                x, covariance = predicted(x, covariance, age)
                step, used = 0.5 * nis + np.log(foreign) + volume, (("report", number),)
                fused = with_plots(x, covariance, used, mmsi, step)
                out += fused or [child(x, covariance, step, used, mmsi)]
    return out


def paths(node: Node, before: tuple[Any, ...] = ()) -> list[tuple[Node, tuple[Any, ...], float]]:
    """Every leaf with what its path below the root took, by look, and its score there."""
    if not node["below"]:
        return [(node, before, 0.0)]
    out = []
    for child in node["below"]:
        out += [(leaf, path, score + child["step"]) for leaf, path, score in paths(child, (*before, child["used"]))]
    return out


def best_choice(trees: list[Node]) -> list[tuple[Node, tuple[Any, ...], float]]:
    """The path of each tree of the least total score, nothing taken twice, (4.21) to (4.23)."""
    every = [(k, *path) for k, tree in enumerate(trees) for path in paths(tree)]
    cost, names = np.array([path[3] for path in every]), {}
    one_each, at_most_once = np.zeros((len(trees), len(every))), []
    for column, (k, _, path, _) in enumerate(every):
        one_each[k, column] = 1.0
        for look, used in enumerate(path):
            for what in used:
                row = names.setdefault((look - len(path), what), len(names))
                at_most_once.append((row, column))
    shared = np.zeros((max(len(names), 1), len(every)))
    shared[tuple(np.array(at_most_once, int).reshape(-1, 2).T)] = 1.0
    shared = shared[shared.sum(axis=1) > 1.0]
    rules = [LinearConstraint(one_each, 1.0, 1.0)] + ([LinearConstraint(shared, -np.inf, 1.0)] if len(shared) else [])
    found = milp(cost, constraints=rules, integrality=np.ones(len(every)), bounds=(0.0, 1.0), options={"mip_rel_gap": 0.0})
    return [every[column][1:] for column in np.flatnonzero(found.x > 0.5)]


def look(
    trees: list[Node], plots: Any, time: float, reports: list[Any], rules: dict[str, float], window: int
) -> tuple[list[Node], dict[int, Any]]:
    """The trees after a look, and by tree the state and newest measurements of the chosen leaf."""
    for tree in trees:
        for leaf in leaves(tree):
            leaf["below"] = children(leaf, plots, time, reports, rules)
    after, chosen = [], {}
    for tree, (leaf, path, score) in zip(trees, best_choice(trees), strict=True):
        miss = -np.log(1.0 - rules["detection"])
        gone = np.hypot(*(leaf["x"][:2])) > rules["range"]
        if gone or score / (window + 1) > END_SHARE * miss or leaf["life"] > END_SCORE:
            continue
        chosen[tree["number"]] = leaf["x"], path[-1]
        if len(path) > window:  # the child of the root on the path becomes the root
            tree = next(c for c in tree["below"] if any(x is leaf for x in leaves(c)))
        after.append(tree)
    return after, chosen
