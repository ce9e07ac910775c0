"""One table of speed and quality: `make bench`, or `python -m scaling.bench [--part NAME] [--folder FOLDER]`.

Each part is a command that prints JSON. A part that fails or is missing becomes a sentence under the table.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import textwrap
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

from coastwatch.scenario import load_scenario
from coastwatch.server.timing import date_utc, machine
from scaling.load import national
from scaling.load.stages import NOT_COMPUTE

CHECKOUT = Path(__file__).parents[1]
RESULTS = CHECKOUT / "scaling" / "results"
PACKAGES = "numpy", "scipy", "numba", "scikit-learn", "sqlalchemy"
SCENARIO = "context-driven-1000"
KERNELS = "scaling/kernels", "--benchmark-only", "--benchmark-timer=time.process_time", "-q", "-o", "python_files=bench_*.py"
TIMEOUT_S = 600.0
CONDITIONS = (
    "Stages and load: median wall time per cycle. Peers: median processor time per cycle. Kernels: least processor time per row",
    f"Load: {national.conditions({})}; chain: the coast of scaling.load.chain",
    f"Stages: {SCENARIO} as shipped; peers: default settings of Coastwatch",
)
HEADS = "part", "what", "ours", "of the period", "quality", "beside it", "takes", "quality", "ratio"
CHAIN_PERIOD_S = 3.0
STAGE = "stage"  # the part of single stages, which the Markdown table leaves out
BASELINE, OURS = "test_baseline_", "test_ours"


class Row(NamedTuple):
    """One row of the table; a cell that does not apply is empty."""

    part: str
    what: str
    ours: str
    of_period: str = ""
    quality: str = ""
    beside: str = ""
    takes: str = ""
    its_quality: str = ""
    ratio: str = ""


class Part(NamedTuple):
    """A command, and the function that reads rows from its JSON."""

    name: str
    module: str
    options: tuple[str, ...]
    read: Callable[[Any], list[Row]]


def stage_rows(found: dict[str, Any]) -> list[Row]:
    """Rows of `scaling.load.stages --json`: the stages of each scenario, and the sum of the compute stages."""
    rows = []
    for name, stages in found.items():
        period_s = load_scenario(name).period_s
        medians = {stage: t["median"] for stage, t in stages.items()}
        compute_s = sum(s for stage, s in medians.items() if stage not in NOT_COMPUTE)
        rows += [Row(STAGE, f"{name}: {k}", _ms(s), _percent(s / period_s)) for k, s in medians.items()]
        rows.append(Row("stages", f"{name}: compute, the sum", _ms(compute_s), _percent(compute_s / period_s)))
    return rows


def cycle_rows(found: dict[str, Any]) -> list[Row]:
    """Rows of `scaling.load.cycle --json`: compute, the whole cycle if it is stored, memory."""
    size, compute, whole = f"{found['tracks']:,} tracks", found["compute_s"], found["cycle_s"]
    f1 = f"F1 {100.0 * found['decisions']['all']['f1']:.3f} %"
    rows = [Row("load", f"{size}: compute", _ms(compute["median"]), _percent(compute["share_of_period"]), f1)]
    if found["store"] != "none":
        written = f"{found['rows_written']:,.0f} rows"
        what = f"{size}: whole cycle, {found['store']}"
        rows.append(Row("load", what, _ms(whole["median"]), _percent(whole["share_of_period"]), written))
    return [*rows, Row("load", f"{size}: peak memory", f"{found['memory_mib']['peak']:.0f} MiB")]


def chain_rows(found: dict[str, Any]) -> list[Row]:
    """Rows of `scaling.load.chain --json`: compute and its largest stages, the whole cycle if it is stored, memory."""
    size, compute, whole, quality = (
        f"{found['load']['vessels']:,} vessels",
        found["compute_s"],
        found["cycle_s"],
        found["quality"],
    )
    tracks = quality["tracks"]
    good = f"F1 {100.0 * quality['associations']['f1']:.3f} %, completeness {tracks['completeness']:.4f}"
    rows = [Row("chain", f"{size}: compute", _ms(compute["median"]), _percent(compute["share_of_period"]), good)]
    computed = {stage: t["median"] for stage, t in found["stages_s"].items() if t["share"] is not None}
    rows += [Row(STAGE, f"{size}: {stage}", _ms(s), _percent(s / CHAIN_PERIOD_S)) for stage, s in computed.items()]
    if found["store"] != "none":
        what = f"{size}: whole cycle, {found['store']}"
        written = f"{found['rows_written']:,.0f} rows"
        rows.append(Row("chain", what, _ms(whole["median"]), _percent(whole["share_of_period"]), written))
    plots = f"{found['plots']:,.0f} plots a cycle"
    return [*rows, Row("chain", f"{size}: peak memory", f"{found['memory_mib']['peak']:.0f} MiB", "", plots)]


def peer_rows(found: dict[str, Any]) -> list[Row]:
    """Rows of `scaling.peers.run --json`."""
    return [
        Row(
            "peers",
            f"{r['task']}, {r['tracks']:,} {r['size_of']}",
            _ms(1e-3 * r["ours_ms"]),
            "",
            f"{r['figure']} {r['ours_quality']:.2f}",
            ", ".join(f"{package} {number}" for package, number in r["versions"].items()),
            _ms(1e-3 * r["peer_ms"]),
            f"{r['figure']} {r['peer_quality']:.2f}",
            _times(r["ratio"]),
        )
        for r in found["rows"]
    ]


def kernel_rows(found: dict[str, Any]) -> list[Row]:
    """Rows of the JSON of pytest-benchmark: each of our functions beside the baseline of its group, least time per row."""
    rows: list[Row] = []
    groups: dict[str, dict[str, float]] = {}
    for one in found["benchmarks"]:
        groups.setdefault(one["group"], {})[one["name"]] = one["stats"]["min"] / one["extra_info"]["rows"]
    for group, times in groups.items():
        ((baseline, baseline_s),) = ((name, s) for name, s in times.items() if name.startswith(BASELINE))
        for name, s in times.items():
            if name.startswith(OURS):
                variant = name.removeprefix(OURS).strip("_")
                what = f"{group}, {variant}" if variant else group
                package = baseline.removeprefix(BASELINE)
                rows.append(Row("kernels", what, _us(s), "", "", package, _us(baseline_s), "", _times(baseline_s / s)))
    return rows


PARTS = (
    Part("stages", "scaling.load.stages", (SCENARIO, "--json"), stage_rows),
    Part("load", "scaling.load.cycle", ("--tracks", "10000", "--store", "sqlite:///{folder}/load.db", "--json"), cycle_rows),
    Part("load", "scaling.load.cycle", ("--tracks", "100000", "--store", "sqlite:///{folder}/load.db", "--json"), cycle_rows),
    Part("chain", "scaling.load.chain", ("--vessels", "16000", "--json"), chain_rows),
    Part(
        "chain",
        "scaling.load.chain",
        ("--vessels", "100000", "--cycles", "8", "--store", "sqlite:///{folder}/chain.db", "--json"),
        chain_rows,
    ),
    Part("peers", "scaling.peers.run", ("--json",), peer_rows),
    Part("kernels", "pytest", (*KERNELS, "--benchmark-json={folder}/kernels.json"), kernel_rows),
)


def measure(part: Part) -> tuple[list[Row], list[str]]:
    """The rows of a part, and a sentence for each failure."""
    title = " ".join(["python", "-m", part.module, *part.options])
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", part.module, *(option.format(folder=folder) for option in part.options)]
        try:
            done = subprocess.run(command, cwd=CHECKOUT, capture_output=True, text=True, timeout=TIMEOUT_S, check=False)
        except subprocess.TimeoutExpired:
            return [], [f"{title}: not done after {TIMEOUT_S:.0f} s"]
        if done.returncode:
            return [], [f"{title}: {last_line(done.stderr or done.stdout)}"]
        file = Path(folder) / "kernels.json"
        try:
            found = json.loads(file.read_text("utf-8")) if file.exists() else last_object(done.stdout)
            return part.read(found), found.get("missing", [])
        except (KeyError, ValueError) as error:
            return [], [f"{title}: its output cannot be read: {type(error).__name__} {error}"]


def last_object(text: str) -> Any:
    """The last line that is a JSON object; other lines are comments. Raises: ValueError: there is none."""
    lines = [line for line in text.splitlines() if line.startswith("{")]
    if not lines:
        raise ValueError(f"got {text[:200]!r}, needed a line with a JSON object")
    return json.loads(lines[-1])


def last_line(text: str) -> str:
    """The last line that is not blank."""
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    return lines[-1] if lines else "no output"


def heading() -> list[str]:
    """Machine and date, versions, conditions."""
    m = machine()
    versions = ", ".join(f"{p} {version(p)}" for p in ("coastwatch", *PACKAGES))
    return [
        f"{m['processor']}, {m['processors']} processors, {m['system']}, load {m['load']} at the start, {date_utc()}",
        f"Python {m['python']}, {versions}",
        *CONDITIONS,
    ]


def as_text(heading: list[str], rows: list[Row], missing: list[str]) -> str:
    """The table for a terminal."""
    cells = [HEADS, *rows]
    widths = [max(len(row[k]) for row in cells) for k in range(len(HEADS))]
    body = ["  ".join(cell.ljust(w) for cell, w in zip(row, widths, strict=True)).rstrip() for row in cells]
    return "\n".join([*(f"# {line}" for line in ["make bench", *heading]), *body, *(f"# {line}" for line in missing)]) + "\n"


def as_markdown(heading: list[str], rows: list[Row], missing: list[str]) -> str:
    """The table in Markdown, without the single stages."""
    lines = ["| " + " | ".join(row) + " |" for row in (HEADS, *(row for row in rows if row.part != STAGE))]
    lines.insert(1, "|---" * len(HEADS) + "|")
    said = [
        part for line in heading for part in textwrap.wrap(f"- {line}.", 120, subsequent_indent="  ", break_on_hyphens=False)
    ]
    return "\n".join(["`make bench`:", "", *said, "", *lines, *(f"\n{line}" for line in missing)]) + "\n"


def _ms(seconds: float) -> str:
    return f"{1e3 * seconds:.2f} ms"


def _us(seconds: float) -> str:
    return f"{_figures(1e6 * seconds)} us each"


def _percent(share: float) -> str:
    return f"{100.0 * share:.2f} %"


def _times(ratio: float) -> str:
    return f"{_figures(ratio)} x"


def _figures(value: float) -> str:
    """A number with three significant figures, without an exponent."""
    return f"{value:,.0f}" if value >= 100.0 else f"{value:.3g}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--part", action="append", choices=sorted({p.name for p in PARTS}), help="only this one; repeatable")
    parser.add_argument("--folder", type=Path, default=RESULTS, help="where bench.txt and bench.md are written")
    options = parser.parse_args()
    top, rows, missing = heading(), [], []
    for part in PARTS:
        if not options.part or part.name in options.part:
            print(f"{part.name}: {part.module} {' '.join(part.options)}", file=sys.stderr, flush=True)
            part_rows, failures = measure(part)
            rows += part_rows
            missing += failures
    text = as_text(top, rows, missing)
    (options.folder / "bench.txt").write_text(text, "utf-8")
    (options.folder / "bench.md").write_text(as_markdown(top, rows, missing), "utf-8")
    print(text, end="")


if __name__ == "__main__":
    main()
