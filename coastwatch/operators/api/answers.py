"""What the API answers: rows of the live picture and of the store, as JSON, GeoJSON, CSV or Parquet."""

from __future__ import annotations

import argparse
import hashlib
import json
import pathlib
import re
from collections.abc import Callable, Mapping, Sequence
from typing import Annotated, Any, Literal, TypeVar, get_args

import numpy as np
from fastapi import APIRouter, Depends, HTTPException, Path, Query, Request, Response
from pydantic import BaseModel, ConfigDict, Field

from coastwatch import store
from coastwatch.batches import COVER_AZIMUTHS, COVER_RANGES, Bools, Flag, Ints
from coastwatch.errors import InputError
from coastwatch.operators import export, presentation
from coastwatch.operators.api.service import Service
from coastwatch.operators.api.validation import CheckedRoute
from coastwatch.operators.api.wire import Encoder
from coastwatch.operators.selection import order, selected
from coastwatch.operators.typed import box, utc
from coastwatch.server.live_picture import KIND_OF_SOURCE, LivePicture
from coastwatch.shipped import scenarios_folder
from coastwatch.spelling import utc_text
from coastwatch.store import NotThere, Rows
from coastwatch.store.bbox import Box, inside
from coastwatch.store.read.picture_queries import COLUMNS

T = TypeVar("T")
MOST_ROWS, MOST_IDS, MOST_FOUND, NEWEST_POINTS = 10_000, 200, 50, 500
LARGEST_ID = 2**62
FORMATS = {
    "application/json": "json",
    "application/geo+json": "geojson",
    "text/csv": "csv",
    "application/vnd.apache.parquet": "parquet",
}
TYPES = {form: kind for kind, form in FORMATS.items()}
KINDS = {kind.name.lower(): bit for kind, bit in KIND_OF_SOURCE.items()}
FLAGS = {str(flag.name).lower(): int(flag) for flag in Flag}

Form = Literal["json", "geojson", "csv", "parquet"]
FormWithoutPositions = Literal["json", "csv", "parquet"]
Text = Annotated[str | None, Field(max_length=200)]
Limit = Annotated[int, Field(ge=0, le=MOST_ROWS)]
VesselId = Annotated[int, Path(ge=0, le=LARGEST_ID)]
Offset = Annotated[int, Field(ge=0, le=LARGEST_ID)]


class Refusal(BaseModel):
    """Why a request is refused, in one sentence."""

    detail: str


REFUSALS: dict[int | str, dict[str, Any]] = {
    status: {"description": reason, "model": Refusal}
    for status, reason in {
        400: "a parameter is wrong",
        401: "a token is needed",
        403: "the role does not suffice, or the host or origin is foreign",
        404: "there is none",
        413: "the body is too large",
        414: "the path or query is too long",
        422: "a parameter is not of its type",
        429: "too many requests; Retry-After says when to ask again",
        431: "the headers are too large",
        503: "there is no picture yet, the database is away, or the question takes too long",
    }.items()
}
ROWS: dict[int | str, dict[str, Any]] = {
    200: {
        "description": "the rows",
        "content": {
            "application/json": {"schema": {"type": "object"}},
            "application/geo+json": {"schema": {"type": "object"}},
            "text/csv": {"schema": {"type": "string"}},
            "application/vnd.apache.parquet": {"schema": {"type": "string", "format": "binary"}},
        },
    }
}


WITHOUT_POSITIONS: dict[int | str, dict[str, Any]] = {
    200: {
        **ROWS[200],
        "content": {kind: schema for kind, schema in ROWS[200]["content"].items() if kind != TYPES["geojson"]},
    }
}


def service_of(request: Request) -> Service:
    """The service of the application."""
    service: Service = request.app.state.service
    return service


def form_of(request: Request, format: Form | None = None) -> str:  # noqa: A002 (the name of a query parameter)
    """The format that is asked for: by `?format=`, else by the first known type in Accept, else JSON."""
    return format or _accepted(request, get_args(Form))


def form_without_positions(request: Request, format: FormWithoutPositions | None = None) -> str:  # noqa: A002 (as above)
    """The same for rows that have no position, which are no GeoJSON."""
    return format or _accepted(request, get_args(FormWithoutPositions))


def _accepted(request: Request, forms: Sequence[str]) -> str:
    wanted = [part.split(";")[0].strip() for part in request.headers.get("accept", "").split(",")]
    return next((FORMATS[kind] for kind in wanted if FORMATS.get(kind) in forms), "json")


