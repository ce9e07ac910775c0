"""Web hooks: each alarm that begins or ends is sent, signed, and again while nobody takes it; wrong ones are refused."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from alarm_world import hooked
from server_world import listening, raise_alarm, wait_for

from coastwatch.batches import AlarmKind
from coastwatch.errors import InputError
from coastwatch.operators.api import logs, webhooks
from coastwatch.operators.api.metrics import Metrics
from coastwatch.operators.api.webhooks import WebHook, checked, secret_of, signature
from coastwatch.operators.cli.serving import following
from coastwatch.server.link import Backoff
from coastwatch.store import open_store

pytestmark = pytest.mark.whole


@contextmanager
def receiver(answers: list[int]) -> Iterator[tuple[str, list[tuple[dict[str, str], bytes]]]]:
    """A server that answers with these statuses, then with 204. Yields: its address; headers and bodies as they come."""
    taken: list[tuple[dict[str, str], bytes]] = []

    def take(headers: dict[str, str], body: bytes) -> int:
        taken.append((headers, body))
        return answers.pop(0) if answers else 204

    with hooked(take) as address:
        yield f"{address}hook?key=hidden", taken


def test_alarms_are_sent_signed_and_again_until_they_are_taken(tmp_path: Path) -> None:
    import store_world

    with open_store(str(tmp_path / "sea.db")) as opened, receiver([503, 302]) as (address, taken):
        store_world.begin(opened)
        store_world.write(opened, 1, 0)
        with following(opened, None, poll_s=0.05) as service:
            dead = WebHook("http://127.0.0.1:9/")  # nobody listens there, and the other one does not wait for it
            hooks = [dead, WebHook(address, ("dark",), "s3cret"), WebHook(address, ("lost",))]
            wait_for(lambda: service.book.run_id > 0)
            with listening(service, hooks=hooks):
                served: Any = type("Served", (), {"store": opened})
                raise_alarm(served, 1, 4)  # the first answer is 503: it comes again; the second, 302, is final
                wait_for(lambda: len(taken) == 2)
                raise_alarm(served, 2, None)
                wait_for(lambda: len(taken) == 3)
                metrics = service.metrics.text().decode()
    said = [json.loads(body) for _, body in taken]
    assert [(one["event"], one["alarm"]["vessel_id"], one["alarm"]["kind"]) for one in said] == [
        ("opened", 4, "dark"), ("opened", 4, "dark"), ("closed", 4, "dark"),
    ]  # fmt: skip
    assert said[2]["alarm"]["end_utc"] is not None
    for headers, body in taken:
        assert headers["x-coastwatch-signature"] == signature("s3cret", headers["x-coastwatch-timestamp"], body)
    assert taken[0][0]["x-coastwatch-delivery"] == taken[1][0]["x-coastwatch-delivery"] != taken[2][0]["x-coastwatch-delivery"]
    name = address.split("/")[2]
    counts = {
        count: f'coastwatch_webhook_total{{count="{count}",webhook="{name}"}} 1.0' in metrics for count in ("retried", "failed")
    }
    assert counts == {"retried": True, "failed": True}
    assert "hidden" not in metrics
    assert "s3cret" not in metrics


def test_deliveries_that_fail_are_a_trouble_until_one_is_taken(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    import store_world

    monkeypatch.setattr(Backoff, "wait_s", lambda *_: 0.3)
    with open_store(str(tmp_path / "sea.db")) as opened, receiver([503, 503, 503]) as (address, taken):
        store_world.begin(opened)
        store_world.write(opened, 1, 0)
        with following(opened, None, poll_s=0.05) as service:
            hooks = [WebHook("http://127.0.0.1:9/hidden"), WebHook(address)]
            wait_for(lambda: service.book.run_id > 0)
            watch, name = logs.Watch(service), address.split("/")[2]
            with listening(service, hooks=hooks):
                assert service.troubles() == []
                served: Any = type("Served", (), {"store": opened})
                raise_alarm(served, 1, 4)
                wait_for(lambda: len(taken) == 2)
                watch.look()
                wait_for(lambda: any("2 deliveries" in one.text for one in service.troubles() if one.name == name))
                said = {one.name: one for one in service.troubles()}
                watch.look()
                wait_for(lambda: len(taken) == 4)
                wait_for(lambda: [one.name for one in service.troubles()] == ["127.0.0.1:9"])
                watch.look()
            assert service.troubles() == []
    assert said[name].text == "2 deliveries failed, the last: it answered 503; tried again"
    assert "failed, the last: Connection refused; tried again" in said["127.0.0.1:9"].text
    assert {(one.kind, one.is_serious) for one in said.values()} == {("webhook", False)}
    warned = [record for record in caplog.records if "503" in record.message]
    assert [record.levelname for record in warned] == ["WARNING"]


def test_every_kind_of_alarm_may_be_chosen() -> None:
    kinds = (*(kind.name.lower() for kind in AlarmKind), "dark", "epirb")
    assert checked(WebHook("https://a/b", kinds)).kinds == kinds
    for flag in ("coasting", "stationary"):
        with pytest.raises(InputError, match=flag):
            checked(WebHook("https://a/b", (flag,)))


def test_the_signature_is_that_of_openssl() -> None:
    """printf '1.{}' | openssl dgst -sha256 -hmac key"""
    assert signature("key", "1", b"{}") == "sha256=1ba6b8171186efc613e8bcc0cbdab2748f24984d7c5a84faa2637afa0e40d224"


@pytest.mark.parametrize(
    ("hook", "said"),
    [
        (WebHook("ftp://a/b"), "needed an address such as https://host/path"),
        (WebHook("https://a/b#c"), "webhook a: got .#. in its address"),
        (WebHook("https://a:1/b?key=hidden", ("drak",)), "webhook a:1: kinds: got 'drak', needed some of dark"),
    ],
)
def test_wrong_hooks_are_refused(hook: WebHook, said: str) -> None:
    with pytest.raises(InputError, match=said) as found:
        checked(hook)
    assert "hidden" not in str(found.value)


def test_a_secret_is_the_first_line_of_a_file(tmp_path: Path) -> None:
    file = tmp_path / "secret"
    file.write_text("s3cret\nmore\n")
    assert secret_of(str(file)) == "s3cret"
    file.write_text("\n")
    with pytest.raises(InputError, match="needed the secret"):
        secret_of(str(file))


@pytest.mark.parametrize(
    ("head", "status"),
    [(b"HTTP/1.1 200 OK\r\nX-Slow: ", 0), (b"HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\n\r\n", 200)],
)
@pytest.mark.parametrize(("piece", "every_s"), [(b"1\r\na\r\n", 0.02), (b"4000\r\n" + b"a" * 0x4000 + b"\r\n", 0.0)])
def test_a_receiver_whose_answer_does_not_end_holds_up_no_other_message(
    head: bytes, status: int, piece: bytes, every_s: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A time for each read alone is never over where a byte comes now and then."""
    monkeypatch.setattr(webhooks, "TIME_OUT_S", 0.5)
    if not status:
        piece = b"a"
    service: Any = type("Service", (), {"metrics": Metrics()})()

    async def answer(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        await reader.readuntil(b"\r\n\r\n")
        writer.write(head)
        try:
            while True:
                writer.write(piece)
                await writer.drain()
                await asyncio.sleep(every_s)
        except OSError:
            pass
        finally:
            writer.close()

    async def main() -> tuple[int, str]:
        server = await asyncio.start_server(answer, "127.0.0.1", 0)
        hook = WebHook(f"http://127.0.0.1:{server.sockets[0].getsockname()[1]}/")
        sender = webhooks._Sender(hook, service, webhooks.RETRY)
        client = vars(sender)["_client"]
        try:
            return await asyncio.wait_for(sender._post(client, webhooks._Message(0, 1, "a", "a-opened", b"{}")), 5.0)
        finally:
            await client.aclose()
            server.close()

    assert asyncio.run(main()) == (status, f"it answered {status}" if status else "no answer within 0.5 s")
