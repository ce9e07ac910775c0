"""The border of the feeds: odd messages of every format are counted, and no exception of a decoder stops the other lines."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from feed_world import SEA, SENSORS, START_S, cycles, deliver, items, joined, put, put_datagrams, receiving
from nmea_sentences import with_sum
from region_world import region_tracks

from coastwatch.batches import limits
from coastwatch.formats.decoding import BROKEN
from coastwatch.scenario import load_scenario
from coastwatch.server.deployment import with_track_sources
from coastwatch.server.regions.client import Connection, parsed_region
from coastwatch.server.regions.intake import RegionIntake
from coastwatch.server.regions.link import Position
from coastwatch.server.regions.message import RegionCycle
from scaling.load import fuzz

pytestmark = pytest.mark.whole

WITH_SOURCE = with_track_sources(load_scenario("guanabara"), ["vts"]).sensors()
PLOT = b'{"type": "plot", "radar": "%s", "time": %f, "range_m": %s, "azimuth_deg": 10.0%s}'
RADAR = str(SENSORS.radars.name[0]).encode()


def faults(made: Any) -> dict[str, int]:
    return {fault.kind: fault.count for fault in made.faults()}


@pytest.mark.parametrize(
    "body",
    [
        "RATTM,01,2.5,45.0", "RATTM,01,inf,45.0,T,10.0,90.0,T,0.1,1.0,N,NAME,T,,120000.00,A",
        "RATTM,01,1e400,45.0,T,10.0,90.0,T", "RATLL,01", "RATLL,01,5047.7,N,99906.3,W,NAME,120000.00,T,",
        "RATTM", "RATTM,,,,,,,,,,,,,,,",
    ],
)  # fmt: skip
def test_a_target_sentence_that_is_cut_short_or_odd_is_counted(body: str) -> None:
    good = [with_sum("RATTM,02,2.5,45.0,T,10.0,90.0,T,0.1,1.0,N,NAME,T,,,A"), with_sum("GPHDT,90.0,T")]
    with receiving("ttm+listen://127.0.0.1:0?source=vts&site=-22.9,-43.1", sensors=WITH_SOURCE) as made:
        put(made.ports[0], [with_sum("GPZDA,150641.00,15,06,2025,00,00"), with_sum(body), *good])
        deliver(made, 4)
        tracks = joined(cycles(made), "tracks")
    assert 2 in tracks.number
    assert np.isfinite(tracks.position_deg).all()


@pytest.mark.parametrize(
    ("fields", "range_m"),
    [(b', "range_sigma_m": 1e10, "azimuth_sigma_deg": 1e-10', b"5e3"), (b', "range_sigma_m": 1e-300', b"5e3"), (b"", b"1e300")],
)
def test_a_plot_beyond_all_bounds_is_counted_and_not_used(fields: bytes, range_m: bytes) -> None:
    good = PLOT % (RADAR, START_S + 2.0, b"4e3", b"")
    with receiving("json+listen://127.0.0.1:0") as made:
        put(made.ports[0], [PLOT % (RADAR, START_S + 1.0, range_m, fields), good])
        deliver(made, 2)
        radar = joined(cycles(made), "radar")
        found = faults(made)
    assert radar.range_m.tolist() == [4e3]
    assert sum(count for kind, count in found.items() if kind.startswith(limits.BEYOND)) >= 1


@pytest.mark.parametrize("name", ["ais", "json", "asterix"])
def test_whatever_one_line_raises_the_others_are_used(name: str) -> None:
    sent = items(f"{name}+udp://x:1")
    address = "asterix+udp://127.0.0.1:0?date=2025-06-15" if name == "asterix" else f"{name}+listen://127.0.0.1:0"
    with receiving(address) as made:
        feed = vars(made)["_feeds"][0]
        take, broken = feed.decoder.decode, sent[1]

        def odd(some: list[Any], reference_s: float | None) -> None:
            if any(item[1].strip() == broken.strip() for item in some):
                raise ValueError("of an odd line")
            take(some, reference_s)

        feed.decoder.decode = odd
        if name == "asterix":
            put_datagrams(made.ports[0], sent)
        else:
            put(made.ports[0], sent)
        deliver(made, len(sent))
        found = cycles(made)
        assert faults(made)[BROKEN] == 1
    kind = {"ais": "ais", "json": "bearing", "asterix": "radar"}[name]
    assert len(joined(found, kind)) >= 0.5 * len(getattr(SEA, kind))


class Sends(Connection):
    """A region that has sent one cycle."""

    cycle: RegionCycle | None = None

    def next(self) -> RegionCycle | None:
        one, self.cycle = self.cycle, None
        if one is not None:
            self.incoming.received(Position(one.run, one.seq))
        return one


@pytest.mark.parametrize(
    ("odd", "value"),
    [("position_deg", np.nan), ("position_deg", 95.0), ("velocity_m_s", 1e9), ("covariance", -1.0), ("covariance", np.nan)],
)
def test_an_odd_state_of_a_region_is_left_out_and_counted(odd: str, value: float) -> None:
    good = region_tracks(0)
    column = getattr(good, odd).copy()
    column[3].flat[0] = value
    end_s = float(good.updated_s[0])
    connection = Sends(parsed_region("ws://127.0.0.1:1?name=north"))
    connection.cycle = RegionCycle("1@a", 1, end_s, replace(good, **{odd: column}))
    taken = RegionIntake(connection, 0, False)
    taken.receive(end_s)
    found = taken.reports_between(end_s - 3.0, end_s)
    assert len(found) == len(good.position_deg) - 1
    assert {fault.kind: fault.count for fault in taken.faults() if fault.kind.startswith(limits.BEYOND)}


def test_cycles_that_a_killed_region_computes_again_in_a_merged_one_count_once() -> None:
    connection = Sends(parsed_region("ws://127.0.0.1:1?name=north"))
    taken, tracks, found = RegionIntake(connection, 0, False), region_tracks(0), []
    for end_s, seq, merged in ((START_S, 515, 0), (START_S + 3.0, 516, 0), (START_S + 9.0, 518, 2)):
        connection.cycle = RegionCycle("1@a", seq, end_s, tracks, merged)
        taken.receive(end_s)
        taken.reports_between(end_s - 3.0, end_s)
        found += [(one.first_seq, one.last_seq) for one in taken.intake()]
    assert found == [(515, 515), (516, 516), (517, 518)]


def test_damaged_messages_of_every_format_raise_nothing_in_decoders_and_chain() -> None:
    *_, (done, broken, taken) = fuzz.fuzzed(24_000, 11, 2_400)
    assert done >= 24_000
    assert not broken
    assert all(taken[name] > 50 for name in fuzz.ADDRESSES)
