"""Rows of the store in the units of an operator: UTC, MMSI with nine digits, flags as words, rounded numbers."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

import numpy as np

from coastwatch import store
from coastwatch.batches import COVER_AZIMUTHS, COVER_RANGES, Flag, Floats, nav_status_text
from coastwatch.errors import InputError
from coastwatch.geodesy import NAUTICAL_MILE_M
from coastwatch.operators.columns import digits_of, rounded
from coastwatch.spelling import did_you_mean
from coastwatch.store import QueryLimit, Rows, Store, Table
from coastwatch.store.read.questions import ParameterError

MAIN_COLUMNS = (
    "vessel_id",
    "mmsi",
    "name",
    "nav_status",
    "latitude_deg",
    "longitude_deg",
    "sog_kn",
    "cog_deg",
    "major_m",
    "updated_utc",
    "sources",
    "flags",
)
"""Columns of the picture in the table on a screen; the other formats have all."""

MAIN_SCORES = (("associations", "f1"), ("fused_tracks", "position_rmse_m"), ("picture", "gospa_rms_m"))
"""Scores in the table of runs; --json has all."""

ENDS = {
    "died": "the run died",
    "failed": "the run failed",
    "interrupted": "the run was interrupted",
    "running": "the run goes on",
}
"""What a picture says of a run that has not finished, by its status."""

ERRORS = (
    ("azimuth_bias_deg", "azimuth_sigma_deg"),
    ("range_bias_m", "range_sigma_m"),
    ("time_lag_s", ""),
    ("estimated_lag_s", "lag_sigma_s"),
)
"""Registration errors of a sensor and their standard deviations. A lag is subtracted only once it is accurate."""


STATISTICS = {
    "windowed_covariance": "log-likelihood ratio that both tracks are one vessel, summed over cycles: larger is surer",
    "windowed_covariance_literal": "distance of the tracks over their covariance, squared: smaller is surer",
    "bearing_likelihood": "log odds that the bearings are of this vessel: larger is surer",
    "bearing_windowed_covariance": "distance of bearing and rate over their covariance, squared: smaller is surer",
}
"""What the statistic of an association means, by the method that decided."""

ENDLESS = 100_000_000
"""A run with so many cycles is live."""

LAST = 2**62
"""The last cycle of a stay that lasts."""

COURSES = ("cog_deg", "bearing_deg")  # never 360.00
WORDS = ("flags", "nav_status")  # numbers that people read as words
NAMED_SOURCES = ("source", "first_source", "second_source")

Box = tuple[float, float, float, float]


@dataclass(frozen=True)
class Vessel:
    """The details of one vessel, and its tables: tracks, history and others."""

    details: dict[str, Any]
    tables: dict[str, Rows]
    meanings: dict[str, str]  # of the statistics in its tables
    stays: tuple[tuple[int, int], ...]  # first and last cycle of each time in the picture

    @property
    def name(self) -> str:
        """Name or MMSI if it has one, else its number."""
        return str(self.details.get("name") or self.details.get("mmsi") or f"vessel {self.details['vessel_id']}")

    def paths(self) -> list[Rows]:
        """The history of each stay that has points, oldest first."""
        rows = self.tables["history"]
        at = rows.columns.index("cycle")
        found = [[row for row in rows.rows if first <= row[at] <= last] for first, last in self.stays]
        return [Rows(rows.columns, path) for path in found if path]


@contextmanager
def opened(url: str, limit: QueryLimit | None = None) -> Iterator[Store]:
    """The database, which must exist. Args: limit: of each read transaction. Raises: StoreError."""
    with store.open_store(url, create=False, limit=limit) as found:
        yield found


def run(found: Store, run_id: int | None) -> dict[str, Any]:
    """The run with this number, or the latest. Raises: StoreError if there is none."""
    return store.run(found, store.latest_run(found) if run_id is None else run_id)


def runs(found: Store) -> Rows:
    """Every run, newest first, with its scores; `scores` is a dict."""
    listed = store.runs(found)
    names = ("run", *listed.columns[1:])
    return in_operator_units(Rows(names, listed.rows))


def runs_table(rows: Rows) -> Rows:
    """The rows of `runs` as a table for a screen, with the main scores."""
    made = []
    for row in rows.rows:
        of = dict(zip(rows.columns, row, strict=True))
        scores = of["scores"] or {}
        main = [(scores.get(stage) or {}).get(name) for stage, name in MAIN_SCORES]
        cycles = _cycles(of)
        about = (of[name] for name in ("run", "scenario", "seed", "version", "status"))
        figures = [round(value, 4) if isinstance(value, float) else value for value in main]
        faults = sum(fault["count"] for fault in of["faults"])
        made.append((*about, cycles, of["started_utc"], faults, *figures, _verdict(of["verdict"])))
    columns = ("run", "scenario", "seed", "version", "status", "cycles", "started_utc", "faults")
    return Rows((*columns, *(f"{stage}.{name}" for stage, name in MAIN_SCORES), "verdict"), made)


def _verdict(sentences: list[str] | None) -> str | None:
    return None if sentences is None else f"{len(sentences)} fell" if sentences else "good"


def heading(run_row: Mapping[str, Any], rows: Rows) -> str:
    """Which run a picture is of, its instant, and how the run ended. Args: run_row: as of `run`; rows: as of `picture`."""
    newest = max(rows.column("time_utc"), default=utc_text(run_row["start_s"] + run_row["cycles_stored"] * run_row["period_s"]))
    said = f"run {run_row['id']} of {run_row['scenario']}, seed {run_row['seed']}: {len(rows.rows)} vessels at {newest}"
    return f"{said}; {ending(run_row)}" if ending(run_row) else said


def ending(run_row: Mapping[str, Any]) -> str:
    """How a run that has not finished ended, such as "the run died after cycle 3 of 9"; empty if it finished."""
    ends = ENDS.get(run_row["status"])
    return f"{ends} after cycle {_cycles(run_row)}" if ends else ""


def beyond_end(found: Store, run_row: Mapping[str, Any], at_s: float | None) -> str:
    """A sentence if an instant is more than a period after the last cycle of a run; empty if not. Args: run_row: as of `run`."""
    last_s = None if at_s is None else store.last_instant(found, run_row["id"])
    if at_s is None or last_s is None or at_s <= last_s + run_row["period_s"]:
        return ""
    return f"run {run_row['id']} holds nothing at {utc_text(at_s)}: its last cycle is at {utc_text(last_s)}, and this answer is of then"


def _cycles(run_row: Mapping[str, Any]) -> str:
    """Cycles stored, and of how many; a live run has no end."""
    return str(run_row["cycles_stored"]) + ("" if run_row["cycles"] >= ENDLESS else f" of {run_row['cycles']}")


def picture(found: Store, run_id: int, at_s: float | None, bbox: Box | None) -> Rows:
    """The picture, one row per vessel, in the units of an operator."""
    return in_operator_units(store.picture(found, run_id, at_s, bbox))


def traffic(found: Store, run_id: int, bbox: Box, span_s: tuple[float, float]) -> Rows:
    """The vessels in a box between two instants. Raises: InputError, StoreError."""
    return in_operator_units(store.traffic(found, run_id, bbox, *_span(span_s)))


def encounters(found: Store, run_id: int, bbox: Box, span_s: tuple[float, float], limits: Mapping[str, Any]) -> Rows:
    """Pairs of vessels that came close to each other. Args: limits: as of `store.encounters`. Raises: InputError, StoreError."""
    for name, value in limits.items():
        if not 0.0 <= value < float("inf"):
            raise InputError(f"{name}: got {value:g}, needed 0 or more")
    return in_operator_units(store.encounters(found, run_id, bbox, *_span(span_s), **limits))


def _span(span_s: tuple[float, float]) -> tuple[float, float]:
    if span_s[0] > span_s[1]:
        raise InputError(f"--from: got {utc_text(span_s[0])}, needed an instant before --to, {utc_text(span_s[1])}")
    return span_s


def main_columns(rows: Rows) -> Rows:
    """The columns of MAIN_COLUMNS."""
    keep = [rows.columns.index(name) for name in MAIN_COLUMNS if name in rows.columns]
    return Rows(tuple(rows.columns[k] for k in keep), [tuple(row[k] for k in keep) for row in rows.rows])


TABLES = ("history", "events", "members", "associations", "bearing_associations")
"""Of a vessel, in this order."""


def vessel(found: Store, run_row: Mapping[str, Any], vessel_id: int) -> Vessel:
    """Details and tables of one vessel. Args: run_row: as of `run`. Raises: StoreError if the run never had it."""
    track = store.track(found, run_row["id"], vessel_id)
    row = in_operator_units(Rows(tuple(track.vessel), [tuple(track.vessel.values())]))
    names = {number: name for number, name, _ in store.sources(found, run_row["id"]).rows}
    tables = {key.replace("_", " "): in_operator_units(_with_names(getattr(track, key), names)) for key in TABLES}
    methods = {key: run_row["settings"].get(key, {}).get("method") for key in ("associations", "bearing_associations")}
    return Vessel(
        {"run": run_row["id"], **dict(zip(row.columns, row.rows[0], strict=True))},
        tables,
        {key.replace("_", " "): STATISTICS[method] for key, method in methods.items() if method in STATISTICS},
        tuple((first, LAST if last is None else last) for first, last, _ in track.stays.rows),
    )


def _with_names(rows: Rows | Table, names: Mapping[int, str]) -> Rows | Table:
    """The rows with the names of sources in the place of their numbers, and `track_id` for the track of a bearing."""
    columns = tuple("track_id" if name == "bearing_track" else name for name in rows.columns)
    at = {k for k, name in enumerate(columns) if name in NAMED_SOURCES}
    if not at:
        return rows
    made = [tuple(names.get(value, value) if k in at else value for k, value in enumerate(row)) for row in rows.rows]
    return Rows(columns, made)


def sensors(found: Store, run_id: int, at_s: float | None) -> Rows:
    """One row per sensor with all its columns, and its health: heard, silent or never heard."""
    states = store.sensor_states(found, run_id, at_s)
    health = [_health(dict(zip(states.columns, row, strict=True))) for row in states.rows]
    with_health = [(*row, word) for row, word in zip(states.rows, health, strict=True)]
    return in_operator_units(Rows((*states.columns, "health"), with_health))


SILENT_TURNS, SILENT_LEAST_S, SILENT_AIS_S = 3.0, 10.0, 60.0
"""A radar is silent after so many turns without a report, a sonar after so many intervals, at least after 10 s; AIS after 60 s."""


def _health(of: Mapping[str, Any]) -> str | None:
    """Whether a sensor was heard lately, in the cycle that its row is of; None: nothing is expected. Args: of: its row."""
    if of["kind"] not in ("radar", "ais", "bearing") or of["time_s"] is None:
        return None
    if of["heard_s"] is None:
        return "never heard"
    spec = of["spec"] or {}
    expected_s = spec.get("period_s", spec.get("interval_s"))
    allowed_s = SILENT_AIS_S if expected_s is None else max(SILENT_TURNS * expected_s, SILENT_LEAST_S)
    return "silent" if of["time_s"] - of["heard_s"] > allowed_s else "heard"


COVER_COLUMNS = ("ais_detection", "ais_looks", "track_detection", "track_looks")
CLUTTER_COLUMNS = ("false_plots_per_km2", "turns")


def radar_cover(found: Store, run_id: int, clutter: bool, sectors: int, rings: int) -> Rows:
    """The learnt cover of each radar, or the density of its false plots, in so many sectors and rings.

    Sectors of several cells have the mean: of a detection probability by looks, of a density by area. Cells without a look, or
    without a false plot, are left out.
    Args: sectors, rings: divisors of the cells of `RadarCover`.
    Raises: InputError: no cover is stored.
    """
    names, cover = store.radar_covers(found, run_id)
    if not names:
        raise InputError(f"run {run_id}: no cover of a radar is stored; it is learnt from radars with `cover.method` learnt")
    edges_nm = np.linspace(0.0, 1.0, COVER_RANGES + 1) * cover.range_m[:, None] / NAUTICAL_MILE_M
    area = np.broadcast_to(np.diff(edges_nm**2, axis=1)[:, None, :], cover.ais_looks.shape)

    def total(grid: Floats) -> Floats:
        parts = grid.reshape(len(names), sectors, COVER_AZIMUTHS // sectors, rings, COVER_RANGES // rings)
        return np.asarray(parts.sum(axis=(2, 4)))

    def mean(grid: Floats, weight: Floats) -> Floats:
        return np.asarray(total(grid * weight) / np.maximum(total(weight), 1e-12))

    looks, track_looks, density = total(cover.ais_looks), total(cover.track_looks), 1e6 * mean(cover.false_plots_per_m2, area)
    columns: tuple[str, ...] = CLUTTER_COLUMNS if clutter else COVER_COLUMNS
    values: tuple[Floats, ...]
    if clutter:
        shown, values = density > 0.0, (density, np.broadcast_to(cover.turns[:, None, None], density.shape))
    else:
        detection = mean(cover.ais_detection, cover.ais_looks), mean(cover.track_detection, cover.track_looks)
        known = np.where(looks > 0.0, detection[0], np.nan), np.where(track_looks > 0.0, detection[1], np.nan)
        shown, values = (looks > 0.0) | (track_looks > 0.0), (known[0], looks, known[1], track_looks)
    radar, sector, ring = np.nonzero(shown)
    width, step = 360.0 / sectors, COVER_RANGES // rings
    borders = sector * width, (sector + 1) * width, edges_nm[radar, ring * step], edges_nm[radar, (ring + 1) * step]
    numbers = np.stack([*borders, *(value[shown] for value in values)], 1)
    made = [(names[r], *(None if np.isnan(v) else v for v in row)) for r, row in zip(radar, numbers.tolist(), strict=True)]
    return in_operator_units(Rows(("name", "from_deg", "to_deg", "from_nm", "to_nm", *columns), made))


def standing_echoes(found: Store, run_row: Mapping[str, Any]) -> Rows:
    """The echoes that the clutter maps of radars hide, one row each, by radar. Args: run_row: as of `run`.

    Raises: InputError: no clutter map is learnt.
    """
    if not (run_row["settings"].get("tracks", {}).get("clutter") or {}).get("learnt"):
        raise InputError(
            f"run {run_row['id']}: no clutter map is learnt (`tracks.clutter.learnt`), so echoes that stand are in the picture: "
            "`coastwatch query stationary`"
        )
    return in_operator_units(store.standing_echoes(found, run_row["id"]))


def registration(rows: Rows, settings: Mapping[str, Any]) -> Rows:
    """The rows of `sensors` as a table for a screen: an error and its standard deviation in one cell, the evidence in another.

    Args: settings: of the run.
    """
    false_alarm = settings.get("registration", {}).get("false_alarm")
    names = ("kind", "name", "region", "latitude_deg", "longitude_deg", "range_nm", "specification", "heard_utc")
    made = []
    for row in rows.rows:
        s = dict(zip(rows.columns, row, strict=True))
        spec = " ".join(f"{key}={round(value, 3):g}" for key, value in (s["spec"] or {}).items())
        errors = [_with_sigma(s[value], s.get(sigma)) for value, sigma in ERRORS]
        site = (s["kind"], s["name"], s["region"], s["latitude_deg"], s["longitude_deg"])
        range_nm = None if s["range_m"] is None else round(s["range_m"] / NAUTICAL_MILE_M, 2)
        known = spec, s["heard_utc"], s["state"], *errors, s["time_jitter_s"], s["vessels"], _evidence(s, false_alarm)
        made.append((*site, range_nm, *known))
    return Rows((*names, "state", *(value for value, _ in ERRORS), "time_jitter_s", "vessels", "evidence"), made)


def _evidence(s: Mapping[str, Any], false_alarm: float | None) -> str | None:
    """What is known of the registration of a radar, or of a track source, in words. Args: s: a row of `sensors`."""
    if s["kind"] == "tracks" and s["states"] is not None:
        sigma = f"{s['position_sigma_m']:.1f} m and {s['velocity_sigma_m_s']:.2f} m/s of those without covariance"
        partners = f"{s['vessels']} differences to AIS" if s["vessels"] else "as set"
        return f"{s['tracks']:,} tracks, {s['states']:,} states, {s['dropped']:,} dropped; {sigma}, {partners}"
    if s["state"] == "unknown":
        return "no plots" if s["compared"] is None else "no AIS vessel in cover"
    if s["state"] is None or s["odds"] is None:
        return None
    said = f"{rounded(s['candidate_azimuth_deg'], 1):.1f} deg {rounded(s['candidate_range_m'], 0):.0f} m: {_odds(s['odds'])}"
    said += f", {s['voices']} voices, rival {100.0 * s['rival_share']:.0f} %"
    if s["found_odds"] is not None:
        return f"{said}, {_odds(s['found_odds'])} when found"
    return said if false_alarm is None else f"{said}, wants {_odds(1.0 / false_alarm)}"


def _odds(value: float) -> str:
    """Odds as people write them."""
    return (
        f"{value:,.0f} to 1"
        if 1.0 <= value < 1e7
        else f"{value:.0e} to 1"
        if value >= 1e7
        else f"1 to {min(1.0 / max(value, 1e-6), 1e6):,.0f}"
    )


def _with_sigma(value: float | None, sigma: float | None) -> str | None:
    if value is None:
        return None
    return f"{rounded(value, 3):.3f}" + ("" if sigma is None else f" +- {sigma:.3f}")


def questions() -> Rows:
    """Name, title and parameters of every question."""
    rows: list[tuple[Any, ...]] = []
    for name, question in store.operator_queries().items():
        parameters = [
            f"{key}{'' if p.default is None else f'={p.default}'} ({p.meaning})" for key, p in question.parameters.items()
        ]
        rows.append((name, question.title, "; ".join(parameters)))
    return Rows(("question", "answers", "parameters"), rows)


def answer(found: Store, name: str, parameters: Mapping[str, str], at_s: float | None = None) -> Rows:
    """The answer to a question, now or at an instant. Raises: InputError, StoreError."""
    known = store.operator_queries()
    if name not in known:
        raise InputError(f"query: got {name!r}, needed one of {', '.join(known)}{did_you_mean(name, known)}")
    takes = known[name].parameters
    unknown = [key for key in parameters if key not in (*takes, "run")]
    missing = [key for key, p in takes.items() if p.default is None and key not in parameters]
    if unknown or missing:
        got = f"got {', '.join(unknown)}" if unknown else f"got no {', '.join(missing)}"
        hint = did_you_mean(unknown[0], takes) if unknown else ""
        raise InputError(f"query {name}: {got}, needed --set with {', '.join((*takes, 'run'))}{hint}")
    try:
        return in_operator_units(store.operator_query(found, name, parameters, at_s))
    except ParameterError as error:
        raise InputError(str(error)) from error


def in_operator_units(rows: Rows | Table) -> Rows:
    """The same rows in the units of an operator. Columns of instants are renamed from `_s` to `_utc`."""
    makers = [_maker(name) for name in rows.columns]
    names = tuple(map(name_in_operator_units, rows.columns))
    made = [tuple(None if v is None else make(v) for v, make in zip(row, makers, strict=True)) for row in rows.rows]
    return Rows(names, made)


def name_in_operator_units(name: str) -> str:
    """The name of a column in the units of an operator."""
    return f"{name[:-2]}_utc" if name in store.INSTANTS else name


def utc_text(time_s: float) -> str:
    """Seconds since the Unix epoch as ISO 8601 text, UTC."""
    return datetime.fromtimestamp(time_s, UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")


def flag_words(flags: int) -> str:
    """The names of the flags in lower case, with spaces between."""
    return " ".join(str(flag.name).lower() for flag in Flag(flags))


def _maker(name: str) -> Callable[[Any], Any]:
    if name in store.INSTANTS:
        return lambda value: utc_text(float(value))
    if name == "mmsi" or name.endswith("_mmsi"):
        return lambda value: f"{int(value):09d}"
    if name == "nav_status":
        return lambda value: nav_status_text(value) if isinstance(value, int) else value
    if name == "flags":
        return lambda value: flag_words(int(value)) if isinstance(value, int) else value
    digits = digits_of(name)
    if name in COURSES:
        return lambda value: rounded(value, digits) % 360.0 if isinstance(value, float) else value
    return lambda value: rounded(value, digits) if isinstance(value, float) else value
