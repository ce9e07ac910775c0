"""The web application: the API, the socket of the picture, the files of the page, and what guards them."""

from __future__ import annotations

import logging
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager
from functools import partial
from pathlib import Path
from typing import Annotated

from fastapi import APIRouter, FastAPI, Header, HTTPException, Query, Request, Response, WebSocket
from fastapi.exceptions import RequestValidationError, WebSocketRequestValidationError
from fastapi.responses import HTMLResponse, JSONResponse, StreamingResponse
from pydantic import BaseModel, Field
from starlette.middleware.gzip import GZipMiddleware
from starlette.staticfiles import StaticFiles
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from coastwatch.errors import InputError, StoreError
from coastwatch.operators.api import alarms, answers, validation, video_stream, webhooks, zones
from coastwatch.operators.api.alarms import AlarmStream
from coastwatch.operators.api.answers import In
from coastwatch.operators.api.bounds import LargeAnswerQueue
from coastwatch.operators.api.guard import COOKIE, SESSION, Guard, methods_of
from coastwatch.operators.api.service import NoPictureYet, Service
from coastwatch.operators.api.streaming import serve_tracks
from coastwatch.operators.api.wire import PROTOCOL, VERSIONS, spoken
from coastwatch.server.regions.client import PATH
from coastwatch.server.regions.link import Position
from coastwatch.server.run import version
from coastwatch.spelling import printable

LOG = logging.getLogger("coastwatch.serve")

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


router = APIRouter(route_class=validation.CheckedRoute)


def application(service: Service, guard: Guard, web: Path = WEB, hooks: Sequence[webhooks.WebHook] = ()) -> FastAPI:
    """The application of a server. Its `state.stopping` says whether the server ends.

    Args: web: folder of the page; hooks: to which alarms are sent.
    """

    stream_of_alarms = AlarmStream(service, lambda: app.state.stopping())

    @asynccontextmanager
    async def life(_: FastAPI) -> AsyncIterator[None]:
        service.hub.open()
        service.asked.append(guard.troubles)
        try:
            async with webhooks.sending(hooks, stream_of_alarms, service):
                yield
        finally:
            service.asked.remove(guard.troubles)

    app = FastAPI(
        title="Coastwatch",
        version=version(),
        lifespan=life,
        docs_url=None,
        redoc_url=None,
        openapi_url="/api/v1/openapi.json",
        exception_handlers={
            NoPictureYet: _one_sentence,
            StoreError: _one_sentence,
            InputError: _one_sentence,
            RequestValidationError: validation.refused,
            Exception: partial(_failed, service),
            404: _wrong_path,
            405: _wrong_method,
        },
    )
    app.add_exception_handler(WebSocketRequestValidationError, validation.refused_socket)
    app.state.service, app.state.guard, app.state.alarms = service, guard, stream_of_alarms
    app.state.stopping = lambda: False
    for routes in (answers.router, alarms.router, zones.router, video_stream.router, router):
        app.include_router(routes)
    app.add_middleware(GZipMiddleware, minimum_size=2000, compresslevel=1)
    app.add_middleware(Heads)
    app.add_middleware(LargeAnswerQueue)
    app.add_middleware(guard.middleware, metrics=service.metrics, audit=service.audit)
    if (web / "index.html").is_file():
        app.mount("/", StaticFiles(directory=web, html=True), name="web")
    else:
        app.add_api_route("/", lambda: HTMLResponse(PLAIN_PAGE), include_in_schema=False)
    return app


@router.get("/healthz", include_in_schema=False)
def alive() -> dict[str, str]:
    """That the process answers."""
    return {"status": "alive"}


@router.get("/readyz", include_in_schema=False)
def ready(service: In) -> JSONResponse:
    """Whether there is a picture of now, and why not."""
    is_ready, state = service.ready()
    return JSONResponse(state, 200 if is_ready else 503)


@router.get("/metrics", include_in_schema=False)
def metrics(service: In) -> Response:
    """Counters in the text format of Prometheus."""
    return Response(service.metrics.text(), media_type="text/plain; version=0.0.4")


class TypedToken(BaseModel):
    """A token that a person typed."""

    token: Annotated[str, Field(max_length=200)]


@router.post(SESSION, include_in_schema=False)
def log_in(typed: TypedToken, request: Request) -> Response:
    """A cookie for a token, or 401."""
    guard: Guard = request.app.state.guard
    return guard.session(typed.token)


@router.delete(SESSION, include_in_schema=False)
def log_out() -> Response:
    """An answer that deletes the cookie."""
    answer = Response(status_code=204)
    answer.delete_cookie(COOKIE)
    return answer


