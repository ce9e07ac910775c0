"""`serve`: the picture of a live run or of a database over HTTP and WebSocket."""

from __future__ import annotations

import argparse
import math
import shutil
import signal
import socket
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from types import FrameType
from typing import Any, NamedTuple

import uvicorn
from fastapi import FastAPI

from coastwatch.errors import InputError, RunFailedError
from coastwatch.formats.registry import FORMATS
from coastwatch.operators import presentation
from coastwatch.operators.api import logs
from coastwatch.operators.api.application import application
from coastwatch.operators.api.bounds import LARGEST_HEAD, LARGEST_MESSAGE
from coastwatch.operators.api.certificate import Certificate
from coastwatch.operators.api.guard import LOOPBACK, Guard
from coastwatch.operators.api.people import Tokens, add, trusted
from coastwatch.operators.api.service import Service
from coastwatch.operators.api.slow_requests import Frames, SlowRequestGuard
from coastwatch.operators.api.webhooks import WebHook, checked, secret_of
from coastwatch.scenario import load_scenario
from coastwatch.sensors import NO_INPUT, LiveFeeds
from coastwatch.server.deployment import Deployment, deployment, of_centre, with_track_sources, with_zones
from coastwatch.server.feeds.address import parsed
from coastwatch.server.feeds.live_input import LiveInput
from coastwatch.server.feeds.outgoing import OutAddress, OutFeed, parsed_out
from coastwatch.server.follow import POLL_S, Follower
from coastwatch.server.input import Input, Paced
from coastwatch.server.link import notice_loss
from coastwatch.server.live import LiveRun
from coastwatch.server.live_video import LiveVideo
from coastwatch.server.processes import handled_by
from coastwatch.server.regions.client import TRACKS, RegionAddress, check_files, parsed_region
from coastwatch.server.regions.publisher import Publisher
from coastwatch.spelling import utc_text
from coastwatch.store import QueryLimit, Store, open_store, sole_server

QUERY = QueryLimit(5.0, time.monotonic)
"""Of each question of the API to the database."""

STOP_S = 3

BACKLOG = 2048
"""Connections that may wait to be taken."""


class Outputs(NamedTuple):
    """Where a server sends what it has."""

    pictures: Sequence[OutAddress]
    journals: Sequence[RegionAddress]  # the tracks of a region
    hooks: Sequence[WebHook]


@contextmanager
def following(opened: Store, run_id: int | None, poll_s: float = POLL_S, asked: Store | None = None) -> Iterator[Service]:
    """The service of a database that another process writes. Args: asked: the same for the questions of the API, with a limit."""
    service = Service(asked or opened)
    service.source = follower = Follower(opened, run_id, service.receive, poll_s)
    with follower:
        yield service


def serve(arguments: argparse.Namespace) -> int:
    """Serve until Ctrl-C or SIGTERM."""
    options = deployment(vars(arguments))
    guard = _guard(options)
    _check_role(options)
    outputs = _outputs(options)  # wrong addresses are refused before anything starts
    logs.begin(options.log_format)
    # The server ends in order, and so the run: it raises signals again when its sockets are closed.
    # A used port is refused before anything starts.
    # SIGHUP has its files read again; the process that renews a certificate sends it.
    hangup = threading.Event()
    on_hangup = handled_by(lambda *_: hangup.set(), [signal.SIGHUP])
    with on_hangup, handled_by(lambda *_: None), bound(options.host, options.port) as listener:
        if options.scenario is None:
            with (
                presentation.opened(options.db) as opened,
                presentation.opened(options.db, limit=QUERY) as asked,
                following(opened, options.run, asked=asked) as service,
                logs.Watch(service, hangup),
            ):
                listen(service, guard, options, outputs, listener)
        else:
            _serve_run(options, options.scenario, guard, outputs, listener, hangup)
    return 0


