"""A Scene drawn as a PNG with matplotlib. Longitudes are continuous across the antimeridian; only the labels are wrapped."""

from __future__ import annotations

import io
from typing import Any

import matplotlib
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PathCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.path import Path as Outline
from matplotlib.ticker import FuncFormatter, MultipleLocator
from matplotlib.transforms import ScaledTranslation

from coastwatch.batches import Bools, Flag, Floats
from coastwatch.geodesy import NAUTICAL_MILE_M, offset_deg, wrap_deg
from coastwatch.operators import presentation
from coastwatch.operators.output_file import written
from coastwatch.operators.scene import AIS_ONLY, BEARING, COASTING, FUSED, RADAR, RADAR_ONLY, SONAR_ONLY, STATION, Scene, load
from coastwatch.spelling import printable

matplotlib.use("Agg")

WATER, LAND, SHORE, INK, FAINT = "#e4eef4", "#efe6cf", "#a59c86", "#1d2733", "#5b6b7a"
RADAR_COLOURS = ("#1f5fbf", "#c62f2f", "#1f8a70", "#7b4bb3", "#8a6a1f", "#c2417f")
SONAR_COLOUR, STATION_COLOUR, BOW_TIE_COLOUR, AIS_COLOUR = "#e08a1e", "#5f9e6e", "#d21f26", "#1f9c3a"
ALARM_COLOUR, WARNING_COLOUR = "#ff00c8", "#7a00ff"
COVER_STEPS = (
    (0.0, "#b2182b", "radars detect under 25 % of AIS vessels"),
    (0.25, "#ef8a62", "25 to 50 %"),
    (0.5, "#a6d96a", "50 to 75 %"),
    (0.75, "#1a9641", "75 % or more"),
)
"""Least detection probability, colour and text of each step."""
CLUTTER_STEPS = (
    (0.0, "#dadaeb", "under 0.1 false plots in a km2 and turn"),
    (0.1, "#9e9ac8", "0.1 to 1"),
    (1.0, "#6a51a3", "1 to 10"),
    (10.0, "#3f007d", "10 or more"),
)
BOW_TIE = Outline([(-1.0, -0.8), (-1.0, 0.8), (1.0, -0.8), (1.0, 0.8), (-1.0, -0.8)], closed=True)
WIDTH_IN = 9.0
BELOW_IN = 0.45  # of the scale bar, below the numbers of the axis
LEADER_S = 180.0
SIGMAS = 2.0
ELLIPSE_SCALES = (1, 2, 5, 10, 20, 50, 100)
ELLIPSE_SHARE = 0.03  # of the width: largest drawn length of the longer half axis of nine in ten ellipses
LARGEST_SHARE = 0.08  # of the width: an ellipse with a longer half axis is left out
TICKS_MIN = (0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 30, 60, 120, 300, 600)
SCALE_BARS_NM = (0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200)
TURN = np.linspace(0.0, 2.0 * np.pi, 37)


def write(scene: Scene, output: str) -> None:
    """Draws the scene to a PNG file. Raises: OSError."""
    figure = draw(scene)
    with written(output) as file:
        figure.savefig(file, format="png", dpi=150, bbox_inches="tight", pad_inches=0.25, metadata={"Title": scene.title})


def draw_run(database: str, run_id: int, shore: str) -> tuple[dict[str, int], bytes]:
    """The last picture of a run: number of vessels of each kind and of bearings, and the PNG. Args: shore: GeoJSON file of land."""
    with presentation.opened(database) as opened:
        scene = load(opened, presentation.run(opened, run_id), None, None, shore)
    png = io.BytesIO()
    draw(scene).savefig(png, format="png", dpi=90, bbox_inches="tight", pad_inches=0.2)
    kinds = {kind.replace(" ", "_"): int((scene.kind == kind).sum()) for kind in (AIS_ONLY, RADAR_ONLY, FUSED)}
    return {**kinds, "bearings": len(scene.bearing_from_deg)}, png.getvalue()


def draw(scene: Scene) -> Figure:
    """The figure of a scene, with the proportions of its area."""
    height_deg, width_deg = scene.size_deg
    shape = np.clip(scene.height_nm / scene.width_nm, 0.45, 1.5)
    figure = Figure(figsize=(WIDTH_IN, float(WIDTH_IN * shape)), facecolor="white")
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set_facecolor(WATER)
    lat, lon = scene.centre_deg
    axes.set_aspect(1.0 / np.cos(np.radians(lat)))
    axes.set_xlim(lon - 0.5 * width_deg, lon + 0.5 * width_deg)
    axes.set_ylim(lat - 0.5 * height_deg, lat + 0.5 * height_deg)
    axes.autoscale(False)
    _land(axes, scene)
    marks = [*_cells(axes, scene), *_coverage(axes, scene), *_bearings(axes, scene), *_trails(axes, scene)]
    marks = [*_vessels(axes, scene), *marks, *_ellipses(axes, scene)]
    _names(axes, scene)
    _grid(axes, width_deg, height_deg)
    _scale_bar(axes, scene)
    _titles(axes, scene, marks)
    return figure


