"""The result of a run as one JSON object, or as text for a terminal."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from coastwatch.operators.cli import inputs
from coastwatch.scenario import Scenario
from coastwatch.server.run import RunResult
from coastwatch.spelling import json_value

PERCENT = ("f1", "precision", "recall", "accuracy", "specificity")
INPUTS = {
    "ais": ("AIS table", "AIS tables"),
    "nmea": ("NMEA file", "NMEA files"),
    "files": ("AIS file", "AIS files"),
    "plots": ("table of plots", "tables of plots"),
    "bearings": ("table of bearings", "tables of bearings"),
    "tracks": ("table of tracks", "tables of tracks"),
    "track_sentences": ("file of targets", "files of targets"),
}
"""What the settings of an input name: one of them, several."""

COUNTS = ("tp", "fn", "fp", "tn")

Scores = Mapping[str, float | int | None]
"""The figures of a stage: not a number is None."""


def as_object(scenario: Scenario, result: RunResult) -> dict[str, object]:
    """The result as plain values for JSON. A number that is not finite becomes null."""
    plain: dict[str, object] = json_value(
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
            "files": inputs.contents_as_objects(result.contents),
            "records": inputs.accounts_as_object(result),
            "warnings": inputs.warnings(scenario, result),
            "database": result.database,
        }
    )
    return plain


def as_text(scenario: Scenario, result: RunResult) -> str:
    """The summary of a run in lines."""
    parts = [
        (len(scenario.radars), "radar", "radars", f" in {len({r.region for r in scenario.radars})} region(s)"),
        (len(scenario.stations), "AIS station", "AIS stations", ""),
        (len(scenario.sonars), "bearing sensor", "bearing sensors", ""),
        *(
            (len(files), *names, "")
            for key, names in INPUTS.items()
            if isinstance(files := getattr(scenario.input, key, ()), tuple)
        ),
    ]
    sources = ", ".join(f"{n} {several if n > 1 else one}{where}" for n, one, several, where in parts if n)
    lines = [
        f"{scenario.name}: {scenario.title}",
        f"run {result.run_id}: {result.vessels} vessels in the picture after {result.cycles} cycles of {scenario.period_s:g} s, "
        f"computed in {result.elapsed_s:.1f} s",
        f"sources: {sources or 'none'}",
        *inputs.contents_as_lines(result.contents),
        *inputs.accounts_as_lines(result),
        *_scores(scenario, json_value(result.scores)),
        *_timings(json_value(result.timings_s), scenario.period_s),
    ]
    if result.faults:
        lines.append("records refused, dropped or not used, and lost workers, by kind, with the first of each")
    lines += [f"  {f.count:>8} x {f.kind}: {f.first}" for f in result.faults]
    db = f"--db {result.database}"
    return "\n".join(
        [
            *lines,
            f"database: {result.database}",
            "next, for instance",
            f"  coastwatch picture {db}",
            f"  coastwatch plot {db} --output picture.png",
            f"  coastwatch query {db}",
        ]
    )


def _scores(scenario: Scenario, scores: Mapping[str, Scores | float | None]) -> Iterator[str]:
    if not scores:
        yield "scores: none (no truth in this input)"
        return
    lanes, motion = getattr(scenario.input, "lanes", None), getattr(scenario.input, "motion", None)
    unbound = ("lanes sway", getattr(lanes, "share", 0.0)), ("vessels brake", getattr(motion, "stopping_share", 0.0))
    why_unbound = " and ".join(reason for reason, is_so in unbound if is_so)  # no exact filter can follow such a vessel
    yield "scores"
    for stage, values in scores.items():
        if isinstance(values, Mapping):
            shown = _fusion_score(values, why_unbound) if "position_rmse_m" in values else _shares(values)
            yield f"  {stage:<22} {', '.join(shown) or 'nothing to score'}"
        elif values is not None:
            yield f"  {stage:<22} {_figure(stage, values)}"


def _shares(values: Scores) -> Iterator[str]:
    """Shares as percentages, then the other figures by name, then the counts of decisions."""
    for key in PERCENT:
        if (share := values.get(key)) is not None:
            yield f"{'F1' if key == 'f1' else key} {100.0 * share:.3f} %"
    for key, value in values.items():
        if key not in PERCENT and key not in COUNTS and value is not None and not isinstance(value, Mapping | list):
            yield f"{'MCC' if key == 'mcc' else key.replace('_', ' ')} {_figure(key, value)}"
    counts = [f"{key} {values[key]}" for key in COUNTS if values.get(key) is not None]
    if counts:
        yield " ".join(counts)


def _fusion_score(values: Scores, why_unbound: str) -> Iterator[str]:
    """Args: why_unbound: why vessels may have no bound; empty: all have one, or the input has none at all."""
    position, bound = values.get("position_rmse_m"), values.get("bound_position_rmse_m")
    if position is not None:
        has_bound = (values.get("bound_count") or 0) / max(values.get("count") or 0, 1)
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
    alone = {name: values.get(f"{key}_position_rmse_m") for key, name in (("radar", "radar"), ("ais", "AIS"))}
    if any(rmse is not None for rmse in alone.values()):
        yield "alone: " + ", ".join(f"{name} {rmse:.2f} m" for name, rmse in alone.items() if rmse is not None)


def _figure(key: str, value: object) -> str:
    if isinstance(value, float):
        is_share = key.endswith(("_rate", "_share", "recall", "precision", "coverage"))
        return f"{100.0 * value:.2f} %" if is_share else f"{value:.4g}"
    return str(value)


def _timings(timings_s: Mapping[str, Mapping[str, float]], period_s: float) -> Iterator[str]:
    if not timings_s:
        return
    yield f"time of a cycle{'':<10} median ms    p99 ms   of all stages   of the {period_s:g} s period"
    for stage, t in timings_s.items():
        percent, of_period = 100.0 * t["share"], 100.0 * t["median"] / period_s
        yield f"  {stage:<22} {1e3 * t['median']:>10.2f} {1e3 * t['p99']:>9.2f} {percent:>13.1f} % {of_period:>17.3f} %"
    median = sum(t["median"] for t in timings_s.values())
    yield f"  {'sum of medians':<22} {1e3 * median:>10.2f} {'':>9} {'':>13}   {100.0 * median / period_s:>17.3f} %"
