"""The two ends of a link between a region and a centre, without sockets: each cycle once and in order, whatever is lost."""

from __future__ import annotations

import io
from collections import deque
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from coastwatch.errors import AddressError
from coastwatch.server.link import reason_of
from coastwatch.server.regions import message
from coastwatch.server.regions.client import _reason, parsed_region
from coastwatch.server.regions.link import IN_FLIGHT, NOTHING, Incoming, LinkError, Outgoing, Position
from coastwatch.server.regions.message import MessageError, RegionCycle, RegionTracks, decode, encode

pytestmark = pytest.mark.contract

CYCLES = 200


def tracks(n: int = 3) -> RegionTracks:
    g = np.random.default_rng(n)
    return RegionTracks(
        np.arange(n), g.uniform(0, 9, n), g.uniform(-1, 1, (n, 2)), g.uniform(-9, 9, (n, 2)), g.uniform(0, 1, (n, 4, 4))
    )


@pytest.mark.parametrize("seed", range(20))
def test_each_cycle_comes_once_and_in_order_however_often_the_connection_breaks(seed: int) -> None:
    g, journal = np.random.default_rng(seed), [Position("1@a", seq) for seq in range(1, CYCLES + 1)]
    centre, used, written, most = Incoming(), [], 0, 0
    while len(used) < CYCLES:
        region, way, back = Outgoing(centre.position), deque[Position](), deque[Position]()
        for _ in range(int(g.integers(1, 40))):  # events until the connection breaks, in any order
            event = g.integers(4)
            if event == 0:
                written = min(written + 1, CYCLES)
            elif event == 1:
                for cycle in journal[region.position.seq : written][: region.room]:
                    region.sent(cycle)
                    way.append(cycle)
                most = max(most, len(way) + len(back))
            elif event == 2 and way:
                cycle = way.popleft()
                used += [cycle] if centre.received(cycle) else []
                back.append(cycle)
            elif event == 3 and back:
                region.acknowledged(back.popleft())
    assert used == journal
    assert 1 < most <= IN_FLIGHT
    assert centre.missing == 0


def test_no_more_than_four_are_on_their_way_and_an_old_acknowledgement_changes_nothing() -> None:
    region = Outgoing()
    for seq in range(1, IN_FLIGHT + 1):
        region.sent(Position("1@a", seq))
    with pytest.raises(LinkError, match="needed at most 4"):
        region.sent(Position("1@a", 9))
    region.acknowledged(Position("0@z", 2))
    assert region.room == 0
    region.acknowledged(Position("1@a", 3))
    assert region.room == 3


def test_gaps_and_another_run_are_counted() -> None:
    centre = Incoming()
    assert centre.position == NOTHING
    said = [centre.received(Position(run, seq)) for run, seq in (("1@a", 7), ("1@a", 8), ("1@a", 8), ("1@a", 11), ("2@b", 1))]
    assert said == [True, True, False, True, True]
    assert (centre.missing, centre.repeated, centre.position) == (2, 1, Position("2@b", 1))


def test_a_run_that_comes_again_after_another_one_is_of_a_second_sender_and_no_gap() -> None:
    centre = Incoming()
    for seq in range(1, 6):
        assert centre.received(Position("1@a", seq))
        assert centre.received(Position("1@b", 500 + seq))
    assert (centre.missing, centre.repeated, centre.returned, centre.position) == (0, 0, 8, Position("1@b", 505))
    assert not centre.received(Position("1@a", 5))
    assert centre.received(Position("1@a", 8))
    assert (centre.missing, centre.repeated) == (2, 1)
    assert centre.received(Position("2@a", 4))
    assert (centre.missing, centre.returned) == (5, 9)


def test_a_cycle_is_the_same_to_the_bit_after_its_way_and_damaged_ones_are_refused() -> None:
    sent = RegionCycle("7@2026-07-01T12:00:00Z", 12, 1_750_000_000.1, tracks())
    data = encode(sent)
    found = decode(data)
    assert (found.run, found.seq, found.time_s) == (sent.run, sent.seq, sent.time_s)
    one, other = sent.reports(1), RegionCycle("8@b", 12, 1.0, tracks()).reports(1)
    assert not set(one.number) & set(other.number)
    for name in ("track_id", "position_deg", "velocity_m_s", "covariance"):
        assert np.array_equal(getattr(found.tracks, name), getattr(sent.tracks, name))
    g = np.random.default_rng(1)
    for cut in g.integers(0, len(data), 40).tolist():
        with pytest.raises(MessageError):
            decode(data[:cut])
    with pytest.raises(MessageError, match="needed 1 or more"):
        decode(encode(RegionCycle("7@x", 0, 1.0, tracks())))
    with pytest.raises(MessageError, match="NUMBER@TIME"):
        decode(encode(RegionCycle("x", 1, 1.0, tracks())))


