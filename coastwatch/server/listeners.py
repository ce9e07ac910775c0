"""Those who are told of each change: of alarms, of radar video, of tracks for centres."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress


class Listeners:
    """Functions that are called after each change. All of it may be called in any thread."""

    def __init__(self) -> None:
        self._listeners: dict[object, Callable[[], None]] = {}
        self._lock = threading.Lock()

    def listen(self, tell: Callable[[], None]) -> Callable[[], None]:
        """Have a function called after each change, in any thread. Returns: what ends that."""
        key = object()
        with self._lock:
            self._listeners[key] = tell

        def end() -> None:
            with self._lock:
                self._listeners.pop(key, None)

        return end

    def tell(self) -> None:
        """Call all of them: there is a change."""
        with self._lock:
            listeners = list(self._listeners.values())
        for listener in listeners:
            listener()


@asynccontextmanager
async def woken_by(listen: Callable[[Callable[[], None]], Callable[[], None]]) -> AsyncIterator[asyncio.Event]:
    """An event that is set at each change. Args: listen: takes what is called at a change, in any thread; returns what ends that."""
    loop, wake = asyncio.get_running_loop(), asyncio.Event()

    def tell() -> None:
        with suppress(RuntimeError):  # the loop has been closed
            loop.call_soon_threadsafe(wake.set)

    stop = listen(tell)
    try:
        yield wake
    finally:
        stop()
