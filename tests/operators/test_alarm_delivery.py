"""A man overboard is told at once: among thousands of alarms, beside old ones, to listeners and hooks that are slow or refuse others."""

from __future__ import annotations

import asyncio
import json
import math
import threading
from collections import deque
from collections.abc import AsyncIterator, Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import alarm_world
import httpx2 as httpx
import numpy as np
import pytest
from prometheus_client import Counter
from server_world import Served, events, listening, wait_for
from sqlalchemy import text

from coastwatch.batches import AlarmKind, EventChanges, EventSpans, Flag, VesselAlarms
from coastwatch.operators.api import alarms, webhooks
from coastwatch.operators.api.alarms import AlarmStream
from coastwatch.operators.api.service import Service
from coastwatch.operators.api.webhooks import WebHook
from coastwatch.operators.cli.serving import following
from coastwatch.server.alarm_book import AlarmBook
from coastwatch.server.link import Backoff
from coastwatch.store import open_store

pytestmark = pytest.mark.whole

OVERBOARD = 970_001


def begun(kind: str, vessels: Sequence[int], start_s: float) -> EventChanges:
    """Alarms that begin, one of each vessel."""
    return alarm_world.begun(*((vessel, kind, start_s) for vessel in vessels), text="seen")


class FromBook:
    """What a stream reads, without a server."""

    def __init__(self) -> None:
        self.book = AlarmBook()
        self.book.begin(1)
        self.hub = type("Hub", (), {"picture": None})()
        self.asked: list[Any] = []

    rows_of = Service.rows_of


async def told(chunks: AsyncIterator[bytes], count: int) -> list[list[tuple[str, int, str]]]:
    """Kind of event, vessel (or run) and id of what comes, a list a chunk, until there are so many alarms."""
    out: list[list[tuple[str, int, str]]] = []
    while sum(kind == "alarm" for part in out for kind, _, _ in part) < count:
        part = []
        for event in (await asyncio.wait_for(anext(chunks), 20.0)).decode().split("\n\n"):
            fields = dict(line.split(":", 1) for line in event.splitlines())
            if "data" in fields:
                data = json.loads(fields["data"])
                part.append((fields["event"].strip(), data.get("vessel_id", -1), fields["id"].strip()))
        out.append(part)
    return out


def test_before_a_run_nothing_is_said_to_be_gone() -> None:
    """A page keeps the alarms of before a restart until the run has begun: `run` would empty its list."""

    async def main() -> None:
        service: Any = FromBook()
        service.book = AlarmBook()
        chunks = AlarmStream(service).events("", lambda: True, 60.0)
        first = asyncio.ensure_future(anext(chunks))
        done, _ = await asyncio.wait([first], timeout=0.2)
        assert not done
        service.book.begin(1)
        service.book.apply(begun("man_overboard", [OVERBOARD], 11.0))
        assert (await asyncio.wait_for(first, 20.0)).startswith(b"id: ")
        await chunks.aclose()

    asyncio.run(main())


def test_what_begins_while_a_long_list_is_sent_comes_with_the_next_portion_and_nothing_is_lost() -> None:
    async def main() -> None:
        service: Any = FromBook()
        service.book.apply(begun("dark", range(1, 5001), 10.0))
        chunks = AlarmStream(service).events("", lambda: True, 60.0)
        first = await told(chunks, 1)
        assert [kind for part in first for kind, _, _ in part][:2] == ["run", "alarm"]
        service.book.apply(begun("man_overboard", [OVERBOARD], 11.0))
        next_ones = await told(chunks, 1)
        assert next_ones[0][0][1] == OVERBOARD, "before the others that wait"
        rest = await told(chunks, 5001 - sum(len(part) for part in (*first, *next_ones)) + 1)
        every = [one for part in (*first, *next_ones, *rest) for one in part if one[0] == "alarm"]
        assert {vessel for _, vessel, _ in every} == {*range(1, 5001), OVERBOARD}
        assert len(every) == 5001
        ids = [mark for _, _, mark in every]
        assert set(ids[:-1]) == {""}, "whoever loses the connection among them begins again"
        assert ids[-1] == f"1-{service.book.number}-{alarms.PROCESS}"
        assert max(len(part) for part in rest) <= alarms.PORTION

        service.book.apply(begun("dark", range(6001, 6251), 12.0))
        more = (await told(chunks, 1))[0]
        assert len(more) == alarms.PORTION
        again = await told(AlarmStream(service).events(more[-1][2], lambda: True, 60.0), 250)
        assert {vessel for part in again for _, vessel, _ in part} == set(range(6001, 6251)), "a part was told: all come again"

    asyncio.run(main())


