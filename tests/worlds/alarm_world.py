"""Events that begin, and a receiver of web hooks, for the tests of alarms."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

import numpy as np

from coastwatch.batches import BegunEvents, EventChanges, EventSpans
from coastwatch.batches.kinds import EVENT_KINDS

NUMBER = {name: number for number, name in EVENT_KINDS.items()}


def begun(*rows: tuple[int, str, float], text: str | None = None, position_deg: np.ndarray | None = None) -> EventChanges:
    """Events that begin. Args: rows: vessel, kind, start; text: the evidence of all, else `why 0`, `why 1` and so on."""
    n = len(rows)
    vessel, number = (np.array(column, np.int64) for column in ([row[0] for row in rows], [NUMBER[row[1]] for row in rows]))
    start_s, evidence = np.array([row[2] for row in rows], np.float64), np.array([text or f"why {k}" for k in range(n)], object)
    where = np.zeros((n, 2)) if position_deg is None else position_deg
    made = BegunEvents(vessel, number, np.zeros(n, np.int64), start_s, where, np.ones(n), np.full(n, -1), evidence)
    return EventChanges(made, EventSpans.empty(), EventSpans.empty())


@contextmanager
def hooked(answer: Callable[[dict[str, str], bytes], int]) -> Iterator[str]:
    """A receiver of a web hook. Args: answer: status to a message, of its headers in lower case and its body. Yields: its address."""

    class Handler(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            body = self.rfile.read(int(self.headers["Content-Length"]))
            self.send_response(answer({key.lower(): value for key, value in self.headers.items()}, body))
            self.end_headers()

        def log_message(self, *unused: Any) -> None:
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    server.daemon_threads = True
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    try:
        yield f"http://127.0.0.1:{server.server_address[1]}/"
    finally:
        server.shutdown()
        server.server_close()
        thread.join()
