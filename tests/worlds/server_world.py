"""Servers on a free port of loopback, and a small sea in a database."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import httpx2 as httpx
import numpy as np
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect

from coastwatch.batches import Flag
from coastwatch.operators.api.application import WEB, application
from coastwatch.operators.api.guard import Guard
from coastwatch.operators.api.service import Service
from coastwatch.operators.api.webhooks import WebHook
from coastwatch.operators.cli.serving import bound, following, server_of
from coastwatch.store import Store, open_store


@dataclass(frozen=True)
class Served:
    """A running server."""

    address: str  # host:port
    service: Service
    store: Store

    def get(self, path: str, **given: Any) -> httpx.Response:
        return httpx.get(f"http://{self.address}{path}", **given)

    def stream(self, query: str = "", **given: Any) -> ClientConnection:
        return connect(
            f"ws://{self.address}/api/v1/stream{query}", subprotocols=["coastwatch.picture.v1"], max_size=2**26, **given
        )


@contextmanager
def listening(
    service: Service, guard: Guard | None = None, web: Path = WEB, port: int = 0, hooks: Sequence[WebHook] = ()
) -> Iterator[str]:
    """Serve in a thread. Args: port: 0: a free one. Yields: host:port."""
    server = server_of(application(service, guard or Guard(), web, hooks))
    with bound("127.0.0.1", port) as opened:
        port = opened.getsockname()[1]
        thread = threading.Thread(target=server.run, kwargs={"sockets": [opened]})
        thread.start()
        try:
            yield f"127.0.0.1:{port}"
        finally:
            server.should_exit = True
            thread.join()


def wait_for(found: Any, seconds: float = 60.0) -> None:
    """Wait until a function returns something true. A machine that compiles kernels may be slow."""
    done = threading.Event()
    for _ in range(int(seconds / 0.02)):
        if found():
            return
        done.wait(0.02)
    raise AssertionError("it did not happen in time")


def code_of(viewer: ClientConnection) -> int:
    """The code with which a socket is closed."""
    try:
        while True:
            viewer.recv(timeout=10)
    except ConnectionClosed as closed:
        return -1 if closed.rcvd is None else closed.rcvd.code


@contextmanager
def served_sea(folder: Path) -> Iterator[Served]:
    """A server on a database with 3 cycles of a small sea."""
    import store_world

    with open_store(str(folder / "sea.db")) as opened:
        run_id = store_world.begin(opened)
        for number in range(3):
            store_world.write(opened, run_id, number)
        with following(opened, None, poll_s=0.05) as service, listening(service, web=folder) as address:
            wait_for(lambda: service.hub.picture)
            yield Served(address, service, opened)


def raise_alarm(served: Served, number: int, vessel_id: int | None) -> None:
    """Write a cycle in which one vessel is dark, or none."""
    import store_world

    picture = store_world.picture_of(number, 30)
    flags = np.where(picture.vessel_id == vessel_id, int(Flag.DARK), 0)
    store_world.write(served.store, 1, number, cycle=store_world.cycle_of(number, 30, replace(picture, flags=flags)))


def events(answer: httpx.Response) -> Iterator[dict[str, Any]]:
    """The alarms of a stream, with their ids."""
    fields: dict[str, str] = {}
    for line in answer.iter_lines():
        key, _, value = line.partition(": ")
        if not line and fields.get("event") == "alarm":
            yield {**json.loads(fields["data"]), "id": fields["id"]}
        if not line:
            fields = {}
        fields[key] = value
