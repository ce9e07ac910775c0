"""Those who are told of each change: of alarms, of radar video, of tracks for centres."""

from __future__ import annotations

import threading
from collections.abc import Callable


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
