"""The content of a plot at one instant of a run, read from the store into arrays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from coastwatch import store
from coastwatch.batches import COVER_AZIMUTHS, COVER_RANGES, Array, Bools, Floats, Ints
from coastwatch.errors import InputError
from coastwatch.formats import coastline
from coastwatch.formats.coastline import Shore
from coastwatch.geodesy import KNOT_M_S, NAUTICAL_MILE_M, difference_m, offset_deg, scale_m_deg, wrap_deg
from coastwatch.operators.presentation import Run, ending
from coastwatch.shipped import scenarios_folder
from coastwatch.spelling import printable, utc_text
from coastwatch.store import Rows, Store, Table

RADAR, STATION, BEARING = "radar", "station", "bearing"
AIS_ONLY, RADAR_ONLY, SONAR_ONLY, FUSED, COASTING = "AIS only", "radar only", "sonar only", "fused", "no sensor now"
NO_LAND = "none"
NATURAL_EARTH_NM = 8.0  # a narrower frame would show its errors of some 500 m
MARGIN = 1.1  # land is cut outside the frame, so that the cut is not seen
MOST_NAMES = 8
TRAIL_S = 180.0
TRAILS_MOST = 5000  # vessels; with more, trails would cover the picture


@dataclass(frozen=True, eq=False)
class Coverage:
    """The coverage of one sensor."""

    name: str
    kind: str  # RADAR, STATION or BEARING
    site_deg: Floats  # (2,)
    range_m: float
    arc_deg: tuple[float, float] = (0.0, 360.0)  # clockwise from, to


@dataclass(frozen=True, eq=False)
class CoverCells:
    """Cells of the learnt cover of radars."""

    corner_deg: Floats  # (C, 4, 2)
    value: Floats  # (C,) detection probability, or false plots in a square kilometre and turn
    is_clutter: bool


@dataclass(frozen=True, eq=False)
class Scene:
    """A picture with coverage, bearings, trails and land. V vessels, B bearing lines."""

    title: str
    subtitle: str
    centre_deg: tuple[float, float]
    width_nm: float
    height_nm: float
    coverages: tuple[Coverage, ...]
    position_deg: Floats  # (V, 2)
    velocity_m_s: Floats  # (V, 2)
    ellipse: Floats  # (V, 3) 1-sigma half axes, m, and direction of the longer one, deg from north; NaN if unknown
    kind: Array  # (V,) AIS_ONLY, RADAR_ONLY, FUSED (both), SONAR_ONLY (neither) or COASTING (no sensor has a track)
    flags: Ints  # (V,) sum of batches.Flag
    bearing_from_deg: Floats  # (B, 2)
    bearing_to_deg: Floats  # (B, 2)
    trails_deg: tuple[Floats, ...] = ()  # each (P, 2), oldest first
    trail_s: float = 0.0
    land: tuple[Shore, ...] = ()
    land_label: str = "land"
    names: tuple[tuple[int, str], ...] = ()  # row and text of each vessel that is named
    selected: tuple[int, ...] = ()  # rows
    cover: CoverCells | None = None

    @property
    def size_deg(self) -> tuple[float, float]:
        """Height and width of the frame in degrees."""
        north, east = (NAUTICAL_MILE_M / float(scale) for scale in scale_m_deg(np.array(self.centre_deg[0])))
        return self.height_nm * north, self.width_nm * east

    def inside(self, position_deg: Floats) -> Bools:
        """Which positions are in the frame. Args: position_deg: (V, 2)."""
        away = np.abs(np.stack([position_deg[:, 0] - self.centre_deg[0], wrap_deg(position_deg[:, 1] - self.centre_deg[1])], 1))
        return np.asarray((away <= 0.5 * np.array(self.size_deg)).all(1))


def load(
    database: Store,
    run: Run,
    at_s: float | None,
    bbox: tuple[float, float, float, float] | None,
    shore: str | None,
    *,
    names: int = MOST_NAMES,
    vessels: Sequence[int] = (),
    cover: str | None = None,
) -> Scene:
    """The scene of a run, now or at an instant.

    Args: run: as `store.run` returns it. bbox: south, west, north, east in degrees, instead of the scenario's area. shore: GeoJSON
    file instead of the scenario's coastline or Natural Earth; NO_LAND: none. names: how many of the longest vessels are named.
    vessels: ids of selected vessels, which are named and marked. cover: "detection" or "clutter": cells of radars to be coloured.
    Raises: StoreError, InputError.
    """
    rows = store.picture(database, run["id"], at_s, bbox)
    position, ids = _numbers(rows, "latitude_deg", "longitude_deg"), rows.column("vessel_id")
    sog_kn, cog_deg = _numbers(rows, "sog_kn", "cog_deg").T
    east_north = np.stack([np.sin(np.radians(cog_deg)), np.cos(np.radians(cog_deg))], -1)
    time_s = max(rows.column("time_s"), default=None)
    bearings = _bearings(database, run["id"], ids, position) if at_s is None else np.zeros((2, 0, 2))
    when = f"{utc_text(round(time_s))[:-5]}Z · " if time_s is not None else ""
    centre_deg, width_nm, height_nm = _frame(run["settings"]["area"], bbox)
    ends = f" · {ending(run)}" if ending(run) else ""
    scene = Scene(
        title=run["title"],
        subtitle=f"{when}run {run['id']} of {run['scenario']}, seed {run['seed']} · {len(rows)} vessels{ends}",
        centre_deg=centre_deg,
        width_nm=width_nm,
        height_nm=height_nm,
        coverages=_coverages(store.sensors(database, run["id"])),
        position_deg=position,
        velocity_m_s=np.where(sog_kn[:, None] == 0.0, 0.0, (sog_kn * KNOT_M_S)[:, None] * east_north),
        ellipse=_numbers(rows, "major_m", "minor_m", "orientation_deg"),
        kind=_kinds(rows.column("sources"), store.sources(database, run["id"])),
        flags=np.array(rows.column("flags"), np.int64),
        bearing_from_deg=bearings[0],
        bearing_to_deg=bearings[1],
        trails_deg=_trails(database, run["id"], ids, position, time_s),
        trail_s=TRAIL_S,
        cover=None if cover is None else _cover_cells(database, run["id"], cover == "clutter"),
    )
    land, label = _land(run["scenario"], shore, scene)
    absent = [str(vessel) for vessel in vessels if vessel not in ids]
    if absent:
        raise InputError(
            f"--vessel: got {', '.join(absent)}, needed ids of vessels in this picture; `coastwatch picture` lists them"
        )
    selected = tuple(ids.index(vessel) for vessel in vessels)
    return replace(scene, land=land, land_label=label, selected=selected, names=_names(scene, rows, names, selected))


def _names(scene: Scene, rows: Table, most: int, selected: Sequence[int]) -> tuple[tuple[int, str], ...]:
    """Row and text of the selected vessels and of the longest ones in the frame: name, MMSI or id."""
    (length,) = _numbers(rows, "length_m").T
    here = np.flatnonzero(scene.inside(scene.position_deg) & ~np.isnan(length))
    longest = here[np.argsort(-length[here], kind="stable")][:most]
    name, vessel_id = rows.column("name"), rows.column("vessel_id")
    mmsi = [None if value is None else f"{value:09d}" for value in rows.column("mmsi")]
    named = dict.fromkeys([*selected, *longest.tolist()])
    return tuple((k, printable(name[k] or mmsi[k] or f"vessel {vessel_id[k]}")) for k in named)


def _numbers(rows: Table, *names: str) -> Floats:
    return np.array([rows.column(name) for name in names], float).reshape(len(names), -1).T


def _frame(area: dict[str, float], bbox: tuple[float, float, float, float] | None) -> tuple[tuple[float, float], float, float]:
    """Centre in degrees, width and height in NM of the plot."""
    if bbox is None:
        return (area["latitude_deg"], area["longitude_deg"]), area["width_nm"], area["height_nm"]
    south, west, north, east = bbox
    centre = 0.5 * (south + north), float(wrap_deg(west + 0.5 * ((east - west) % 360.0)))
    scale_north, scale_east = (float(s) / NAUTICAL_MILE_M for s in scale_m_deg(np.array(centre[0])))
    return centre, ((east - west) % 360.0) * scale_east, (north - south) * scale_north


def _coverages(rows: Rows) -> tuple[Coverage, ...]:
    kinds = {"radar": RADAR, "ais": STATION, "bearing": BEARING}
    coverages = []
    for row in rows.rows:
        sensor = dict(zip(rows.columns, row, strict=True))
        site = np.array([sensor["latitude_deg"], sensor["longitude_deg"]], float)
        arc = (float(sensor["spec"].get("arc_from_deg", 0.0)), float(sensor["spec"].get("arc_to_deg", 360.0)))
        coverages.append(Coverage(sensor["name"], kinds[sensor["kind"]], site, float(sensor["range_m"]), arc))
    return tuple(sorted(coverages, key=lambda c: (RADAR, BEARING, STATION).index(c.kind)))


def _cover_cells(database: Store, run_id: int, clutter: bool) -> CoverCells:
    """The cells of all radars in which something was learnt. Raises: InputError: no cover is stored."""
    names, cover = store.radar_covers(database, run_id)
    if not names:
        raise InputError(f"--cover: run {run_id} has no learnt cover of a radar; it is stored with `cover.method` learnt")
    value = 1e6 * cover.false_plots_per_m2 if clutter else cover.ais_detection
    learnt: Bools = np.greater(value if clutter else cover.ais_looks, 0.0) & np.isfinite(cover.site_deg[:, :1, None])
    radar, sector, ring = np.nonzero(learnt)
    angle = 2.0 * np.pi / COVER_AZIMUTHS * (sector[:, None] + np.array([0, 1, 1, 0]))
    reach = (cover.range_m[radar] / COVER_RANGES)[:, None] * (ring[:, None] + np.array([0, 0, 1, 1]))
    metres = np.stack([reach * np.sin(angle), reach * np.cos(angle)], -1)
    return CoverCells(offset_deg(cover.site_deg[radar][:, None, :], metres), value[learnt], clutter)


def _kinds(sources: list[str | None], table: Rows) -> Array:
    """Which sensors have a track of each vessel. Args: sources: names with commas between, None or empty if there is none."""
    kind_of = {f",{name},": kind for name, kind in zip(table.column("name"), table.column("kind"), strict=True)}
    kind_of_vessel = []
    for text in sources:
        kinds = {kind for name, kind in kind_of.items() if name in f",{text},"}
        if kinds & {"radar", "ais"}:  # a sonar beside them changes no symbol: its bearing is drawn as a line
            kind_of_vessel.append(FUSED if {"radar", "ais"} <= kinds else AIS_ONLY if "ais" in kinds else RADAR_ONLY)
        else:
            kind_of_vessel.append(SONAR_ONLY if "bearing" in kinds else COASTING)
    return np.array(kind_of_vessel, "U13")


def _bearings(database: Store, run_id: int, vessels: list[int], position_deg: Floats) -> Floats:
    """Ends of the lines from a sensor along its bearings, as far as the associated vessel. (2, B, 2)"""
    row_of = {vessel: k for k, vessel in enumerate(vessels)}
    rows = store.bearing_tracks(database, run_id)
    lines = []
    for row in rows.rows:
        track = dict(zip(rows.columns, row, strict=True))
        if track["vessel_id"] in row_of:
            lines.append((row_of[track["vessel_id"]], track["latitude_deg"], track["longitude_deg"], track["bearing_deg"]))
    numbers = np.array(lines, float).reshape(-1, 4)
    site, angle = numbers[:, 1:3], np.radians(numbers[:, 3])
    distance_m = np.hypot(*difference_m(position_deg[numbers[:, 0].astype(int)], site).T)
    return np.stack([site, offset_deg(site, distance_m[:, None] * np.stack([np.sin(angle), np.cos(angle)], -1))])


def _trails(database: Store, run_id: int, vessels: list[int], position_deg: Floats, time_s: float | None) -> tuple[Floats, ...]:
    """Of each vessel its positions in the last minutes, the current one last. Args: position_deg: (V, 2)."""
    if time_s is None or len(vessels) > TRAILS_MOST:
        return ()
    past = store.history(database, run_id, time_s - TRAIL_S, time_s)
    if not len(past):
        return ()
    vessel = np.array([*past.column("vessel_id"), *vessels], np.int64)
    position = np.array([past.column("latitude_deg"), past.column("longitude_deg")], float).T
    position = np.concatenate([position, position_deg])
    order = np.flatnonzero(np.isin(vessel, vessels))
    order = order[np.argsort(vessel[order], kind="stable")]
    cuts = np.flatnonzero(np.diff(vessel[order])) + 1
    return tuple(position[rows] for rows in np.split(order, cuts) if len(rows) > 1)


def _land(scenario: str, shore: str | None, scene: Scene) -> tuple[tuple[Shore, ...], str]:
    """Land and its name in the legend: of a file, of the scenario, or of Natural Earth if the frame is wide enough for it."""
    own = scenarios_folder() / scenario / "coastline.geojson"
    if shore == NO_LAND:
        return (), ""
    if shore is not None or own.is_file():
        read, note = coastline.read(own if shore is None else shore)
        land = tuple(replace(line, position_deg=_near(line.position_deg, scene.centre_deg[1])) for line in read)
        return land, f"land ({note.partition(':')[0]})" if note else "land"
    if scene.width_nm < NATURAL_EARTH_NM:
        return (), ""
    (latitude, longitude), (height, width) = scene.centre_deg, (0.5 * MARGIN * size for size in scene.size_deg)
    land = coastline.natural_earth(latitude - height, longitude - width, latitude + height, longitude + width)
    return land, "land (Natural Earth 1:10m, not for navigation)"


def _near(line_deg: Floats, longitude_deg: float) -> Floats:
    """A line without steps at the antimeridian, as a whole within half a turn of a longitude. Args: line_deg: (P, 2)."""
    if not len(line_deg):
        return line_deg
    longitude = np.unwrap(line_deg[:, 1], period=360.0)
    turns = np.round((longitude_deg - 0.5 * (longitude.min() + longitude.max())) / 360.0)
    return np.stack([line_deg[:, 0], longitude + 360.0 * turns], 1)
