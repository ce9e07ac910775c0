"""A record of ASTERIX CAT 062 by hand, octet after octet, as the tables of edition 1.20 have it."""

from __future__ import annotations

import struct
from typing import NamedTuple


class SystemTrack(NamedTuple):
    """The items of one record: 010, 040, 070, 105, 185 and 500; None where the field specification leaves one out."""

    sac: int
    sic: int
    number: int
    of_day_s: float
    latitude_deg: float
    longitude_deg: float
    velocity_m_s: tuple[float, float] | None
    sigma_m: tuple[float, float] | None
    root_covariance_m: float | None


def frns(data: bytes, at: int) -> tuple[list[int], int]:
    """The numbers of the fields of a specification, and where it ends: seven a octet, the last bit says that one follows."""
    fields, first = [], 1
    while True:
        octet = data[at]
        fields += [first + k for k in range(7) if octet & (0x80 >> k)]
        at, first = at + 1, first + 7
        if not octet & 1:
            return fields, at


def system_track(datagram: bytes) -> SystemTrack:
    """The only record of a datagram. Raises: ValueError: it has other items than these."""
    category, length = struct.unpack_from(">BH", datagram)
    if category != 62 or length != len(datagram):
        raise ValueError(f"got category {category}, {length} octets of {len(datagram)}")
    fields, at = frns(datagram, 3)
    if not {1, 4, 5, 12, 13} <= set(fields) <= {1, 4, 5, 7, 12, 13, 27}:
        raise ValueError(f"got fields {fields}")
    sac, sic = datagram[at : at + 2]
    of_day = int.from_bytes(datagram[at + 2 : at + 5], "big")
    latitude, longitude = struct.unpack_from(">ii", datagram, at + 5)
    at += 13
    velocity = sigma = root = None
    if 7 in fields:
        vx, vy = struct.unpack_from(">hh", datagram, at)
        velocity, at = (vx * 0.25, vy * 0.25), at + 4
    number, at = struct.unpack_from(">H", datagram, at)[0], at + 2
    while datagram[at] & 1:
        at += 1
    at += 1
    if 27 in fields:
        parts, at = frns(datagram, at)
        if parts != [1, 2]:
            raise ValueError(f"got parts {parts} of item 500")
        x, y, cov = struct.unpack_from(">HHh", datagram, at)
        sigma, root, at = (x * 0.5, y * 0.5), cov * 0.5, at + 6
    if at != len(datagram):
        raise ValueError(f"got {len(datagram) - at} octets more")
    scale = 180.0 / 2**25
    return SystemTrack(sac, sic, number, of_day / 128.0, latitude * scale, longitude * scale, velocity, sigma, root)
