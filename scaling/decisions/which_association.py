"""Methods of association side by side: `python -m scaling.decisions.which_association OUTPUT [--seeds 1000-1099] [--workers 2]`.

The question: which method of association should be the default, and do the orderings of the thesis hold? The families of Sagild
give the tracks, with AIS every 12, 6, 3 s (`default`) and every 4, 2, 2 s (`fast`). All methods see the same tracks. OUTPUT is a folder
that keeps the record of each run, so a second call runs only what is missing. `--method NAME=JSON` adds a method to those of
`published.toml`; with null it leaves one out. `--summary` runs nothing. It prints rates of all runs together with jackknife standard
errors, paired differences to the method `--base`, and the verdicts on the orderings.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from coastwatch.batches import Floats
from coastwatch.reproduction.figures import Made, orders
from coastwatch.reproduction.planning import Wanted
from coastwatch.reproduction.published import Published, papers
from coastwatch.reproduction.side_by_side import SideBySide, measure
from coastwatch.scenario import load_scenario
from coastwatch.server.processes import over_processes
from scaling.load.seeds import seed_range

FAMILIES = "easy", "normal", "difficult", "very-difficult"
COUNTS = "tp", "fn", "fp", "tn", "waited_s", "vessels"
UNITS = "TPR, %", "FPR, 1e-5", "first, s"


class Job(NamedTuple):
    """One run of one family."""

    family: str
    variant: str
    settings: tuple[str, ...]
    seed: int
    asked: SideBySide


def run(job: Job) -> dict[str, Any]:
    """The counts of each method on the tracks of one run."""
    scenario = load_scenario(f"sagild-{job.family}", dict(pair.split("=", 1) for pair in job.settings))
    return measure(scenario, job.seed, job.asked)["pairs"]


def rates(counts: Floats) -> Floats:
    """TPR in %, FPR in 1e-5, time until the first right association in s. Args: counts: (6,) or (..., 6), as COUNTS. Returns: (..., 3)."""
    tp, fn, fp, tn, waited_s, vessels = np.moveaxis(counts, -1, 0)
    return np.stack([100.0 * tp / (tp + fn), 1e5 * fp / (fp + tn), waited_s / vessels], axis=-1)


def jackknife(counts: Sequence[Floats], figure: Callable[..., Floats]) -> tuple[Floats, Floats]:
    """A figure of the sums over runs, and its standard error. Args: counts: (R, 6) of each method, runs alike."""
    sums, runs = [one.sum(axis=0) for one in counts], len(counts[0])
    without = np.stack([figure(*(total - one[k] for total, one in zip(sums, counts, strict=True))) for k in range(runs)])
    error = np.sqrt((runs - 1) / runs * np.sum((without - without.mean(axis=0)) ** 2, axis=0))
    return figure(*sums), error


def show(records: Sequence[Mapping[str, Any]], base: str) -> None:
    """Print the rates of each method, and its differences to the base on the same runs."""
    named = {name: np.array([[one[name][key] for key in COUNTS] for one in records], np.float64) for name in records[0]}
    print(f"{'':<20}" + "".join(f"{unit:>20}" for unit in UNITS) + "   less that of " + base + "; ratio of FPR")
    for name, counts in named.items():
        mean, error = jackknife([counts], rates)
        apart, apart_error = jackknife([counts, named[base]], lambda one, other: rates(one) - rates(other))
        ratio, ratio_error = jackknife([counts, named[base]], lambda one, other: rates(one)[1:2] / rates(other)[1:2])
        line = "".join(f"{m:11.3f} +-{e:6.3f}" for m, e in zip(mean, error, strict=True))
        line += "".join(f"{m:10.3f} +-{e:6.3f}" for m, e in zip(apart, apart_error, strict=True))
        print(f"{name:<20}{line}   x{ratio[0]:6.3f} +-{ratio_error[0]:6.3f}", flush=True)


def show_orderings(of: Published, records: Mapping[str, Sequence[Mapping[str, Any]]]) -> None:
    """Print the verdict on each claim about the variants that were run."""
    made = [
        Made(Wanted(variant, (), variant.settings, ()), tuple({"scores": {"pairs": one}} for one in records[variant.name]))
        for variant in of.variant
        if variant.name in records
    ]
    for one in orders(of, made):
        print(f"  {one.ordering.title}: {one.verdict}: {one.difference.mean:.3g} +- {one.error:.2g}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("output", type=Path)
    parser.add_argument("--seeds", default="1000-1099", help="first-last")
    parser.add_argument("--family", action="append", default=[], choices=FAMILIES)
    parser.add_argument("--variant", action="append", default=[], choices=("default", "fast"))
    parser.add_argument("--method", action="append", default=[], metavar="NAME=JSON")
    parser.add_argument("--only-given", action="store_true", help="leave out the methods of published.toml")
    parser.add_argument("--base", default="test 0.01")
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--summary", action="store_true")
    asked = parser.parse_args()
    asked.output.mkdir(parents=True, exist_ok=True)
    published = papers()["sagild"]
    given = {name: json.loads(value) for name, value in (pair.split("=", 1) for pair in asked.method)}
    files: dict[tuple[str, str, int], Path] = {}
    jobs = []
    for seed in seed_range(asked.seeds):
        for family in asked.family or FAMILIES:
            of = published[f"sagild-{family}"]
            assert of.side_by_side is not None
            known = {} if asked.only_given else of.side_by_side.associations
            wanted = {name: one for name, one in {**known, **given}.items() if one}
            side_by_side = SideBySide.model_validate({"associations": wanted, "fused_tracks": {}})
            for variant in of.variant:
                if asked.variant and variant.name not in asked.variant:
                    continue
                path = asked.output / f"{family}-{variant.name}-{seed}.json"
                files[family, variant.name, seed] = path
                if not path.exists():
                    jobs.append(Job(family, variant.name, variant.settings, seed, side_by_side))
    for job, record in over_processes(run, () if asked.summary else jobs, asked.workers):
        files[job.family, job.variant, job.seed].write_text(json.dumps(record), "utf-8")
    for family in asked.family or FAMILIES:
        found: dict[str, list[dict[str, Any]]] = {}
        for (of_family, variant_name, _), path in files.items():
            if of_family == family and path.exists():
                found.setdefault(variant_name, []).append(json.loads(path.read_text("utf-8")))
        for variant_name, records in found.items():
            print(f"\n{family}, {variant_name}: {len(records)} runs")
            show(records, asked.base if asked.base in records[0] else next(iter(records[0])))
        show_orderings(published[f"sagild-{family}"], found)


if __name__ == "__main__":
    main()
