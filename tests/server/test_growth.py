"""What grows in a server with time, distinct MMSI or distinct texts is bounded, and no thread of it ends silently."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from feed_world import SENSORS
from nmea_sentences import checked, tagged
from server_world import Served, wait_for

from coastwatch.batches import AisStatics, RadarReports, TrackSources
from coastwatch.errors import StoreError
from coastwatch.formats import decoding
from coastwatch.formats.decoding import Counts, FeedSettings, Waiting
from coastwatch.formats.intake.faults import Tally
from coastwatch.formats.nmea.ais import AisDecoder
from coastwatch.formats.nmea.targets import TargetDecoder
from coastwatch.operators.api import logs
from coastwatch.operators.api.logs import Watch
from coastwatch.server import live, timing
from coastwatch.server.feeds import outgoing
from coastwatch.server.feeds.address import parsed
from coastwatch.server.feeds.live_input import LiveInput
from coastwatch.server.feeds.outgoing import OutFeed, parsed_out
from coastwatch.server.follow import Follower
from coastwatch.server.link import Backoff
from coastwatch.server.live_picture import Statics, merge_statics, without_absent
from coastwatch.server.regions.client import Connection, parsed_region
from coastwatch.server.timing import Stopwatch
from coastwatch.server.troubles import Trouble

pytestmark = pytest.mark.whole

NOW_S = 1.79e9
DEFECT = "ZeroDivisionError: a defect"


def plots(time_s: np.ndarray) -> RadarReports:
    n = len(time_s)
    none, place = np.full(n, -1), np.full((n, 2), -22.9)
    return RadarReports(np.zeros(n, np.int64), time_s, time_s, np.linspace(1e3, 9e3, n), np.full(n, 10.0), place, none)


def test_reports_that_wait_are_bounded_and_the_oldest_go(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(decoding, "MOST_WAITING", 1_000)
    counts = Counts()
    waiting = Waiting(counts, Tally(), "radar")
    for k in range(50):
        waiting.add("radar", plots(NOW_S + np.arange(100) + 100.0 * k))
        assert waiting.rows <= 1_000
    found = waiting.reports_between(NOW_S - 1.0, NOW_S + 5_000.0).radar
    assert len(found) >= 900
    assert len(found) + counts.dropped == 5_000
    assert found.received_s.min() == NOW_S + 5_000.0 - len(found)


NAMED = "!AIVDM,1,1,,A,H42O55i18tMET00000000000000,2*" + checked("AIVDM,1,1,,A,H42O55i18tMET00000000000000,2")
"""Part A of message 24, which has a name."""


def test_names_of_a_sender_whose_clock_is_a_little_ahead_do_not_add_up() -> None:
    """As long as one waits for its cycle, those that were used were kept too."""
    decoder = AisDecoder("x", 0, True)
    used = 0
    for cycle in range(40):
        at_s = NOW_S + 3.0 * cycle
        line = tagged(f"c:{int(at_s) + 30}", NAMED).encode()
        decoder.decode([(at_s, line, 0)] * 20, None)
        used += len(decoder._named(at_s + 3.0)[1])
        assert sum(len(statics) for statics, _ in decoder._statics) <= 20 * 12
    assert used > 20 * 20


def test_names_of_a_receiver_that_wait_are_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(decoding, "MOST_WAITING", 100)
    decoder = AisDecoder("x", 0, False)
    for k in range(20):
        decoder.decode([(NOW_S + k, NAMED.encode(), 0)] * 30, None)
        assert sum(len(rows) for _, rows in decoder._statics) <= 100
        assert sum(len(statics) for statics, _ in decoder._statics) <= 100
    assert decoder.counts.dropped >= 400


def test_lines_that_belong_to_no_sentence_are_not_kept() -> None:
    decoder = AisDecoder("x", 0, True)
    one = np.full(1, 10.0)
    source = TrackSources(np.array(["other"]), np.full((1, 2), np.nan), np.zeros(1), one, one, one)
    sensors = replace(SENSORS, track_sources=source)
    targets = TargetDecoder(FeedSettings("x", "x", {"site": "50,-1"}, "other"), sensors)
    for k in range(20):
        for made in (decoder, targets):
            made.decode([(NOW_S + k, b"$PGHP,1,2026,1,1,0,0,0,0,,,1", 0)] * 200, None)
        assert decoder.counts.ledger.read == targets.counts.ledger.read == 200 * (k + 1)  # each is decoded when it comes
    assert decoder.waiting == targets.waiting == 0


def test_what_is_dropped_is_said_of_the_feed() -> None:
    with LiveInput([parsed("json+listen://127.0.0.1:0")], SENSORS) as made:
        made._feeds[0].decoder.counts.dropped = 7
        assert made.feeds()[0]["dropped"] == 7
        assert [fault.count for fault in made.faults()] == [7]


def test_names_in_memory_are_those_of_the_picture_where_there_are_too_many() -> None:
    known: Statics = {}
    for k in range(5):
        mmsi = np.arange(1_000) + 1_000 * k
        n = len(mmsi)
        of = np.full(n, NOW_S), mmsi, np.full(n, "A"), np.full(n, ""), np.full(n, 70), np.full(n, 9.0), np.full(n, 9.0)
        merge_statics(known, AisStatics(*of))
    assert len(known) == 5_000 < live.MOST_STATICS
    assert sorted(without_absent(known, np.array([-1, 7, 4_999]))) == [7, 4_999]


def test_times_of_stages_are_bounded_and_their_totals_are_of_all(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(timing, "KEPT", 100)
    watch = Stopwatch()
    for k in range(1_000):
        watch._cycle = {"plots": 1.0 if k < 900 else 3.0}
        watch.lap()
        watch.late("store", 0.5)
        assert max(map(len, watch.seconds.values())) <= 100
    said = watch.summary()
    assert (said["plots"]["median"], said["plots"]["total"]) == (3.0, 1_200.0)
    assert said["plots"]["share"] == pytest.approx(1_200.0 / 1_700.0)


def test_the_log_remembers_what_is_wrong_now_and_no_more() -> None:
    said: list[Trouble] = []
    feed = {"name": "north", "connected": True, "state": "connected", "error": ""}
    source = SimpleNamespace(error=lambda: None, counts=dict)
    watch = Watch(SimpleNamespace(source=source, feeds=lambda: [feed], troubles=lambda: said))  # type: ignore[arg-type]
    for k in range(2_000):
        said[:] = [Trouble("feed", f"sender {k}", None, f"text {k}", False)]
        feed["error"] = f"error {k}"
        watch.look()
    assert (len(watch._troubles), len(watch._errors), len(watch._connected)) == (1, 1, 1)


def test_each_trouble_of_a_feed_is_logged_and_once_while_its_numbers_alone_change(caplog: pytest.LogCaptureFixture) -> None:
    said: list[Trouble] = []
    source = SimpleNamespace(error=lambda: None, counts=dict)
    watch = Watch(SimpleNamespace(source=source, feeds=list, troubles=lambda: said))  # type: ignore[arg-type]
    caplog.set_level("INFO", "coastwatch.serve")
    texts = (
        ["its clock is 3,600 s ahead"],
        ["its clock is 3601.5 s ahead"],
        ["its clock is 12 s behind", "8 of 9 reports thrown away"],
        [],
    )
    for some in texts:
        said[:] = [Trouble("feed", "north", None, text, False) for text in some]
        watch.look()
    logged = [record.getMessage() for record in caplog.records]
    assert logged[0] == texts[0][0]
    assert sorted(logged[1:3]) == sorted(texts[2])
    assert logged[3:] == ["trouble is over"]


def fails_first(then: Callable[..., Any]) -> tuple[Callable[..., Any], list[int]]:
    """A function that raises what nobody expects at its first two calls. Returns: it, and its calls."""
    calls: list[int] = []

    def made(*given: Any) -> Any:
        calls.append(1)
        if len(calls) <= 2:
            raise ZeroDivisionError("a defect")
        return then(*given)

    return made, calls


def test_a_connection_to_a_region_survives_a_defect(monkeypatch: pytest.MonkeyPatch) -> None:
    connection, seen = Connection(parsed_region("ws://127.0.0.1:1?name=north")), list[tuple[bool, str | None]]()
    session, calls = fails_first(lambda: connection._ended.wait(20.0))

    def noted() -> None:
        seen.append((connection.connected, connection.error))
        connection.connected = True
        session()

    monkeypatch.setattr(connection, "_session", noted)
    with connection:
        wait_for(lambda: len(calls) == 3 and connection.connected)
    assert seen[1:] == [(False, DEFECT)] * 2


def test_a_feed_that_is_sent_survives_a_defect(monkeypatch: pytest.MonkeyPatch, served: Served) -> None:
    feed = OutFeed(parsed_out("cot+udp://127.0.0.1:9"))
    messages, calls = fails_first(feed._encoder.messages)
    monkeypatch.setattr(feed._encoder, "messages", messages)
    monkeypatch.setattr(outgoing, "RETRY", Backoff(0.2, 15.0))
    with feed:
        feed.receive(served.service.picture())
        wait_for(lambda: feed.error == DEFECT and not feed.connected)
        wait_for(lambda: (feed.receive(served.service.picture()), feed.sent > 0)[1])
        assert feed.connected
    assert len(calls) >= 3


@pytest.mark.parametrize("error", [ZeroDivisionError("a defect"), StoreError("database is locked")])
def test_a_journal_survives_a_defect_and_a_database_that_is_away(monkeypatch: pytest.MonkeyPatch, error: Exception) -> None:
    pytest.importorskip("nats", reason="the package nats-py is not installed")
    from coastwatch.server.regions.jetstream import Journal

    journal = Journal(parsed_region("nats://127.0.0.1:1/north"), SimpleNamespace(), 60.0)  # type: ignore[arg-type]
    seen: list[tuple[bool, str | None]] = []

    async def publish() -> None:
        seen.append((journal.connected, journal.error))
        journal.connected, journal.connections = True, journal.connections + 1
        raise error

    monkeypatch.setattr(journal, "_publish", publish)
    with journal:
        wait_for(lambda: len(seen) >= 3)
    assert seen[1:3] == [(False, str(error) if isinstance(error, StoreError) else DEFECT)] * 2


def test_the_thread_of_the_log_survives_a_defect(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(logs, "POLL_S", 0.01)
    source = SimpleNamespace(error=lambda: None, counts=dict)
    watch = Watch(SimpleNamespace(source=source, feeds=list, troubles=list))  # type: ignore[arg-type]
    look, calls = fails_first(watch.look)
    monkeypatch.setattr(watch, "look", look)
    with watch:
        wait_for(lambda: len(calls) > 3)


def test_a_database_that_is_followed_with_a_defect_is_followed_again(served: Served, monkeypatch: pytest.MonkeyPatch) -> None:
    taken: list[Any] = []
    follower = Follower(served.store, None, taken.append, 0.2)
    look, _ = fails_first(follower._read_changes)
    monkeypatch.setattr(follower, "_read_changes", look)
    with follower:
        wait_for(lambda: follower.error() == DEFECT)
        wait_for(lambda: taken and follower.error() is None)