In = Annotated[Service, Depends(service_of)]
As = Annotated[str, Depends(form_of)]
AsWithoutPositions = Annotated[str, Depends(form_without_positions)]
router = APIRouter(prefix="/api/v1", responses=REFUSALS, route_class=CheckedRoute)


def parsed(read: Callable[[str], T], name: str, text: str | None) -> T | None:
    """The value of a query parameter. Raises: HTTPException that names it."""
    if text is None:
        return None
    try:
        return read(text)
    except argparse.ArgumentTypeError as error:
        raise HTTPException(400, f"{name}: {error}") from error


def parsed_span(start: str | None, end: str | None) -> tuple[float | None, float | None]:
    """The instants `from` and `to`, None where not given. Raises: HTTPException, also where they are in the other order."""
    from_s, to_s = parsed(utc, "from", start), parsed(utc, "to", end)
    if from_s is not None and to_s is not None and from_s > to_s:
        raise HTTPException(400, f"from: got {start!r}, which is after to, {end!r}")
    return from_s, to_s


@router.get("/status")
def status(request: Request, service: In) -> dict[str, object]:
    """The run, its newest picture and its age, counts, troubles, and the role of who asks. `run_status` `died`: its process is gone.

    `coastline`: whether the scenario has one of its own, for `/coastline`.
    """
    said = service.status()
    coastline = _coastline_of(str(said["scenario"])) is not None
    return {**said, "coastline": coastline, "role": request.state.role, "name": request.state.who}


