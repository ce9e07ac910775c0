"""How the cost of a cycle grows with the number of tracks, each size in a process of its own:

python -m scaling.load.ramp --from 1000 --to 1000000 [--cycles C] [--workers W] [--set KEY=VALUE ...] [--json]
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from coastwatch.operators.cli.arguments import count
from coastwatch.operators.cli.progress import shown
from scaling.load.command import arguments, one_sentence

FIT_FROM = 10_000  # below, what does not depend on the number of tracks is most of it
COSTS = ("compute_s", "compute_cpu_s")


def sizes(first: int, last: int, a_decade: int) -> list[int]:
    """Numbers of tracks from the first to the last, so many a decade, evenly in their logarithm."""
    steps = max(round(a_decade * float(np.log10(last / first))), 1)
    return [round(first * (last / first) ** (k / steps)) for k in range(steps + 1)]


def figures_of(tracks: int, passed: Sequence[str]) -> dict[str, Any]:
    """What `scaling.load.cycle` says of this size; where it ends with an error, so does this process. Args: passed: further arguments."""
    command = [sys.executable, "-m", "scaling.load.cycle", "--tracks", str(tracks), "--json", *passed]
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=False)
    if done.returncode:
        raise SystemExit(done.returncode)  # it has said why
    return dict(json.loads(done.stdout))


def exponent(tracks: Sequence[float], cost: Sequence[float]) -> float | None:
    """The power of the number of tracks with which a cost grows, by least squares in the logarithms; None of fewer than two."""
    if len(tracks) < 2:
        return None
    return float(np.polyfit(np.log(tracks), np.log(cost), 1)[0])


def summary(every: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Exponents of each cost and of each stage: from `FIT_FROM` tracks on, and between one size and the next."""
    large = [f for f in every if f["asked"]["tracks"] >= FIT_FROM]
    out: dict[str, Any] = {"fitted_from": FIT_FROM, "exponent": {}, "local": {}}
    names = [*COSTS, *(f"stages_s.{stage}" for stage in every[-1]["stages_s"])]
    for name in names:
        out["exponent"][name] = exponent([f["tracks"] for f in large], [_cost(f, name) for f in large])
        out["local"][name] = [exponent([f["tracks"] for f in two], [_cost(f, name) for f in two]) for two in pairwise(every)]
    return out


def _cost(figures: dict[str, Any], name: str) -> float:
    group, _, stage = name.partition(".")
    found = figures[group][stage] if stage else figures[group]
    return max(float(found["median"] if isinstance(found, dict) else found), 1e-6)


def text(every: Sequence[dict[str, Any]], fitted: dict[str, Any]) -> str:
    """Both as tables."""
    heads = "tracks", "compute ms", "p99 ms", "cpu ms", "of period %", "pairs", "peak MiB", "F1 %", "exponent"
    lines = ["".join(f"{head:>12}" for head in heads)]
    local = [None, *fitted["local"]["compute_s"]]
    for f, power in zip(every, local, strict=True):
        compute, all_ = f["compute_s"], f["decisions"]["all"]
        row = f"{f['tracks']:12d}{1e3 * compute['median']:12.1f}{1e3 * compute['p99']:12.1f}{1e3 * f['compute_cpu_s']:12.1f}"
        row += f"{100 * compute['share_of_period']:12.2f}{f['pairs_tested']:12d}{f['memory_mib']['peak']:12.0f}"
        lines.append(f"{row}{100 * all_['f1']:12.3f}{_number(power):>12}")
    lines.append(f"exponent of cost against tracks, fitted from {fitted['fitted_from']} on:")
    lines += [f"  {name.removeprefix('stages_s.'):<24}{_number(power):>6}" for name, power in fitted["exponent"].items()]
    return "\n".join(lines)


def _number(power: float | None) -> str:
    return "-" if power is None else f"{power:.2f}"


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--from", type=count, default=1000, dest="first", metavar="TRACKS")
    parser.add_argument("--to", type=count, default=1_000_000, dest="last", metavar="TRACKS")
    parser.add_argument("--a-decade", type=count, default=2, help="sizes a decade")
    parser.add_argument("--cycles", type=count, default=20)
    asked = parser.parse_args()
    if asked.first >= asked.last:
        parser.error(f"--from, --to: got {asked.first} and {asked.last}, needed the first below the last")
    names = ("cycles", "warmup", "workers", "store", "seed")
    passed = [part for name in names for part in (f"--{name}", str(getattr(asked, name)))]
    passed += [part for key, value in asked.set for part in ("--set", f"{key}={value}")]
    wanted, every = sizes(asked.first, asked.last, asked.a_decade), []
    with one_sentence(), shown("size") as say:
        for k, tracks in enumerate(wanted):
            say(k, len(wanted), f"{tracks} tracks")
            every.append(figures_of(tracks, passed))
    fitted = summary(every)
    print(json.dumps({"sizes": every, **fitted}) if asked.json else text(every, fitted))


if __name__ == "__main__":
    main()