def _serve_run(
    options: Deployment, name: str, guard: Guard, outputs: Outputs, listener: socket.socket, hangup: threading.Event
) -> None:
    """Run a scenario, on live feeds or on its own input, and serve its pictures. Args: hangup: as of `logs.Watch`.

    Raises: InputError: another server writes into the database, or options do not fit together.
    """
    regions = [parsed_region(text) for text in options.region]
    for region in regions:
        check_files(region)
    live = bool(options.feed or regions)
    if options.run is not None:
        raise InputError("--run: got it with a scenario, needed one of them: a run of a scenario has a number of its own")
    if live and options.speed != 1.0:
        raise InputError("--speed: got it with --feed, needed one of them: feeds have their own speed")
    scenario = with_zones(load_scenario(name, options.settings), options.zones)
    if not live and isinstance(scenario.input, LiveFeeds):
        raise InputError(NO_INPUT)
    feeds = [parsed(text) for text in options.feed]
    scenario = with_track_sources(scenario, [address.source for address in feeds if FORMATS[address.format].own_source])
    if options.role == "centre":
        scenario = of_centre(scenario, [region.name for region in regions])
    elif options.role == "region" and not scenario.radars:
        raise InputError(f"--role region: got {name!r} without radars, needed a scenario with at least one")
    with open_store(options.db, limit=QUERY) as opened, ExitStack() as stack:
        stack.enter_context(sole_server(opened))
        service = Service(opened, publisher=Publisher(opened) if options.role == "region" else None)
        sensors = scenario.sensors()
        video = service.video = LiveVideo(sensors.radars)
        source: Input = Paced(options.speed)
        if live:
            source = LiveInput(
                feeds, sensors, regions=regions, clock=options.clock, lateness_s=options.lateness, on_video=video.take_as_sent
            )
            stack.enter_context(source)
            for text in source.dateless:
                logs.LOG.warning(
                    f"{text}: its times of day are of today's date, as no feed has one; ?date=YYYY-MM-DD says another"
                )
        run = LiveRun(
            scenario,
            source,
            service.receive,
            database=options.db,
            workers=options.workers,
            resume=live and not options.new,
            publisher=service.publisher,
            on_video=video.take_by_heading if live else video.take_all,  # live feeds give the others before the cycle
        )
        service.source, run.on_failed = run, lambda: service.end()
        service.asked.append(run.left_alarms)
        if service.publisher is not None and outputs.journals:
            from coastwatch.server.regions.jetstream import Journal  # of the extra `nats`

            keep_s = 60.0 * scenario.store.journal_minutes
            journals = (Journal(address, service.publisher, keep_s) for address in outputs.journals)
            service.journals = [stack.enter_context(journal) for journal in journals]
        with run, logs.Watch(service, hangup):
            listen(service, guard, options, outputs, listener)
        if run.failed:
            raise RunFailedError(run.error())


def _outputs(options: Deployment) -> Outputs:
    """Where the options send pictures, tracks and alarms. Raises: AddressError, InputError."""
    pictures = [parsed_out(text) for text in options.out if not text.startswith(TRACKS)]
    journals = [parsed_region(text, is_out=True) for text in options.out if text.startswith(TRACKS)]
    if journals and options.role != "region":
        raise InputError(f"--out tracks+...: got it with --role {options.role}, needed --role region: it has tracks to publish")
    hooks = [checked(WebHook(hook.url, hook.kinds, hook.secret or secret_of(hook.secret_file))) for hook in options.webhooks]
    return Outputs(pictures, journals, hooks)


def _check_role(options: Deployment) -> None:
    """Raises: InputError where the regions or the scenario do not fit the role."""
    if options.role == "centre" and not options.region:
        raise InputError(
            "--role centre: got no --region, needed at least one, e.g. --region wss://north.example:8100?name=north"
        )
    if options.region and options.role != "centre":
        raise InputError(f"--region: got it with --role {options.role}, needed --role centre")
    if options.role != "all" and options.scenario is None:
        raise InputError(f"--role {options.role}: got no scenario, needed one: it names the sensors and the settings")


def _certificate(options: Deployment) -> Certificate | None:
    """The certificate of https; None: http. Raises: InputError."""
    if bool(options.tls_cert) != bool(options.tls_key):
        raise InputError("--tls-cert, --tls-key: got one, needed both or none")
    return Certificate(Path(options.tls_cert), Path(options.tls_key)) if options.tls_cert and options.tls_key else None