def _flat(scene: Scene, position_deg: Floats) -> Floats:
    """x, y of positions, with longitudes within 180 degrees of the centre of the scene."""
    lon = scene.centre_deg[1] + wrap_deg(position_deg[..., 1] - scene.centre_deg[1])
    return np.stack([lon, position_deg[..., 0]], axis=-1)


def _land(axes: Axes, scene: Scene) -> None:
    outlines = []
    for line in scene.land:
        if line.closed:
            rings = [Outline(ring[:, ::-1], closed=True) for ring in (line.position_deg, *line.lakes_deg)]
            outlines.append(Outline.make_compound_path(*rings))
        else:
            axes.plot(*line.position_deg.T[::-1], color=SHORE, linewidth=1.2, zorder=1)
    land = PathCollection(outlines, facecolors=LAND, edgecolors=SHORE, linewidths=0.9, zorder=1)
    axes.add_collection(land, autolim=False)


def _coverage(axes: Axes, scene: Scene) -> list[Artist]:
    marks: list[Artist] = []
    radars = 0
    for c in scene.coverages:
        colour = {STATION: STATION_COLOUR, BEARING: SONAR_COLOUR}.get(c.kind, RADAR_COLOURS[radars % len(RADAR_COLOURS)])
        radars += c.kind == RADAR
        dash: Any = (0, (6, 4)) if c.kind == STATION else "solid"
        first, last = c.arc_deg
        span = (last - first) % 360.0 or 360.0
        angle = np.radians(first + np.linspace(0.0, span, 181))
        outline = offset_deg(np.asarray(c.site_deg, float), c.range_m * np.stack([np.sin(angle), np.cos(angle)], -1))
        if span < 360.0:  # a sector has lines to its centre
            outline = np.vstack([c.site_deg, outline, c.site_deg])
        ring = _flat(scene, outline)
        if c.kind != STATION:
            axes.fill(*ring.T, facecolor=colour, alpha=0.07, linewidth=0, zorder=2)
        axes.plot(*ring.T, color=colour, linewidth=1.6 if c.kind != STATION else 1.0, linestyle=dash, zorder=3)
        site = _flat(scene, c.site_deg)
        shape = {STATION: "v", BEARING: "D"}.get(c.kind, "o")
        axes.plot(*site, marker=shape, color=colour, markersize=7.5, markeredgecolor="white", markeredgewidth=1.0, zorder=9)
        name = printable(c.name).replace("$", r"\$")  # else what is between two is a formula
        text = f"{name}: {('AIS', 'radar', 'bearings')[(STATION, RADAR, BEARING).index(c.kind)]}, {c.range_m / NAUTICAL_MILE_M:.3g} NM"
        marks.append(
            Line2D([], [], color=colour, linestyle=dash, marker=shape, markeredgecolor="white", markersize=7, label=text)
        )
    return marks


def _cells(axes: Axes, scene: Scene) -> list[Artist]:
    """Cells of the cover of radars in the colours of COVER_STEPS or CLUTTER_STEPS."""
    if scene.cover is None:
        return []
    steps = CLUTTER_STEPS if scene.cover.is_clutter else COVER_STEPS
    step = np.searchsorted([low for low, *_ in steps], scene.cover.value, side="right") - 1
    colours = np.array([colour for _, colour, _ in steps])[step]
    outline = _flat(scene, scene.cover.corner_deg)
    axes.add_collection(PolyCollection(list(outline), facecolors=colours.tolist(), alpha=0.45, linewidths=0, zorder=2))
    return [
        Patch(facecolor=colour, alpha=0.45, label=f"{text} ({(step == k).sum()} cells)")
        for k, (_, colour, text) in enumerate(steps)
    ]


def _bearings(axes: Axes, scene: Scene) -> list[Artist]:
    if not len(scene.bearing_from_deg):
        return []
    lines = np.stack([_flat(scene, scene.bearing_from_deg), _flat(scene, scene.bearing_to_deg)], 1)
    style = {"colors": BOW_TIE_COLOUR, "linestyles": (0, (1, 2.2)), "linewidths": 1.1}
    axes.add_collection(LineCollection(list(lines), alpha=0.75, zorder=4, **style))
    return [Line2D([], [], color=BOW_TIE_COLOUR, linestyle=(0, (1, 2.2)), label=f"associated bearing ({len(lines)})")]


