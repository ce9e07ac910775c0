"""Captures of a network, PCAP and PCAPNG, to the datagrams of UDP in them."""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any

from coastwatch.formats.intake.faults import SET_ASIDE, Tally
from coastwatch.sensors.recorded.files import head

NEW_MAGIC = b"\x0a\x0d\x0d\x0a"
MAGICS = (b"\xa1\xb2\xc3\xd4", b"\xd4\xc3\xb2\xa1", b"\xa1\xb2\x3c\x4d", b"\x4d\x3c\xb2\xa1", NEW_MAGIC)
MOST_BYTES = 1 << 24  # of a packet or a block: more is damage
OTHER = SET_ASIDE + "packet without a datagram of the feed"
FRAGMENT = "fragment of a datagram"
SHORT = "datagram cut by the capture"


class Bytes:
    """A file that counts what was read of it."""

    def __init__(self, file: IO[bytes]) -> None:
        self._file, self.at = file, 0

    def read(self, size: int) -> bytes:
        """The next bytes. Raises: ValueError: a size that no part of a file has."""
        if not 0 <= size <= MOST_BYTES:
            raise ValueError(f"a part of {size} bytes")
        data = self._file.read(size)
        self.at += len(data)
        return data


class _Whole:
    """Parts of a capture, each whole: the library takes what is left of the last one for a packet."""

    def __init__(self, stream: Bytes, begin: bytes) -> None:
        """Args: begin: its first bytes, which were read to see what it is."""
        self._stream, self._begin = stream, begin

    def read(self, size: int) -> bytes:
        begin, self._begin = self._begin, b""
        data = begin + self._stream.read(size - len(begin))
        if 0 < len(data) < size:
            raise EOFError(f"{len(data)} of {size} bytes of a packet")
        return data


def is_capture(path: Path) -> bool:
    """Whether a file is a capture, by its first bytes. Raises: OSError, InputError."""
    return head(path, 4) in MAGICS


def datagrams(stream: Bytes, name: str, port: int | None, tally: Tally) -> Iterator[tuple[float, bytes, int]]:
    """When each datagram came, Unix time, its bytes, and the number of its sender.

    Args: name: of the file; port: to which it was sent; None: any. Raises: EOFError, ValueError: the capture is cut short or damaged.
    """
    import dpkt  # as libasterix: only those who read captures wait for it

    begin = stream.read(4)
    try:
        reader: Any = (dpkt.pcapng if begin == NEW_MAGIC else dpkt.pcap).Reader(_Whole(stream, begin))
        packets, link = iter(reader), reader.datalink()
    except dpkt.Error as error:
        raise EOFError(f"the head of a capture alone ({type(error).__name__})") from error
    while (packet := _next(packets)) is not None:
        when_s, data = packet
        if not data:
            raise EOFError("a packet without its bytes")
        network = _network(data, link)
        datagram = getattr(network, "data", None)
        where = f"{name}: byte {stream.at - len(data)}"
        if isinstance(network, dpkt.ip.IP) and (network.mf or network.offset) and network.p == dpkt.ip.IP_PROTO_UDP:
            tally.add(FRAGMENT, where)
        elif not isinstance(datagram, dpkt.udp.UDP) or (port is not None and datagram.dport != port):
            tally.add(OTHER, where)
        elif len(datagram.data) < datagram.ulen - 8:
            tally.add(SHORT, where)
        else:
            payload = bytes(datagram.data)[: datagram.ulen - 8] if datagram.ulen else bytes(datagram.data)
            yield float(when_s), payload, zlib.crc32(network.src + datagram.sport.to_bytes(2, "big"))


def _next(packets: Iterator[Any]) -> tuple[float, bytes] | None:
    """The next packet; None: there is none. Raises: as of `datagrams`."""
    try:
        packet: tuple[float, bytes] | None = next(packets, None)
    except (EOFError, OSError, zlib.error, ValueError):
        raise
    except Exception as error:  # whatever the library raises on damaged bytes
        raise ValueError(f"{type(error).__name__}: {error}") from error
    return packet


def _network(data: bytes, link: int) -> Any:
    """The packet of the network layer in a packet of this link; None: it has none."""
    import dpkt
    from dpkt import loopback, sll, sll2

    of_ip = dpkt.ip6.IP6 if data[0] >> 4 == 6 else dpkt.ip.IP
    links = {0: loopback.Loopback, 1: dpkt.ethernet.Ethernet, 108: loopback.Loopback, 113: sll.SLL, 276: sll2.SLL2}
    if link not in (*links, 12, 14, 101, 228, 229):
        raise ValueError(f"a capture of link type {link}, needed Ethernet, Linux cooked, loopback or raw IP")
    try:
        layer = links.get(link, of_ip)(data)
        while not isinstance(layer, dpkt.ip.IP | dpkt.ip6.IP6):
            layer = layer.data
    except Exception:  # no IP: bytes have no layer in them; or damaged
        return None
    return layer
