"""Rows of the store in the units of an operator: UTC, MMSI with nine digits, flags as words, rounded numbers."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

from coastwatch import store
from coastwatch.batches import Flag
from coastwatch.geodesy import NAUTICAL_MILE_M
from coastwatch.operators.bad_input import BadInput
from coastwatch.store import Rows, Store, Table
from coastwatch.store.questions import ParameterError

DIGITS = {
    "latitude_deg": 6,
    "longitude_deg": 6,
    "sog_kn": 2,
    "statistic": 3,
    "share": 4,
    "azimuth_bias_deg": 4,
    "azimuth_sigma_deg": 4,
    "azimuth_change_deg": 4,
}
ENDINGS = {"_deg": 2, "_deg_s": 4, "_m": 1, "_nm": 3, "_kn": 2, "_ms": 3, "_s": 3, "_min": 2}
MAIN_COLUMNS = (
    "vessel_id",
    "mmsi",
    "name",
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


Box = tuple[float, float, float, float]


@dataclass(frozen=True)
class Vessel:
    """The details of one vessel, and its tables: tracks, history and others."""

    details: dict[str, Any]
    tables: dict[str, Rows]

    def as_object(self) -> dict[str, Any]:
        """The same as plain values: each table a list of objects."""
        lists = {key: [dict(zip(rows.columns, row, strict=True)) for row in rows.rows] for key, rows in self.tables.items()}
        return {**self.details, **lists}


@contextmanager
def opened(url: str) -> Iterator[Store]:
    """The database, which must exist. Raises: StoreError."""
    with store.open_store(url, create=False) as found:
        yield found


def run(found: Store, run_id: int | None) -> dict[str, Any]:
    """The run with this number, or the latest. Raises: StoreError if there is none."""
    return store.run(found, store.latest_run(found) if run_id is None else run_id)


def runs(found: Store) -> Rows:
    """Every run, newest first, with its scores; `scores` is a dict."""
    listed = store.runs(found)
    names = ("run", *listed.columns[1:])
    return for_people(Rows(names, listed.rows))


def runs_table(rows: Rows) -> Rows:
    """The rows of `runs` as a table for a screen, with the main scores."""
    made = []
    for row in rows.rows:
        of = dict(zip(rows.columns, row, strict=True))
        scores = of["scores"] or {}
        main = [(scores.get(stage) or {}).get(name) for stage, name in MAIN_SCORES]
        cycles = f"{of['cycles_stored']} of {of['cycles']}"
        about = (of[name] for name in ("run", "scenario", "seed", "version", "status"))
        figures = [round(value, 4) if isinstance(value, float) else value for value in main]
        made.append((*about, cycles, of["started_utc"], *figures, _verdict(of["verdict"])))
    columns = ("run", "scenario", "seed", "version", "status", "cycles", "started_utc")
    return Rows((*columns, *(f"{stage}.{name}" for stage, name in MAIN_SCORES), "verdict"), made)


def _verdict(sentences: list[str] | None) -> str | None:
    return None if sentences is None else f"{len(sentences)} fell" if sentences else "good"


def heading(of_run: Mapping[str, Any], rows: Rows) -> str:
    """Which run a picture is of, its instant, and how the run ended. Args: of_run: as of `run`; rows: as of `picture`."""
    done, ends = of_run["cycles_stored"], ENDS.get(of_run["status"])
    newest = max(rows.column("time_utc"), default=utc_text(of_run["start_s"] + done * of_run["period_s"]))
    said = f"run {of_run['id']} of {of_run['scenario']}, seed {of_run['seed']}: {len(rows.rows)} vessels at {newest}"
    return said + (f"; {ends} after cycle {done} of {of_run['cycles']}" if ends else "")


def picture(found: Store, run_id: int, at_s: float | None, bbox: Box | None) -> Rows:
    """The picture, one row per vessel, in the units of an operator."""
    return for_people(store.picture(found, run_id, at_s, bbox))


def traffic(found: Store, run_id: int, bbox: Box, span_s: tuple[float, float]) -> Rows:
    """The vessels in a box between two instants. Raises: BadInput, StoreError."""
    return for_people(store.traffic(found, run_id, bbox, *_span(span_s)))


def encounters(found: Store, run_id: int, bbox: Box, span_s: tuple[float, float], limits: Mapping[str, Any]) -> Rows:
    """Pairs of vessels that came close to each other. Args: limits: as of `store.encounters`. Raises: BadInput, StoreError."""
    for name, value in limits.items():
        if not 0.0 <= value < float("inf"):
            raise BadInput(f"{name}: got {value:g}, needed 0 or more")
    return for_people(store.encounters(found, run_id, bbox, *_span(span_s), **limits))


def _span(span_s: tuple[float, float]) -> tuple[float, float]:
    if span_s[0] > span_s[1]:
        raise BadInput(f"--from: got {utc_text(span_s[0])}, needed an instant before --to, {utc_text(span_s[1])}")
    return span_s


def main_columns(rows: Rows) -> Rows:
    """The columns of MAIN_COLUMNS."""
    keep = [rows.columns.index(name) for name in MAIN_COLUMNS if name in rows.columns]
    return Rows(tuple(rows.columns[k] for k in keep), [tuple(row[k] for k in keep) for row in rows.rows])


def vessel(found: Store, run_id: int, vessel_id: int) -> Vessel:
    """Details and tables of one vessel. Raises: StoreError if the run never had it."""
    track = store.track(found, run_id, vessel_id)
    details = track.pop("vessel")
    row = for_people(Rows(tuple(details), [tuple(details.values())]))
    tables = {key.replace("_", " "): for_people(rows) for key, rows in track.items() if key != "stays"}
    return Vessel({"run": run_id, **dict(zip(row.columns, row.rows[0], strict=True))}, tables)


def sensors(found: Store, run_id: int, at_s: float | None) -> Rows:
    """One row per sensor with all its columns."""
    return for_people(store.sensor_states(found, run_id, at_s))


def registration(rows: Rows) -> Rows:
    """The rows of `sensors` as a table for a screen, with an error and its standard deviation in one cell."""
    names = ("kind", "name", "region", "latitude_deg", "longitude_deg", "range_nm", "specification", "heard_utc")
    made = []
    for row in rows.rows:
        s = dict(zip(rows.columns, row, strict=True))
        spec = " ".join(f"{key}={round(value, 3):g}" for key, value in s["spec"].items())
        errors = [_with_sigma(s[value], s.get(sigma)) for value, sigma in ERRORS]
        site = (s["kind"], s["name"], s["region"], s["latitude_deg"], s["longitude_deg"])
        made.append((*site, round(s["range_m"] / NAUTICAL_MILE_M, 2), spec, s["heard_utc"], s["state"], *errors, s["vessels"]))
    return Rows((*names, "state", *(value for value, _ in ERRORS), "vessels"), made)


def _with_sigma(value: float | None, sigma: float | None) -> str | None:
    return None if value is None else f"{value:.3f}" if sigma is None else f"{value:.3f} +- {sigma:.3f}"


def questions() -> Rows:
    """Name, title and parameters of every question."""
    rows: list[tuple[Any, ...]] = []
    for name, question in store.operator_queries().items():
        parameters = [
            f"{key}{'' if p.default is None else f'={p.default}'} ({p.meaning})" for key, p in question.parameters.items()
        ]
        rows.append((name, question.title, "; ".join(parameters)))
    return Rows(("question", "answers", "parameters"), rows)


def answer(found: Store, name: str, parameters: Mapping[str, str]) -> Rows:
    """The answer to a question. Raises: BadInput, StoreError."""
    known = store.operator_queries()
    if name not in known:
        raise BadInput(f"query: got {name!r}, needed one of {', '.join(known)}")
    takes = known[name].parameters
    unknown = [key for key in parameters if key not in (*takes, "run")]
    missing = [key for key, p in takes.items() if p.default is None and key not in parameters]
    if unknown or missing:
        got = f"got {', '.join(unknown)}" if unknown else f"got no {', '.join(missing)}"
        raise BadInput(f"query {name}: {got}, needed --set with {', '.join((*takes, 'run'))}")
    try:
        return for_people(store.operator_query(found, name, parameters))
    except ParameterError as error:
        raise BadInput(str(error)) from error


def for_people(rows: Rows | Table) -> Rows:
    """The same rows in the units of an operator. Columns of instants are renamed from `_s` to `_utc`."""
    makers = [_maker(name) for name in rows.columns]
    names = tuple(f"{name[:-2]}_utc" if name in store.INSTANTS else name for name in rows.columns)
    made = [tuple(None if v is None else make(v) for v, make in zip(row, makers, strict=True)) for row in rows.rows]
    return Rows(names, made)


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
    if name == "flags":
        return lambda value: flag_words(int(value)) if isinstance(value, int) else value
    ending = max((e for e in ENDINGS if name.endswith(e)), key=len, default="")
    digits = DIGITS.get(name, ENDINGS.get(ending, 6))
    return lambda value: round(value, digits) if isinstance(value, float) else value
