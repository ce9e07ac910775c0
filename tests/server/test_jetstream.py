"""A region and its centres over a stream of NATS JetStream: the cycles are those that a WebSocket brings, each once."""

from __future__ import annotations

import asyncio
import shutil
import socket
import subprocess
import threading
import uuid
from collections.abc import Callable, Coroutine, Iterator
from contextlib import ExitStack, suppress
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import store_world
from region_world import PERIOD_S, START_S, VESSELS, Region, centre_scenario
from relay_world import relayed
from server_world import listening, wait_for

from coastwatch.errors import AddressError, InputError
from coastwatch.operators.cli import make_parser
from coastwatch.operators.cli.serving import serve
from coastwatch.server.feeds.live_input import LiveInput
from coastwatch.server.regions.client import parsed_region
from coastwatch.server.troubles import of_outs
from coastwatch.store import open_store

pytestmark = pytest.mark.whole

SERVER = "nats://127.0.0.1:4222"
KEEP_S = 600.0


def run_with_stream(act: Callable[[Any], Coroutine[Any, Any, Any]]) -> Any:
    import nats

    async def whole() -> Any:
        client = await nats.connect(SERVER, allow_reconnect=False, connect_timeout=2)
        try:
            return await act(client)
        finally:
            await client.close()

    return asyncio.run(whole())


@pytest.fixture
def name() -> Iterator[str]:
    """What a region of this test calls itself; its stream is deleted."""
    if find_spec("nats") is None:
        pytest.skip("needs the package nats-py")
    from nats.js.errors import Error, NotFoundError

    try:
        with socket.create_connection(("127.0.0.1", 4222), timeout=1.0):
            run_with_stream(lambda client: client.jetstream().account_info())
    except (OSError, Error) as error:
        pytest.skip(f"needs a NATS server with JetStream at 127.0.0.1:4222: {error}")
    made = f"test-{uuid.uuid4().hex[:12]}"
    yield made
    with suppress(NotFoundError):
        run_with_stream(lambda client: client.jetstream().delete_stream(f"coastwatch-{made}"))


@pytest.fixture
def region(tmp_path: Path) -> Iterator[Region]:
    with open_store(str(tmp_path / "region.db")) as opened:
        yield Region(opened)


def journal(region: Region, address: str) -> Any:
    from coastwatch.server.regions.jetstream import Journal

    assert region.service.publisher is not None
    return Journal(parsed_region(address), region.service.publisher, KEEP_S)


def stopped_after(seconds: float) -> threading.Event:
    """An event that is set after a time, so that no wait is endless."""
    stop = threading.Event()
    timer = threading.Timer(seconds, stop.set)
    timer.daemon = True
    timer.start()
    return stop


def cycles(address: str, positions: dict[str, tuple[str, int]], wanted: int) -> tuple[list[Any], list[Any], dict[str, Any]]:
    """The tracks and the intake of each cycle of a centre, and the counters of its region."""
    scenario = centre_scenario()
    sensors = scenario.sensors()
    with LiveInput([], sensors, regions=[parsed_region(address)], clock="feeds") as source:
        source.begin(scenario, sensors, 1, threading.Event(), positions)
        found, intake = [], []
        for number in range(wanted):
            wait_for(lambda number=number: source.wait(START_S + (number + 1) * PERIOD_S, threading.Event()))
            found.append(source.between(START_S + number * PERIOD_S, START_S + (number + 1) * PERIOD_S).tracks)
            intake.append(source.intake())
        return found, intake, source.feeds()[0]


def test_cycles_of_a_stream_are_to_the_bit_those_of_a_websocket_and_go_on_after_the_last_one(
    region: Region, name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        "coastwatch.server.regions.jetstream.HEADERS_BYTES", (1 << 20) - 1000
    )  # so each cycle has several parts
    region.write(7)
    with listening(region.service, web=tmp_path) as address, journal(region, f"{SERVER}/{name}") as published:
        wait_for(lambda: published.published == 7)
        by_socket = cycles(f"ws://{address}?name=north", {}, 7)
        by_stream = cycles(f"{SERVER}/{name}?name=north", {}, 7)
        run = by_stream[1][0][0].region_run
        later = cycles(f"{SERVER}/{name}?name=north", {"north": (run, 4)}, 7)
    assert by_stream[1] == by_socket[1]
    assert [len(tracks) for tracks in by_stream[0]] == 7 * [VESSELS]
    for one, other in zip(by_socket[0], by_stream[0], strict=True):
        for column in ("sensor", "number", "time_s", "position_deg", "velocity_m_s", "covariance"):
            assert np.array_equal(getattr(one, column), getattr(other, column)), column
    assert [len(tracks) for tracks in later[0]] == [0, 0, 0, 0, VESSELS, VESSELS, VESSELS]
    assert (by_stream[2]["records"], by_stream[2]["dropped"], by_stream[2]["refused"], by_stream[2]["late"]) == (7, 0, 0, 0)
    messages = run_with_stream(lambda client: client.jetstream().stream_info(f"coastwatch-{name}")).state.messages
    assert messages > 2 * 7