def test_one_alarm_that_cannot_be_written_holds_up_no_other(monkeypatch: pytest.MonkeyPatch) -> None:
    service: Any = FromBook()
    rows_of = service.rows_of

    def broken(alarms: Any) -> Any:
        if any(alarm.vessel_id == 13 for alarm in alarms):
            raise ValueError("no such text")
        return rows_of(alarms)

    service.rows_of = broken
    service.book.apply(begun("dark", range(1, 20), 10.0))
    service.book.apply(begun("man_overboard", [OVERBOARD], 10.0))

    async def main() -> set[int]:
        found = await told(AlarmStream(service).events("", lambda: True, 60.0), 19)
        return {vessel for part in found for kind, vessel, _ in part if kind == "alarm"}

    assert asyncio.run(main()) == {*range(1, 20), OVERBOARD} - {13}
    made = webhooks._messages(service, service.book.since(1, 0))
    assert len(made) == 19


@contextmanager
def hooked(answer: Callable[[dict[str, Any]], int]) -> Iterator[tuple[str, list[dict[str, Any]]]]:
    """A receiver of a web hook. Args: answer: status to a message. Yields: its address, and the messages as they come."""
    taken: list[dict[str, Any]] = []

    def take(headers: dict[str, str], body: bytes) -> int:
        said = json.loads(body)
        taken.append(said | {"delivery": headers["x-coastwatch-delivery"]})
        return answer(said)

    with alarm_world.hooked(take) as address:
        yield address, taken


