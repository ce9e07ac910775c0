"""Radar video of a feed: parts are joined, what is lost is counted, times are those of the beam, and nothing bad stops it."""

from __future__ import annotations

import math
import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from video_world import CELLS, DURATION_FS, PERIOD_S, SPOKES, START_S, arrivals, messages, sensors

from coastwatch.batches import RadarVideo, Reports, Videos
from coastwatch.errors import AddressError
from coastwatch.formats.asterix import video_feed
from coastwatch.formats.asterix.spokes import CHANGED, MOST_PARTS
from coastwatch.formats.asterix.video import MOST_CELLS, encode
from coastwatch.formats.asterix.video_feed import VIDEO, VideoDecoder, datagrams, renumbered
from coastwatch.formats.decoding import FeedSettings, Item, decode

pytestmark = pytest.mark.contract

STAMP_S = 0.5 / 128.0  # most by which a time of day is off
ORIGIN = {"25/1": "north", "25/2": "south"}


def decoder(options=ORIGIN, **given) -> VideoDecoder:
    made = VIDEO.decoder(FeedSettings("feed", "video+udp://x", options, **given), sensors())
    assert isinstance(made, VideoDecoder)
    return made


def video(made: VideoDecoder, items: list[Item], part=None) -> tuple[RadarVideo, ...]:
    part = part or len(items)
    for first in range(0, len(items), part):
        decode(made, "feed", items[first : first + part], None)
    return made.reports_between(-math.inf, math.inf).video.parts


def beam_s(spokes: RadarVideo, begun_s=START_S) -> np.ndarray:
    """When the beam was at each azimuth."""
    return begun_s + np.unwrap(spokes.azimuth_rad) / (2.0 * np.pi) * PERIOD_S


@pytest.mark.parametrize("parts", [1, 3])
@pytest.mark.parametrize("part", [None, 7])
def test_parts_are_joined_wherever_the_stream_is_cut(parts, part):
    made = decoder()
    (spokes,) = video(made, arrivals(messages(parts=parts), parts=parts), part)
    assert len(spokes) == 2 * SPOKES
    wanted = np.stack([message.level for message in messages()])
    assert np.array_equal(spokes.level, wanted)
    assert not spokes.missing.any()
    assert spokes.cell_m == pytest.approx(14.99, abs=0.01)
    assert np.degrees(spokes.azimuth_rad[:2]) == pytest.approx([0.5 * 360 / SPOKES, 1.5 * 360 / SPOKES], abs=0.01)
    state = made.counts.radars["north"]
    assert (state.spokes, state.spokes_lost, state.parts_lost, state.parts, state.cells) == (2 * SPOKES, 0, 0, parts, CELLS)
    assert made.tally.faults() == ()
    counts = made.counts
    assert counts.records == 2 * SPOKES
    assert counts.ledger.read == counts.records + sum(counts.ledger.beside.values())
    whole = decoder()
    (again,) = video(whole, arrivals(messages(parts=parts), parts=parts))
    assert np.array_equal(again.time_s, spokes.time_s)


def test_a_part_that_did_not_come_is_missing_and_not_zero():
    found = list(messages(parts=4, turns=1))
    lost = {4 * 100 + 1, 4 * 120 + 3, 4 * 130}
    made = decoder()
    (spokes,) = video(made, arrivals([m for k, m in enumerate(found) if k not in lost], parts=4))
    assert len(spokes) == SPOKES
    assert {row: tuple(spokes.missing[row].tolist()) for row in np.flatnonzero(spokes.missing[:, 1])} == {
        100: (16, 32), 120: (48, 64), 130: (0, 16)
    }  # fmt: skip
    whole = np.stack([m.level for m in messages(turns=1)])
    whole[100, 16:32] = whole[120, 48:] = whole[130, :16] = 0
    assert np.array_equal(spokes.level, whole)
    state = made.counts.radars["north"]
    assert (state.parts_lost, state.spokes_lost) == (3, 0)


