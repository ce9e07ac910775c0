"""Zones over the API: those of the scenario file, which are changed there, and those that operators draw or send."""

from __future__ import annotations

import re
import time
from typing import Annotated, Any

import numpy as np
from fastapi import APIRouter, Header, HTTPException, Path, Request, Response
from pydantic import ValidationError

from coastwatch import store
from coastwatch.alarms import Zone
from coastwatch.geodesy import NAUTICAL_MILE_M, offset_deg
from coastwatch.operators import export, presentation
from coastwatch.operators.api.answers import REFUSALS, In
from coastwatch.operators.api.service import Service
from coastwatch.operators.api.validation import MOST_ERRORS, CheckedRoute
from coastwatch.scenario.refusing import refusals
from coastwatch.store.zones import FIRST_NUMBER, StoredZone, ZoneChangedError

MOST_ZONES = 500
CORNERS = 72
"""Of the polygon that is drawn for a circle."""

Number = Annotated[int, Path(ge=1, le=2**53)]
CONFLICT: dict[int | str, dict[str, Any]] = {
    409: {"description": "another zone has the name, or the zone is of the scenario file"}
}
CHANGED: dict[int | str, dict[str, Any]] = {412: {"description": "the zone has another ETag than If-Match"}}
TAGGED: dict[int | str, dict[str, Any]] = {
    status: {"description": "the zone", "headers": {"ETag": {"description": "its version", "schema": {"type": "string"}}}}
    for status in (200, 201)
}
TAG = r'(?:W/)?"[\x21\x23-\x7e]*"'
TAGS = re.compile(rf"{TAG}(?: *, *{TAG})*")
IfMatch = Annotated[str, Header(max_length=200, description="the ETag of the zone that is to be changed; *: of any version")]
router = APIRouter(prefix="/api/v1", responses=REFUSALS, route_class=CheckedRoute)


@router.get("/zones")
def zones(service: In) -> dict[str, object]:
    """The zones as GeoJSON. A circle is drawn as a polygon; longitudes go on beyond 180 degrees across the antimeridian."""
    run_row = service.run_row()
    drawn = store.zones(service.store, run_row["scenario"])
    return {"type": "FeatureCollection", "features": [_shown(zone) for zone in (*_of_scenario(run_row), *drawn)]}


@router.get("/zones/changes")
def changes(service: In) -> dict[str, list[dict[str, object]]]:
    """Who changed which zone when, newest first; a change without a definition deleted the zone."""
    rows = store.zone_changes(service.store, service.run_row()["scenario"])
    return {"changes": export.as_objects(presentation.in_operator_units(rows))}


@router.post("/zones", status_code=201, responses=CONFLICT | {201: TAGGED[201]})
def add(zone: Zone, request: Request, response: Response, service: In) -> dict[str, object]:
    """Add a zone, as `[[zones]]` of a scenario file. A live run watches it from its next cycle on. Returns: its feature."""
    run_row = service.run_row()
    if len(store.zones(service.store, run_row["scenario"])) >= MOST_ZONES:
        raise HTTPException(409, f"zones: there are {MOST_ZONES}, needed fewer: delete one first")
    _refuse_name_of_scenario(run_row, zone.name)
    definition = zone.model_dump(mode="json", exclude_defaults=True)
    stored = store.add_zone(service.store, run_row["scenario"], definition, at_s=time.time(), who=request.state.who)
    if stored is None:
        raise HTTPException(409, f"name: got {zone.name!r}, which another zone has, needed a new one")
    response.headers["ETag"] = _tag(stored)
    return _feature(stored, zone)


@router.get("/zones/{number:int}", responses={200: TAGGED[200]})
def zone(number: Number, response: Response, service: In) -> dict[str, object]:
    """One zone, as in `/zones`. Its ETag is for `If-Match` of a change."""
    run_row = service.run_row()
    for stored in (*_of_scenario(run_row), *store.zones(service.store, run_row["scenario"])):
        if stored.number == number:
            response.headers["ETag"] = _tag(stored)
            return _shown(stored)
    raise HTTPException(404, f"there is no zone {number}")


@router.put("/zones/{number:int}", responses=CONFLICT | CHANGED | {200: TAGGED[200]})
def change(
    number: Number, zone: Zone, request: Request, response: Response, service: In, if_match: IfMatch = "*"
) -> dict[str, object]:
    """Replace a zone; with `If-Match` only if nobody has changed it since. Returns: its feature."""
    stored = _changed(number, zone, request, service, if_match)
    response.headers["ETag"] = _tag(stored)
    return _feature(stored, zone)


