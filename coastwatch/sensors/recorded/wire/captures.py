"""Captures of a network, PCAP and PCAPNG, to the datagrams of UDP in them."""

from __future__ import annotations

import zlib
from collections import OrderedDict
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any

from coastwatch.formats.intake.faults import SET_ASIDE, Tally
from coastwatch.sensors.recorded.files import head

NEW_MAGIC = b"\x0a\x0d\x0d\x0a"
MAGICS = (b"\xa1\xb2\xc3\xd4", b"\xd4\xc3\xb2\xa1", b"\xa1\xb2\x3c\x4d", b"\x4d\x3c\xb2\xa1", NEW_MAGIC)
MOST_BYTES = 1 << 24  # of a packet or a block: more is damage
OTHER = SET_ASIDE + "packet without a datagram of the feed"
FRAGMENT = "fragment of a datagram, the others did not come"
OVERLAP = "fragments that overlap, or make no datagram"
MOST_OPEN = 256  # datagrams of which not every fragment has come; the oldest goes first
MOST_WAIT_S = 2.0  # from the first fragment to the last; a sender counts datagrams with 16 bits, so numbers come again
OFFSET_BYTES = 8  # unit of the fragment offset: RFC 791, section 3.1
MOST_DATAGRAM = 65_535  # bytes
SHORT = "datagram cut by the capture"
UDP_HEAD = 8  # bytes


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
    fragments = _Fragments(tally)
    while (packet := _next(packets)) is not None:
        when_s, data = packet
        if not data:
            raise EOFError("a packet without its bytes")
        network = _network(data, link)
        datagram = getattr(network, "data", None)
        where = f"{name}: byte {stream.at - len(data)}"
        if isinstance(network, dpkt.ip.IP) and (network.mf or network.offset) and network.p == dpkt.ip.IP_PROTO_UDP:
            if (whole := fragments.joined(network, float(when_s), where)) is None:
                continue
            datagram = dpkt.udp.UDP(whole)
        if not isinstance(datagram, dpkt.udp.UDP) or (port is not None and datagram.dport != port):
            tally.add(OTHER, where)
        elif 0 < datagram.ulen < UDP_HEAD or len(datagram.data) < datagram.ulen - UDP_HEAD:
            tally.add(SHORT, where)
        else:
            payload = bytes(datagram.data)[: datagram.ulen - UDP_HEAD] if datagram.ulen else bytes(datagram.data)
            yield float(when_s), payload, zlib.crc32(network.src + datagram.sport.to_bytes(2, "big"))
    fragments.close(name)


class _Fragments:
    """Fragments of IP, joined to datagrams."""

    def __init__(self, tally: Tally) -> None:
        self._tally = tally
        self._open: OrderedDict[tuple[bytes, bytes, int], _Open] = OrderedDict()

    def joined(self, network: Any, when_s: float, where: str) -> bytes | None:
        """The datagram that a fragment completes; None: others are missing. Args: network: an IP packet of dpkt; where: in the capture."""
        data, first = bytes(network.data), OFFSET_BYTES * int(network.offset)
        if len(data) != network.len - 4 * network.hl or first + len(data) > MOST_DATAGRAM:
            self._tally.add(SHORT, where)
            return None
        key = (network.src, network.dst, int(network.id))
        begun = self._open.pop(key, None)
        if begun is not None and abs(when_s - begun.begun_s) > MOST_WAIT_S:
            self._tally.add(FRAGMENT, where, count=begun.fragments)
            begun = None
        begun = begun or _Open(when_s)
        begun.held += len(data) - len(begun.parts.get(first, b""))
        begun.parts[first], begun.fragments = data, begun.fragments + 1
        begun.size = begun.size if network.mf else first + len(data)
        if begun.held == begun.size or begun.held > MOST_DATAGRAM:
            if begun.held == begun.size >= UDP_HEAD and begun.is_gapless():
                return b"".join(begun.parts[at] for at in sorted(begun.parts))
            self._tally.add(OVERLAP, where, count=begun.fragments)
            return None
        self._open[key] = begun
        if len(self._open) > MOST_OPEN:
            _, oldest = self._open.popitem(last=False)
            self._tally.add(FRAGMENT, where, count=oldest.fragments)
        return None

    def close(self, where: str) -> None:
        """Count what is left at the end of the capture."""
        if left := sum(one.fragments for one in self._open.values()):
            self._tally.add(FRAGMENT, where, count=left)
        self._open.clear()


@dataclass
class _Open:
    """A datagram of which not every fragment has come."""

    begun_s: float  # when its first fragment came
    parts: dict[int, bytes] = field(default_factory=dict)  # by their place
    held: int = 0  # bytes of the parts
    size: int = -1  # of all of it; -1: not known
    fragments: int = 0

    def is_gapless(self) -> bool:
        """Whether each part begins where the one before ends."""
        at = 0
        for first in sorted(self.parts):
            if first != at:
                return False
            at += len(self.parts[first])
        return True


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
