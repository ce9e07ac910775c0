"""The web application: the API, the socket of the picture, the files of the page, and what guards them."""

from __future__ import annotations

from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Annotated

from fastapi import FastAPI, Header, HTTPException, Query, Request, Response, WebSocket
from fastapi.exceptions import RequestValidationError
from fastapi.responses import HTMLResponse, JSONResponse, StreamingResponse
from pydantic import BaseModel, Field
from starlette.middleware.gzip import GZipMiddleware
from starlette.staticfiles import StaticFiles

from coastwatch.errors import InputError, StoreError
from coastwatch.operators.api import answers, validation, webhooks, zones
from coastwatch.operators.api.alarm_stream import AlarmStream
from coastwatch.operators.api.guard import COOKIE, SESSION, Guard, methods_of
from coastwatch.operators.api.service import NoPictureYet, Service
from coastwatch.operators.api.track_stream import serve_tracks
from coastwatch.operators.api.wire import PROTOCOL
from coastwatch.server.regions.client import PATH
from coastwatch.server.regions.link import Position
from coastwatch.server.run import version
from coastwatch.spelling import printable

WEB = Path(__file__).resolve().parent.parent / "web"
"""Where the build puts the page."""

PLAIN_PAGE = """<!doctype html>
<html lang="en"><meta charset="utf-8"><title>Coastwatch</title>
<h1>Coastwatch</h1>
<p>The server runs. The map is not built: <code>make web</code> builds it where npm can be reached; then start the server again.</p>
<p>The API works: <a href="/api/v1/status">status</a>, <a href="/api/v1/picture">picture</a>,
<a href="/api/v1/alarms">alarms</a>, <a href="/api/v1/sensors">sensors</a>, <a href="/api/v1/openapi.json">all paths</a>.</p>
</html>
"""


def application(service: Service, guard: Guard, web: Path = WEB) -> FastAPI:
    """The application of a server. Its `state.stopping` says whether the server ends. Args: web: folder of the page."""

    alarms = AlarmStream(service, lambda: app.state.stopping())

    @asynccontextmanager
    async def life(_: FastAPI) -> AsyncIterator[None]:
        service.hub.open()
        service.asked.append(guard.troubles)
        try:
            async with webhooks.sending(service.webhooks, alarms, service):
                yield
        finally:
            service.asked.remove(guard.troubles)

    app = FastAPI(
        title="Coastwatch", version=version(), lifespan=life, docs_url=None, redoc_url=None, openapi_url="/api/v1/openapi.json"
    )
    app.router.route_class = validation.CheckedRoute
    app.state.service = service
    app.state.stopping = lambda: False
    app.include_router(answers.router)
    app.include_router(zones.router)
    _add_health(app, service)
    _add_session(app, guard)
    _add_stream(app, service)
    _add_track_stream(app, service)
    _add_alarm_stream(app, alarms)
    _add_land(app)
    _add_refusals(app)
    app.add_middleware(GZipMiddleware, minimum_size=2000, compresslevel=1)
    app.add_middleware(guard.middleware, metrics=service.metrics, audit=service.audit)
    if (web / "index.html").is_file():
        app.mount("/", StaticFiles(directory=web, html=True), name="web")
    else:
        app.add_api_route("/", lambda: HTMLResponse(PLAIN_PAGE), include_in_schema=False)
    return app


def _add_health(app: FastAPI, service: Service) -> None:
    @app.get("/healthz", include_in_schema=False)
    def alive() -> dict[str, str]:
        return {"status": "alive"}

    @app.get("/readyz", include_in_schema=False)
    def ready() -> JSONResponse:
        is_ready, said = service.ready()
        return JSONResponse(said, 200 if is_ready else 503)

    @app.get("/metrics", include_in_schema=False)
    def metrics() -> Response:
        return Response(service.metrics.text(), media_type="text/plain; version=0.0.4")


class _Typed(BaseModel):
    """A token that a person typed."""

    token: Annotated[str, Field(max_length=200)]


