"""Payloads of many AIS messages to rows: the fields of types 1, 2, 3, 5, 18, 19, 24 and 27, decoded as arrays.

Source: Recommendation ITU-R M.1371-5 (2014), annex 8; armouring of six bits a character: IEC 61162-1. The tests compare each field
with pyais, which decodes one message at a time.
"""

from __future__ import annotations

import zlib

import numpy as np

from coastwatch.batches import AisStatics, Array, Bools, Floats, Ints, PositionAccuracy
from coastwatch.formats.intake.ais_validation import AisRows, StaticRows
from coastwatch.formats.intake.faults import SET_ASIDE, Tally
from coastwatch.formats.nmea.messages import UNDECODABLE, Messages

CUT_PAYLOAD = "payload too short"
OTHER_MESSAGE = SET_ASIDE + "other message"
NO_VESSEL = {4: SET_ASIDE + "base station", 9: SET_ASIDE + "search and rescue aircraft", 21: SET_ASIDE + "aid to navigation"}

CLASS_A, CLASS_B, LONG_RANGE = (1, 2, 3), (18, 19), 27
NEEDED_BITS = {1: 143, 2: 143, 3: 143, 5: 270, 18: 139, 19: 139, 24: 160, 27: 94}
"""Up to the second, or the course if there is no second; of static data up to the dimensions, or the name of part A."""
STATIC_BITS_19 = 301
LONGEST = 71  # characters of the longest of these messages (type 5, 424 bits)

ARMOUR = np.array([0 if not 48 <= c <= 119 else c - 56 if c > 88 else c - 48 for c in range(256)], np.uint8)
LETTER = np.array([v + 64 if v < 32 else v for v in range(64)], np.uint8)
FIRST_SHIP_TYPE, LAST_SHIP_TYPE = 20, 99  # the others are reserved

WHERE: dict[str, tuple[tuple[int, int], ...]] = {  # first bit and width of a field: class A, class B, long range; width 0: none
    "sog": ((50, 10), (46, 10), (79, 6)),
    "lon": ((61, 28), (57, 28), (44, 18)),
    "lat": ((89, 27), (85, 27), (62, 17)),
    "cog": ((116, 12), (112, 12), (85, 9)),
    "heading": ((128, 9), (124, 9), (0, 0)),
    "second": ((137, 6), (133, 6), (0, 0)),
    "status": ((38, 4), (0, 0), (40, 4)),
    "accurate": ((60, 1), (56, 1), (38, 1)),
    "raim": ((148, 1), (147, 1), (39, 1)),
}
UNKNOWN_LONG_RANGE_SOG, UNKNOWN_LONG_RANGE_COG = 63, 511  # knots, degrees


def decoded(messages: Messages, name: str, tally: Tally) -> tuple[AisRows, AisStatics, StaticRows]:
    """The position rows and the static data of these messages. Other messages are counted in the tally.

    The stamps are those of the messages, NaN where they have none.
    """
    kind = ARMOUR[np.array([p[0] for p in messages.payload], np.int64)].astype(np.int64)
    needed = np.array([NEEDED_BITS.get(k, 0) for k in range(64)])[kind]
    short = messages.bits < needed
    part = np.flatnonzero(kind == 24)
    wrong = np.zeros(len(kind), np.bool_)  # neither part A nor part B of static data
    wrong[part] = bits(six_bits([messages.payload[i] for i in part], 7), 38, 2) > 1
    wrong &= ~short
    faults = {k: (kind == k, fault) for k, fault in NO_VESSEL.items()}
    other = (needed == 0) & ~np.isin(kind, list(NO_VESSEL))
    for mask, fault in (*faults.values(), (other, OTHER_MESSAGE), (short, CUT_PAYLOAD), (wrong, UNDECODABLE)):
        tally.add_rows(fault, mask, lambda i: f"{name}:{messages.line[i]}", lambda i: messages.raw[i].decode("ascii"))
    good = (needed > 0) & ~short & ~wrong
    digest = np.array([zlib.crc32(p) for p in messages.payload], np.int64)
    statics, static_rows = _statics(messages, kind, good, digest)
    return _positions(messages, kind, good, digest), statics, static_rows


def six_bits(payloads: list[bytes], length: int) -> Array:
    """The six bits of each character, 0 beyond the end of a payload. (length, M) uint8"""
    text = np.array([p[:length] for p in payloads], f"S{length}")
    return ARMOUR[np.ascontiguousarray(text.view(np.uint8).reshape(len(payloads), length).T)]


def bits(six: Array, start: int, width: int) -> Ints:
    """The unsigned numbers in these bits. Args: six: (characters, M). Returns: (M,)"""
    first, last = start // 6, (start + width - 1) // 6
    value = six[first].astype(np.int64)
    for k in range(first + 1, last + 1):
        value = (value << 6) | six[k]
    return np.asarray((value >> (6 * (last + 1) - start - width)) & ((1 << width) - 1))


def _signed(six: Array, start: int, width: int) -> Ints:
    value = bits(six, start, width)
    return value - ((value >> (width - 1)) << width)


def _text(six: Array, start: int, length: int) -> Array:
    """The text in these bits up to the first @, without spaces around it. (M,) of U"""
    codes = np.stack([LETTER[bits(six, start + 6 * k, 6)] for k in range(length)], axis=-1)
    codes[np.logical_or.accumulate(codes == ord("@"), axis=1)] = 0
    return np.asarray(np.char.strip(np.ascontiguousarray(codes).view(f"S{length}")[:, 0].astype(f"U{length}")))


