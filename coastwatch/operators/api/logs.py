"""What a server prints while it runs: as text, or as one JSON object a line. No log has a token, a query or a body."""

from __future__ import annotations

import json
import logging
import re
import sys
import threading
from collections.abc import Mapping
from typing import Any, Self

from coastwatch.operators.api.service import Service
from coastwatch.spelling import printable, printable_lines, utc_text

LOG = logging.getLogger("coastwatch.serve")
POLL_S = 1.0
NUMBER = re.compile(r"\d[\d,.]* ?\w*")  # with what it counts: a text whose numbers alone change is said once


class _Lines(logging.Formatter):
    """A record as one line. Its `fields` are more keys. As text nothing in it can make another line or move a cursor."""

    def __init__(self, as_json: bool) -> None:
        super().__init__()
        self.as_json = as_json

    def format(self, record: logging.LogRecord) -> str:
        fields: Mapping[str, Any] = getattr(record, "fields", {})
        trouble = self.formatException(record.exc_info) if record.exc_info else ""
        if not self.as_json:
            named = ", ".join(f"{name} {value}" for name, value in fields.items())
            head = "" if record.levelno == logging.INFO else f"{record.levelname.lower()}: "
            line = printable(f"coastwatch: {head}{record.getMessage()}" + (f" ({named})" if named else ""))
            return f"{line}\n{printable_lines(trouble)}" if trouble else line
        when = utc_text(record.created)
        row = {"time": when, "level": record.levelname.lower(), "logger": record.name, "message": record.getMessage(), **fields}
        return json.dumps({**row, "trace": trouble} if trouble else row, default=str)


def begin(form: str) -> None:
    """Print what the server and uvicorn log to stderr. Args: form: text or json."""
    handler = logging.StreamHandler()
    handler.setFormatter(_Lines(form == "json"))
    for name, level in (("coastwatch.serve", logging.INFO), ("uvicorn", logging.ERROR)):
        log = logging.getLogger(name)
        log.handlers, log.propagate = [handler], False
        log.setLevel(level)


def say(line: str, **fields: Any) -> None:
    """Print a line for people as it is; as JSON with its fields."""
    handlers = LOG.handlers
    if handlers and isinstance(handlers[0].formatter, _Lines) and handlers[0].formatter.as_json:
        LOG.info(line.removeprefix("coastwatch: "), extra={"fields": fields})
    else:
        print(printable(line), file=sys.stderr, flush=True)


class Watch:
    """Logs what changes in a server, looked at once a second. Use it in a `with` block."""

    def __init__(self, service: Service, hangup: threading.Event | None = None) -> None:
        """Args: hangup: set when SIGHUP has come; its files are read again then, here and not where the signal interrupts."""
        self._service, self._stop, self._hangup = service, threading.Event(), hangup or threading.Event()
        self._error: str | None = None
        self._began = False  # pictures have come
        self._connected: dict[str, bool] = {}
        self._errors: dict[str, str] = {}  # the last one of each feed
        self._troubles: set[tuple[str, str, str]] = set()  # kind, name and words of those of the last look
        self._late = 0.0
        self._thread = threading.Thread(target=self._watch, name="log", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, kind: object, *unused: object) -> None:
        self._stop.set()
        self._thread.join()
        if kind is None:  # else the error is said instead
            LOG.info("stopped")

    def _watch(self) -> None:
        while not self._stop.wait(POLL_S):
            try:
                self.look()
            except Exception:  # of one look: the next one may succeed
                LOG.exception("the server cannot be watched")

    def look(self) -> None:
        """Log what has changed since the last look."""
        if self._hangup.is_set():
            self._hangup.clear()
            files = self._service.files
            LOG.info("SIGHUP: certificate and tokens are read again" if files else "SIGHUP: there is no file to read again")
            for one in files:
                one.reread()
        source = self._service.source
        error = source.error()
        if error != self._error:
            LOG.log(logging.WARNING if self._began and error else logging.INFO, error or "pictures come")
            self._error, self._began = error, self._began or error is None
        for feed in self._service.feeds():
            name, connected, refusal = str(feed["name"]), bool(feed["connected"]), str(feed.get("error") or "")
            if connected != self._connected.get(name, False):
                level = logging.INFO if connected else logging.WARNING
                LOG.log(level, f"feed {feed['state']}" if connected else "feed lost", extra={"fields": {"feed": name}})
            self._connected[name] = connected
            if refusal and self._errors.get(name) != refusal:
                self._errors[name] = refusal
                LOG.warning(refusal, extra={"fields": {"feed": name}})
        troubles = {(t.kind, t.name, NUMBER.sub("", t.text)): t.text for t in self._service.troubles()}
        for kind, name, words in troubles.keys() - self._troubles:
            LOG.warning(troubles[kind, name, words], extra={"fields": {"trouble": kind, **({"name": name} if name else {})}})
        for kind, name in {key[:2] for key in self._troubles} - {key[:2] for key in troubles}:
            LOG.info("trouble is over", extra={"fields": {"trouble": kind, **({"name": name} if name else {})}})
        self._troubles = set(troubles)
        counts = source.counts()
        late = counts.get("cycles_late", 0.0)
        if late > self._late:
            LOG.warning("cycles late", extra={"fields": {"cycles_late": late, "late_s": round(counts.get("late_s", 0.0), 2)}})
        self._late = late
