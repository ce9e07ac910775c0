"""Half a minute of reports, and a live input that receives them over real sockets."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from typing import Any

import numpy as np
from server_world import wait_for

from coastwatch.batches import AisReports, AisStatics, BearingReports, RadarReports, Reports
from coastwatch.scenario import load_scenario
from coastwatch.server.feeds.address import parsed
from coastwatch.server.feeds.live_input import LiveInput
from coastwatch.server.feeds.sending import encoded

START_S, SPAN_S = 1_750_000_000.0, 30.0
SCENARIO = load_scenario("guanabara")
SENSORS = SCENARIO.sensors()


def sea(vessels: int = 40, seed: int = 1) -> Reports:
    """Half a minute of positions, names, plots and bearings."""
    g = np.random.default_rng(seed)
    n = 3 * vessels
    when = np.sort(START_S + 1.0 + np.round(g.uniform(0, SPAN_S - 1.0, n), 3))
    vessel = g.integers(0, vessels, n)
    none = np.full(n, -1, np.int64)
    place = np.round(np.stack([g.uniform(-23, -22.9, n), g.uniform(-43.2, -43, n)], 1), 5)
    class_b, speed, course = vessel % 3 == 0, np.round(g.uniform(0, 20, n), 1), np.round(g.uniform(0, 359, n), 1)
    ais = AisReports(
        np.floor(when), when, 257_000_000 + vessel, place, speed, course, class_b, none, np.where(class_b, -1, 0),
        np.zeros(n, np.int64), feed=np.zeros(n, np.int64),
    )  # fmt: skip
    name = AisStatics(
        when[:5], ais.mmsi[:5], np.array(["ANA", "BIA", "CAI", "DUO", "EVA"]), np.full(5, "LA1B"), np.full(5, 70),
        np.full(5, 90.0), np.full(5, 14.0),
    )  # fmt: skip
    radar = RadarReports(
        sensor=g.integers(0, len(SENSORS.radars), n), time_s=when, received_s=when, range_m=g.uniform(1e3, 2e4, n),
        azimuth_deg=g.uniform(0, 360, n), site_deg=SENSORS.radars.site_deg[np.zeros(n, np.int64)], origin=none,
    )  # fmt: skip
    bearing = BearingReports(
        sensor=np.zeros(9, np.int64), time_s=when[:9], received_s=when[:9], bearing_deg=g.uniform(0, 360, 9), contact=np.arange(9),
        site_deg=SENSORS.sonars.site_deg[np.zeros(9, np.int64)], signature=none[:9], origin=none[:9],
    )  # fmt: skip
    return Reports(radar, ais, name, bearing)


SEA = sea()


def items(address: str) -> list[bytes]:
    return encoded(SEA, parsed(address), SENSORS)


@contextmanager
def receiving(*addresses: str, sensors: Any = SENSORS, **given: Any) -> Iterator[LiveInput]:
    with LiveInput([parsed(text) for text in addresses], sensors, clock="feeds", **given) as made:
        yield made


def deliver(made: LiveInput, received: int, feed: int = 0) -> None:
    """Wait until a feed has received so many lines or datagrams."""
    wait_for(lambda: made.feeds()[feed]["received"] >= received)


def cycles(made: LiveInput, period_s: float = 5.0) -> list[Reports]:
    edges = np.arange(START_S, START_S + SPAN_S + 2 * period_s, period_s)
    return [made.between(a, b) for a, b in pairwise(edges.tolist())]


def same(one: Any, other: Any) -> bool:
    return all(
        np.array_equal(getattr(one, f), getattr(other, f), equal_nan=getattr(one, f).dtype.kind == "f")
        for f in one.__dataclass_fields__
    )


def joined(parts: list[Reports], kind: str) -> Any:
    batches = [getattr(part, kind) for part in parts]
    return type(batches[0]).join(batches)


def put(port: int, lines: list[bytes]) -> None:
    with socket.create_connection(("127.0.0.1", port)) as out:
        out.sendall(b"\r\n".join([*lines, b""]))


def put_datagrams(port: int, found: list[bytes]) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
        for datagram in found:
            out.sendto(datagram, ("127.0.0.1", port))