def test_a_region_that_starts_again_publishes_what_the_stream_does_not_have(region: Region, name: str) -> None:
    region.write(3)
    with journal(region, f"{SERVER}/{name}") as published:
        wait_for(lambda: published.published == 3)
    region.write(2)
    with journal(region, f"{SERVER}/{name}") as published:
        wait_for(lambda: published.published == 2)
        region.write(1)
        wait_for(lambda: published.published == 3)
        assert published.counters()["connected"]
        assert published.counters()["dropped"] == 0
    found, intake, _ = cycles(f"{SERVER}/{name}?name=north", {}, 6)
    assert [len(tracks) for tracks in found] == 6 * [VESSELS]
    assert [(one.first_seq, one.last_seq) for part in intake for one in part] == [(seq, seq) for seq in range(1, 7)]


def test_damaged_messages_are_counted_and_cycles_that_the_stream_lost_too(region: Region, name: str) -> None:
    region.write(2)
    with journal(region, f"{SERVER}/{name}") as published, ExitStack() as stack:
        wait_for(lambda: published.published == 2)
        scenario = centre_scenario()
        sensors = scenario.sensors()
        source = stack.enter_context(
            LiveInput([], sensors, regions=[parsed_region(f"{SERVER}/{name}?name=north")], clock="feeds")
        )
        source.begin(scenario, sensors, 1, threading.Event(), {})
        wait_for(lambda: source.feeds()[0]["received"] == 2)

        async def damage(client: Any) -> None:
            stream = client.jetstream()
            for headers in ({"Coastwatch-Part": "1/1"}, {"Coastwatch-Part": "3/2"}, None):
                await stream.publish(f"coastwatch.tracks.{name}.9@x.1", b"damaged", headers=headers)

        run_with_stream(damage)
        wait_for(lambda: source.feeds()[0]["refused"] == 3)
        region.cycles += 1  # a cycle that nobody gets
        region.write(1)
        wait_for(lambda: source.feeds()[0]["received"] == 4)
        assert source.feeds()[0]["dropped"] == 1


