"""Radar video as messages of CAT 240, and captures of a network that has them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import dpkt
import numpy as np

from coastwatch.formats.asterix.video import VideoMessage, encode
from coastwatch.formats.decoding import Item
from coastwatch.scenario.sites import Radar, TrackSource, sensors_of

START_S = 1_782_864_000.0  # midnight
PERIOD_S, SPOKES, CELLS = 2.4, 256, 64
DURATION_FS = 100_000_000  # of a cell of 15 m


def sensors():
    radars = (Radar(name=name, latitude_deg=54.0, longitude_deg=12.0, range_nm=6.0, rpm=25.0) for name in ("north", "south"))
    return sensors_of(tuple(radars), (), (), (TrackSource(name="vts"),))


def messages(turns=2.0, parts=1, begun_s=START_S, timed=True, sic=1, seed=1, cells=CELLS, **fields) -> Iterator[VideoMessage]:
    """Spokes of random levels, at even steps."""
    rng = np.random.default_rng(seed)
    for spoke in range(round(turns * SPOKES)):
        time_s = begun_s + (spoke + 0.5) / SPOKES * PERIOD_S
        level = rng.integers(0, 256, cells).astype(np.uint8)
        start = spoke % SPOKES * 65_536 // SPOKES
        for part in range(parts):
            first, end = part * cells // parts, (part + 1) * cells // parts
            whole = VideoMessage(
                25, sic, spoke * parts + part, start, (start + 65_536 // SPOKES) % 65_536, first, DURATION_FS, level[first:end],
                time_s % 86_400.0 if timed else math.nan,
            )  # fmt: skip
            yield whole._replace(**fields)


def arrivals(found, begun_s=START_S, parts=1, late_s=0.05, sender=0) -> list[Item]:
    step_s = PERIOD_S / SPOKES / parts
    return [(begun_s + (k + 0.5) * step_s + late_s, encode(message), sender) for k, message in enumerate(found)]


def captured(
    path: Path,
    items: list[Item],
    writer: Callable[..., Any] = dpkt.pcap.Writer,
    unit: int = 1480,
    lost: Callable[[int, int], bool] = lambda packet, fragment: False,
    snap: int = 1 << 16,
) -> Path:
    """Datagrams to port 8600 in a capture. Args: unit: most bytes of a packet of IP; lost: which fragments are; snap: bytes of a packet."""
    with path.open("wb") as file:
        made = writer(file)
        for k, (at_s, data, sender) in enumerate(items):
            udp = bytes(dpkt.udp.UDP(sport=4000 + sender, dport=8600, data=data, ulen=8 + len(data)))
            pieces = [udp[first : first + unit] for first in range(0, len(udp), unit)]
            for piece, part in sorted(enumerate(pieces), key=lambda pair: -pair[0] if k % 3 == 0 else pair[0]):  # in any order
                if lost(k, piece):
                    continue
                more = piece < len(pieces) - 1
                ip = dpkt.ip.IP(
                    src=b"\x0a\0\0\1", dst=b"\xef\xc0\0\1", p=dpkt.ip.IP_PROTO_UDP, id=k % 65_536, data=part, len=20 + len(part)
                )
                ip.mf, ip.offset = int(more), piece * unit // 8  # its unit is 8 bytes
                frame = dpkt.ethernet.Ethernet(src=b"\0" * 6, dst=b"\1" * 6, type=dpkt.ethernet.ETH_TYPE_IP, data=bytes(ip))
                made.writepkt(bytes(frame)[:snap], ts=at_s)
    return path
