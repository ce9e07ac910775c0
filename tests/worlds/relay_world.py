"""A relay between clients and a server of loopback, which can lose all bytes without closing a connection."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress


class Relay:
    """Passes bytes on in both directions. Connections that are open at `lose` stay open and carry nothing more, as of a dead link."""

    def __init__(self, server: socket.socket, port: int) -> None:
        self._server, self._port = server, port
        self.port, self.accepted = int(server.getsockname()[1]), 0
        self._lost: set[socket.socket] = set()
        self._open: list[socket.socket] = []

    def lose(self) -> None:
        """The connections that are open carry nothing more."""
        self._lost.update(self._open)

    def run(self) -> None:
        """Accept until the listening socket is closed."""
        with suppress(OSError):
            while True:
                client, _ = self._server.accept()
                self.accepted += 1
                server = socket.create_connection(("127.0.0.1", self._port))
                self._open += [client, server]
                for one, other in ((client, server), (server, client)):
                    threading.Thread(target=self._pass_on, args=(one, other), daemon=True).start()

    def close(self) -> None:
        """Close all."""
        for one in (self._server, *self._open):
            with suppress(OSError):
                one.shutdown(socket.SHUT_RDWR)
            one.close()

    def _pass_on(self, one: socket.socket, other: socket.socket) -> None:
        with suppress(OSError):
            while data := one.recv(65_536):
                if one not in self._lost:
                    other.sendall(data)
            if one not in self._lost:
                other.shutdown(socket.SHUT_RDWR)


@contextmanager
def relayed(port: int) -> Iterator[Relay]:
    """A relay to a port of loopback."""
    relay = Relay(socket.create_server(("127.0.0.1", 0)), port)
    thread = threading.Thread(target=relay.run, daemon=True)
    thread.start()
    try:
        yield relay
    finally:
        relay.close()
        thread.join()