def _degrees(tenth_minutes: Ints) -> Floats:
    """Degrees of 1/10,000 minutes, to the sixth decimal."""
    return np.asarray(((10 * tenth_minutes + 3) // 6) / 1e6)


def _positions(messages: Messages, kind: Ints, good: Bools, digest: Ints) -> AisRows:
    rows = np.flatnonzero(good & (kind != 5) & (kind != 24))
    six = six_bits([messages.payload[i] for i in rows], 28)
    kind_of_row = kind[rows]
    form = np.select([kind_of_row == LONG_RANGE, (kind_of_row == 18) | (kind_of_row == 19)], [2, 1], 0)
    raw = {name: np.zeros(len(rows), np.int64) for name in WHERE}
    for k in range(3):
        mine = np.flatnonzero(form == k)
        if not len(mine):
            continue
        some = six[:, mine]
        for name, at in WHERE.items():
            start, width = at[k]
            if width:
                take = _signed if name in ("lon", "lat") else bits
                raw[name][mine] = take(some, start, width)
    far = form == 2
    position = [np.where(far, _degrees(1000 * raw[name]), _degrees(raw[name])) for name in ("lat", "lon")]
    unknown_sog, unknown_cog = far & (raw["sog"] == UNKNOWN_LONG_RANGE_SOG), far & (raw["cog"] == UNKNOWN_LONG_RANGE_COG)
    monitored = (raw["raim"] == 1) & (kind_of_row != 19)  # type 19 has other data in that bit
    return AisRows(
        row=messages.line[rows],
        stamp_s=messages.stamp_s[rows],
        fix_s=np.full(len(rows), np.nan),
        second=np.where(far, -1, raw["second"]),
        mmsi=bits(six, 8, 30),
        position_deg=np.stack(position, axis=-1),
        sog_kn=np.where(unknown_sog, np.nan, np.where(far, raw["sog"], raw["sog"] / 10.0)),
        cog_deg=np.where(unknown_cog, np.nan, np.where(far, raw["cog"], raw["cog"] / 10.0)),
        class_b=form == 1,
        digest=digest[rows],
        nav_status=np.where(form == 1, -1, raw["status"]),
        heading_deg=np.where(far | (raw["heading"] >= 360), np.nan, raw["heading"]),
        accuracy=np.where(raw["accurate"] == 1, PositionAccuracy.HIGH, np.where(monitored, PositionAccuracy.LOW, 0)),
    )


def _statics(messages: Messages, kind: Ints, good: Bools, digest: Ints) -> tuple[AisStatics, StaticRows]:
    whole = (kind == 5) | (kind == 24) | ((kind == 19) & (messages.bits >= STATIC_BITS_19))
    rows = np.flatnonzero(good & whole)
    six = six_bits([messages.payload[i] for i in rows], LONGEST)
    n, kind_of_row, mmsi = len(rows), kind[rows], bits(six, 8, 30)
    part_b = (kind_of_row == 24) & (bits(six, 38, 2) == 1)
    name, sign = np.full(n, "", "U20"), np.full(n, "", "U7")
    size = np.zeros((n, 4), np.int64)  # to the bow, the stern, port, starboard
    type_ = np.zeros(n, np.int64)
    # By form of message: first bits of the name, the call sign, the ship type and the dimensions; -1: it has none.
    forms = (
        (kind_of_row == 5, 112, 70, 232, 240),
        (kind_of_row == 19, 143, -1, 263, 271),
        ((kind_of_row == 24) & ~part_b, 40, -1, -1, -1),
        (part_b, -1, 90, 40, 132),
    )
    for mine, name_at, sign_at, type_at, size_at in forms:
        some = six[:, mine]
        if name_at >= 0:
            name[mine] = _text(some, name_at, 20)
        if sign_at >= 0:
            sign[mine] = _text(some, sign_at, 7)
        if type_at >= 0:
            type_[mine] = bits(some, type_at, 8)
        if size_at >= 0:
            at = (size_at, 9), (size_at + 9, 9), (size_at + 18, 6), (size_at + 24, 6)
            size[mine] = np.stack([bits(some, start, width) for start, width in at], axis=-1)
    size[part_b & (mmsi // 10_000_000 == 98)] = 0  # a craft of a mother ship has the mother's MMSI there
    length, beam = (size[:, k] + size[:, k + 1] for k in (0, 2))
    of_antenna = np.where((length > 0)[:, None], size, np.nan).T
    statics = AisStatics(
        received_s=messages.stamp_s[rows],
        mmsi=mmsi,
        name=name,
        call_sign=sign,
        ship_type=np.where((type_ >= FIRST_SHIP_TYPE) & (type_ <= LAST_SHIP_TYPE), type_, -1),
        length_m=np.where(length > 0, length, np.nan),
        beam_m=np.where(beam > 0, beam, np.nan),
        to_bow_m=of_antenna[0],
        to_stern_m=of_antenna[1],
        to_port_m=of_antenna[2],
        to_starboard_m=of_antenna[3],
    )
    number = np.arange(n, dtype=np.int64)
    return statics, StaticRows(messages.line[rows], messages.stamp_s[rows], digest[rows], number)
