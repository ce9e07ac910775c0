"""Rows of the table of `make bench`, read from what each part says in JSON."""

from __future__ import annotations

from typing import Any, NamedTuple

from coastwatch.scenario import load_scenario

BESIDES = ("store", "scores", "checkpoint")  # stages that are not compute
HEADS = "part", "what", "ours", "of the period", "quality", "beside it", "takes", "quality", "ratio"
STAGE = "stage"  # the part of rows that are too many for a README
BASELINE, OURS = "test_baseline_", "test_ours"


class Row(NamedTuple):
    """One line; what does not apply is empty."""

    part: str
    what: str
    ours: str
    of_period: str = ""
    quality: str = ""
    beside: str = ""
    takes: str = ""
    its_quality: str = ""
    ratio: str = ""


def of_stages(found: dict[str, Any]) -> list[Row]:
    """Rows of `scaling.load.stages --json`: the stages of each scenario, and the sum of those that compute."""
    rows = []
    for name, stages in found.items():
        period_s = load_scenario(name).period_s
        medians = {stage: t["median"] for stage, t in stages.items()}
        compute_s = sum(s for stage, s in medians.items() if stage not in BESIDES)
        rows += [Row(STAGE, f"{name}: {k}", _ms(s), _percent(s / period_s)) for k, s in medians.items()]
        rows.append(Row("stages", f"{name}: compute, the sum", _ms(compute_s), _percent(compute_s / period_s)))
    return rows


def of_cycle(found: dict[str, Any]) -> list[Row]:
    """Rows of `scaling.load.cycle --json`: compute, the whole cycle where it is stored, memory."""
    size, compute, whole = f"{found['tracks']:,} tracks", found["compute_s"], found["cycle_s"]
    f1 = f"F1 {100.0 * found['decisions']['all']['f1']:.3f} %"
    rows = [Row("load", f"{size}: compute", _ms(compute["median"]), _percent(compute["share_of_period"]), f1)]
    if found["store"] != "none":
        written = f"{found['rows_written']:,.0f} rows"
        what = f"{size}: whole cycle, {found['store']}"
        rows.append(Row("load", what, _ms(whole["median"]), _percent(whole["share_of_period"]), written))
    return [*rows, Row("load", f"{size}: peak memory", f"{found['memory_mib']['peak']:.0f} MiB")]


def of_peers(found: dict[str, Any]) -> list[Row]:
    """Rows of `scaling.peers.run --json`."""
    return [
        Row(
            "peers",
            f"{r['task']}, {r['tracks']:,} tracks",
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


def of_kernels(found: dict[str, Any]) -> list[Row]:
    """Rows of the JSON of pytest-benchmark: every way that is ours beside the baseline of its group, by least time a row."""
    rows, groups = [], {}
    for one in found["benchmarks"]:
        groups.setdefault(one["group"], {})[one["name"]] = one["stats"]["min"] / one["extra_info"]["rows"]
    for group, times in groups.items():
        ((plain, plain_s),) = ((name, s) for name, s in times.items() if name.startswith(BASELINE))
        for name, s in times.items():
            if name.startswith(OURS):
                way = name.removeprefix(OURS).strip("_")
                what = f"{group}, {way}" if way else group
                beside = plain.removeprefix(BASELINE)
                rows.append(Row("kernels", what, _us(s), "", "", beside, _us(plain_s), "", _times(plain_s / s)))
    return rows


def _ms(seconds: float) -> str:
    return f"{1e3 * seconds:.2f} ms"


def _us(seconds: float) -> str:
    return f"{_figures(1e6 * seconds)} us each"


def _percent(share: float) -> str:
    return f"{100.0 * share:.2f} %"


def _times(ratio: float) -> str:
    return f"{_figures(ratio)} x"


def _figures(value: float) -> str:
    """Three of them, without an exponent."""
    return f"{value:,.0f}" if value >= 100.0 else f"{value:.3g}"