@router.websocket("/api/v1/stream")
async def stream(
    socket: WebSocket, run: Annotated[int, Query(ge=0, lt=2**32)] = 0, seq: Annotated[int, Query(ge=0, lt=2**32)] = 0
) -> None:
    """Frames of the picture. Args: run, seq: of the last frame that the viewer has."""
    protocol = spoken(socket.scope.get("subprotocols", []))
    await socket.accept(subprotocol=protocol)
    await socket.app.state.service.hub.serve(socket, run, seq, VERSIONS[protocol or PROTOCOL])


@router.websocket("/api/v1/video/stream")
async def video(
    socket: WebSocket, run: Annotated[int, Query(ge=0, lt=2**32)] = 0, seq: Annotated[int, Query(ge=0, lt=2**32)] = 0
) -> None:
    """Sectors of radar video. Args: run, seq: of the last sector that the viewer has."""
    await video_stream.serve_video(socket, socket.app.state.service.video, run, seq)


@router.websocket(PATH)
async def track_stream(
    socket: WebSocket,
    run: Annotated[str, Query(max_length=64)] = "",
    seq: Annotated[int, Query(ge=0, lt=2**62)] = 0,
    from_s: Annotated[float, Query(allow_inf_nan=False)] = 0.0,
) -> None:
    """Cycles of tracks of a region. Args: run, seq: of the last cycle that the centre has."""
    await serve_tracks(socket, socket.app.state.service.publisher, Position(run, seq), from_s)


@router.get("/api/v1/alarms/stream", response_class=StreamingResponse)
async def alarm_stream(request: Request, last_event_id: Annotated[str, Header(max_length=40)] = "") -> StreamingResponse:
    """Server-sent events: `alarm` is a new or changed row; `run`: forget the rows before. `Last-Event-ID` goes on after an event."""
    stream_of_alarms: AlarmStream = request.app.state.alarms
    events = stream_of_alarms.events(last_event_id, request.state.allowed, request.state.recheck_s)
    return StreamingResponse(events, media_type="text/event-stream", headers={"Cache-Control": "no-store"})


@router.get("/land/{zoom}/{x}/{y}", include_in_schema=False)
def land(zoom: int, x: int, y: int) -> Response:
    """A tile of the land of the map. It needs no token: it is a part of the page."""
    from coastwatch.operators import land_tiles  # shapely takes a while, and only the map needs it

    if not (0 <= zoom <= land_tiles.MOST_ZOOM and 0 <= x < 2**zoom and 0 <= y < 2**zoom):
        raise HTTPException(404, f"there is no tile {zoom}/{x}/{y}; zooms are 0 to {land_tiles.MOST_ZOOM}")
    headers = {"Cache-Control": "max-age=86400"}
    return Response(land_tiles.tile(zoom, x, y), media_type="application/vnd.mapbox-vector-tile", headers=headers)


class Heads:
    """Has the application answer GET without the body where HEAD is asked of a path that has GET, as monitors probe.

    The framework gives its routes GET alone. Files of the page know HEAD themselves.
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """As of ASGI."""
        if scope["type"] != "http" or scope["method"] != "HEAD" or "GET" not in methods_of(scope):
            await self._app(scope, receive, send)
            return

        async def sending(message: Message) -> None:
            if message["type"] == "http.response.start":  # a stream would never end: its answer ends at once
                await send(message)
                await send({"type": "http.response.body"})

        await self._app({**scope, "method": "GET"}, receive, sending)


async def _one_sentence(_: Request, error: Exception) -> Response:
    detail = printable(str(error).removeprefix("--"))  # an option of the command line is a parameter here
    return JSONResponse({"detail": detail}, 400 if isinstance(error, InputError) else 503)


async def _wrong_path(request: Request, error: Exception) -> Response:
    detail = getattr(error, "detail", "")
    sentence = f"there is no path {request.url.path}" if detail == "Not Found" else detail
    return JSONResponse({"detail": printable(sentence)}, 404)


async def _failed(service: Service, request: Request, _: Exception) -> Response:
    """A defect of the server, whose log has the traceback. It is counted here, as no answer went through the guard."""
    service.metrics.requests.labels("500").inc()
    LOG.error("request failed", extra={"fields": {"method": request.method, "path": request.url.path[:200], "status": 500}})
    return JSONResponse({"detail": "the server has a defect: its log says more"}, 500)


async def _wrong_method(request: Request, _: Exception) -> Response:
    methods = methods_of(request.scope)
    if not methods and request.url.path.startswith("/api/"):  # no route has the path, and so the files of the page refused it
        return await _wrong_path(request, HTTPException(404))
    methods = methods or ["GET", "HEAD"]  # of a file
    return JSONResponse({"detail": f"got {request.method}, needed {' or '.join(methods)}"}, 405, {"Allow": ", ".join(methods)})