def _guard(options: Deployment) -> Guard:
    """Who is answered. Raises: InputError where others than this machine could ask without a token."""
    certificate = _certificate(options)
    if options.tokens is not None or options.trusted_proxy:
        return Guard(
            tokens=Tokens(Path(options.tokens)) if options.tokens is not None else None,
            proxy=trusted(options.trusted_proxy) if options.trusted_proxy else None,
            secure=options.tls_cert is not None or bool(options.trusted_proxy),
            certificate=certificate,
        )
    if options.host not in LOOPBACK:
        raise InputError(
            f"--host: got {options.host!r} without --tokens, needed a file of tokens, because others than this machine can ask: "
            "`coastwatch token add NAME --tokens FILE` makes one; or --trusted-proxy, where a proxy asks people who they are"
        )
    return Guard(certificate=certificate)


def add_token(options: argparse.Namespace) -> int:
    """Make a token and print it; the file keeps its hash only. Raises: InputError, OSError."""
    if options.expires is not None and options.expires <= time.time():
        raise InputError(f"--expires: got {utc_text(options.expires)}, needed an instant after now")
    token = add(Path(options.tokens), options.name, options.role, options.expires)
    print(token)
    print(f"coastwatch: {options.role} {options.name} is in {options.tokens}; the token is shown this once", file=sys.stderr)
    return 0


def _free_bytes(folder: Path) -> float:
    """Free bytes of the disk of a folder; NaN where it cannot be asked: the other metrics are answered."""
    try:
        return shutil.disk_usage(folder).free
    except OSError:
        return math.nan


def listen(service: Service, guard: Guard, options: Deployment, outputs: Outputs, listener: socket.socket) -> None:
    """Answer requests until Ctrl-C or SIGTERM, and send pictures and alarms where the options say. Args: listener: as of `bound`."""
    host, port = listener.getsockname()[:2]
    url = f"{'https' if options.tls_cert else 'http'}://{f'[{host}]' if ':' in host else host}:{port}"
    with ExitStack() as stack:
        service.outs = [stack.enter_context(OutFeed(address)) for address in outputs.pictures]
        stack.callback(setattr, service, "outs", ())  # feeds that end are not lost
        logs.say(f"coastwatch: {url}", address=url)
        tls: dict[str, Any] = {}
        if (certificate := guard.certificate) is not None:
            service.metrics.certificate(lambda: certificate.left_s)
            tls = {"ssl_context_factory": lambda *_: certificate.context}
        if (file := service.store.file) is not None:
            service.metrics.disk(lambda: _free_bytes(file.parent))
        service.files = guard.files()
        server = server_of(application(service, guard, hooks=outputs.hooks), **tls)

        def end() -> None:
            server.should_exit = True

        service.end = end
        if not service.source.failed:
            server.run(sockets=[listener])


class _Server(uvicorn.Server):
    """Ends in order within STOP_S, whatever signals come: a forced end cancels the application, and logs that as an error."""

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """As of `uvicorn.Server`: a second Ctrl-C forces nothing."""
        super().handle_exit(sig, frame)
        self.force_exit = False


def server_of(app: FastAPI, **more_settings: Any) -> uvicorn.Server:
    """The server of an application, which then knows when it ends. Args: more_settings: of uvicorn."""
    slow_requests = SlowRequestGuard(app, lambda status: app.state.service.metrics.requests.labels(status).inc())
    config = uvicorn.Config(
        slow_requests,
        http=slow_requests.protocol,
        log_level="error",  # below that, whoever sends rubbish fills the log
        h11_max_incomplete_event_size=LARGEST_HEAD,
        ws=Frames,
        ws_per_message_deflate=False,  # it costs 85 ms a frame and viewer, and saves a third
        ws_max_size=LARGEST_MESSAGE,
        timeout_graceful_shutdown=STOP_S,
        proxy_headers=False,  # the address of the other end is that of the connection: a header may say anything
        log_config=None,
        server_header=False,
        **more_settings,
    )
    server = _Server(config)
    app.state.stopping = lambda: server.should_exit
    return server


def bound(host: str, port: int) -> socket.socket:
    """A listening socket: requests wait until the server answers. Raises: OSError that names the address."""
    family, kind, proto, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
    listener = socket.socket(family, kind, proto)
    try:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        notice_loss(listener)  # else a stream of a lost network keeps its slot for a quarter of an hour
        listener.bind(address)
        listener.listen(BACKLOG)
    except OSError as error:
        listener.close()
        raise OSError(
            f"{host}:{port}: {error.strerror}: is another server running there? --port chooses another one"
        ) from error
    return listener