class Chosen(BaseModel):
    """Which vessels of a picture, and which of their columns."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)

    format: Form | None = None
    at: Text = None  # instant; none: now
    bbox: Text = None  # S,W,N,E
    flags: Text = None  # any of these
    sources: Text = None  # any of these kinds or names
    mmsi: Text = None
    q: Text = None  # in name, call sign, MMSI or id
    min_sog: float = 0.0  # knots
    max_sog: float | None = None
    sort: Text = None  # columns, -NAME: descending
    columns: Text = None
    limit: Limit = 1000
    offset: Offset = 0

    def rows(self, picture: LivePicture) -> Ints:
        """The rows of a picture that are asked for. Raises: HTTPException that names the wrong parameter."""
        rows = np.arange(len(picture)) if self.q is None else picture.search(self.q)
        keep = np.ones(len(rows), np.bool_)
        if (area := parsed(box, "bbox", self.bbox)) is not None:
            keep &= inside(picture.positions_deg()[rows], area)
        if self.flags:
            unknown = [word for word in _names(self.flags) if word not in FLAGS]
            if unknown:
                raise HTTPException(400, f"flags: got {unknown[0]!r}, needed some of {', '.join(FLAGS)}")
            keep &= (picture.array("flags")[rows] & sum(FLAGS[word] for word in _names(self.flags))) != 0
        if self.sources:
            keep &= _has_source(picture, self.sources)[rows]
        if self.mmsi:
            if not re.fullmatch("[0-9]{1,9}", self.mmsi):
                raise HTTPException(400, f"mmsi: got {self.mmsi!r}, needed nine digits")
            keep &= picture.array("mmsi")[rows] == int(self.mmsi)
        if self.max_sog is not None and self.min_sog > self.max_sog:
            raise HTTPException(400, f"min_sog: got {self.min_sog:g}, needed at most max_sog = {self.max_sog:g}")
        speed = np.nan_to_num(picture.array("sog_kn")[rows])
        keep &= (speed >= self.min_sog) & (speed <= (np.inf if self.max_sog is None else self.max_sog))
        return rows[keep]


@router.get("/picture", responses={**ROWS, 304: {"description": "the picture is the one of the ETag"}})
def picture(request: Request, service: In, form: As, chosen: Annotated[Chosen, Query()]) -> Response:
    """The picture now or at an instant: one row a vessel, of which parameters choose some. `Link` has the next page."""
    tag = None
    if chosen.at is None:
        asked = repr((service.version_of_picture(), form, sorted(request.query_params.multi_items())))
        tag = f'W/"{hashlib.sha256(asked.encode()).hexdigest()[:32]}"'
        if request.headers.get("if-none-match") == tag:
            return Response(status_code=304, headers={"ETag": tag})
    at_s = parsed(utc, "at", chosen.at)
    # Names of sources are judged by those of the whole picture.
    shown = _picture_at(service, at_s, None if chosen.sources else parsed(box, "bbox", chosen.bbox))
    rows = chosen.rows(shown)
    if chosen.sort is not None:
        rows = rows[order(lambda name: shown.column(name, rows), COLUMNS, _names(chosen.sort))]
    page = shown.rows(rows[chosen.offset : chosen.offset + chosen.limit])
    vessels = selected(presentation.in_operator_units(page), (), None, _names(chosen.columns))
    head = {"run": shown.run_id, "cycle": shown.cycle, "time_utc": utc_text(shown.time_s), "total": len(rows)}
    headers = page_headers(request, len(rows), chosen.offset, chosen.limit) | ({"ETag": tag} if tag else {})
    if at_s is not None and (
        warning := presentation.beyond_end(service.store, presentation.run(service.store, shown.run_id), at_s)
    ):
        head["warning"] = headers["X-Warning"] = f"at: {warning}"
    return answer(vessels, form, "vessels", {**head, "offset": chosen.offset}, headers)


@router.get("/frame", responses={200: {"content": {"application/octet-stream": {}}}})
def frame(service: In, bbox: Text = None, at: Text = None, version: Annotated[int, Query(ge=1, le=2)] = 1) -> Response:
    """The picture as one full binary frame (coastwatch.picture.v1 or v2), now or at an instant."""
    area = parsed(box, "bbox", bbox)
    shown = _picture_at(service, parsed(utc, "at", at), area)
    if area is not None:
        shown = shown.take(np.flatnonzero(inside(shown.positions_deg(), area)))
    return Response(Encoder(0).frame(shown).full(version), media_type="application/octet-stream")


@router.get("/vessels")
def vessels(
    request: Request, service: In, ids: Annotated[str | None, Query(max_length=4000)] = None, q: Text = None, at: Text = None
) -> Response:
    """Details of up to 200 vessels by their ids, or of up to 50 that a text finds. `at`: of the picture of this instant."""
    words = _names(ids)
    if (ids is None) == (q is None):
        raise HTTPException(400, "got both or none of ids and q, needed one of them")
    if len(words) > MOST_IDS or not all(word.isdecimal() and len(word) < 19 for word in words):
        raise HTTPException(400, f"ids: got {len(words)} words, needed at most {MOST_IDS} whole numbers with commas between")
    shown = _picture_at(service, parsed(utc, "at", at), None)
    rows = shown.at(np.array([int(word) for word in words], np.int64)) if q is None else shown.search(q)[:MOST_FOUND]
    found = export.as_objects(presentation.in_operator_units(shown.rows(rows)))
    body = json.dumps({"run": shown.run_id, "vessels": found}, allow_nan=False)
    tag = f'"{hashlib.sha256(body.encode()).hexdigest()[:32]}"'
    if request.headers.get("if-none-match") == tag:
        return Response(status_code=304, headers={"ETag": tag})
    return Response(body, media_type="application/json", headers={"ETag": tag})


@router.get("/vessels/{vessel_id}")
def vessel(vessel_id: VesselId, service: In, at: Text = None) -> dict[str, object]:
    """One vessel with its tracks, events, associations and the newest points of its path. `at`: of the run that has this instant."""
    run_row, one = _vessel(service, vessel_id, parsed(utc, "at", at))

    def newest(rows: Rows) -> Rows:
        kept = rows.rows
        if "to_utc" in rows.columns:  # what has ended is left out before what lasts
            at = rows.columns.index("to_utc")
            kept = sorted(kept, key=lambda row: row[at] is None)
        return Rows(rows.columns, kept[-NEWEST_POINTS:])

    methods = {key: run_row["settings"].get(key) for key in ("associations", "bearing_associations")}
    return {**export.as_vessel(one, newest), "method": methods}


@router.get("/vessels/{vessel_id}/history", responses=ROWS)
def history(
    request: Request, vessel_id: VesselId, service: In, form: As,
    start: Annotated[str | None, Query(alias="from", max_length=40)] = None,
    end: Annotated[str | None, Query(alias="to", max_length=40)] = None, at: Text = None, limit: Limit = 5000,
) -> Response:  # fmt: skip
    """The newest points of a vessel's path between two instants, oldest first. `Link` has the page of those before them.

    `at`: of the run that has this instant; none: of the run of now.
    """
    run_row, one = _vessel(service, vessel_id, parsed(utc, "at", at))
    span_s, of = parsed_span(start, end), {"run": run_row["id"], "vessel_id": vessel_id}
    return _between(request, one.tables["history"], form, "history", of, span_s, limit)


@router.get("/vessels/{vessel_id}/decided", responses=ROWS)
def decided(
    request: Request, vessel_id: VesselId, service: In, form: As,
    start: Annotated[str | None, Query(alias="from", max_length=40)] = None,
    end: Annotated[str | None, Query(alias="to", max_length=40)] = None, at: Text = None, limit: Limit = 5000,
) -> Response:  # fmt: skip
    """The newest states of a vessel's corrected past between two instants, oldest first. The history stays what the watch saw.

    `Link` has the page of those before them. `at`: of the run that has this instant; none: of the run of now.
    """
    span_s, run_id = parsed_span(start, end), service.run_at(parsed(utc, "at", at))
    try:
        rows = presentation.decided_path(service.store, run_id, vessel_id)
    except NotThere as error:
        raise HTTPException(404, f"run {run_id} never had a vessel {vessel_id}") from error
    return _between(request, rows, form, "decided", {"run": run_id, "vessel_id": vessel_id}, span_s, limit)


def _between(
    request: Request,
    rows: Rows,
    form: str,
    name: str,
    of: Mapping[str, object],
    span_s: tuple[float | None, float | None],
    limit: int,
) -> Response:
    """The newest rows of a vessel between two instants. The next page ends with the newest one before them.

    A page ends between two instants: rows of one instant are together, also where they are more than the limit.
    Args: of: run and vessel.
    """
    from_s, to_s = span_s
    times = rows.column("time_utc")
    when = np.array([utc(text) for text in times])
    kept = np.flatnonzero((when >= (-np.inf if from_s is None else from_s)) & (when <= (np.inf if to_s is None else to_s)))
    first = max(len(kept) - limit, 0)
    while 0 < first < len(kept) and times[kept[first - 1]] == times[kept[first]]:
        first -= 1
    shown = Rows(rows.columns, [rows.rows[k] for k in kept[first:]])
    headers = _counted(len(kept))
    if limit > 0 and first > 0:
        headers["Link"] = _next(request, to=times[kept[first - 1]])
    return answer(shown, form, name, {**of, "total": len(kept)}, headers)


@router.get("/sensors", responses=ROWS)
def sensors(service: In, form: As) -> Response:
    """The sensors with their registration and `health`: heard, silent (after 3 turns, or 60 s of AIS) or never heard."""
    return answer(presentation.sensors(service.store, service.run_id(), None), form, "sensors", {})


@router.get("/sensors/{number}/cover", responses=ROWS)
def sensor_cover(
    number: Annotated[int, Path(ge=0, le=LARGEST_ID)], service: In, form: As,
    grid: Literal["detection", "clutter", "standing"] = "detection",
) -> Response:  # fmt: skip
    """The newest learnt cover of a radar or the density of its false plots, one row a cell; or the standing echoes that it hides.

    `number` is as in `/sensors`.
    """
    run_id = service.run_id()
    names = {row[1]: row[2] for row in store.sensors(service.store, run_id).rows if row[0] == "radar"}
    if number not in names:
        raise HTTPException(404, f"sensors: got radar {number}, needed one of {', '.join(map(str, names)) or 'none'}")
    try:
        if grid == "standing":
            cells = presentation.standing_echoes(service.store, service.run_row())
        else:
            cells = presentation.radar_cover(service.store, run_id, grid == "clutter", COVER_AZIMUTHS, COVER_RANGES)
    except InputError as error:
        raise HTTPException(404, str(error)) from error
    of_radar = Rows(cells.columns, [row for row in cells.rows if row[0] == names[number]])
    listed = "echoes" if grid == "standing" else "cells"
    return answer(of_radar, form, listed, {"run": run_id, "radar": names[number], "grid": grid})


@router.get("/feeds")
def feeds(service: In) -> dict[str, list[dict[str, object]]]:
    """The live feeds with their counters; none where a database is followed."""
    return {"feeds": [dict(state) for state in service.feeds()]}


@router.get("/runs", responses=WITHOUT_POSITIONS)
def runs(service: In, form: AsWithoutPositions) -> Response:
    """The runs of the database, newest first."""
    return answer(presentation.runs(service.store), form, "runs", {})


@router.get("/audit", responses=WITHOUT_POSITIONS)
def audit(request: Request, service: In, form: AsWithoutPositions, limit: Limit = 1000, offset: Offset = 0) -> Response:
    """Who changed what through this API, newest first. For admins. `Link` has the next page."""
    rows, total = service.changes(limit, offset)
    return answer(rows, form, "changes", {"total": total}, page_headers(request, total, offset, limit))


@router.get("/cycles")
def cycles(service: In) -> dict[str, object]:
    """The span of time of which pictures can be asked for, from the oldest that this run or one of the server before it has."""
    run_row = service.run_row()
    newest, first_s = store.newest_picture(service.store, run_row["id"]), store.first_instant(service.store, run_row["id"])
    return {
        "first_utc": None if first_s is None else utc_text(first_s),
        "last_utc": None if newest is None else utc_text(newest[2]),
        "period_s": run_row["period_s"],
        "cycles": run_row["cycles_stored"],
        "recorded": bool(run_row["settings"].get("store", {}).get("recording")),
    }


@router.get(
    "/coastline", response_class=Response, responses={200: {"content": {TYPES["geojson"]: {"schema": {"type": "object"}}}}}
)
def coastline(service: In) -> Response:
    """The coastline that comes with the scenario, as GeoJSON."""
    path = _coastline_of(str(service.run_row()["scenario"]))
    if path is None:
        raise HTTPException(404, "the scenario has no coastline of its own")
    return Response(path.read_bytes(), media_type=TYPES["geojson"], headers={"Cache-Control": "max-age=3600"})


def _coastline_of(scenario: str) -> pathlib.Path | None:
    """The coastline that comes with a scenario; None: it has none."""
    path = scenarios_folder() / scenario / "coastline.geojson"
    return path if path.parent.parent == scenarios_folder() and path.is_file() else None


def page_headers(request: Request, total: int, offset: int, limit: int) -> dict[str, str]:
    """Headers of a page of rows: how many there are in all, and where the next page is, if there is one."""
    headers = _counted(total)
    if 0 < limit < total - offset:
        headers["Link"] = _next(request, offset=offset + limit)
    return headers


def _counted(total: int) -> dict[str, str]:
    return {"X-Total-Count": str(total), "Vary": "Accept"}


def _next(request: Request, **parameters: object) -> str:
    """`Link` to the next page. Args: parameters: that it has in place of those of the request."""
    following = request.url.include_query_params(**parameters)
    return f'<{following.path}?{following.query}>; rel="next"'


def _picture_at(service: Service, at_s: float | None, area: Box | None) -> LivePicture:
    """The picture now, or of the last cycle up to an instant, with the time of that cycle: viewers move its vessels on from there.

    An instant before the run began is answered from a run of the server before it, where one has it.
    Args: area: in a picture of the past, other vessels may be left out; that of now is whole.
    """
    if at_s is None:
        return service.picture()
    run_id = service.run_at(at_s)
    try:
        number, time_s = store.picture_cycle(service.store, run_id, at_s)
        return service.picture_of(run_id, number, time_s, area)
    except NotThere as error:
        raise HTTPException(404, f"at: {str(error).removeprefix(f'{service.store.where}: ')}") from error


def _vessel(service: Service, vessel_id: int, at_s: float | None) -> tuple[presentation.Run, presentation.Vessel]:
    """The run that has an instant, and one of its vessels; none: of now. Raises: HTTPException where the run never had it."""
    run_row = service.run_row(at_s)
    try:
        return run_row, presentation.vessel(service.store, run_row, vessel_id)
    except NotThere as error:
        raise HTTPException(404, f"run {run_row['id']} never had a vessel {vessel_id}") from error


def _has_source(picture: LivePicture, text: str) -> Bools:
    """Which vessels have one of these kinds of sources, or one of these sources. (V,)"""
    sources = {name for texts in picture.source_texts for name in texts.split(",")}
    has_source = np.zeros(len(picture), np.bool_)
    for word in _names(text):
        if word in KINDS:
            has_source |= (picture.kind & KINDS[word]) != 0
        elif word in sources:
            has_source |= np.array([word in texts.split(",") for texts in picture.source_texts], np.bool_)[picture.source_codes]
        else:
            raise HTTPException(
                400, f"sources: got {word!r}, needed some of {', '.join([*KINDS, *sorted(sources - {''} - set(KINDS))])}"
            )
    return has_source


def _names(text: str | None) -> Sequence[str]:
    return tuple(part.strip() for part in (text or "").split(",") if part.strip())


def answer(rows: Rows, form: str, name: str, head: Mapping[str, object], headers: dict[str, str] | None = None) -> Response:
    """The rows in a format; in JSON as the list `name` behind other values. Args: headers: of a page; none: these are all rows."""
    headers = headers or _counted(len(rows.rows))
    if form == "parquet":
        return Response(export.as_parquet(rows), media_type=TYPES[form], headers=headers)
    if form == "json":
        text = json.dumps({**head, name: export.as_objects(rows)}, allow_nan=False)
    else:
        text = export.as_geojson(rows) if form == "geojson" else export.as_csv(rows)
    return Response(text, media_type=TYPES[form], headers=headers)
