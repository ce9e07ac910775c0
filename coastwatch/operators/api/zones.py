"""Zones over the API: those of the scenario file, which are changed there, and those that operators draw or send."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Annotated, Any

import numpy as np
from fastapi import APIRouter, HTTPException, Path, Request
from pydantic import ValidationError

from coastwatch import store
from coastwatch.alarms import Zone
from coastwatch.geodesy import NAUTICAL_MILE_M, offset_deg
from coastwatch.operators import export, presentation
from coastwatch.operators.api.answers import REFUSALS, In
from coastwatch.operators.api.service import Service
from coastwatch.operators.api.validation import MOST_ERRORS, CheckedRoute
from coastwatch.scenario.refusing import refusals
from coastwatch.store.zones import FIRST_NUMBER

MOST_ZONES = 500
CORNERS = 72
"""Of the polygon that is drawn for a circle."""

Number = Annotated[int, Path(ge=1, le=2**53)]
CONFLICT: dict[int | str, dict[str, Any]] = {
    409: {"description": "another zone has the name, or the zone is of the scenario file"}
}
router = APIRouter(prefix="/api/v1", responses=REFUSALS, route_class=CheckedRoute)


@router.get("/zones")
def zones(service: In) -> dict[str, Any]:
    """The zones as GeoJSON. A circle is drawn as a polygon; longitudes go on beyond 180 degrees across the antimeridian."""
    about = service.run_row()
    fixed = [_shown(number, 0, definition) for number, definition in _of_scenario(about)]
    drawn = [_shown(zone.number, zone.version, zone.definition) for zone in store.zones(service.store, about["scenario"])]
    return {"type": "FeatureCollection", "features": [*fixed, *drawn]}


@router.get("/zones/changes")
def changes(service: In) -> dict[str, Any]:
    """Who changed which zone when, newest first; a change without a definition deleted the zone."""
    found = store.zone_changes(service.store, service.run_row()["scenario"])
    return {"changes": export.as_objects(presentation.in_operator_units(found))}


@router.post("/zones", status_code=201, responses=CONFLICT)
def add(zone: Zone, request: Request, service: In) -> dict[str, Any]:
    """Add a zone. A live run of the scenario watches it from its next cycle on. Returns: its feature, with its number."""
    about = service.run_row()
    if len(store.zones(service.store, about["scenario"])) >= MOST_ZONES:
        raise HTTPException(409, f"zones: there are {MOST_ZONES}, needed fewer: delete one first")
    _refuse_name_of_scenario(about, zone.name)
    found = store.add_zone(service.store, about["scenario"], _definition(zone), at_s=time.time(), who=request.state.who)
    if found is None:
        raise HTTPException(409, f"name: got {zone.name!r}, which another zone has, needed a new one")
    return _feature(found.number, found.version, zone)


@router.put("/zones/{number:int}", responses=CONFLICT)
def change(number: Number, zone: Zone, request: Request, service: In) -> dict[str, Any]:
    """Replace a zone. Returns: its feature."""
    about = _changeable(service, number)
    _refuse_name_of_scenario(about, zone.name)
    given = {"at_s": time.time(), "who": request.state.who}
    found = store.change_zone(service.store, about["scenario"], number, _definition(zone), **given)
    if isinstance(found, str):
        raise HTTPException(409, f"name: got {found!r}, which another zone has, needed a new one")
    if found is None:
        raise HTTPException(404, f"there is no zone {number}")
    return _feature(found.number, found.version, zone)


@router.delete("/zones/{number:int}", responses=CONFLICT)
def delete(number: Number, request: Request, service: In) -> dict[str, Any]:
    """Delete a zone. Its alarms end with the next cycle. Returns: its feature as it was."""
    about = _changeable(service, number)
    given = {"at_s": time.time(), "who": request.state.who}
    found = store.change_zone(service.store, about["scenario"], number, None, **given)
    if found is None or isinstance(found, str):
        raise HTTPException(404, f"there is no zone {number}")
    return _shown(found.number, found.version, found.definition)


def _changeable(service: Service, number: int) -> dict[str, Any]:
    """The run, if a zone with this number may be changed. Raises: HTTPException."""
    about = service.run_row()
    if number < FIRST_NUMBER:
        if any(number == known for known, _ in _of_scenario(about)):
            raise HTTPException(409, f"zone {number} is of the scenario file, needed one that was drawn or sent")
        raise HTTPException(404, f"there is no zone {number}")
    return about


def _refuse_name_of_scenario(about: dict[str, Any], name: str) -> None:
    if any(zone.get("name") == name for _, zone in _of_scenario(about)):
        raise HTTPException(409, f"name: got {name!r}, which a zone of the scenario file has, needed a new one")


def _of_scenario(about: dict[str, Any]) -> list[tuple[int, Mapping[str, Any]]]:
    """Numbers and definitions of the zones of the scenario file."""
    return list(enumerate(about["settings"].get("zones", ()), 1))


def _definition(zone: Zone) -> dict[str, Any]:
    return zone.model_dump(mode="json", exclude_defaults=True)


def _shown(number: int, version: int, definition: Mapping[str, Any]) -> dict[str, Any]:
    """A zone of a run or database as a feature. One that is refused today says why, and has a geometry if it can be drawn."""
    try:
        return _feature(number, version, Zone.model_validate(definition))
    except ValidationError as error:
        said = {"refused": "; ".join(refusals(error, Zone)[:MOST_ERRORS])}
    try:
        known = {name: value for name, value in definition.items() if name in Zone.model_fields}
        out = _feature(number, version, Zone.model_construct(**known))
        out["properties"] |= said
        return out
    except Exception:  # of another version: its shape is not known
        about = {"number": number, "version": version, "source": "stored" if version else "scenario"}
        return {"type": "Feature", "id": number, "geometry": None, "properties": {**about, **definition, **said}}


def _feature(number: int, version: int, zone: Zone) -> dict[str, Any]:
    """A zone as a feature of GeoJSON: its definition and numbers as properties. Args: version: 0: of the scenario file."""
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
    about = {"number": number, "version": version, "source": "stored" if version else "scenario"}
    return {
        "type": "Feature",
        "id": number,
        "geometry": geometry,
        "properties": {**about, **zone.model_dump(mode="json", warnings=False)},
    }