@pytest.mark.parametrize("parts", [1, 3])
def test_lost_spokes_are_no_rows_and_are_counted(parts):
    lost = {*range(60, 67), 90, 200}
    found = [m for k, m in enumerate(messages(parts=parts)) if k // parts not in lost]
    made = decoder()
    (spokes,) = video(made, arrivals(found, parts=parts))
    assert len(spokes) == 2 * SPOKES - len(lost)
    assert made.counts.radars["north"].spokes_lost == len(lost)
    assert not spokes.missing.any()


def test_without_numbers_gaps_are_counted_by_azimuth():
    found = [m._replace(number=5) for k, m in enumerate(messages()) if k not in {300, 301, 400}]
    made = decoder()
    (spokes,) = video(made, arrivals(found))
    assert len(spokes) == 2 * SPOKES - 3
    assert made.counts.radars["north"].spokes_lost == 3


def test_without_numbers_a_radar_may_change_its_spokes_a_turn():
    items = arrivals([m._replace(number=5) for k, m in enumerate(messages(turns=5)) if k < SPOKES or k % 2 == 0])
    made = decoder()
    video(made, items[: 2 * SPOKES])
    state = made.counts.radars["north"]
    lost = state.spokes_lost
    assert lost <= CHANGED
    video(made, [item for k, item in enumerate(items) if k >= 2 * SPOKES and k not in {600, 601}])
    assert state.spokes_lost == lost + 2


def test_a_spoke_holds_no_more_than_so_many_parts():
    begin = next(messages())
    found = [begin._replace(number=k, first_cell=2 * k, level=begin.level[:1]) for k in range(1_000)]
    made = decoder()
    made.decode(arrivals(found, parts=1_000), None)
    assert made.waiting == 3 + 1_000 - 3 * MOST_PARTS
    made.reports_between(-math.inf, math.inf)
    state = made.counts.radars["north"]
    assert (state.messages, state.spokes) == (1_000, 4)


def test_what_comes_twice_or_late_is_not_used():
    found = list(messages(turns=1))
    order = [*range(50), 49, *range(51, 60), 50, *range(60, SPOKES)]
    made = decoder()
    (spokes,) = video(made, arrivals([found[k] for k in order]))
    assert len(spokes) == SPOKES - 1
    assert made.counts.radars["north"].out_of_order == 2
    assert [fault.kind for fault in made.tally.faults()] == [video_feed.OUT_OF_ORDER]


@pytest.mark.parametrize("begun_s", [START_S, START_S - 3.0])  # the second over midnight
@pytest.mark.parametrize("late_s", [0.0, 0.3])
def test_times_of_day_are_made_those_of_the_beam(begun_s, late_s):
    made = decoder()
    (spokes,) = video(made, arrivals(messages(turns=4, begun_s=begun_s), begun_s, late_s=late_s))
    off_s = spokes.time_s - beam_s(spokes, begun_s)
    assert np.abs(off_s[SPOKES:]).max() < 0.001
    assert np.abs(off_s).max() < 2.0 * STAMP_S
    assert made.counts.radars["north"].period_s == pytest.approx(PERIOD_S, abs=0.005)
    assert made.counts.radars["north"].spokes_a_turn == SPOKES


def test_without_time_of_day_arrivals_are_straightened():
    rng = np.random.default_rng(3)
    items = [(at_s + rng.exponential(0.01), data, 0) for at_s, data, _ in arrivals(messages(turns=4, timed=False), late_s=0.0)]
    made = decoder()
    (spokes,) = video(made, items)
    off_s = spokes.time_s - beam_s(spokes)
    assert np.abs(off_s[SPOKES:] - 0.01).max() < 0.005
    state = made.counts.radars["north"]
    assert not state.has_time_of_day
    assert state.untimed_s == items[0][0]


def test_a_clock_that_stands_is_noticed_and_arrivals_taken():
    items = arrivals([m._replace(time_of_day_s=5.0) for m in messages(turns=4)], late_s=0.0)
    made = decoder()
    every = video(made, items)
    assert made.counts.radars["north"].clock_stuck
    last = every[-1]
    assert last.time_s[-1] == pytest.approx(START_S + 4 * PERIOD_S, abs=0.02)


def test_a_change_of_range_or_bits_is_a_new_batch():
    first, second = slice(0, SPOKES // 2), slice(SPOKES // 2, None)

    def changed(**fields):
        return [*list(messages(turns=1))[first], *list(messages(turns=1, **fields))[second]]

    parts = video(decoder(), arrivals(changed(cells=96)))
    assert [part.level.shape for part in parts] == [(128, 64), (128, 96)]
    parts = video(decoder(), arrivals(changed(cells=32)))
    assert [part.level.shape[1] for part in parts] == [64, 32]
    assert sum(map(len, parts)) == SPOKES
    parts = video(decoder(), arrivals(changed(duration_fs=DURATION_FS // 2)))
    assert [round(part.cell_m, 1) for part in parts] == [15.0, 7.5]
    coarse = [m._replace(bits=4, level=m.level >> 4) for m in messages(turns=1)]
    parts = video(decoder(), arrivals([*list(messages(turns=1))[first], *coarse[second]]))
    assert [part.bits for part in parts] == [8, 4]


def test_two_senders_with_one_sac_and_sic_are_said_and_one_is_used():
    one, other = arrivals(messages(turns=1)), arrivals(messages(turns=1, seed=9), sender=7)
    made = decoder(sender_name=lambda number: f"10.0.0.{number}:8600")
    (spokes,) = video(made, sorted([*one, *other], key=lambda item: (item[0], item[2])))
    assert np.array_equal(spokes.level, np.stack([m.level for m in messages(turns=1)]))
    state = made.counts.radars["north"]
    assert state.senders == ("10.0.0.0:8600", "10.0.0.7:8600")
    assert state.second_messages == SPOKES
    after = [(at_s + 10.0, data, sender) for at_s, data, sender in other]  # the first one is silent
    assert sum(map(len, video(made, after))) == SPOKES


def test_radars_are_those_of_the_address_or_by_number():
    both = [*arrivals(messages(turns=0.1)), *arrivals(messages(turns=0.1, sic=2)), *arrivals(messages(turns=0.1, sic=3))]
    assert [part.sensor for part in video(decoder({"25/2": "north"}), both)] == [0]
    made = decoder({})
    assert sorted(part.sensor for part in video(made, both)) == [0, 1]
    assert made.tally.count(video_feed.UNKNOWN_RADAR) == 26
    assert not video(made, arrivals(messages(turns=0.1, sac=9), START_S + 0.3))  # the radar is heard under another SAC
    (spokes,) = video(made, arrivals(messages(turns=0.1, sac=9, begun_s=START_S + 60.0), START_S + 60.0))
    assert (spokes.sensor, made.counts.radars["north"].sac) == (0, 9)
    with pytest.raises(AddressError, match="of a track source"):
        decoder({"25/1": "vts"})
    with pytest.raises(AddressError, match="needed SAC/SIC=NAME"):
        decoder({"25/1": "moon"})


def test_a_radar_that_changes_its_sac_keeps_its_spokes_and_their_counts():
    shown: list[RadarVideo] = []
    made = decoder({}, on_video=shown.append)
    made.decode(arrivals(messages(turns=0.1, parts=2), parts=2)[:9], None)  # four spokes and a part
    later_s = START_S + 60.0
    video(made, arrivals(messages(turns=0.1, sac=9, parts=2, begun_s=later_s), later_s, parts=2))
    counts = made.counts
    assert sum(map(len, shown)) == counts.records == 5 + 26
    assert counts.ledger.beside[video_feed.FURTHER_PARTS] == 4 + 26
    assert counts.ledger.read == counts.records + sum(counts.ledger.beside.values())


def test_a_text_of_a_radar_is_shown_and_absurd_video_is_refused():
    made = decoder()
    summary = bytes([240, 0, 12, 0b11010000, 25, 1, 1, 4]) + b"NOVA"
    far = encode(next(messages(first_cell=1 << 31)))
    empty = encode(next(messages(cells=0)))
    good = encode(next(messages()))
    made.decode([(START_S, good, 0)], None)
    made.decode([(START_S, data, 0) for data in (summary, far, empty, b"\xf0")], None)
    assert made.counts.radars["north"].text == "NOVA"
    faults = {fault.kind: fault.example for fault in made.tally.faults()}
    assert set(faults) == {video_feed.TEXT, video_feed.ABSURD_RANGE, video_feed.EMPTY, "damaged video: block: cut short"}
    assert "needed 0.05 m or more, at most 131072, 500 km" in faults[video_feed.ABSURD_RANGE]
    for odd in ({"duration_fs": 1}, {"duration_fs": 0}, {"first_cell": 131_072, "duration_fs": 1_000_000}):
        made.decode([(START_S, encode(next(messages(**odd))), 0)], None)
    assert made.tally.count(video_feed.ABSURD_RANGE) == 4


def test_a_radar_without_usable_video_is_silent_since_its_first_message():
    made = decoder()
    for late_s in (0.0, 30.0):
        made.decode([(START_S + late_s, encode(next(messages(cells=0))), 0)], None)
    assert made.counts.radars["north"].heard_s == START_S


def test_after_a_pause_the_times_are_those_of_the_beam():
    later_s = START_S + 3 * PERIOD_S + 30.7
    items = [*arrivals(messages(turns=3)), *arrivals(messages(turns=2.2, begun_s=later_s), later_s)]
    made = decoder()
    (spokes,) = video(made, items)
    off_s = spokes.time_s[3 * SPOKES :] - later_s - (np.arange(round(2.2 * SPOKES)) + 0.5) / SPOKES * PERIOD_S
    assert np.abs(off_s).max() < 2.0 * STAMP_S
    made = decoder()
    video(made, items[: 4 * SPOKES + 9])
    assert made.counts.radars["north"].period_s == pytest.approx(PERIOD_S, abs=0.01)


@pytest.mark.parametrize("back_s", [10.0, 30.0, 3600.0])
def test_a_clock_that_is_set_back_gives_the_new_times_at_once(back_s):
    """In the middle of the third turn: it was said to stand, and all spokes had one time until the clock had caught up."""
    every = [
        m._replace(time_of_day_s=m.time_of_day_s - back_s * (row >= 2.5 * SPOKES)) for row, m in enumerate(messages(turns=6))
    ]
    made = decoder()
    spokes = video(made, arrivals(every, late_s=0.0))
    time_s, azimuth = (np.concatenate([getattr(one, name) for one in spokes]) for name in ("time_s", "azimuth_rad"))
    wanted = START_S + np.unwrap(azimuth) / (2.0 * np.pi) * PERIOD_S - back_s * (np.arange(len(azimuth)) >= 2.5 * SPOKES)
    assert len(time_s) == 6 * SPOKES
    assert np.abs(time_s - wanted).max() < 3.0 * STAMP_S
    state = made.counts.radars["north"]
    assert not state.clock_stuck
    assert state.period_s == pytest.approx(PERIOD_S, abs=0.01)


def test_a_slow_radar_that_blanks_a_wide_sector_has_turns():
    """Two hundred degrees of 360, for longer than a fast radar pauses."""
    slow = round(5.0 / PERIOD_S)
    kept = [m for row, m in enumerate(messages(turns=5)) if not 0.25 <= row % SPOKES / SPOKES < 0.8]
    every = [
        m._replace(number=k, time_of_day_s=(m.time_of_day_s - START_S % 86400.0) * slow + 3600.0) for k, m in enumerate(kept)
    ]
    first_s = START_S - START_S % 86400.0 + 3600.0
    items = [(first_s + (at_s - START_S) * slow, data, n) for at_s, data, n in arrivals(every, late_s=0.0)]
    made = decoder()
    video(made, items)
    assert made.counts.radars["north"].turns >= 2
    assert made.counts.radars["north"].period_s == pytest.approx(slow * PERIOD_S, rel=0.02)


def test_a_radar_that_turns_counter_clockwise_is_noticed():
    for sign in (1, -1):
        every = [m._replace(start=sign * m.start % 65536, end=sign * m.end % 65536) for m in messages(turns=4)]
        made = decoder()
        video(made, arrivals(every))
        assert made.counts.radars["north"].counter_clockwise == (sign < 0)


def test_a_clock_ahead_of_the_arrivals_is_known_after_a_turn():
    every = [m._replace(time_of_day_s=m.time_of_day_s + 40.0) for m in messages(turns=3)]
    made = decoder()
    video(made, arrivals(every, late_s=0.2))
    assert made.counts.radars["north"].ahead_s == pytest.approx(39.8, abs=0.05)


def test_a_spoke_far_out_does_not_make_all_of_them_as_long():
    found = list(messages(turns=1))
    found[100] = found[100]._replace(first_cell=70_000, duration_fs=1_000_000)
    others = [m._replace(duration_fs=1_000_000) for k, m in enumerate(found) if k != 100]
    parts = video(decoder(), arrivals([*others[:100], found[100], *others[100:]]))
    assert {part.level.shape[1] for part in parts} == {CELLS}
    assert sum(map(len, parts)) == SPOKES


def test_what_waits_is_bounded_in_bytes(monkeypatch):
    monkeypatch.setattr(video_feed, "MOST_WAITING_BYTES", 100 * CELLS)
    made = decoder()
    spokes = video(made, arrivals(messages(turns=1)), 10)
    assert sum(map(len, spokes)) <= 106
    assert made.counts.dropped == SPOKES - sum(map(len, spokes))


def bomb(records: int, cells: int = MOST_CELLS) -> Item:
    """A datagram of so many compressed spokes of zeros, of 32 bits a cell."""
    begin = next(messages(cells=cells))
    spokes = [
        begin._replace(
            number=k,
            start=16 * k % 65536,
            end=16,
            bits=32,
            compressed=True,
            level=np.zeros(cells, np.uint8),
            duration_fs=50_000_000,
        )
        for k in range(records)
    ]
    body = b"".join(encode(one)[3:] for one in spokes)
    return START_S, b"\xf0" + (3 + len(body)).to_bytes(2, "big") + body, 0


def peak_of(made: VideoDecoder, items: list[Item]) -> int:
    """Bytes that decoding takes at most."""
    tracemalloc.start()
    made.decode(items, None)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return peak


def test_a_datagram_that_unpacks_to_more_cells_than_any_radar_sends_is_refused():
    made = decoder()
    assert peak_of(made, [bomb(40)]) < 6_000_000, "40 spokes of 65,536 cells of four octets"
    (fault,) = made.tally.faults()
    assert fault.kind == "damaged video: cells: too many in one datagram"
    assert "needed at most 2097152" in fault.example
    assert made.counts.ledger.read == 33, "the 32 before it are read"


def test_cells_in_a_call_are_bounded_and_what_is_beyond_is_dropped_unread(monkeypatch):
    monkeypatch.setattr(video_feed, "MOST_AT_A_TIME", 1 << 19)
    monkeypatch.setattr(video_feed, "COLLECTED", 1 << 17)
    monkeypatch.setattr(video_feed, "MOST_WAITING_BYTES", 1 << 17)
    made = decoder()
    assert peak_of(made, [bomb(8, 16_384)] * 40) < 2_000_000
    assert made.counts.dropped >= 36
    _, data, _ = bomb(1, 16_384)
    refused = decoder()
    refused.decode([(START_S, data[:-5], 0), (START_S, data[:3] + b"\xff" + data[4:], 0)] * 40, None)
    assert refused.counts.dropped >= 60, "what is refused takes time too"
    good = decoder()
    assert sum(map(len, video(good, arrivals(messages(turns=1))))) == SPOKES
    assert not good.counts.dropped


def test_short_parts_of_long_spokes_are_collected_in_time(monkeypatch):
    monkeypatch.setattr(video_feed, "COLLECTED", 1 << 16)
    monkeypatch.setattr(video_feed, "MOST_WAITING_BYTES", 1 << 16)
    begin = next(messages(cells=8_192))
    short = [
        begin._replace(number=2 * k, start=16 * k, end=16 * k + 16, level=begin.level[: 1 if k else None]) for k in range(400)
    ]
    made = decoder()
    assert peak_of(made, arrivals(short, parts=400)) < 1_500_000, "400 spokes of 8,192 cells"
    assert made.counts.dropped > 380


def test_what_is_sent_is_what_comes():
    rng = np.random.default_rng(5)
    n, cells = 200, 40_000
    azimuth = (np.arange(n) + 0.5) * 2.0 * np.pi / n
    time_s = START_S + 100.0 + azimuth / (2.0 * np.pi) * PERIOD_S
    missing = np.zeros((n, 2), np.int64)
    missing[3] = 100, 200
    sent = RadarVideo(
        sensor=1, first_m=0.0, cell_m=4.5, time_s=time_s, received_s=time_s, azimuth_rad=azimuth,
        site_deg=np.tile([54.0, 12.0], (n, 1)), level=rng.integers(0, 256, (n, cells)).astype(np.uint8), missing=missing,
    )  # fmt: skip
    sent.level[3, 100:200] = 0
    numbers = video_feed.Counter()
    found = []
    for rows in (slice(0, 90), slice(90, None)):
        part = Reports(video=Videos((sent.take(rows),)))
        found += renumbered(datagrams(part, {}), numbers)
    assert max(map(len, found)) < 65_507
    made = decoder({})
    (got,) = video(made, [(START_S + 103.0, data, 0) for data in found])
    assert np.array_equal(got.level[3:], sent.level[3:])
    assert np.array_equal(got.missing[3:], missing[3:])
    assert np.abs(got.azimuth_rad - azimuth).max() < 2e-4
    assert np.abs(got.time_s - time_s)[n // 2 :].max() < 0.004
    assert made.counts.radars["south"].spokes_lost == 0


@pytest.mark.parametrize("bits", [4, 16, 32])
def test_cells_of_any_bits_are_sent_in_datagrams(bits):
    time_s, cells = np.array([START_S + 100.0, START_S + 100.01]), 40_000
    sent = RadarVideo(
        sensor=0, first_m=0.0, cell_m=4.5, time_s=time_s, received_s=time_s, azimuth_rad=np.array([1.0, 1.01]),
        site_deg=np.tile([54.0, 12.0], (2, 1)), level=np.arange(2 * cells, dtype=np.uint8).reshape(2, -1) % 16, bits=bits,
    )  # fmt: skip
    found = renumbered(datagrams(Reports(video=Videos((sent,))), {}), video_feed.Counter())
    assert max(map(len, found)) < 65_507
    (got,) = video(decoder({}), [(START_S + 101.0, data, 0) for data in found])
    assert np.array_equal(got.level, sent.level)
    assert got.bits == bits


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32), st.integers(1, 3), st.sampled_from([1, 2, 4, 8, 16, 32]), st.booleans())
def test_nothing_that_is_damaged_stops_a_feed(seed, parts, bits, compressed):
    rng = np.random.default_rng(seed)
    made = decoder({})
    found = [m._replace(bits=bits, compressed=compressed) for m in messages(turns=0.3, parts=parts, cells=24)]
    items = arrivals(found, parts=parts)
    for k in rng.integers(0, len(items), len(items) // 2):
        raw = bytearray(items[k][1])
        for at in rng.integers(0, len(raw), rng.integers(1, 5)):
            raw[at] = rng.integers(0, 256)
        items[k] = (items[k][0], bytes(raw[: rng.integers(1, len(raw) + 1)]), int(rng.integers(0, 2)))
    made.decode(items, None)
    reports = made.reports_between(-math.inf, math.inf)
    assert len(reports) == len(reports.video) <= len(items)
    for part in reports.video.parts:
        assert (np.diff(part.received_s) >= 0.0).all()


def test_memory_is_flat_under_damaged_messages():
    rng = np.random.default_rng(1)
    made = decoder({})
    good = [data for _, data, _ in arrivals(messages(turns=1))]
    sizes = []
    tracemalloc.start()
    for turn in range(8):
        items = []
        for k in range(300):
            raw = bytearray(good[k % len(good)])
            raw[rng.integers(3, 30)] = rng.integers(0, 256)
            items.append((START_S + turn + 0.003 * k, bytes(raw), 0))
        made.decode(items, None)
        made.reports_between(START_S + turn - 60.0, math.inf)
        del items
        sizes.append(tracemalloc.get_traced_memory()[0])
    tracemalloc.stop()
    assert sizes[-1] - sizes[4] < 60_000, sizes
