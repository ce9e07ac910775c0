"""What the routes of the API share: the newest picture, the database, and where the pictures come from."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from functools import partial
from typing import Any, Protocol

from coastwatch import store
from coastwatch.batches import ALARM_KINDS
from coastwatch.operators import stored
from coastwatch.operators.api.audit import Audit
from coastwatch.operators.api.hub import Hub
from coastwatch.operators.api.metrics import Metrics
from coastwatch.operators.api.webhook_settings import WebHook
from coastwatch.server.feeds.outgoing import OutFeed
from coastwatch.server.live_picture import LivePicture
from coastwatch.server.regions.publisher import Publisher
from coastwatch.server.run import version
from coastwatch.store import Rows, Store

ALARM_ID = re.compile(r"(\d{1,18})-([a-z_]{1,32})-(\d{1,15})(?:-(\d{1,18}))?")
ALL_ALARMS = 2**31 - 1
ZONE_KINDS = ("zone_enter", "zone_leave", "zone_dwell", "zone_speed", "line_crossed")
"""Kinds of alarms whose subject is a zone."""


class NoPictureYet(Exception):
    """There is no picture to answer from; the message says why."""


class Source(Protocol):
    """Where pictures come from."""

    live: bool  # whether this process computes them

    def error(self) -> str | None:
        """Why there is no newer picture, if something is wrong."""
        ...

    def feeds(self) -> list[dict[str, Any]]:
        """The feeds with their counters."""
        ...

    def cycle_s(self) -> float | None:
        """How long the last cycle took."""
        ...

    def counts(self) -> dict[str, float]:
        """Of a live run: cycles, cycles_late and late_s."""
        ...


class Counted(Protocol):
    """What has the counters of a feed."""

    def counters(self) -> dict[str, Any]:
        """Its state for operators."""
        ...


@dataclass
class Service:
    """The parts of a running server. `run_id` is of the newest picture."""

    store: Store
    source: Source = field(init=False)
    metrics: Metrics = field(default_factory=Metrics)
    hub: Hub = field(init=False)
    audit: Audit = field(init=False)
    publisher: Publisher | None = None  # of a region's tracks
    outs: Sequence[OutFeed] = ()  # to which each picture is sent
    journals: Sequence[Counted] = ()  # to which the tracks of this region are published
    webhooks: Sequence[WebHook] = ()  # to which alarms are sent
    acknowledged: Callable[[], None] = lambda: None  # called after each acknowledgement, in any thread
    _runs: dict[int, dict[str, Any]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.hub = Hub(self.metrics)
        self.audit = Audit(partial(store.note_change, self.store))
        self.metrics.ask(lambda: (self.ready()[0], self.source.counts(), self.feeds()))

    def receive(self, picture: LivePicture) -> None:
        """Take a picture of the source. It may be called in any thread, one call at a time."""
        taken = self.source.cycle_s()
        if taken is not None:
            self.metrics.cycle.observe(taken)
        self.hub.receive(picture)
        for out in self.outs:
            out.receive(picture)

    def picture(self) -> LivePicture:
        """The newest picture. Raises: NoPictureYet."""
        found = self.hub.picture
        if found is None:
            raise NoPictureYet(self.source.error() or "there is no picture yet")
        return found

    def version_of_picture(self) -> tuple[int, int]:
        """A value that changes with each new picture. Raises: NoPictureYet."""
        self.picture()
        return self.hub.run, self.hub.frames[-1].seq

    def changes(self, limit: int, offset: int) -> tuple[Rows, int]:
        """Who changed what, the newest first, and how many changes there are. Raises: StoreError."""
        found, total = store.changes(self.store, limit, offset)
        return stored.for_people(found), total

    def computed_all(self) -> bool:
        """Whether this process has computed the run of the newest picture from its first cycle."""
        of = self.hub.picture
        return of is not None and self.source.live and self.source.counts().get("cycles", 0) > of.cycle

    def run_id(self) -> int:
        """The run of the newest picture. Raises: NoPictureYet."""
        return self.picture().run_id

    def of_run(self) -> dict[str, Any]:
        """The row of the run, as it is now. Raises: NoPictureYet, StoreError."""
        return stored.run(self.store, self.run_id())

    def feeds(self) -> list[dict[str, Any]]:
        """The feeds with their counters."""
        return [*self.source.feeds(), *(out.counters() for out in (*self.outs, *self.journals))]

    def alarms(self, parameters: Mapping[str, str], kind: str | None, count: int) -> Rows:
        """The alarms of the run, newest first, with an id and who acknowledged them."""
        asked = {**parameters, "run": str(self.run_id()), "count": str(count)} | ({"kind": kind} if kind else {})
        found = stored.answer(self.store, "alarms", asked)
        done = {_alarm_id(*row[:4]): row[4:7] for row in store.acknowledgements(self.store, self.run_id()).rows}
        at = [found.columns.index(name) for name in ("vessel_id", "kind", "subject", "start_utc")]
        rows = []
        for row in found.rows:
            vessel_id, alarm_kind, subject, start = (row[k] for k in at)
            alarm_id = _alarm_id(vessel_id, alarm_kind, subject, datetime.fromisoformat(start).timestamp())
            by, when_s, note = done.get(alarm_id, (None, None, None))
            rows.append((alarm_id, *row, by, None if when_s is None else stored.utc_text(when_s), note))
        return Rows(("alarm_id", *found.columns, "acknowledged_by", "acknowledged_utc", "note"), rows)

    def acknowledge(self, alarm_id: str, name: str, note: str, who: str) -> Rows | None:
        """Acknowledge an alarm. Returns: its row; None where there is no such alarm. Args: name: of the person; who: of the token."""
        found = ALARM_ID.fullmatch(alarm_id)
        if found is None or found[2] not in ALARM_KINDS:
            return None
        event = int(found[1]), found[2], int(found[4] or 0), int(found[3]) / 1000.0
        if not store.acknowledge(self.store, self.run_id(), event, at_s=time.time(), name=name, note=note, who=who):
            return None
        self.acknowledged()
        rows = self.alarms({"from_s": "0"}, event[1], ALL_ALARMS)
        return Rows(rows.columns, [row for row in rows.rows if row[0] == alarm_id])

    def acknowledge_all(
        self, kind: str | None, zone: int | None, began_s: tuple[float, float], name: str, note: str, who: str
    ) -> int:
        """Acknowledge every alarm that began between two instants and that nobody has acknowledged. Returns: how many.

        Args: kind: none: any; zone: number of the zone; none: any, and alarms without a zone; name, note, who: as of `acknowledge`.
        """
        kinds = [each for each in ALARM_KINDS if kind in (None, each) and (zone is None or each in ZONE_KINDS)]
        count = store.acknowledge_all(
            self.store, self.run_id(), kinds, zone, began_s, at_s=time.time(), name=name, note=note, who=who
        )
        self.acknowledged()
        return count

    def ready(self) -> tuple[bool, dict[str, Any]]:
        """Whether there is a picture and nothing is wrong, and why not."""
        of, error = self.hub.picture, self.source.error()
        said = error or ("there is no picture yet" if of is None else "ready")
        run, cycle = (None, None) if of is None else (of.run_id, of.cycle)
        return said == "ready", {"status": said, "run": run, "cycle": cycle, "age_s": round(self.metrics.age_s, 3)}

    def status(self) -> dict[str, Any]:
        """The run, its newest picture and its age. Raises: NoPictureYet."""
        of = self.picture()
        about = self._about(of.run_id)
        kinds = {str(kind): int((of.kind == kind).sum()) for kind in range(8)}
        taken = self.source.cycle_s()
        return {
            "run": of.run_id,
            "scenario": about["scenario"],
            "title": about["title"],
            "run_status": store.run_status(self.store, of.run_id),
            "version": version(),
            "live": self.source.live,
            "run_id": self.hub.run,
            "seq": self.hub.frames[-1].seq,
            "cycle": of.cycle,
            "time_utc": stored.utc_text(of.time_s),
            "server_utc": stored.utc_text(time.time()),
            "age_s": round(time.time() - of.time_s, 3),
            "period_s": about["period_s"],
            "cycle_ms": None if taken is None else round(taken * 1e3, 1),
            "vessels": len(of),
            "by_kind": kinds,
            "viewers": len(self.hub.viewers),
            "area": about["settings"].get("area"),
            "error": self.source.error(),
            "late": sum(feed.get("late", 0) for feed in self.source.feeds()),
            **{name: round(value, 3) for name, value in self.source.counts().items()},
        }

    def _about(self, run_id: int) -> dict[str, Any]:
        """The row of a run, kept: what is taken from it does not change."""
        if run_id not in self._runs:
            self._runs = {run_id: stored.run(self.store, run_id)}
        return self._runs[run_id]


def _alarm_id(vessel_id: int, kind: str, subject: int, start_s: float) -> str:
    return f"{vessel_id}-{kind}-{round(start_s * 1000)}" + (f"-{subject}" if subject else "")