@pytest.mark.parametrize(
    ("changed", "needed"),
    [
        ({"seq": np.float64(1e300)}, "needed a whole number"),
        ({"seq": np.uint64(2**63)}, "at most 4294967296"),
        ({"seq": np.int64(2**62), "merged": np.int64(2**61)}, "at most 4294967296"),
        ({"seq": np.array([5])}, "needed a whole number"),
        ({"merged": np.float64(0.0)}, "needed a whole number"),
        ({"run": np.array("7@\ud800")}, "needed printable ASCII"),
        ({"run": np.array("7@a\0b")}, "needed printable ASCII"),
        ({"run": np.array("7@" + "x" * 63)}, "65 characters"),
    ],
)
def test_what_the_database_would_refuse_is_no_cycle(changed: dict[str, Any], needed: str) -> None:
    with np.load(io.BytesIO(encode(RegionCycle("7@" + "x" * 62, 5, 1.0, tracks())))) as file:
        arrays = dict(file)
    changed_file, same = io.BytesIO(), io.BytesIO()
    np.savez(changed_file, **(arrays | changed))
    with pytest.raises(MessageError, match=needed):
        decode(changed_file.getvalue())
    np.savez(same, **arrays)
    assert decode(same.getvalue()).seq == 5


def test_sizes_and_alternatives_come_along_and_an_older_message_has_none() -> None:
    sent = replace(tracks(), **{name: np.array([200.0, np.nan, 7.0]) + k for k, name in enumerate(message.OPTIONAL)})
    data = encode(RegionCycle("7@x", 1, 1.0, sent))
    reports = decode(data).reports(2)
    assert [getattr(reports, name)[0] for name in message.OPTIONAL] == [200.0, 201.0, 202.0, 203.0]
    with np.load(io.BytesIO(data)) as file:
        former = {name: file[name] for name in file.files if name not in message.OPTIONAL}
    old = io.BytesIO()
    np.savez(old, **former)
    found = decode(old.getvalue()).tracks
    assert np.isnan([getattr(found, name) for name in message.OPTIONAL]).all()


def test_a_small_message_with_arrays_of_any_size_is_refused_before_they_are_made(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(message, "LARGEST_MESSAGE", 1 << 20)
    arrays = {name: getattr(tracks(), name) for name in ("track_id", "updated_s", "position_deg", "velocity_m_s")}
    out = io.BytesIO()
    np.savez_compressed(out, run=np.array("7@a"), seq=1, time_s=1.0, covariance=np.zeros((20_000, 4, 4)), **arrays)
    assert len(out.getvalue()) < 1 << 17
    monkeypatch.setattr(np, "load", lambda *_: pytest.fail("it was unpacked"))
    with pytest.raises(MessageError, match="bytes of arrays, needed at most 1048576"):
        decode(out.getvalue())


@pytest.mark.parametrize(
    "text",
    ["wss://", "http://a:1", "ws://a:1/path", "ws://a:1?token=secret", "ws://u:p@a:1", "ws://a:99999", "tracks+nats://a:1/b"],
)
def test_an_address_of_no_region_is_refused(text: str) -> None:
    with pytest.raises(AddressError, match="needed ws"):
        parsed_region(text)


def test_a_region_has_a_name() -> None:
    assert parsed_region("ws://a:1").name == "a:1"
    found = parsed_region("wss://a:1?name=north&token-file=t&ca-file=c")
    assert (found.name, found.token_file, found.ca_file, found.url) == ("north", "t", "c", "wss://a:1")


def test_an_error_without_a_text_is_named_all_the_same() -> None:
    assert reason_of(TimeoutError()) == "no answer in time"
    assert (reason_of(OSError()), _reason(TimeoutError()), _reason(OSError("gone"))) == ("OSError", "TimeoutError", "gone")