def _trails(axes: Axes, scene: Scene) -> list[Artist]:
    marks: list[Artist] = []
    if scene.trails_deg:
        trails = [_flat(scene, t) for t in scene.trails_deg]
        axes.add_collection(LineCollection(trails, colors=FAINT, linewidths=0.9, alpha=0.55, zorder=4))
        marks.append(Line2D([], [], color=FAINT, linewidth=0.9, label=f"trail, last {scene.trail_s / 60.0:g} min"))
    moving = np.isfinite(scene.velocity_m_s).all(-1) & (np.hypot(*scene.velocity_m_s.T) > 0.1)
    if moving.any():
        start = scene.position_deg[moving]
        tip = offset_deg(start, LEADER_S * scene.velocity_m_s[moving])
        lines = np.stack([_flat(scene, start), _flat(scene, tip)], 1)
        axes.add_collection(LineCollection(list(lines), colors=INK, linewidths=0.8, alpha=0.8, zorder=5))
        marks.append(Line2D([], [], color=INK, linewidth=0.8, label=f"leader, {LEADER_S / 60.0:g} min ahead"))
    return marks


def _ellipses(axes: Axes, scene: Scene) -> list[Artist]:
    """Ellipses of 2 sigma, enlarged by the factor in the legend. An ellipse that would cover the rest is left out."""
    rows = np.flatnonzero(np.isfinite(scene.ellipse).all(-1))
    if not len(rows):
        return []
    major, minor, direction = scene.ellipse[rows].T * np.array([[SIGMAS], [SIGMAS], [np.pi / 180.0]])
    wanted = ELLIPSE_SHARE * scene.width_nm * NAUTICAL_MILE_M / max(float(np.percentile(major, 90.0)), 1e-3)
    scale = max(s for s in ELLIPSE_SCALES if s <= max(wanted, 1.0))
    fits = scale * major <= LARGEST_SHARE * scene.width_nm * NAUTICAL_MILE_M
    rows, major, minor, direction = rows[fits], major[fits], minor[fits], direction[fits]
    along, across = scale * major[:, None] * np.cos(TURN), scale * minor[:, None] * np.sin(TURN)
    sine, cosine = np.sin(direction)[:, None], np.cos(direction)[:, None]
    metres = np.stack([along * sine + across * cosine, along * cosine - across * sine], -1)
    outline = _flat(scene, offset_deg(scene.position_deg[rows][:, None, :], metres))
    style: dict[str, Any] = {"facecolor": "#1d273318", "edgecolor": "#1d273399"}
    axes.add_collection(PolyCollection(list(outline), linewidths=0.6, zorder=5, **style))
    label = f"uncertainty, {SIGMAS:g} sigma" + (f", drawn {scale} x" if scale > 1 else "")
    return [Patch(label=label + (f" ({(~fits).sum()} too large to draw)" if not fits.all() else ""), **style)]


def _vessels(axes: Axes, scene: Scene) -> list[Artist]:
    styles: dict[str, tuple[Any, str, str, float]] = {
        AIS_ONLY: ("^", AIS_COLOUR, "#0d5a1e", 34.0),
        RADAR_ONLY: ("s", "white", INK, 26.0),
        FUSED: (BOW_TIE, BOW_TIE_COLOUR, "#7d0f14", 46.0),
        SONAR_ONLY: ("D", SONAR_COLOUR, INK, 26.0),
        COASTING: ("X", FAINT, "white", 40.0),
    }
    xy, inside = _flat(scene, scene.position_deg), scene.inside(scene.position_deg)
    marks: list[Artist] = []
    for kind, (marker, face, edge, size) in styles.items():
        rows = scene.kind == kind
        if kind in (SONAR_ONLY, COASTING) and not rows.any():
            continue  # most pictures have none, and then no line of the legend
        axes.scatter(xy[rows, 0], xy[rows, 1], s=size, marker=marker, facecolor=face, edgecolor=edge, linewidth=0.9, zorder=7)
        points = float(np.sqrt(size)) + 0.8
        style: dict[str, Any] = {"markerfacecolor": face, "markeredgecolor": edge, "markersize": points, "linestyle": "none"}
        marks.append(Line2D([], [], marker=marker, label=f"{kind} ({_count(rows, inside)})", **style))
    for flags, colour, name in (
        (Flag.DARK, ALARM_COLOUR, "dark: radar, no AIS inside AIS coverage"),
        (Flag.AIS_CONTRADICTED | Flag.MMSI_TWICE | Flag.IMPOSSIBLE_SPEED, WARNING_COLOUR, "AIS contradicted or impossible"),
    ):
        rows = (scene.flags & int(flags)) != 0
        if rows.any():
            axes.scatter(
                xy[rows, 0], xy[rows, 1], s=150.0, marker="o", facecolor="none", edgecolor=colour, linewidth=1.7, zorder=8
            )
            style = {"markerfacecolor": "none", "markeredgecolor": colour, "markersize": 11, "markeredgewidth": 1.7}
            marks.append(Line2D([], [], marker="o", label=f"{name} ({_count(rows, inside)})", linestyle="none", **style))
    chosen = xy[np.array(scene.selected, np.int64)]
    axes.scatter(chosen[:, 0], chosen[:, 1], s=260.0, marker="s", facecolor="none", edgecolor=INK, linewidth=1.4, zorder=8)
    return marks