def _add_session(app: FastAPI, guard: Guard) -> None:
    @app.post(SESSION, include_in_schema=False)
    def log_in(typed: _Typed) -> Response:
        return guard.session(typed.token)

    @app.delete(SESSION, include_in_schema=False)
    def log_out() -> Response:
        answer = Response(status_code=204)
        answer.delete_cookie(COOKIE)
        return answer


def _add_stream(app: FastAPI, service: Service) -> None:
    @app.websocket("/api/v1/stream")
    async def stream(
        socket: WebSocket, run: Annotated[int, Query(ge=0, lt=2**32)] = 0, seq: Annotated[int, Query(ge=0, lt=2**32)] = 0
    ) -> None:
        offered = socket.scope.get("subprotocols", [])
        await socket.accept(subprotocol=PROTOCOL if PROTOCOL in offered else None)
        await service.hub.serve(socket, run, seq)


def _add_track_stream(app: FastAPI, service: Service) -> None:
    @app.websocket(PATH)
    async def stream(
        socket: WebSocket,
        run: Annotated[str, Query(max_length=64)] = "",
        seq: Annotated[int, Query(ge=0, lt=2**62)] = 0,
        from_s: Annotated[float, Query(allow_inf_nan=False)] = 0.0,
    ) -> None:
        await serve_tracks(socket, service.publisher, Position(run, seq), from_s)


def _add_alarm_stream(app: FastAPI, alarms: AlarmStream) -> None:
    @app.get("/api/v1/alarms/stream", response_class=StreamingResponse)
    async def stream(request: Request, last_event_id: Annotated[str, Header(max_length=40)] = "") -> StreamingResponse:
        """New and changed alarms as server-sent events; `Last-Event-ID` goes on after an event."""
        headers = {"Cache-Control": "no-store"}
        state = request.state
        events = alarms.events(last_event_id, state.allowed, state.recheck_s)
        return StreamingResponse(events, media_type="text/event-stream", headers=headers)


def _add_land(app: FastAPI) -> None:
    @app.get("/land/{zoom}/{x}/{y}", include_in_schema=False)
    def land(zoom: int, x: int, y: int) -> Response:
        """A tile of the land of the map. It needs no token: it is a part of the page."""
        from coastwatch.operators import land_tiles  # shapely takes a while, and only the map needs it

        if not (0 <= zoom <= land_tiles.MOST_ZOOM and 0 <= x < 2**zoom and 0 <= y < 2**zoom):
            raise HTTPException(404, f"there is no tile {zoom}/{x}/{y}; zooms are 0 to {land_tiles.MOST_ZOOM}")
        headers = {"Cache-Control": "max-age=86400"}
        return Response(land_tiles.tile(zoom, x, y), media_type="application/vnd.mapbox-vector-tile", headers=headers)


def _add_refusals(app: FastAPI) -> None:
    """One sentence for every error, as `{"detail": ...}`."""

    def says(status: int) -> Callable[[Request, Exception], Awaitable[Response]]:
        async def answer(_: Request, error: Exception) -> Response:
            said = str(error).removeprefix("--")  # an option of the command line is a parameter here
            return JSONResponse({"detail": printable(said)}, status)

        return answer

    for kind, status in ((NoPictureYet, 503), (StoreError, 503), (InputError, 400)):
        app.add_exception_handler(kind, says(status))

    app.add_exception_handler(RequestValidationError, validation.refused)

    async def wrong_path(request: Request, error: Exception) -> Response:
        detail = getattr(error, "detail", "")
        said = f"there is no path {request.url.path}" if detail == "Not Found" else detail
        return JSONResponse({"detail": printable(said)}, 404)

    app.add_exception_handler(404, wrong_path)

    async def wrong_method(request: Request, _: Exception) -> Response:
        known = methods_of(request.scope)
        said = f"got {request.method}, needed {' or '.join(known)}"
        return JSONResponse({"detail": said}, 405, {"Allow": ", ".join(known)})

    app.add_exception_handler(405, wrong_method)