@pytest.mark.parametrize("trouble", ["refused", "held", "broken"])
def test_a_hook_that_takes_no_other_message_is_told_of_a_man_overboard(trouble: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A message that is refused comes again after 1,000 s; one that is held is not answered; one that is broken raises."""
    go_on = threading.Event()

    def answer(said: dict[str, Any]) -> int:
        if said["alarm"]["kind"] == "man_overboard":
            return 204
        if trouble == "held":
            go_on.wait(60.0)
        return 503

    post = webhooks._Sender._post

    async def posting(self: Any, client: Any, message: Any) -> int:
        status = await post(self, client, message)
        if trouble == "broken" and message.priority:
            raise ValueError("no such text")
        return status

    monkeypatch.setattr(webhooks._Sender, "_post", posting)
    monkeypatch.setattr(webhooks, "TIME_OUT_S", 300.0)

    async def main(address: str, taken: list[dict[str, Any]]) -> None:
        service: Any = FromBook()
        service.metrics = type("Metrics", (), {"webhooks": Counter("told", "messages", ["webhook", "count"], registry=None)})()
        async with webhooks.sending([WebHook(address)], AlarmStream(service), service, Backoff(1000.0, 1000.0)):
            service.book.apply(begun("dark", range(1, 4), 10.0))
            while not taken:
                await asyncio.sleep(0.01)
            await asyncio.sleep(0.1)
            service.book.apply(begun("man_overboard", [OVERBOARD], 11.0))
            async with asyncio.timeout(20.0):
                while all(said["alarm"]["kind"] != "man_overboard" for said in taken):
                    await asyncio.sleep(0.01)
            go_on.set()

    with hooked(answer) as (address, taken):
        asyncio.run(main(address, taken))
    assert len(taken) == (4 if trouble == "broken" else 2), "an error of one message ends no other"


def ended(kind: str, vessel: int, start_s: float, end_s: float | None) -> EventChanges:
    """An alarm that ends, or returns."""
    ints = np.array([vessel]), np.array([alarm_world.NUMBER[kind]]), np.zeros(1, np.int64)
    spans = EventSpans(*ints, np.array([start_s]), np.array([math.nan if end_s is None else end_s]))
    return replace(EventChanges.empty(), **{"returned" if end_s is None else "ended": spans})


def sent_to_hook(book: Callable[[AlarmBook], None], answers: list[int], count: int) -> list[tuple[str, str, str | None]]:
    """Event, delivery and end of the messages that a hook took, of alarms raised by a function. Args: answers: its first statuses."""
    with hooked(lambda said: answers.pop(0) if answers else 204) as (address, taken):

        async def main() -> None:
            service: Any = FromBook()
            service.metrics = type(
                "Metrics", (), {"webhooks": Counter("told", "messages", ["webhook", "count"], registry=None)}
            )()
            book(service.book)
            async with webhooks.sending([WebHook(address)], AlarmStream(service), service, Backoff(0.2, 0.2)):
                async with asyncio.timeout(20.0):
                    while len(taken) < count:
                        await asyncio.sleep(0.01)

        asyncio.run(main())
    return [(said["event"], said["delivery"], said["alarm"]["end_utc"]) for said in taken]


@pytest.mark.parametrize("kind", ["man_overboard", "dark"])
def test_a_hook_is_told_that_an_alarm_returns_and_each_message_has_its_own_delivery(kind: str) -> None:
    """The last that it was told was `closed`, while the alarm lasted, and the second end looked like a repetition of the first."""

    def raised(book: AlarmBook) -> None:
        book.begin(1)
        for changes in (begun(kind, [5], 10.0), *(ended(kind, 5, 10.0, end_s) for end_s in (20.0, None, 40.0))):
            book.apply(changes)

    told = sent_to_hook(raised, [503, 503], 6)[2:]
    assert [(event, end is None) for event, _, end in told] == [
        ("opened", True), ("closed", False), ("returned", True), ("closed", False),
    ]  # fmt: skip
    assert len({delivery for _, delivery, _ in told}) == 4


def test_a_server_that_goes_on_repeats_the_changes_of_the_last_minutes() -> None:
    """What waited for a hook when the process ended was lost."""
    first = AlarmBook()
    first.begin(1)
    for kind, start_s, end_s in (
        ("dark", 10.0, 30.0),
        ("lost", 400.0, 500.0),
        ("aground", 450.0, None),
        ("dark", 150.0, 420.0),
    ):
        first.apply(begun(kind, [int(start_s)], start_s))
        if end_s is not None:
            first.apply(ended(kind, int(start_s), start_s, end_s))
    known = first.alarms()
    told = sent_to_hook(lambda book: book.begin(1, known, 390.0), [], 4)
    assert sorted(delivery for _, delivery, _ in told) == [
        "150-dark-150000-closed", "400-lost-400000-closed", "400-lost-400000-opened", "450-aground-450000-opened",
    ]  # fmt: skip
    lost = [event for event, delivery, _ in told if delivery.startswith("400")]
    assert lost == ["opened", "closed"]


def test_a_reader_that_fell_behind_is_not_told_again_what_was_before_the_start() -> None:
    async def main() -> list[list[str]]:
        service: Any = FromBook()
        service.book._changes = deque(maxlen=30)
        before = AlarmBook()
        before.begin(1)
        before.apply(begun("dark", [1, 2], 10.0))
        service.book.begin(1, before.alarms(), 0.0)
        told, changes = [], AlarmStream(service).changes()
        told.append([change.alarm.alarm_id for change in await asyncio.wait_for(anext(changes), 20.0)])
        for k in range(3):  # more changes than are kept
            service.book.apply(begun("lost", range(100 + 20 * k, 120 + 20 * k), 20.0 + k))
        told.append([change.alarm.kind for change in await asyncio.wait_for(anext(changes), 20.0)])
        await changes.aclose()
        return told

    first, then = asyncio.run(main())
    assert len(first) == 2
    assert set(then) == {"lost"}


def test_among_2000_alarms_and_20000_acknowledged_ones_a_man_overboard_comes_first_to_streams_and_hooks(
    tmp_path: Path,
) -> None:
    import store_world

    with open_store(str(tmp_path / "sea.db")) as opened, hooked(lambda _: 204) as (address, taken):
        store_world.begin(opened)
        for number in range(2):
            store_world.write(opened, 1, number)
        _acknowledged_ones(opened, 20_000)
        with following(opened, None, poll_s=0.05) as service:
            wait_for(lambda: service.book.run_id > 0)
            assert service.book.alarms() == [], "what is acknowledged and has ended is read by nobody"
            with listening(service, hooks=[WebHook(address)]) as served, httpx.Client(timeout=30.0) as client:
                with client.stream("GET", f"http://{served}/api/v1/alarms/stream") as answer:
                    seen = events(answer)
                    store_world.write(opened, 1, 2, cycle=_flooded_cycle(2, 2000))
                    first = next(seen)
                    assert (first["kind"], first["vessel_id"]) == ("man_overboard", 7)
                    kinds = [next(seen)["kind"] for _ in range(2000)]
                    assert set(kinds) == {"zone_enter"}
                wait_for(lambda: len(taken) > 20, 30.0)
                assert "man_overboard" in [said["alarm"]["kind"] for said in taken[:3]]
                waiting = client.get(f"http://{served}/api/v1/alarms?state=unacknowledged&limit=5").json()
                assert (waiting["total"], waiting["alarms"][0]["kind"]) == (2001, "man_overboard")
                done = client.post(
                    f"http://{served}/api/v1/alarms/{first['alarm_id']}/acknowledge", json={"name": "Ana"}
                ).json()
                assert done["acknowledged_by"] == "Ana"
                assert len(service.book.alarms("unacknowledged")) == 2000


def _acknowledged_ones(opened: Any, count: int) -> None:
    """Put so many alarms into run 1 that have ended and were acknowledged."""
    numbers = f"WITH RECURSIVE n(k) AS (SELECT 1000 UNION ALL SELECT k + 1 FROM n WHERE k < {999 + count}) SELECT"
    with opened.engine.begin() as connection:
        connection.execute(
            text(
                "INSERT INTO event (run_id, vessel_id, kind, subject, from_cycle, to_cycle, start_s, end_s, latitude_deg, "
                f"longitude_deg, evidence, unacknowledged) {numbers} 1, k, 'dark', 0, 0, 0, 1.6e9 + k, 1.6e9 + k + 60, 0, 0, '', 0 "
                "FROM n"
            )
        )
        connection.execute(
            text(
                "INSERT INTO acknowledgement (run_id, vessel_id, kind, subject, from_cycle, acknowledged_s, acknowledged_by, "
                f"note, who) {numbers} 1, k, 'dark', 0, 0, 1.6e9, 'Ana', '', 'ana' FROM n"
            )
        )


def _flooded_cycle(number: int, count: int) -> Any:
    """A cycle in which one vessel enters so many zones and another one loses a man."""
    import store_world

    none = np.full(count, np.nan)
    raised = VesselAlarms(
        np.full(count, 4), np.full(count, int(AlarmKind.ZONE_ENTER)), np.arange(1, count + 1), np.full(count, "bay", "U64"),
        np.zeros((count, 2)), np.zeros((count, 2)), np.full(count, -1), none, none, none, none,
    )  # fmt: skip
    picture = store_world.picture_of(number, 30)
    flags = np.where(picture.vessel_id == 7, int(Flag.MAN_OVERBOARD), 0)
    return replace(store_world.cycle_of(number, 30, replace(picture, flags=flags)), vessel_alarms=raised)


def test_a_listener_of_a_real_stream_is_told_while_its_first_list_is_sent(changing: Served) -> None:
    wait_for(lambda: changing.service.book.run_id > 0)
    changing.service.book.apply(begun("dark", range(1, 10_001), 10.0))
    with httpx.stream("GET", f"http://{changing.address}/api/v1/alarms/stream", timeout=30.0) as answer:
        seen = events(answer)
        next(seen)
        changing.service.book.apply(begun("man_overboard", [OVERBOARD], 11.0))
        found = {next(seen)["vessel_id"] for _ in range(10_000)}
    assert OVERBOARD in found
    assert len(found) == 10_000