def _count(rows: Bools, inside: Bools) -> str:
    """How many vessels of a kind are in the frame, and how many are not."""
    outside = int((rows & ~inside).sum())
    return f"{(rows & inside).sum()}" + (f", {outside} outside the frame" if outside else "")


def _names(axes: Axes, scene: Scene) -> None:
    xy, inside = _flat(scene, scene.position_deg), scene.inside(scene.position_deg)
    for row, name in scene.names:
        if inside[row]:
            style: dict[str, Any] = {"textcoords": "offset points", "fontsize": 7.5, "parse_math": False}
            axes.annotate(name, (xy[row, 0], xy[row, 1]), (7.0, 4.0), color=INK, zorder=12, **style)


def _grid(axes: Axes, width_deg: float, height_deg: float) -> None:
    for axis, span_deg, ends in ((axes.xaxis, width_deg, "EW"), (axes.yaxis, height_deg, "NS")):
        step = next((t for t in TICKS_MIN if span_deg * 60.0 / t <= 7), TICKS_MIN[-1])
        axis.set_major_locator(MultipleLocator(step / 60.0))
        axis.set_major_formatter(FuncFormatter(lambda value, _, ends=ends, step=step: _degrees(value, ends, step)))
    axes.grid(color="white", linewidth=0.9, zorder=0.5)
    axes.tick_params(labelsize=9, colors=FAINT)
    for spine in axes.spines.values():
        spine.set_color(FAINT)


def _degrees(value: float, ends: str, step_min: float) -> str:
    """Degrees and minutes with the letter of the hemisphere, longitude in -180..180."""
    turned = float(wrap_deg(value)) if ends == "EW" else value
    digits = 0 if step_min >= 1 else 2 if step_min < 0.1 else 1
    minutes = round(abs(turned) * 60.0, digits)
    letter = ends[0] if turned >= 0.0 else ends[1]
    return f"{int(minutes // 60)}°{minutes % 60:0{digits + 3 if digits else 2}.{digits}f}'{letter}"


def _scale_bar(axes: Axes, scene: Scene) -> None:
    """A bar below the frame, where it hides nothing."""
    length_nm = max(s for s in SCALE_BARS_NM if s <= max(0.25 * scene.width_nm, SCALE_BARS_NM[0]))
    length = length_nm / scene.width_nm
    below = axes.transAxes + ScaledTranslation(0.0, -BELOW_IN, axes.figure.dpi_scale_trans)
    style: dict[str, Any] = {"transform": below, "clip_on": False, "solid_capstyle": "butt"}
    axes.plot([0.0, length], [0.0, 0.0], color=INK, linewidth=6.6, zorder=10, **style)
    for k in range(4):
        ends = [0.25 * k * length, 0.25 * (k + 1) * length]
        axes.plot(ends, [0.0, 0.0], color=INK if k % 2 == 0 else "white", linewidth=5, zorder=11, **style)
    axes.text(length + 0.01, 0.0, f"{length_nm:g} NM", transform=below, va="center", color=INK)


def _titles(axes: Axes, scene: Scene, marks: list[Artist]) -> None:
    axes.set_title(printable(scene.title), loc="left", parse_math=False, fontsize=14, fontweight="bold", color=INK, pad=22)
    above: dict[str, Any] = {"xycoords": "axes fraction", "textcoords": "offset points"}
    axes.annotate(
        printable(scene.subtitle), (0.0, 1.0), (0.0, 6.0), fontsize=10, color=FAINT, va="bottom", parse_math=False, **above
    )
    if scene.land:
        marks = [*marks, Patch(facecolor=LAND, edgecolor=SHORE, label=scene.land_label)]
    style: dict[str, Any] = {"frameon": False, "fontsize": 9.5, "labelcolor": INK, "labelspacing": 0.75, "borderaxespad": 0.0}
    axes.legend(handles=marks, loc="upper left", bbox_to_anchor=(1.015, 1.0), **style)
