"""The plots of a report as data URIs, so that the page loads nothing."""

from __future__ import annotations

import base64
import io
from collections.abc import Callable, Mapping, Sequence

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from coastwatch.batches import Floats
from coastwatch.reproduction.figures import Made, Record, Spread, at, values
from coastwatch.reproduction.published import Published
from coastwatch.reproduction.trackers import picture_of

matplotlib.use("Agg")

LITERAL, OURS, BOUND, PUBLISHED, INK = "#b8442f", "#1f5fbf", "#7d8894", "#c99a2e", "#1d2733"
NOISE, SPOTS, VESSELS = "input.motion.process_noise_fraction", "spots.count", "input.count"
LEAST_RATE = 1e-6  # left end of a ROC curve
POINTS = 400  # of a ROC curve
ABOUT_5 = 5.0  # per cent of the time with one spot, 1000 vessels and 20 spots: section IV-C


def drawn(kind: str, of: Published, made: Sequence[Made]) -> list[tuple[str, str]]:
    """Data URI and caption of the plots of one kind; empty if their data are absent."""
    return KINDS[kind](of, made)


def picture(of: Published, made: Sequence[Made]) -> list[tuple[str, str]]:
    """The last picture of the first run that has one."""
    shown = [(r["seed"], r["picture"]["png"]) for one in made for r in one.records if r.get("picture")]
    return [(f"data:image/png;base64,{png}", f"The last picture of the run with seed {seed}.") for seed, png in shown[:1]]


def time_shares(of: Published, made: Sequence[Made]) -> list[tuple[str, str]]:
    """Time of the association by number of vessels and of spots, a panel each variant."""
    vessels, spots = (sorted({dict(one.wanted.point)[key] for one in made}, key=float) for key in (VESSELS, SPOTS))
    figure, panels = _panels(len(of.variant))
    for axes, variant in zip(panels, of.variant, strict=True):
        for k, count in enumerate(spots):
            shares = [100.0 * _share(made, variant.name, {VESSELS: n, SPOTS: count}) for n in vessels]
            place = np.arange(len(vessels)) + (k - 0.5 * (len(spots) - 1)) * 0.16
            bars = axes.bar(place, shares, 0.15, label=f"{count} spots", color=matplotlib.colormaps["Blues"](0.9 - 0.16 * k))
            axes.bar_label(bars, fmt="%.0f", fontsize=7, color=INK)
        axes.set_xticks(np.arange(len(vessels)), [f"{n} vessels" for n in vessels])
        axes.axhline(ABOUT_5, color=PUBLISHED, linewidth=1.2, linestyle="--", label="published, 1000 vessels, 20 spots")
        _label(axes, variant.title, "", "time of the association, % of that with one spot")
    return [(_uri(figure), "Share of the time of the association with one spot, mean over the runs.")]


def _share(made: Sequence[Made], variant: str, point: Mapping[str, float | int | str]) -> float:
    one, alone = at(made, variant, point), at(made, variant, {**point, SPOTS: 1})
    times = [values(x.records, "timings_s.associations.median") if x else () for x in (one, alone)]
    return float(np.mean([a / b for a, b in zip(*times, strict=False)])) if all(times) else 0.0


def noise(of: Published, made: Sequence[Made]) -> list[tuple[str, str]]:
    """Errors of the fused tracks over the process noise, beside the published ones."""
    fractions = sorted({float(dict(one.wanted.point)[NOISE]) for one in made})
    kinds = (("position", "m"), ("course", "deg"), ("speed", "kn"))
    figure, panels = _panels(len(kinds))
    for axes, (quantity, unit) in zip(panels, kinds, strict=True):
        name = f"{quantity}_rmse_{unit}"
        for variant in of.variant:
            found = [_spread(made, variant.name, f, f"fused_tracks.{name}") for f in fractions]
            style = "--" if variant.name.startswith("literal") else "-"
            _bars(axes, fractions, found, variant.title, style, OURS if variant.name == "default" else None)
        bounds = [_spread(made, of.variant[-1].name, f, f"fused_tracks.bound_{name}") for f in fractions]
        _bars(axes, fractions, bounds, "physical bound", ":", BOUND)
        for method, marker in (("Weighted Average", "s"), ("IMM Filter", "D")):
            points = [(f.at[NOISE], f.published) for f in of.figure if f.name.endswith(f"{method}, {quantity}") and f.published]
            axes.plot(*zip(*points, strict=True), marker, color=PUBLISHED, label=f"published, {method}")
        axes.set_ylim(bottom=0.0)
        axes.set_xticks(fractions)
        _label(axes, quantity, "process noise f, of the highest speed", f"RMSE, {unit}")
    return [(_uri(figure), "Errors of the fused tracks against the process noise; bars are one standard deviation of a run.")]


