"""Rows of the store in the units of an operator: UTC, MMSI with nine digits, flags as words, rounded numbers."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypedDict, cast

import numpy as np

from coastwatch import store
from coastwatch.batches import COVER_AZIMUTHS, COVER_RANGES, Flag, Floats, nav_status_text
from coastwatch.errors import InputError
from coastwatch.geodesy import NAUTICAL_MILE_M
from coastwatch.operators.columns import digits_of, rounded
from coastwatch.operators.typed import Box
from coastwatch.spelling import utc_text
from coastwatch.store import QueryLimit, Rows, Store, Table
from coastwatch.store.runs import ENDLESS, Run as Run

MAIN_COLUMNS = (
    "vessel_id", "mmsi", "name", "nav_status", "latitude_deg", "longitude_deg", "sog_kn", "cog_deg", "major_m", "updated_utc",
    "sources", "flags",
)  # fmt: skip
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
    ("range_scale", "range_scale_sigma"),
    ("time_lag_s", ""),
    ("estimated_lag_s", "lag_sigma_s"),
    ("site_east_m", "site_sigma_m"),
    ("site_north_m", ""),
)
"""Registration errors of a sensor and their standard deviations. A lag is subtracted only once it is accurate.
Those of scale and site are known where they seem to be wrong alone."""


STATISTICS = {
    "windowed_covariance": "log-likelihood ratio that both tracks are one vessel, summed over cycles: larger is surer",
    "windowed_covariance_literal": "distance of the tracks over their covariance, squared: smaller is surer",
    "bearing_likelihood": "log odds that the bearings are of this vessel: larger is surer",
    "bearing_windowed_covariance": "distance of bearing and rate over their covariance, squared: smaller is surer",
}
"""What the statistic of an association means, by the method that decided."""

LAST = 2**62
"""The last cycle of a stay that lasts."""

COURSES = ("cog_deg", "bearing_deg")  # never 360.00
WORDS = ("flags", "nav_status")  # numbers that people read as words
NAMED_SOURCES = ("source", "first_source", "second_source")


class Sensor(TypedDict):
    """A row of `sensors`."""

    kind: str
    name: str
    region: str | None
    latitude_deg: float | None
    longitude_deg: float | None
    range_m: float | None
    spec: dict[str, float] | None
    heard_utc: str | None
    state: str | None
    range_noise_factor: float | None  # learnt standard deviation over the stated one, of a radar
    azimuth_noise_factor: float | None
    turn_s: float | None  # of a radar that sends video, and so are the next eight
    spokes_a_turn: int | None
    spokes_lost: int | None
    parts_lost: int | None
    lost_share: float | None
    plots_a_turn: float | None
    threshold_db: float | None
    detection_probability: float | None
    false_plots_a_turn: float | None
    time_jitter_s: float | None
    vessels: int | None
    compared: int | None
    odds: float | None  # against chance, of the candidate of a registration
    candidate_azimuth_deg: float
    candidate_range_m: float
    voices: int
    rival_share: float
    found_odds: float | None
    tracks: int  # of a track source, and so are the next four
    states: int | None
    dropped: int
    position_sigma_m: float
    velocity_sigma_m_s: float


@dataclass(frozen=True)
class Vessel:
    """The details of one vessel, and its tables: tracks, history and others."""

    details: dict[str, object]
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
        paths = [[row for row in rows.rows if first <= row[at] <= last] for first, last in self.stays]
        return [Rows(rows.columns, path) for path in paths if path]


def opened(url: str, limit: QueryLimit | None = None) -> Store:
    """The database, which must exist, for a `with` block. Args: limit: of each read transaction. Raises: StoreError."""
    return store.open_store(url, create=False, limit=limit)


def run(database: Store, run_id: int | None) -> Run:
    """The run with this number, or the latest. Raises: StoreError if there is none."""
    return store.run(database, store.latest_run(database) if run_id is None else run_id)


def run_of_time(
    database: Store, run_id: int | None, at_s: float | None = None, span_s: tuple[float | None, float | None] = (None, None)
) -> tuple[Run, str]:
    """The run to answer from, and a sentence where others of the same server hold the time, or part of it, too; else empty.

    It is the one with this number; none: the newest of the server that holds the instant, or some of the span; else the latest.
    Raises: StoreError if there is none.
    """
    if run_id is not None:
        return run(database, run_id), ""
    newest = store.latest_run(database)
    if at_s is not None:
        then = store.run_at(database, newest, at_s)
        return run(database, then), "" if then == newest else f"this answer is of run {then}: run {newest} began later"
    if span_s == (None, None):
        return run(database, newest), ""
    return run(database, (held := store.runs_between(database, newest, *span_s))[0]), of_other_runs(held, newest)


def of_other_runs(held: Sequence[int], newest: int) -> str:
    """A sentence where an answer from the first of some runs of a server is not all there is; else empty. Args: newest: run."""
    parts = [] if held[0] == newest else [f"this answer is of run {held[0]}: run {newest} began later"]
    if len(held) > 1:
        runs, has = ("run", "has") if len(held) == 2 else ("runs", "have")
        parts.append(
            f"{runs} {', '.join(map(str, held[1:]))} of the same server {has} some of that time too: ask for a run by its number"
        )
    return "; ".join(parts)


def runs(database: Store) -> Rows:
    """Every run, newest first, with its scores; `scores` is a dict."""
    listed = store.runs(database)
    names = ("run", *listed.columns[1:])
    return in_operator_units(Rows(names, listed.rows))


def runs_table(rows: Rows) -> Rows:
    """The rows of `runs` as a table for a screen, with the main scores."""
    table = []
    for row in rows.rows:
        one = dict(zip(rows.columns, row, strict=True))
        scores, fell = one["scores"] or {}, one["verdict"]
        main = [(scores.get(stage) or {}).get(name) for stage, name in MAIN_SCORES]
        about = (one[name] for name in ("run", "scenario", "seed", "version", "status"))
        figures = [round(value, 4) if isinstance(value, float) else value for value in main]
        faults = sum(fault["count"] for fault in one["faults"])
        verdict = None if fell is None else f"{len(fell)} fell" if fell else "good"
        cycles = _cycles(one["cycles_stored"], one["cycles"])
        table.append((*about, cycles, one["started_utc"], faults, *figures, verdict))
    columns = ("run", "scenario", "seed", "version", "status", "cycles", "started_utc", "faults")
    return Rows((*columns, *(f"{stage}.{name}" for stage, name in MAIN_SCORES), "verdict"), table)


def heading(run_row: Run, rows: Rows) -> str:
    """Which run a picture is of, its instant, and how the run ended. Args: run_row: as of `run`; rows: as of `picture`."""
    newest = max(rows.column("time_utc"), default=utc_text(run_row["start_s"] + run_row["cycles_stored"] * run_row["period_s"]))
    text = f"run {run_row['id']} of {run_row['scenario']}, seed {run_row['seed']}: {len(rows.rows)} vessels at {newest}"
    return f"{text}; {ending(run_row)}" if ending(run_row) else text


def ending(run_row: Run) -> str:
    """How a run that has not finished ended, such as "the run died after cycle 3 of 9"; empty if it finished."""
    ends = ENDS.get(run_row["status"])
    return f"{ends} after cycle {_cycles(run_row['cycles_stored'], run_row['cycles'])}" if ends else ""


def beyond_end(database: Store, run_row: Run, at_s: float | None) -> str:
    """A sentence if an instant is more than a period after the last cycle of a run; empty if not. Args: run_row: as of `run`."""
    last_s = None if at_s is None else store.last_instant(database, run_row["id"])
    if at_s is None or last_s is None or at_s <= last_s + run_row["period_s"]:
        return ""
    return f"run {run_row['id']} holds nothing at {utc_text(at_s)}: its last cycle is at {utc_text(last_s)}, and this answer is of then"


def _cycles(stored: int, planned: int) -> str:
    """Cycles stored, and of how many; a live run has no end."""
    return f"{stored}" if planned >= ENDLESS else f"{stored} of {planned}"


def picture(database: Store, run_id: int, at_s: float | None, bbox: Box | None) -> Rows:
    """The picture, one row per vessel, in the units of an operator."""
    return in_operator_units(store.picture(database, run_id, at_s, bbox))


def traffic(database: Store, run_id: int, bbox: Box, span_s: tuple[float, float]) -> Rows:
    """The vessels in a box between two instants. Raises: InputError, StoreError."""
    check_span(*span_s)
    return in_operator_units(store.traffic(database, run_id, bbox, *span_s))


def encounters(
    database: Store, run_id: int, bbox: Box, span_s: tuple[float, float], *, within_m: float, min_sog_kn: float, count: int
) -> Rows:
    """Pairs of vessels that came close to each other. Args: as of `store.encounters`. Raises: InputError, StoreError."""
    for name, value in (("within_m", within_m), ("min_sog_kn", min_sog_kn), ("count", count)):
        if not 0.0 <= value < float("inf"):
            raise InputError(f"{name}: got {value:g}, needed 0 or more")
    check_span(*span_s)
    return in_operator_units(store.encounters(database, run_id, bbox, *span_s, within_m, min_sog_kn, count))


def check_span(from_s: float | None, to_s: float | None) -> None:
    """Raises: InputError where a span of time ends before it begins."""
    if from_s is not None and to_s is not None and from_s > to_s:
        raise InputError(f"--from: got {utc_text(from_s)}, needed an instant before --to, {utc_text(to_s)}")


TABLES = ("history", "decided", "events", "members", "associations", "bearing_associations")
"""Of a vessel, in this order."""


def vessel(database: Store, run_row: Run, vessel_id: int) -> Vessel:
    """Details and tables of one vessel. Args: run_row: as of `run`. Raises: StoreError if the run never had it."""
    track = store.track(database, run_row["id"], vessel_id)
    row = in_operator_units(Rows(tuple(track.vessel), [tuple(track.vessel.values())]))
    names = {number: name for number, name, _ in store.sources(database, run_row["id"]).rows}
    tables = {}
    for key in TABLES:
        rows: Rows = getattr(track, key)
        columns = tuple("track_id" if name == "bearing_track" else name for name in rows.columns)
        at = {k for k, name in enumerate(columns) if name in NAMED_SOURCES}
        if at:  # with the names of sources in the place of their numbers
            values = [tuple(names.get(v, v) if k in at else v for k, v in enumerate(row)) for row in rows.rows]
            rows = Rows(columns, values)
        tables[key.replace("_", " ")] = in_operator_units(rows)
    methods = {key: run_row["settings"].get(key, {}).get("method") for key in ("associations", "bearing_associations")}
    return Vessel(
        {"run": run_row["id"], **dict(zip(row.columns, row.rows[0], strict=True))},
        tables,
        {key.replace("_", " "): STATISTICS[method] for key, method in methods.items() if method in STATISTICS},
        tuple((first, LAST if last is None else last) for first, last, _ in track.stays.rows),
    )


def decided_path(database: Store, run_id: int, vessel_id: int) -> Rows:
    """The corrected past of a vessel, by time. Raises: StoreError if the run never had it."""
    return in_operator_units(store.decided_path(database, run_id, vessel_id))


SILENT_TURNS, SILENT_LEAST_S, SILENT_AIS_S = 3.0, 10.0, 60.0
"""A radar is silent after so many turns without a report, a sonar after so many intervals, at least after 10 s; AIS after 60 s."""


def sensors(database: Store, run_id: int, at_s: float | None) -> Rows:
    """One row per sensor with all its columns, and its health: heard, silent or never heard, in the cycle that its row is of."""
    states = store.sensor_states(database, run_id, at_s)
    with_health = []
    for row in states.rows:
        sensor = dict(zip(states.columns, row, strict=True))
        health = None
        if sensor["kind"] in ("radar", "ais", "bearing") and sensor["time_s"] is not None:  # else nothing is expected
            spec = sensor["spec"] or {}
            turn_s = spec.get("period_s", spec.get("interval_s"))
            allowed_s = SILENT_AIS_S if turn_s is None else max(SILENT_TURNS * turn_s, SILENT_LEAST_S)
            if sensor["heard_s"] is None:
                health = "never heard"
            else:
                health = "silent" if sensor["time_s"] - sensor["heard_s"] > allowed_s else "heard"
        with_health.append((*row, health))
    return in_operator_units(Rows((*states.columns, "health"), with_health))


COVER_COLUMNS = ("ais_detection", "ais_looks", "track_detection", "track_looks")
CLUTTER_COLUMNS = ("false_plots_per_km2", "turns")


def radar_cover(database: Store, run_id: int, clutter: bool, sectors: int, rings: int) -> Rows:
    """The learnt cover of each radar, or the density of its false plots, in so many sectors and rings.

    Sectors of several cells have the mean: of a detection probability by looks, of a density by area. Cells without a look, or
    without a false plot, are left out.
    Args: sectors, rings: divisors of the cells of `RadarCover`.
    Raises: InputError: no cover is stored.
    """
    names, cover = store.radar_covers(database, run_id)
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
        of_ais, of_tracks = np.where(looks > 0.0, detection[0], np.nan), np.where(track_looks > 0.0, detection[1], np.nan)
        shown, values = (looks > 0.0) | (track_looks > 0.0), (of_ais, looks, of_tracks, track_looks)
    radar, sector, ring = np.nonzero(shown)
    width, step = 360.0 / sectors, COVER_RANGES // rings
    borders = sector * width, (sector + 1) * width, edges_nm[radar, ring * step], edges_nm[radar, (ring + 1) * step]
    numbers = np.stack([*borders, *(value[shown] for value in values)], 1)
    cells = [(names[r], *(None if np.isnan(v) else v for v in row)) for r, row in zip(radar, numbers.tolist(), strict=True)]
    return in_operator_units(Rows(("name", "from_deg", "to_deg", "from_nm", "to_nm", *columns), cells))


def standing_echoes(database: Store, run_row: Run) -> Rows:
    """The echoes that the clutter maps of radars hide, one row each, by radar. Args: run_row: as of `run`.

    Raises: InputError: no clutter map is learnt.
    """
    rows = store.standing_echoes(database, run_row["id"])
    if (run_row["settings"].get("tracks", {}).get("clutter") or {}).get("learnt") is not True and not rows.rows:
        raise InputError(
            f"run {run_row['id']}: no clutter map is learnt (`tracks.clutter.learnt`), so echoes that stand are in the picture: "
            "`coastwatch query stationary`"
        )
    return in_operator_units(rows)


def registration(rows: Rows, run_row: Run) -> Rows:
    """The rows of `sensors` as a table for a screen: an error and its standard deviation in one cell, the evidence in another."""
    false_alarm = run_row["settings"].get("registration", {}).get("false_alarm")
    table = []
    for row in rows.rows:
        values = dict(zip(rows.columns, row, strict=True))
        sensor = cast(Sensor, values)
        spec = " ".join(f"{key}={round(value, 3):g}" for key, value in (sensor["spec"] or {}).items())
        errors = []
        for name, sigma in ERRORS:
            text = None if values[name] is None else f"{rounded(values[name], 3):.3f}"
            errors.append(text if text is None or values.get(sigma) is None else f"{text} +- {values[sigma]:.3f}")
        range_nm = None if sensor["range_m"] is None else round(sensor["range_m"] / NAUTICAL_MILE_M, 2)
        site = (sensor["kind"], sensor["name"], sensor["region"], sensor["latitude_deg"], sensor["longitude_deg"], range_nm)
        factors = (sensor["range_noise_factor"], sensor["azimuth_noise_factor"])
        noise = None if factors[0] is None else " ".join("-" if f is None else f"{f:.2f}" for f in factors)
        estimate = (sensor["heard_utc"], sensor["state"], *errors, noise, sensor["time_jitter_s"], sensor["vessels"])
        table.append((*site, spec, *estimate, _evidence(sensor, false_alarm), _video(sensor)))
    names = ("kind", "name", "region", "latitude_deg", "longitude_deg", "range_nm", "specification", "heard_utc", "state")
    return Rows(
        (*names, *(value for value, _ in ERRORS), "noise_factors", "time_jitter_s", "vessels", "evidence", "video"), table
    )


def _video(s: Sensor) -> str | None:
    """The health of the video of a radar in words; none: it sends none."""
    lost = None if s["spokes_lost"] is None else f"{s['spokes_lost']} spokes, {s['parts_lost']} parts"
    share = None if s["lost_share"] is None else f"{100.0 * s['lost_share']:.1f} % of the last minute"
    texts = (
        _said(s["turn_s"], "turn {:.2f} s"),
        _said(s["spokes_a_turn"], "{} spokes a turn"),
        _said(lost, "lost {}") if share is None else f"lost {lost}, {share}",
        _said(s["plots_a_turn"], "{:.1f} plots a turn"),
        _said(s["threshold_db"], "threshold {:.1f} dB"),
        _said(s["detection_probability"], "P_D {:.2f}"),
        _said(s["false_plots_a_turn"], "{:.1f} false plots a turn"),
    )
    return "; ".join(text for text in texts if text is not None) or None


def _said(value: float | str | None, form: str) -> str | None:
    """A value in words; none: it is not known."""
    return None if value is None else form.format(value)


def _evidence(s: Sensor, false_alarm: float | None) -> str | None:
    """What is known of the registration of a radar, or of a track source, in words."""
    if s["kind"] == "tracks" and s["states"] is not None:
        sigma = f"{s['position_sigma_m']:.1f} m and {s['velocity_sigma_m_s']:.2f} m/s of those without covariance"
        partners = f"{s['vessels']} differences to AIS" if s["vessels"] else "as set"
        return f"{s['tracks']:,} tracks, {s['states']:,} states, {s['dropped']:,} dropped; {sigma}, {partners}"
    if s["state"] == "unknown":
        return "no plots" if s["compared"] is None else "no AIS vessel in cover"
    if s["state"] is None or s["odds"] is None:
        return None
    text = f"{rounded(s['candidate_azimuth_deg'], 1):.1f} deg {rounded(s['candidate_range_m'], 0):.0f} m: {_odds(s['odds'])}"
    text += f", {s['voices']} voices, rival {100.0 * s['rival_share']:.0f} %"
    if s["found_odds"] is not None:
        return f"{text}, {_odds(s['found_odds'])} when found"
    return text if false_alarm is None else f"{text}, wants {_odds(1.0 / false_alarm)}"


def _odds(value: float) -> str:
    """Odds as people write them."""
    if value < 1.0:
        return f"1 to {min(1.0 / max(value, 1e-6), 1e6):,.0f}"
    return f"{value:,.0f} to 1" if value < 1e7 else f"{value:.0e} to 1"


def questions() -> Rows:
    """Name, title and parameters of every question."""
    rows = []
    for name, question in store.operator_queries().items():
        parameters = [
            f"{key}{'' if p.default is None else f'={p.default}'} ({p.meaning})" for key, p in question.parameters.items()
        ]
        rows.append((name, question.title, "; ".join(parameters)))
    return Rows(("question", "answers", "parameters"), rows)


def answer(database: Store, name: str, parameters: Mapping[str, str], at_s: float | None = None) -> Rows:
    """The answer to a question, now or at an instant. Raises: StoreError, QuestionError: as of `store.operator_query`."""
    return in_operator_units(store.operator_query(database, name, parameters, at_s))


def in_operator_units(rows: Rows | Table) -> Rows:
    """The same rows in the units of an operator. Columns of instants are renamed from `_s` to `_utc`."""
    conversions = [_conversion(name) for name in rows.columns]
    values = [tuple(convert(v) for v, convert in zip(row, conversions, strict=True)) for row in rows.rows]
    return Rows(tuple(map(name_in_operator_units, rows.columns)), values)


def name_in_operator_units(name: str) -> str:
    """The name of a column in the units of an operator."""
    return f"{name[:-2]}_utc" if name in store.INSTANTS else name


def flag_words(flags: int) -> str:
    """The names of the flags in lower case, with spaces between."""
    return " ".join(str(flag.name).lower() for flag in Flag(flags))


def _conversion(name: str) -> Callable[[object], object]:
    """What makes the value for an operator of a value of a column. An absent value, and a text, stays as it is."""
    if name in store.INSTANTS:
        return lambda value: utc_text(float(value)) if isinstance(value, int | float | np.number) else value
    if name == "mmsi" or name.endswith("_mmsi"):
        return lambda value: f"{int(value):09d}" if isinstance(value, int | np.integer) else value
    if name == "nav_status":
        return lambda value: nav_status_text(value) if isinstance(value, int) else value
    if name == "flags":
        return lambda value: flag_words(value) if isinstance(value, int) else value
    digits = digits_of(name)
    if name in COURSES:
        return lambda value: rounded(value, digits) % 360.0 if isinstance(value, float) else value
    return lambda value: rounded(value, digits) if isinstance(value, float) else value