def test_a_quiet_stream_keeps_its_connection_and_forgets_a_centre_that_ends(
    region: Region, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    from nats.errors import TimeoutError as OfNats
    from nats.js import JetStreamContext

    raised: list[type[Exception]] = []
    fetch = JetStreamContext.PullSubscription.fetch

    async def quiet(messages: Any, *args: Any, **kwargs: Any) -> Any:
        if len(raised) < 6:
            raised.append((TimeoutError, OfNats)[len(raised) % 2])
            raise raised[-1]
        return await fetch(messages, *args, **kwargs)

    monkeypatch.setattr(JetStreamContext.PullSubscription, "fetch", quiet)
    region.write(1)
    with journal(region, f"{SERVER}/{name}") as published:
        wait_for(lambda: published.published == 1)
        found, _, feed = cycles(f"{SERVER}/{name}?name=north", {}, 1)
    assert (len(found[0]), feed["connections"], feed["error"], len(raised)) == (VESSELS, 1, None, 6)
    consumers = run_with_stream(lambda client: client.jetstream().consumers_info(f"coastwatch-{name}"))
    assert not consumers


@pytest.mark.parametrize("how", ["consumer", "stream", "forgotten"])
def test_a_centre_that_the_server_has_forgotten_goes_on_after_its_last_cycle(
    region: Region, name: str, monkeypatch: pytest.MonkeyPatch, how: str
) -> None:
    monkeypatch.setattr("coastwatch.server.regions.jetstream.QUIET_S", 0.1)
    monkeypatch.setattr("coastwatch.server.regions.jetstream.POLL_S", 0.1)
    if how == "forgotten":
        monkeypatch.setattr("coastwatch.server.regions.jetstream.FORGOTTEN_S", 0.3)
    of_stream, wanted, stop = f"coastwatch-{name}", 24, threading.Event()
    written = wanted if how == "forgotten" else 3
    region.write(written)

    def known() -> list[str]:
        return [one.name for one in run_with_stream(lambda client: client.jetstream().consumers_info(of_stream))]

    async def delete(client: Any) -> None:
        if how == "stream":
            await client.jetstream().delete_stream(of_stream)
        for consumer in known_then if how == "consumer" else []:
            await client.jetstream().delete_consumer(of_stream, consumer)

    scenario = centre_scenario()
    sensors = scenario.sensors()
    regions = [parsed_region(f"{SERVER}/{name}?name=north")]
    with (
        journal(region, f"{SERVER}/{name}") as published,
        LiveInput([], sensors, regions=regions, clock="feeds") as source,
    ):
        wait_for(lambda: published.published == written)
        source.begin(scenario, sensors, 1, threading.Event(), {})
        wait_for(lambda: source.feeds()[0]["received"] >= 3)
        known_then = known()
        assert len(known_then) == 1
        run_with_stream(delete)
        region.write(wanted - written)
        if how == "forgotten":  # the centre waits for another region, and asks for nothing
            wait_for(lambda: not known())
        found: list[int] = []
        late = threading.Timer(20.0, stop.set)
        late.start()
        for number in range(wanted):
            assert source.wait(START_S + (number + 1) * PERIOD_S, stop), f"cycle {number + 1} did not come in time"
            assert len(source.between(START_S + number * PERIOD_S, START_S + (number + 1) * PERIOD_S).tracks) == VESSELS
            found += [one.last_seq for one in source.intake()]
        late.cancel()
        feed = source.feeds()[0]
    assert found == list(range(1, wanted + 1))
    assert (feed["connections"], feed["dropped"], feed["late"]) == (2, 0, 0)


def test_a_centre_says_that_its_stream_is_gone_until_it_is_there_again(
    region: Region, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("coastwatch.server.regions.jetstream.QUIET_S", 0.1)
    monkeypatch.setattr("coastwatch.server.regions.jetstream.POLL_S", 0.1)
    region.write(2)
    scenario = centre_scenario()
    sensors = scenario.sensors()
    with LiveInput([], sensors, regions=[parsed_region(f"{SERVER}/{name}?name=north")], clock="feeds") as source:
        with journal(region, f"{SERVER}/{name}") as published:
            wait_for(lambda: published.published == 2)
        source.begin(scenario, sensors, 1, threading.Event(), {})
        wait_for(lambda: source.feeds()[0]["received"] == 2)
        run_with_stream(lambda client: client.jetstream().delete_stream(f"coastwatch-{name}"))
        wait_for(lambda: not source.feeds()[0]["connected"], 10.0)
        wait_for(lambda: source.feeds()[0]["error"] == f"the server has no stream coastwatch-{name}: the region makes it", 10.0)
        with journal(region, f"{SERVER}/{name}"):
            region.write(1)
            wait_for(lambda: source.feeds()[0]["received"] == 3, 10.0)
        assert source.feeds()[0]["dropped"] == 0


def test_a_link_that_carries_nothing_more_is_noticed_and_made_again(
    region: Region, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("coastwatch.server.regions.jetstream.LOST_S", 3)
    monkeypatch.setattr("coastwatch.server.regions.jetstream.QUIET_S", 1e9)  # pings alone
    region.write(2)
    scenario = centre_scenario()
    sensors = scenario.sensors()
    with relayed(4222) as relay, journal(region, f"{SERVER}/{name}") as published:
        regions = [parsed_region(f"nats://127.0.0.1:{relay.port}/{name}?name=north")]
        with LiveInput([], sensors, regions=regions, clock="feeds") as source:
            wait_for(lambda: published.published == 2)
            source.begin(scenario, sensors, 1, threading.Event(), {})
            wait_for(lambda: source.feeds()[0]["received"] == 2)
            relay.lose()
            region.write(1)
            wait_for(lambda: source.feeds()[0]["received"] == 3, 10.0)
            feed = source.feeds()[0]
    assert (feed["connections"], relay.accepted, feed["dropped"]) == (2, 2, 0)


def test_two_regions_of_one_name_are_a_trouble_of_both_and_of_their_centre(region: Region, name: str, tmp_path: Path) -> None:
    scenario = centre_scenario()
    sensors = scenario.sensors()
    with (
        open_store(str(tmp_path / "other.db")) as opened,
        LiveInput([], sensors, regions=[parsed_region(f"{SERVER}/{name}?name=north")], clock="feeds") as source,
    ):
        store_world.begin(opened)  # so that its run has another number
        other = Region(opened)
        region.write(1)
        with journal(region, f"{SERVER}/{name}") as one:
            wait_for(lambda: one.published == 1)
            source.begin(scenario, sensors, 1, threading.Event(), {})
            other.cycles = 40
            with journal(other, f"{SERVER}/{name}") as two:
                for number in range(1, 6):
                    for of, writes in ((region, one), (other, two)):
                        before = writes.published
                        of.write(1)
                        wait_for(lambda writes=writes, before=before: writes.published > before)
                    assert source.wait(START_S + (number + 1) * PERIOD_S, stopped_after(5.0))
                    source.between(START_S + number * PERIOD_S, START_S + (number + 1) * PERIOD_S)
                said = of_outs([one.counters(), two.counters()], 0.0)
                feed = source.feeds()[0]
    assert len(said) == 2
    assert all("of another sender: each region needs a NAME of its own" in trouble.text for trouble in said)
    assert [text.partition(":")[0] for text in feed["troubles"]] == ["two senders"]
    assert feed["dropped"] == 0


@pytest.mark.parametrize(
    "text", ["nats://h:1", "nats://h:1/a.b", "nats://h:1/a/b", "nats://h:1/a?x=1", "ws://h:1?user=a", "tls://:1/a"]
)
def test_an_address_of_no_stream_is_refused(text: str) -> None:
    with pytest.raises(AddressError, match="needed"):
        parsed_region(text)


def test_a_stream_has_a_name_and_secrets_in_files(monkeypatch: pytest.MonkeyPatch) -> None:
    found = parsed_region("tls://h:4222/north-1?user=a&password-file=p&ca-file=c")
    assert (found.url, found.stream, found.name) == ("tls://h:4222", "north-1", "north-1")
    assert (found.user, found.password_file, found.ca_file) == ("a", "p", "c")
    monkeypatch.setattr("coastwatch.server.regions.client.find_spec", lambda name: None)
    with pytest.raises(AddressError, match=r"pip install 'coastwatch\[nats\]'"):
        parsed_region("nats://h:4222/north")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--role", "all", "--out", "tracks+nats://h:1/a"], "needed --role region"),
        (
            ["--role", "region", "--out", "tracks+ws://h:1"],
            r"^out: got 'tracks\+ws://h:1', needed tracks\+nats://HOST:PORT/NAME",
        ),
        (
            ["--role", "region", "--out", "tracks+nats://h:1/a.b c"],
            r"^out: got 'tracks\+nats://h:1/a.b c', needed tracks\+nats",
        ),
        (["--role", "region", "--out", "tracks+nats://h:1"], "^out: .* needed the name of the region in its stream: tracks"),
    ],
)
def test_only_a_region_publishes_and_only_to_a_stream(words: list[str], said: str) -> None:
    with pytest.raises(InputError, match=said):
        serve(make_parser().parse_args(["serve", "guanabara", *words]))


def test_a_server_that_wants_a_token_gets_it_from_a_file(region: Region, name: str, tmp_path: Path) -> None:
    if shutil.which("nats-server") is None:
        pytest.skip("needs the program nats-server")
    with socket.create_server(("127.0.0.1", 0)) as held:
        port = held.getsockname()[1]
    token = tmp_path / "token"
    token.write_text("wrong\n", "utf-8")
    region.write(2)
    words = ["nats-server", "-a", "127.0.0.1", "-p", str(port), "-js", "-sd", str(tmp_path / "js"), "--auth", "right"]
    with subprocess.Popen(words, stderr=subprocess.DEVNULL) as server:
        address = f"nats://127.0.0.1:{port}/{name}?token-file={token}"
        try:
            with journal(region, address) as published:
                wait_for(lambda: "Authorization" in (published.counters()["error"] or ""))
                token.write_text("right\n", "utf-8")
                wait_for(lambda: published.published == 2)
                assert len(cycles(f"{address}&name=north", {}, 2)[0][1]) == VESSELS
        finally:
            server.terminate()


def test_without_a_server_a_centre_says_so_and_tries_again(name: str) -> None:
    with socket.create_server(("127.0.0.1", 0)) as held:
        port = held.getsockname()[1]
    scenario = centre_scenario()
    sensors = scenario.sensors()
    with LiveInput([], sensors, regions=[parsed_region(f"nats://127.0.0.1:{port}/{name}?name=north")], clock="feeds") as source:
        stop = threading.Event()
        waiting = threading.Thread(target=source.begin, args=(scenario, sensors, 1, stop, {}))
        waiting.start()
        wait_for(lambda: source.feeds() and source.feeds()[0]["error"])
        stop.set()
        waiting.join()
        assert (source.feeds()[0]["connected"], source.feeds()[0]["error"]) == (False, f"127.0.0.1:{port}: Connection refused")