def _spread(made: Sequence[Made], variant: str, fraction: float, path: str) -> Spread:
    one = at(made, variant, {NOISE: fraction})
    return Spread(values(one.records, path) if one else ())


def _bars(axes: Axes, x: Sequence[float], found: Sequence[Spread], label: str, style: str, colour: str | None) -> None:
    axes.errorbar(
        x, [s.mean for s in found], np.nan_to_num([s.std for s in found]), label=label, linestyle=style, color=colour, capsize=3
    )


def history(of: Published, made: Sequence[Made]) -> list[tuple[str, str]]:
    """F1 of the decisions over the time since a cold start."""
    stage = "bearing_associations" if any("bearing" in f.path for f in of.figure) else "associations"
    figure, (axes,) = _panels(1)
    shades = iter((LITERAL, "#d98b6a", "#8a6f66"))
    for variant in (v for v in of.variant if not v.sweep):
        one = at(made, variant.name, {})
        found = [Spread(values(one.records, f"history.{t:g}.{stage}.f1")) for t in of.history_s] if one else []
        scaled = [Spread(tuple(100.0 * v for v in s.values)) for s in found]
        literal = variant.name.startswith("literal")
        _bars(axes, of.history_s, scaled, variant.title, "--" if literal else "-", next(shades, None) if literal else OURS)
    published = next((f.published for f in of.figure if f.name == "F1" and f.published), None)
    if published:
        axes.axhline(100.0 * published, color=PUBLISHED, linestyle=":", label="published, over two minutes")
    _label(axes, "F1 against the length of the history", "seconds after a cold start", "F1, %")
    return [(_uri(figure), "F1 of the decisions at that time after a cold start; bars are one standard deviation of a run.")]


def roc(of: Published, made: Sequence[Made]) -> list[tuple[str, str]]:
    """Rates of accepted pairs of the association test over all thresholds."""
    figure, (axes,) = _panels(1)
    for variant, colour in zip((v for v in of.variant if v.roc), (LITERAL, OURS, BOUND), strict=False):
        one = at(made, variant.name, {})
        scores = [r["roc"] for r in one.records if r.get("roc")] if one else []
        if scores and variant.roc:
            axes.plot(*roc_curve(scores), color=colour, label=variant.title)
            axes.plot(*accepted(scores, np.array([variant.roc.threshold])), "o", color=colour)
    axes.set_xscale("log")
    axes.set_xlim(0.7 * LEAST_RATE, 1.0)
    axes.set_ylim(-0.03, 1.03)
    _label(
        axes,
        "The test alone",
        "share of pairs of two vessels that are accepted",
        "share of pairs of one vessel that are accepted",
    )
    caption = (
        "ROC of the association test: every candidate pair, before any choice among partners, over all thresholds. A curve ends with the "
        "stored wrong pairs. A dot is the threshold of the method: a test can separate the pairs well and still have a threshold "
        "in the wrong place."
    )
    return [(_uri(figure), caption)]


