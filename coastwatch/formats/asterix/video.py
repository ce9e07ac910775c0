"""Radar video on the wire: messages of ASTERIX CAT 240, edition 1.3, in both directions.

One message is a spoke, or a part of one. `spokes` joins parts, and times of day have no date here.
Source: EUROCONTROL, Specification for Surveillance Data Exchange, Category 240, Radar Video Transmission, edition 1.3, 2015.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from coastwatch.batches import Array

CATEGORY = 240
BITS = {1: 1, 2: 2, 3: 4, 4: 8, 5: 16, 6: 32}
"""Bits of a cell by the code of item 048."""
CODES = {bits: code for code, bits in BITS.items()}
MOST_CELLS = 65_536
MOST_OF_A_DATAGRAM = 1 << 21
"""Cells of all messages of a datagram, 32 of the longest spokes: one of 64 KB can hold 1,000 of them compressed to nothing."""

MESSAGE, SUMMARY, VIDEO = 2, 1, 2  # FRN of the type; what types there are
SOURCE, NUMBER, TEXT, NANO, FEMTO, RESOLUTION, COUNTERS, TIME = 1, 3, 4, 5, 6, 7, 8, 12  # FRNs of the items
BLOCKS = {9: 4, 10: 64, 11: 256}
"""Octets of a block by FRN: low, medium and high data volume."""
LARGEST_BLOCK = max(BLOCKS.values())
FIXED = {SOURCE: 2, MESSAGE: 1, NUMBER: 4, NANO: 12, FEMTO: 12, RESOLUTION: 2, COUNTERS: 5, TIME: 3}
"""Octets of items of a fixed length."""
REPEATED = BLOCKS | {TEXT: 1}
NEEDED: dict[str, set[int]] = {
    "020": {NUMBER},
    "040 or 041": {NANO, FEMTO},
    "048": {RESOLUTION},
    "049": {COUNTERS},
    "050, 051 or 052": set(BLOCKS),
}
"""Items of video by name, of which it has one in each row. Source: table of I240/000."""
SELF_SIZED = (13, 14)  # reserved expansion and special purpose: the first octet is the length
NS_FS, DAY_STEPS = 1_000_000, 128
NAN = float("nan")


class VideoMessage(NamedTuple):
    """A spoke, or a part of it."""

    sac: int
    sic: int
    number: int  # of the message
    start: int  # azimuth, 1/65536 turn
    end: int
    first_cell: int  # its near edge is at this many durations
    duration_fs: int  # of a cell
    level: Array  # (C,) uint8; cells of 1, 2 and 4 bits as they are, of 16 and 32 bits scaled down
    time_of_day_s: float  # NaN: not sent
    bits: int = 8  # of a cell
    compressed: bool = False


class VideoText(NamedTuple):
    """A summary that a radar sends about its video."""

    sac: int
    sic: int
    text: str


class VideoFault(ValueError):
    """A message that is not one of category 240: a short reason, and after a semicolon what was got and needed."""


def decode(datagram: bytes) -> tuple[list[VideoMessage | VideoText], list[str]]:
    """The messages of a datagram, and why others were refused: each of its data blocks is one record or more.

    Blocks of other categories are left out. What follows a record that is damaged is lost with its block.
    """
    out: list[VideoMessage | VideoText] = []
    faults: list[str] = []
    at = 0
    while at < len(datagram):
        length = int.from_bytes(datagram[at + 1 : at + 3], "big")
        if length < 3 or at + length > len(datagram):
            faults.append("block: cut short")
            break
        if datagram[at] == CATEGORY:
            room = MOST_OF_A_DATAGRAM - sum(len(one.level) for one in out if isinstance(one, VideoMessage))
            try:
                out.extend(_records(datagram[at + 3 : at + length], room))  # also those before one that is damaged
            except VideoFault as fault:
                faults.append(str(fault))
        at += length
    return out, faults


def encode(message: VideoMessage) -> bytes:
    """The data block of a message. Levels are written as they are, those of 16 and 32 bits scaled up. Raises: VideoFault."""
    raw = _packed(message.level, message.bits)
    raw = zlib.compress(raw, 1) if message.compressed else raw
    frn, size = next((f, s) for f, s in BLOCKS.items() if len(raw) <= 255 * s or s == LARGEST_BLOCK)
    blocks = -(-len(raw) // size)
    if blocks > 255:
        raise VideoFault(f"level: got {len(raw)} octets, needed at most {255 * size}")
    has_time = message.time_of_day_s == message.time_of_day_s
    items = {
        SOURCE: bytes([message.sac, message.sic]),
        MESSAGE: bytes([VIDEO]),
        NUMBER: struct.pack(">I", message.number),
        FEMTO: struct.pack(">HHII", message.start, message.end, message.first_cell, message.duration_fs),
        RESOLUTION: bytes([0x80 * message.compressed, CODES[message.bits]]),
        COUNTERS: struct.pack(">H", len(raw)) + len(message.level).to_bytes(3, "big"),
        frn: bytes([blocks]) + raw.ljust(blocks * size, b"\0"),
    }
    if has_time:
        items[TIME] = (round(message.time_of_day_s * DAY_STEPS) % (86_400 * DAY_STEPS)).to_bytes(3, "big")
    present = [frn in items for frn in range(1, 15)]
    fspec = bytes([sum(0x80 >> k for k in range(7) if present[k]) | 1, sum(0x80 >> k for k in range(7) if present[7 + k])])
    body = fspec + b"".join(items[frn] for frn in sorted(items))
    return bytes([CATEGORY]) + (3 + len(body)).to_bytes(2, "big") + body


def _records(block: bytes, room: int) -> Iterator[VideoMessage | VideoText]:
    """The messages of a block without its header. Args: room: for cells. Raises: VideoFault."""
    at = 0
    while at < len(block):
        items, at = _items(block, at)
        if not {SOURCE, MESSAGE} <= items.keys():
            raise VideoFault(f"record: without source or type; got items of FRN {sorted(items)}, needed {SOURCE} and {MESSAGE}")
        sac, sic = items[SOURCE]
        if items[MESSAGE][0] == SUMMARY:
            yield VideoText(sac, sic, items.get(TEXT, b"\0")[1:].decode("ascii", "replace"))
        elif items[MESSAGE][0] == VIDEO:
            message = _video(sac, sic, items, room)
            room -= len(message.level)
            yield message
        else:
            raise VideoFault("record: of an unknown type")


def _items(block: bytes, at: int) -> tuple[dict[int, bytes], int]:
    """The items of a record by FRN, and where it ends. Raises: VideoFault."""
    begun = at
    while at < len(block) and block[at] & 1:
        at += 1
    at += 1
    if at > len(block) or at - begun > 2:
        raise VideoFault("record: cut short")
    items = {}
    for frn in _present(block[begun:at]):
        size = _size(frn, block[at] if at < len(block) else 0)
        if at + size > len(block):
            raise VideoFault("item: cut short")
        items[frn] = block[at : at + size]
        at += size
    return items, at


@lru_cache(maxsize=256)
def _present(octets: bytes) -> tuple[int, ...]:
    """The FRNs that the octets of a field specification name."""
    return tuple(7 * o + k + 1 for o, octet in enumerate(octets) for k in range(7) if octet & (0x80 >> k))


def _size(frn: int, first: int) -> int:
    """Octets of an item. Args: first: its first octet. Raises: VideoFault."""
    if frn in FIXED:
        return FIXED[frn]
    if frn in REPEATED:
        return 1 + first * REPEATED[frn]
    if frn in SELF_SIZED and first >= 1:
        return first
    raise VideoFault("item: not of category 240")


def _video(sac: int, sic: int, items: dict[int, bytes], room: int) -> VideoMessage:
    """The message that items say. Args: room: for cells. Raises: VideoFault."""
    header, block = next((f for f in (NANO, FEMTO) if f in items), 0), next((f for f in BLOCKS if f in items), 0)
    if not (header and block and {NUMBER, RESOLUTION, COUNTERS} <= items.keys()):
        absent = " and ".join(name for name, frns in NEEDED.items() if not items.keys() & frns)
        raise VideoFault(f"record: of video without an item that it needs; got no {absent}, needed {'; '.join(NEEDED)}")
    start, end, first_cell, duration = struct.unpack(">HHII", items[header])
    octets, cells = int.from_bytes(items[COUNTERS][:2], "big"), int.from_bytes(items[COUNTERS][2:], "big")
    packed, code = bool(items[RESOLUTION][0] & 0x80), items[RESOLUTION][1]
    if code not in BITS or cells > MOST_CELLS:
        raise VideoFault(f"cells: more than 65,536, or of an unknown size; got {cells} of code {code}")
    if cells > room:
        raise VideoFault(f"cells: too many in one datagram; needed at most {MOST_OF_A_DATAGRAM}")
    raw, need = items[block][1 : 1 + octets], -(-cells * BITS[code] // 8)  # what is longer is padded
    if packed:
        raw = _inflated(raw, need)
    if len(raw) < need:
        raise VideoFault(f"cells: fewer than announced; got {len(raw)} octets, needed {need}")
    time_s = int.from_bytes(items[TIME], "big") / DAY_STEPS if TIME in items else NAN
    number = int.from_bytes(items[NUMBER], "big")
    duration_fs = duration * (NS_FS if header == NANO else 1)
    level = _levels(raw[:need], BITS[code], cells)
    return VideoMessage(sac, sic, number, start, end, first_cell, duration_fs, level, time_s, BITS[code], packed)


def _inflated(raw: bytes, need: int) -> bytes:
    """The octets of compressed cells. A sender may have padded its last block before it compressed; a bomb has more.

    Args: need: octets that are announced. Raises: VideoFault.
    """
    most = -(-need // LARGEST_BLOCK) * LARGEST_BLOCK
    try:
        inflated = zlib.decompressobj().decompress(raw, most + 1)
    except zlib.error as error:
        raise VideoFault("cells: not in zlib") from error
    if len(inflated) > most:
        raise VideoFault(f"cells: more than announced; got over {most} octets, needed {need}")
    return inflated


def _levels(raw: bytes, bits: int, cells: int) -> Array:
    """Levels of cells, the first one in the high bits; of 16 and 32 bits the high octet. (C,) uint8"""
    octets = np.frombuffer(raw, np.uint8)
    if bits < 8:
        shifts = np.arange(8 - bits, -1, -bits, dtype=np.uint8)
        return np.asarray(((octets[:, None] >> shifts) & np.uint8((1 << bits) - 1)).ravel()[:cells])
    return octets[:: bits // 8].copy() if bits > 8 else octets  # a view would keep all octets


def _packed(level: Array, bits: int) -> bytes:
    """The reverse of `_levels`."""
    if bits >= 8:
        return np.repeat(level[:, None], bits // 8, axis=1).tobytes()
    each = 8 // bits
    padded = np.concatenate([level, np.zeros(-len(level) % each, np.uint8)]).reshape(-1, each)
    shifts = np.arange(8 - bits, -1, -bits, dtype=np.uint8)
    octets: Array = np.bitwise_or.reduce((padded & np.uint8((1 << bits) - 1)) << shifts, axis=1).astype(np.uint8)
    return octets.tobytes()
