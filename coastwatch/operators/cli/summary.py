"""The result of a run as one JSON object, or as text for a terminal."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from coastwatch.operators.cli.inputs import (
    accounts_as_lines,
    accounts_as_object,
    contents_as_lines,
    contents_as_objects,
    warnings,
)
from coastwatch.spelling import json_value

PERCENT = ("f1", "precision", "recall", "accuracy", "specificity")
INPUTS = (
    ("ais", "AIS table"),
    ("nmea", "NMEA file"),
    ("files", "AIS file"),
    ("plots", "table of plots"),
    ("bearings", "table of bearings"),
    ("tracks", "table of tracks"),
    ("track_sentences", "file of targets"),
)
COUNTS = ("tp", "fn", "fp", "tn")


def as_object(scenario: Any, result: Any) -> dict[str, Any]:
    """The result as plain values for JSON. A number that is not finite becomes null."""
    plain: dict[str, Any] = json_value(
        {
            "scenario": result.scenario,
            "run_id": result.run_id,
            "seed": result.seed,
            "version": result.version,
            "vessels": result.vessels,
            "cycles": result.cycles,
            "period_s": scenario.period_s,
            "elapsed_s": result.elapsed_s,
            "interrupted": result.interrupted,
            "scores": result.scores,
            "timings_s": result.timings_s,
            "faults": [{"kind": f.kind, "count": f.count, "where": f.where, "example": f.example} for f in result.faults],
            "files": contents_as_objects(result.contents),
            "records": accounts_as_object(result),
            "warnings": warnings(scenario, result),
            "database": result.database,
        }
    )
    return plain


def as_text(scenario: Any, result: Any) -> str:
    """The summary of a run in lines."""
    lines = [
        f"{scenario.name}: {scenario.title}",
        f"run {result.run_id}: {result.vessels} vessels in the picture after {result.cycles} cycles of {scenario.period_s:g} s, "
        f"computed in {result.elapsed_s:.1f} s",
        f"sources: {_sources(scenario)}",
        *contents_as_lines(result.contents),
        *accounts_as_lines(result),
        *_scores(json_value(result.scores), _why_unbound(scenario)),
        *_timings(json_value(result.timings_s), scenario.period_s),
        *_faults(result.faults),
        f"database: {result.database}",
        *_next(result),
    ]
    return "\n".join(lines)


def _sources(scenario: Any) -> str:
    parts = [
        (len(scenario.radars), "radar", f" in {len({r.region for r in scenario.radars})} region(s)"),
        (len(scenario.stations), "AIS station", ""),
        (len(scenario.sonars), "bearing sensor", ""),
        *((len(files), name, "") for key, name in INPUTS if isinstance(files := getattr(scenario.input, key, ()), tuple)),
    ]
    return ", ".join(f"{n} {_several(name) if n > 1 else name}{rest}" for n, name, rest in parts if n) or "none"


def _several(name: str) -> str:
    first, of, rest = name.partition(" of ")
    return f"{first}s{of}{rest}"


def _why_unbound(scenario: Any) -> str:
    """Why vessels have no bound: what in the scenario moves them as no exact filter can follow; empty: nothing does."""
    lanes, motion = getattr(scenario.input, "lanes", None), getattr(scenario.input, "motion", None)
    why = ("lanes sway", getattr(lanes, "share", 0.0)), ("vessels brake", getattr(motion, "stopping_share", 0.0))
    return " and ".join(said for said, share in why if share)


def _scores(scores: Mapping[str, Any], why_unbound: str) -> Iterator[str]:
    if not scores:
        yield "scores: none (no truth in this input)"
        return
    yield "scores"
    for stage, values in scores.items():
        if isinstance(values, Mapping):
            shown = _fusion_score(values, why_unbound) if "position_rmse_m" in values else _shares(values)
            yield f"  {stage:<22} {', '.join(shown) or 'nothing to score'}"
        elif values is not None:
            yield f"  {stage:<22} {_figure(stage, values)}"


def _shares(values: Mapping[str, Any]) -> Iterator[str]:
    """Shares as percentages, then the other figures by name, then the counts of decisions."""
    for key in PERCENT:
        if values.get(key) is not None:
            yield f"{'F1' if key == 'f1' else key} {100.0 * values[key]:.3f} %"
    for key, value in values.items():
        if key not in PERCENT and key not in COUNTS and value is not None and not isinstance(value, Mapping | list):
            yield f"{'MCC' if key == 'mcc' else key.replace('_', ' ')} {_figure(key, value)}"
    counts = [f"{key} {values[key]}" for key in COUNTS if values.get(key) is not None]
    if counts:
        yield " ".join(counts)


def _fusion_score(values: Mapping[str, Any], why_unbound: str) -> Iterator[str]:
    """Args: why_unbound: why vessels may have no bound; empty: all have one, or the input has none at all."""
    position, bound = values.get("position_rmse_m"), values.get("bound_position_rmse_m")
    if position is not None:
        has_bound = values.get("bound_count", 0) / max(values.get("count", 0), 1)
        against = f" ({position / bound:.2f} x the bound of {bound:.2f} m)" if bound else ""
        if bound and has_bound < 1.0:
            against = (
                f" (bound of {100.0 * has_bound:.0f} % of the vessels: {bound:.2f} m; the others have none: {why_unbound})"
            )
        elif not bound and why_unbound:
            against = f" (no bound: {why_unbound})"
        yield f"position RMSE {position:.2f} m{against}"
    for key, name, unit in (("course_rmse_deg", "course", "deg"), ("speed_rmse_kn", "speed", "kn")):
        if values.get(key) is not None:
            yield f"{name} {values[key]:.2f} {unit}"
    alone = [(n, values.get(f"{key}_position_rmse_m")) for key, n in (("radar", "radar"), ("ais", "AIS"))]
    if any(rmse is not None for _, rmse in alone):
        yield "alone: " + ", ".join(f"{name} {rmse:.2f} m" for name, rmse in alone if rmse is not None)


def _figure(key: str, value: Any) -> str:
    if isinstance(value, float):
        share = key.endswith(("_rate", "_share", "recall", "precision", "coverage"))
        return f"{100.0 * value:.2f} %" if share else f"{value:.4g}"
    return str(value)


def _timings(timings_s: Mapping[str, Any], period_s: float) -> Iterator[str]:
    if not timings_s:
        return
    yield f"time of a cycle{'':<10} median ms    p99 ms   of all stages   of the {period_s:g} s period"
    for stage, t in timings_s.items():
        share, of_period = 100.0 * t["share"], 100.0 * t["median"] / period_s
        yield f"  {stage:<22} {1e3 * t['median']:>10.2f} {1e3 * t['p99']:>9.2f} {share:>13.1f} % {of_period:>17.3f} %"
    median = sum(t["median"] for t in timings_s.values())
    yield f"  {'sum of medians':<22} {1e3 * median:>10.2f} {'':>9} {'':>13}   {100.0 * median / period_s:>17.3f} %"


def _faults(faults: Any) -> Iterator[str]:
    if faults:
        yield "records refused, dropped or not used, and lost workers, by kind, with the first of each"
        for f in faults:
            yield f"  {f.count:>8} x {f.kind}: {f.where}" + (f": {f.example}" if f.example else "")


def _next(result: Any) -> Iterator[str]:
    db = f"--db {result.database}"
    yield "next, for instance"
    yield f"  coastwatch picture {db}"
    yield f"  coastwatch plot {db} --output picture.png"
    yield f"  coastwatch query {db}"