def roc_curve(runs: Sequence[Record]) -> tuple[Floats, Floats]:
    """Share of wrong and of true pairs that are accepted, over thresholds.

    Args: runs: `true`, `wrong` scores, greatest first, of a run each, and the counts of all.
    """
    cut = max((run["wrong"][-1] for run in runs if len(run["wrong"]) < run["wrong_count"]), default=-np.inf)
    every = np.sort(np.concatenate([np.array(run[key], float) for run in runs for key in ("true", "wrong")]))[::-1]
    every = every[every >= cut]
    some = np.unique(np.linspace(0, max(len(every) - 1, 0), POINTS).astype(int))[: len(every)]
    return accepted(runs, every[some])


def accepted(runs: Sequence[Record], threshold: Floats) -> tuple[Floats, Floats]:
    """Share of wrong and of true pairs that are accepted at each threshold; the first at least LEAST_RATE, for a logarithmic axis."""
    shares = []
    for key in ("wrong", "true"):
        against = np.sort(-np.concatenate([np.array(run[key], float) for run in runs]))
        whole = max(sum(int(run[f"{key}_count"]) for run in runs), 1)
        shares.append(np.searchsorted(against, -threshold, side="right") / whole)
    return np.maximum(shares[0], LEAST_RATE), shares[1]


def convergence(of: Published, made: Sequence[Made]) -> list[tuple[str, str]]:
    """ANEES over the first n runs, at the first point of the sweeps."""
    figure, (axes,) = _panels(1)
    records = made[0].records
    for method, colour in zip(_fusions(records), (LITERAL, OURS, BOUND), strict=False):
        found = values(records, f"two_filters.{method}.anees")
        count = np.arange(1, len(found) + 1)
        axes.plot(count, np.cumsum(found) / count, color=colour, label=method.replace("_", " "))
        axes.axhline(values(records, f"two_filters.{method}.exact_anees")[0], color=colour, linestyle=":")
    _label(axes, "ANEES against the number of runs", "runs", "ANEES of position and velocity")
    return [(_uri(figure), "Mean over the first runs; dotted: exact. A consistent estimate has 4.")]


def anees(of: Published, made: Sequence[Made]) -> list[tuple[str, str]]:
    """ANEES over the sweep, with 95 % intervals from the scatter between runs."""
    figure, (axes,) = _panels(1)
    key = next(iter(of.sweep))
    places = [float(dict(one.wanted.point)[key]) for one in made]
    for method, colour in zip(_fusions(made[0].records), (LITERAL, OURS, BOUND), strict=False):
        found = [Spread(values(one.records, f"two_filters.{method}.anees")) for one in made]
        half = [1.96 * s.std / np.sqrt(len(s.values)) for s in found]
        axes.errorbar(
            places, [s.mean for s in found], np.nan_to_num(half), color=colour, capsize=3, label=method.replace("_", " ")
        )
        exact = [values(one.records, f"two_filters.{method}.exact_anees")[0] for one in made]
        axes.plot(places, exact, ":", color=colour)
    _label(axes, of.title, key.replace("_", " "), "ANEES of position and velocity")
    return [(_uri(figure), "Bars: 95 % interval of the mean, from the scatter between runs. Dotted: exact.")]


def targets(of: Published, made: Sequence[Made]) -> list[tuple[str, str]]:
    """Scores of tracks of few targets over the sweep, with standard errors."""
    key = next(iter(of.sweep), "")
    shown = ("ospa_m", "OSPA, m"), ("error_m", "TLE, m"), ("probability", "TPD"), ("false_tracks", "TFAR")
    figure, panels = _panels(len(shown))
    for axes, (name, title) in zip(panels, shown, strict=True):
        for k, variant in enumerate(of.variant):
            mine = [one for one in made if one.wanted.variant.name == variant.name]
            found = [Spread(values(one.records, f"targets.{name}")) for one in mine]
            _errors(axes, [float(dict(one.wanted.point)[key]) for one in mine], found, variant.title, f"C{k}")
        best = [one for one in made if one.wanted.variant.name == of.variant[-1].name]
        if name in ("ospa_m", "error_m"):
            found = [Spread(values(one.records, f"targets.genie_{name}")) for one in best]
            _errors(axes, [float(dict(one.wanted.point)[key]) for one in best], found, of.bound_name, BOUND)
        _label(axes, title, "detection probability", title)
    return [(_uri(figure), "Mean over the runs; bars are one standard error of it.")]