@router.delete("/zones/{number:int}", responses=CONFLICT | CHANGED)
def delete(number: Number, request: Request, service: In, if_match: IfMatch = "*") -> dict[str, object]:
    """Delete a zone; with `If-Match` only if nobody has changed it since. Its alarms end with the next cycle.

    Returns: its feature as it was.
    """
    return _shown(_changed(number, None, request, service, if_match))


def _tag(stored: StoredZone) -> str:
    return f'"{stored.version}"'


def _versions(if_match: str) -> list[int] | None:
    """The versions of which a zone must be that is changed; None: any. A weak tag is never the same. Raises: HTTPException."""
    if if_match == "*":
        return None
    if not TAGS.fullmatch(if_match):
        raise HTTPException(400, f'If-Match: got {if_match!r}, needed the ETag of a zone, such as "2", or *')
    return [int(tag) for tag in re.findall(r'(?<!W/)"([0-9]{1,18})"', if_match)]


def _changed(number: int, zone: Zone | None, request: Request, service: Service, if_match: str) -> StoredZone:
    """The zone with this number as it is after a change, or as it was before it was deleted. Raises: HTTPException."""
    versions, run_row = _versions(if_match), service.run_row()
    if number < FIRST_NUMBER:
        if any(number == fixed.number for fixed in _of_scenario(run_row)):
            raise HTTPException(409, f"zone {number} is of the scenario file, needed one that was drawn or sent")
        raise HTTPException(404, f"there is no zone {number}")
    definition = None
    if zone is not None:
        _refuse_name_of_scenario(run_row, zone.name)
        definition = zone.model_dump(mode="json", exclude_defaults=True)
    try:
        stored = store.change_zone(
            service.store,
            run_row["scenario"],
            number,
            definition,
            at_s=time.time(),
            who=request.state.who,
            versions=versions,
        )
    except ZoneChangedError as error:
        raise HTTPException(412, str(error)) from error
    if isinstance(stored, str):
        raise HTTPException(409, f"name: got {stored!r}, which another zone has, needed a new one")
    if stored is None:
        raise HTTPException(404, f"there is no zone {number}")
    return stored


def _refuse_name_of_scenario(run_row: presentation.Run, name: str) -> None:
    if any(zone.definition.get("name") == name for zone in _of_scenario(run_row)):
        raise HTTPException(409, f"name: got {name!r}, which a zone of the scenario file has, needed a new one")


def _of_scenario(run_row: presentation.Run) -> list[StoredZone]:
    """The zones of the scenario file; version 0."""
    return [StoredZone(number, 0, zone) for number, zone in enumerate(run_row["settings"].get("zones", ()), 1)]


def _shown(stored: StoredZone) -> dict[str, object]:
    """A zone of a run or database as a feature. One that is refused today says why, and has a geometry if it can be drawn."""
    try:
        return _feature(stored, Zone.model_validate(stored.definition))
    except ValidationError as error:
        refused = "; ".join(refusals(error, Zone)[:MOST_ERRORS])
    try:
        fields = {name: value for name, value in stored.definition.items() if name in Zone.model_fields}
        return _feature(stored, Zone.model_construct(**fields), refused=refused)
    except Exception:  # of another version: its shape is not known
        properties = {**_source(stored), **stored.definition, "refused": refused}
        return {"type": "Feature", "id": stored.number, "geometry": None, "properties": properties}


def _source(stored: StoredZone) -> dict[str, object]:
    source = "stored" if stored.version else "scenario"
    return {"number": stored.number, "version": stored.version, "source": source}


def _feature(stored: StoredZone, zone: Zone, **also: str) -> dict[str, object]:
    """A zone as a feature of GeoJSON: its definition and numbers as properties. Args: zone: its definition; also: properties."""
    if zone.kind == "circle":
        angle = np.arange(CORNERS) * (2.0 * np.pi / CORNERS)
        reach_m = (zone.radius_nm or 0.0) * NAUTICAL_MILE_M * np.stack([np.sin(angle), np.cos(angle)], 1)
        points = offset_deg(np.broadcast_to(np.array(zone.centre_deg), (CORNERS, 2)), reach_m)
    else:
        points = np.array(zone.points_deg)
    first = points[0, 1]
    longitude = first + (points[:, 1] - first + 180.0) % 360.0 - 180.0
    drawn = np.round(np.stack([longitude, points[:, 0]], 1), 7).tolist()
    line = {"type": "LineString", "coordinates": drawn}
    geometry = line if zone.kind == "line" else {"type": "Polygon", "coordinates": [[*drawn, drawn[0]]]}
    properties = {**_source(stored), **zone.model_dump(mode="json", warnings=False), **also}
    return {"type": "Feature", "id": stored.number, "geometry": geometry, "properties": properties}
