"""How the cost of a cycle grows with the number of tracks; each size runs in a process of its own:

python -m scaling.load.ramp --from 1000 --to 1000000 [--cycles C] [--workers W] [--set KEY=VALUE ...] [--json]
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from coastwatch.operators.cli.arguments import count
from scaling.load.baseline import CHECKOUT, figures
from scaling.load.cycle import heading
from scaling.load.options import as_arguments, errors_as_one_line, load_parser
from scaling.load.progress import report_progress

FIT_FROM = 10_000  # tracks; at fewer, constant costs dominate
COSTS = ("compute_s", "compute_cpu_s")


def sizes(first: int, last: int, per_decade: int) -> list[int]:
    """Numbers of tracks from the first to the last, evenly spaced in their logarithm."""
    steps = max(round(per_decade * float(np.log10(last / first))), 1)
    return [round(first * (last / first) ** (k / steps)) for k in range(steps + 1)]


def exponent(costs: Sequence[tuple[float, float | None]]) -> float | None:
    """The power of a size with which a cost grows: least squares in the logarithms. Args: costs: size and cost of each run.

    None of fewer than two, or where one has no cost.
    """
    known = [(size, cost) for size, cost in costs if cost is not None]
    if len(known) < max(len(costs), 2):
        return None
    sizes, seconds = np.log(known).T
    return float(np.polyfit(sizes, seconds, 1)[0])


def exponents(
    runs: Sequence[dict[str, Any]], size_of: Callable[[dict[str, Any]], float], stages: str, fit_from: int = 1
) -> dict[str, Any]:
    """Exponents of each cost and stage: over all sizes from `fit_from`, and between one size and the next.

    None where one of the sizes has no such stage. Args: size_of: a run by its figures; stages: key of the seconds of its stages.
    """
    out: dict[str, Any] = {"exponent": {}, "local": {}}
    for name in (*COSTS, *(f"{stages}.{stage}" for stage in runs[-1][stages])):
        costs = [(size_of(f), cost_of(f, name)) for f in runs]
        out["exponent"][name] = exponent([one for one in costs if one[0] >= fit_from])
        out["local"][name] = [exponent(two) for two in pairwise(costs)]
    return out


def cost_of(figures: dict[str, Any], name: str) -> float | None:
    """A cost by its name in the figures of a run, a stage with its group and a dot before it; the median where there is one.

    None: this run had no such stage.
    """
    group, _, stage = name.partition(".")
    found = figures[group].get(stage) if stage else figures[group]
    return None if found is None else max(float(found["median"] if isinstance(found, dict) else found), 1e-6)


def text(runs: Sequence[dict[str, Any]], fitted: dict[str, Any]) -> str:
    """Sizes and exponents as tables for people."""
    heads = "tracks", "compute ms", "p99 ms", "cpu ms", "of period %", "pairs", "peak MiB", "F1 %", "exponent"
    lines = [*heading(runs[0]), "".join(f"{head:>12}" for head in heads)]
    local = [None, *fitted["local"]["compute_s"]]
    for f, power in zip(runs, local, strict=True):
        compute, decisions = f["compute_s"], f["decisions"]["all"]
        row = f"{f['tracks']:12d}{1e3 * compute['median']:12.1f}{1e3 * compute['p99']:12.1f}{1e3 * f['compute_cpu_s']:12.1f}"
        row += f"{100 * compute['share_of_period']:12.2f}{f['pairs_within_gate']:12d}{f['memory_mib']['peak']:12.0f}"
        lines.append(f"{row}{100 * decisions['f1']:12.3f}{_number(power):>12}")
    lines.append(f"exponent of cost against tracks, fitted from {fitted['fitted_from']} on:")
    lines += [f"  {name.removeprefix('stages_s.'):<24}{_number(power):>6}" for name, power in fitted["exponent"].items()]
    return "\n".join(lines)


def _number(power: float | None) -> str:
    return "-" if power is None else f"{power:.2f}"


def main() -> None:
    parser = load_parser(__doc__)
    parser.add_argument("--from", type=count, default=1000, dest="first", metavar="TRACKS")
    parser.add_argument("--to", type=count, default=1_000_000, dest="last", metavar="TRACKS")
    parser.add_argument("--a-decade", type=count, default=2, help="sizes per decade")
    parser.add_argument("--cycles", type=count, default=20)
    options = parser.parse_args()
    if options.first >= options.last:
        parser.error(f"--from, --to: got {options.first} and {options.last}, needed the first below the last")
    arguments = as_arguments(options, "cycles", "warmup", "workers", "store", "seed")
    wanted, runs = sizes(options.first, options.last, options.a_decade), []
    with errors_as_one_line(), report_progress("size") as progress:
        for k, tracks in enumerate(wanted):
            progress(k, len(wanted), f"{tracks} tracks")
            runs.append(figures(CHECKOUT, ["--tracks", str(tracks), *arguments]))
    fitted = {"fitted_from": FIT_FROM, **exponents(runs, lambda f: f["tracks"], "stages_s", FIT_FROM)}
    print(json.dumps({"sizes": runs, **fitted}) if options.json else text(runs, fitted))


if __name__ == "__main__":
    main()