def steps(of: Published, made: Sequence[Made]) -> list[tuple[str, str]]:
    """OSPA at each turn of the radar at the middle of the sweep, with standard errors."""
    figure, (axes,) = _panels(1)
    key = next(iter(of.sweep), "")
    middle = sorted(of.sweep[key])[len(of.sweep[key]) // 2] if key else None
    for k, variant in enumerate(of.variant):
        one = at(made, variant.name, {key: middle} if middle is not None else {})
        runs = np.array([r["scores"]["targets"]["every_ospa_m"] for r in one.records]) if one else np.zeros((0, 0))
        if len(runs):
            mean, error = runs.mean(axis=0), runs.std(axis=0) / np.sqrt(len(runs))
            axes.plot(mean, color=f"C{k}", label=variant.title)
            axes.fill_between(np.arange(len(mean)), mean - error, mean + error, color=f"C{k}", alpha=0.2)
    _label(axes, f"OSPA over time{f' at {middle}' if key else ''}", "turn of the radar", "OSPA, m")
    return [(_uri(figure), "Mean over the runs; bands are one standard error of it.")]


def ospa(of: Published, made: Sequence[Made]) -> list[tuple[str, str]]:
    """OSPA of each tracker over time, a panel for each cut-off."""
    asked = of.trackers
    records = [record["scores"]["trackers"] for one in made for record in one.records]
    if asked is None or not records:
        return []
    figure, panels = _panels(len(asked.cutoffs_m))
    for axes, cutoff in zip(panels, asked.cutoffs_m, strict=True):
        for k, name in enumerate(["scenario", *asked.methods]):
            runs = [record[name]["ospa_over_time"][f"{cutoff:g}"] for record in records]
            at = sorted(set.intersection(*map(set, runs)), key=float)
            axes.plot(
                [float(t) + 0.5 * asked.every_s for t in at], [np.mean([r[t] for r in runs]) for t in at], f"C{k}", label=name
            )
        _label(axes, f"c = {cutoff:g} m", "time, s", "OSPA, m")
    return [(_uri(figure), f"OSPA of order 2 of each tracker over time: means over {asked.every_s:g} s and the runs.")]


def paths(of: Published, made: Sequence[Made]) -> list[tuple[str, str]]:
    """The true paths, and those of each tracker that is drawn, of plots over all of these; of the first run."""
    asked = of.trackers
    first = next((record for one in made for record in one.records), None)
    if asked is None or not asked.drawn or first is None:
        return []
    paths = first["scores"]["trackers"]["paths"]
    figure, panels = _panels(1 + len(asked.drawn))
    for axes, name in zip(panels, ("targets", *asked.drawn), strict=True):
        of_plots = name in asked.methods and not asked.methods[name].takes_video
        for of_what, colour, size in (("candidates", BOUND, 2.0), (name, OURS, 4.0))[0 if of_plots else 1 :]:
            points = np.array(paths[of_what]).reshape(-1, 2) / 1000.0
            axes.scatter(points[:, 0], points[:, 1], size, colour, linewidths=0.0, label=of_what)
        axes.set_aspect("equal")
        _label(axes, name, "east, km", "north, km")
    return [
        (
            _uri(figure),
            f"Paths of the run with seed {first['seed']}, a point each {asked.draw_every} turns; plots of all turns.",
        )
    ]


def scan(of: Published, made: Sequence[Made]) -> list[tuple[str, str]]:
    """A turn of the video of the first run, the same with its plots, and the particles at two stages."""
    first = next((record for one in made for record in one.records), None)
    kept = first["scores"]["trackers"] if first else {}
    if not first or "scan" not in kept:
        return []
    stages = [stage for stage in ("searching", "acquired") if stage in kept]
    figure, panels = _panels(2 + len(stages))
    reach = float(kept["scan"]["reach_m"]) / 1000.0
    for axes, marked in zip(panels[:2], (False, True), strict=True):
        axes.imshow(picture_of(kept["scan"]), cmap="magma", origin="lower", extent=(-reach, reach, -reach, reach))
        if marked:
            plots = np.array(kept["scan"]["candidates"]).reshape(-1, 2) / 1000.0
            axes.scatter(plots[:, 0], plots[:, 1], 60.0, facecolors="none", edgecolors=LITERAL, label="candidates")
        _label(axes, "a turn of the radar", "east, km", "north, km")
    for axes, stage in zip(panels[2:], stages, strict=True):
        for name, colour in (("acquired", LITERAL), ("searching", OURS)):
            particles = np.array(kept[stage][name]).reshape(-1, 2) / 1000.0
            axes.scatter(particles[:, 0], particles[:, 1], 2.0, colour, label=name)
        axes.set_xlim(-reach, reach)
        axes.set_ylim(-reach, reach)
        axes.set_aspect("equal")
        title = "the second filter searches" if stage == "searching" else "both have a vessel"
        _label(axes, title, "east, km", "north, km")
    return [(_uri(figure), f"Video over its background, and particles, of the run with seed {first['seed']}.")]


def _errors(axes: Axes, x: Sequence[float], found: Sequence[Spread], label: str, colour: str) -> None:
    """A curve with standard errors of the mean."""
    error = [s.std / np.sqrt(max(len(s.values), 1)) for s in found]
    axes.errorbar(x, [s.mean for s in found], np.nan_to_num(error), label=label, color=colour, capsize=3)


def pairs(of: Published, made: Sequence[Made]) -> list[tuple[str, str]]:
    """True positive rate, and time of the first right association, against false positive rate; a panel pair each variant."""
    figure, panels = _panels(2 * len(made))
    for one, (rates, times) in zip(made, zip(panels[::2], panels[1::2], strict=True), strict=True):
        for name in one.records[0]["scores"]["pairs"]:
            wrong, right, waited = (
                Spread(values(one.records, f"pairs.{name}.{key}")).mean for key in ("fpr", "tpr", "initialisation_s")
            )
            for axes, y in ((rates, right), (times, waited)):
                axes.plot(wrong, y, ".", color=OURS if name.startswith("window") else INK)
                axes.annotate(name, (wrong, y), fontsize=6, color=INK)
        _label(rates, one.wanted.variant.title, "false positive rate", "true positive rate")
        _label(times, one.wanted.variant.title, "false positive rate", "first right association, s")
    return [(_uri(figure), "Every method on the same tracks; means over runs. Blue: windowed_covariance by threshold.")]


def _fusions(records: Sequence[Record]) -> list[str]:
    return list(records[0]["scores"]["two_filters"])


def _panels(count: int) -> tuple[Figure, Sequence[Axes]]:
    figure = Figure(figsize=(4.0 * count + 2.0 if count > 1 else 7.5, 4.8), layout="constrained")
    return figure, list(np.atleast_1d(figure.subplots(1, count)))


def _label(axes: Axes, title: str, x: str, y: str) -> None:
    axes.set_title(title, fontsize=10, loc="left", color=INK)
    axes.set_xlabel(x, fontsize=9)
    axes.set_ylabel(y, fontsize=9)
    axes.tick_params(labelsize=8)
    axes.grid(color="#e3e8ec", linewidth=0.8)
    axes.set_axisbelow(True)


def _uri(figure: Figure) -> str:
    """The figure as a data URI, with the legend of its last panel below."""
    handles, labels = figure.axes[-1].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=min(len(labels), 3), fontsize=8, frameon=False)
    held = io.BytesIO()
    figure.savefig(held, format="svg", metadata={"Date": None, "Creator": None})
    return f"data:image/svg+xml;base64,{base64.b64encode(held.getvalue()).decode()}"


KINDS: dict[str, Callable[[Published, Sequence[Made]], list[tuple[str, str]]]] = {
    plot.__name__: plot
    for plot in (picture, time_shares, noise, history, roc, convergence, anees, targets, steps, ospa, paths, scan, pairs)
}
"""By the names in `published.toml`."""
