"""What a wire format offers: a decoder, an encoder of reports, an encoder of pictures, or some of them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

from coastwatch.batches import Floats, Ints, Reports, Sensors
from coastwatch.batches.limits import HIGHEST_LATITUDE_DEG
from coastwatch.formats.decoding import Decoder, FeedSettings, ReportsBetween


@dataclass(frozen=True, eq=False)
class Vessels:
    """Some vessels of a picture, for other systems. V rows; NaN: not known."""

    run_id: int
    time_s: float
    period_s: float  # between pictures
    every_id: Ints  # of all vessels of the picture
    vessel_id: Ints  # (V,)
    position_deg: Floats  # (V, 2)
    sog_kn: Floats
    cog_deg: Floats
    major_m: Floats  # standard deviation of the position along the longer axis of its ellipse
    minor_m: Floats
    orientation_deg: Floats  # of the longer axis, clockwise from north
    mmsi: Ints  # -1: none
    name: Sequence[str | None]


class Encoder(Protocol):
    """Vessels to messages, one a vessel."""

    def messages(self, vessels: Vessels) -> Iterator[bytes]:
        """The messages of these vessels. One that cannot be said in the format has none."""
        ...


@dataclass(frozen=True)
class OutSettings:
    """What a format is told of an address to which it sends."""

    site_deg: tuple[float, float] | None = None  # from which range and bearing are


NAMED_BY_CODES = "SAC/SIC"
"""An option of ASTERIX: the name of a radar or a track source, by the numbers of its system area and its code."""


def parsed_site(text: str) -> tuple[float, float] | None:
    """Latitude and longitude of "LAT,LON", degrees; None: it is none, or no plane there is right."""
    try:
        latitude, longitude = (float(part) for part in text.split(","))
    except ValueError:
        return None
    return (latitude, longitude) if abs(latitude) < HIGHEST_LATITUDE_DEG and abs(longitude) <= 180.0 else None


def rounded_deg(degrees: float, digits: int) -> float:
    """A course or bearing with so many decimals, from 0 to under 360: 359.96 with one is 0, which 360.0 would not be to all."""
    return round(degrees, digits) % 360.0


def line_length(data: bytes, begin: int) -> int:
    """As `Format.length`, of a line with its end."""
    return data.find(b"\n", begin) + 1 - begin


@dataclass(frozen=True)
class Format:
    """A wire format. What it does not offer is None."""

    name: str  # as it stands in addresses
    decoder: Callable[[FeedSettings, Sensors], Decoder] | None = None  # raises AddressError
    report_sources: Callable[[Sequence[Decoder]], list[ReportsBetween]] = lambda decoders: [
        decoder.reports_between for decoder in decoders
    ]
    """Of all feeds of it together; where nothing else is said, each feed by itself."""
    encode: Callable[[Reports, Sensors], list[bytes]] | None = None  # lines or datagrams of reports
    encodes: tuple[str, ...] = ()  # the kinds of reports that `encode` takes: fields of `Reports`
    pictures: Callable[[OutSettings], Encoder] | None = None
    renumber: Callable[[list[bytes], Counter[bytes]], list[bytes]] | None = None
    """Of what `encode` makes: with numbers that go on from call to call. The counter, of what was sent by each sensor, is kept up."""
    in_datagrams: bool = False  # a message is a datagram; else it is a line
    length: Callable[[bytes, int], int] = line_length
    """(data, begin) -> bytes of the message of a file that begins there, 0 or less: its end has not come. Raises: ValueError."""
    sending_times: Callable[[Iterable[bytes]], Iterator[tuple[int, float]]] | None = None
    """When `coastwatch feed` sends the messages of a file: (number, time) of each message with a time, numbers from 1 on.

    Of lines Unix time; of datagrams, whose date is not in them, seconds since midnight UTC. None: it cannot send a file.
    """
    options: tuple[str, ...] = ()  # that it takes behind '?' of an address, beside the name
    needs_site: bool = False  # its pictures are of ranges and bearings
    own_source: bool = False  # a feed is a track source by itself, of the name of the feed
    numbered: bool = False  # its reports have the number of their feed
