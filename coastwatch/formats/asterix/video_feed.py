"""A feed of radar video: datagrams of CAT 240 to `Videos`, and back."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np

from coastwatch.batches import RadarVideo, Reports, Sensors, Videos
from coastwatch.batches.limits import MOST_RANGE_M
from coastwatch.errors import AddressError, InputError
from coastwatch.formats.asterix.beam_time import FULL_TURN
from coastwatch.formats.asterix.decoder import SAC, Origin, block_length, date_of, origins_of
from coastwatch.formats.asterix.spokes import HALF_LIGHT_M_FS, SpokeJoiner
from coastwatch.formats.asterix.video import MOST_CELLS, VideoMessage, decode, encode
from coastwatch.formats.decoding import Counts, FeedSettings, Item, Stamps
from coastwatch.formats.format import NAMED_BY_CODES, Format
from coastwatch.formats.intake.faults import SET_ASIDE, Tally
from coastwatch.formats.intake.timestamps import DAY_S, nearest_s
from coastwatch.formats.video_state import VideoState
from coastwatch.spelling import printable

DAMAGED = "damaged video: "
UNKNOWN_RADAR = "video of no radar of the scenario"
ABSURD_RANGE = "video of absurd range"
EMPTY = "video without cells"
SECOND_SENDER = "video of a second sender of one SAC and SIC"
OUT_OF_ORDER = "video message out of order, or again"
TEXT = SET_ASIDE + "text of a radar"
FURTHER_PARTS = "further parts of a spoke"
SECOND_S = 2.0
"""While one sender is heard so often, another one of the same SAC and SIC is not used."""

MOST_WAITING_BYTES = 256 << 20
"""Of the spokes of a feed that wait for their cycle. The oldest go first."""

MOST_AT_A_TIME = 1 << 28
"""Cells of a call of `decode`, about a second of a processor. Each counts in its message, and again in its spoke.

5,000 datagrams of 25,000 cells have room. A flood of compressed spokes is dropped beyond it: it would hold up the cycle.
"""

EACH_MESSAGE = 1_024
"""Cells that a message counts beside its own: so many take about as long as what each message takes."""

COLLECTED = 1 << 24
"""Cells after which spokes are put into their batches within a call, so that its messages have gone by then."""

LEAST_CELL_M = 0.05
MOST_PART = 32_768  # cells of a message that is sent, and octets of them: a datagram has at most 65,507
NUMBER_AT = 8  # octet of a message that `encode` makes at which its number is, of four
KEY_AT = 5  # the same of SAC and SIC


class _Sender(NamedTuple):
    number: int
    heard_s: float


Arrived = tuple[VideoMessage, float, int]
"""A message, when it came, and the number of its sender, as of `Item`."""


class VideoDecoder:
    """The datagrams of one feed. Where its address names nothing, SIC 1 is the first radar of the scenario, 2 the second."""

    def __init__(self, feed: FeedSettings, sensors: Sensors) -> None:
        """Raises: AddressError."""
        self.tally, self.counts, self.checked = Tally(), Counts(), feed.checked
        self.stamps = Stamps(feed.name, feed.checked, self.tally)
        self._feed, self._sensors, self._origins = feed, sensors, origins_of(feed, sensors)
        for (sac, sic), origin in self._origins.items():
            if origin.is_track_source:
                raise AddressError(
                    f"feed: got {sac}/{sic} of a track source in {feed.text!r}, needed a radar: video has no tracks"
                )
        self._date_s, self._before_s = date_of(feed), math.nan  # of the first report; the newest stamp, where there is a date
        self._messages = 0  # datagrams that have come
        self._joiners: dict[tuple[int, int], SpokeJoiner] = {}
        self._senders: dict[tuple[int, int], _Sender] = {}
        self._videos: list[RadarVideo] = []  # that wait for their cycle
        self._room = MOST_AT_A_TIME  # of this call of `decode`
        self._former_parts = 0  # further parts of spokes under a SAC and SIC that a radar had before

    @property
    def has_dates(self) -> bool:
        """As of `Decoder`: whether the date of its first time of day is known."""
        return self._date_s is not None

    @property
    def waiting(self) -> int:
        """As of `Decoder`."""
        return sum(map(len, self._videos)) + sum(joiner.waiting for joiner in self._joiners.values())

    def decode(self, items: list[Item], reference_s: float | None) -> None:
        """As of `Decoder`. A time of day is that nearest to the reference, or to the arrival."""
        messages: list[Arrived] = []
        cells, self._room = 0, MOST_AT_A_TIME
        for arrived_s, data, sender in items:
            self._messages += 1
            if self._room <= cells:
                self.counts.dropped += 1
                continue
            found, faults = self._read(data)
            cells += MOST_CELLS * faults  # each may have unpacked so many
            for message in found:
                messages.append((message, arrived_s, sender))
                cells += len(message.level) + EACH_MESSAGE
            if cells > COLLECTED:
                self._use(messages, reference_s)
                messages, cells, self._room = [], 0, self._room - cells
        self._use(messages, reference_s)

    def _read(self, data: bytes) -> tuple[list[VideoMessage], int]:
        """The video of a datagram, and how many messages are damaged. What else is in it is counted."""
        found, faults = decode(data)
        self.counts.ledger.read += len(found) + len(faults)
        for fault in faults:
            kind, _, got = fault.partition("; ")
            self.tally.add(DAMAGED + kind, self._where, got)
        video = []
        for message in found:
            if isinstance(message, VideoMessage):
                video.append(message)
                continue
            self.tally.add(TEXT, self._where, message.text)
            if (joiner := self._joiners.get((message.sac, message.sic))) is not None:
                joiner.state.text = printable(message.text)
        return video, len(faults)

    def _use(self, messages: list[Arrived], reference_s: float | None) -> None:
        """Take messages and what they complete. Args: reference_s: as of `decode`."""
        if not messages:
            return
        stamp_s = np.array([self._stamp_s(message, arrived_s, reference_s) for message, arrived_s, _ in messages])
        time_s = self.stamps.times_s(stamp_s, np.array([arrived_s for _, arrived_s, _ in messages]))
        for (message, arrived_s, sender), at_s in zip(messages, time_s.tolist(), strict=True):
            if at_s == at_s:
                self._take(message, at_s, arrived_s, sender)
        self._collect(all_of_them=False)

    def reports_between(self, after_s: float, until_s: float) -> Reports:
        """As `ReportsBetween`."""
        if until_s == math.inf:
            self._collect(all_of_them=True)
        parts, rest = [], []
        for video in self._videos:
            end = int(np.searchsorted(video.received_s, until_s, side="right"))
            if end < len(video):
                rest.append(video.take(slice(end, None)))
            if end:
                outdated = self.counts.outdated(video.received_s[:end], after_s)
                parts.append(video.take(slice(int(outdated.sum()), end)))
        self._videos = rest
        joined = Videos(_joined([part for part in parts if len(part)]))
        self.counts.records += len(joined)
        return Reports(video=joined)

    @property
    def _where(self) -> str:
        return f"{self._feed.name}:{self._messages}"

    def _stamp_s(self, message: VideoMessage, arrived_s: float, reference_s: float | None) -> float:
        """When it is the time of day of a message; NaN: it has none."""
        of_day_s = message.time_of_day_s
        if of_day_s != of_day_s:
            return math.nan
        if self._date_s is None:
            return nearest_s(of_day_s, arrived_s if reference_s is None else reference_s)
        at_s = nearest_s(of_day_s, self._before_s) if math.isfinite(self._before_s) else self._date_s + of_day_s
        self._before_s = at_s
        return at_s

    def _joiner(self, key: tuple[int, int], heard_s: float) -> SpokeJoiner | None:
        """What joins the spokes of a radar; None: it is of no radar of the scenario, or heard under another SAC and SIC.

        Args: key: SAC and SIC; heard_s: now.
        """
        if key in self._joiners:
            return self._joiners[key]
        origin = self._origins.get(key) if self._origins else Origin(False, key[1] - 1)
        radars = self._sensors.radars
        if origin is None or not 0 <= origin.number < len(radars):
            return None
        name = str(radars.name[origin.number])
        if (before := self.counts.radars.get(name)) is not None:
            if heard_s - before.heard_s < SECOND_S:
                return None
            self._keep(self._joiners.pop((before.sac, before.sic)).take(all_of_them=True))
            self._former_parts += before.messages - before.spokes
        self.counts.radars[name] = state = VideoState(name, *key, heard_s=heard_s)
        self._joiners[key] = joiner = SpokeJoiner(origin.number, radars.site_deg[origin.number], state)
        return joiner

    def _take(self, message: VideoMessage, time_s: float, arrived_s: float, sender: int) -> None:
        """Take a message of video."""
        key, heard_s = (message.sac, message.sic), time_s if arrived_s != arrived_s else arrived_s
        joiner = self._joiner(key, heard_s)
        if joiner is None:
            self.tally.add(UNKNOWN_RADAR, self._where, f"SAC {key[0]}, SIC {key[1]}")
            return
        cell_m, end = message.duration_fs * HALF_LIGHT_M_FS, message.first_cell + len(message.level)
        if not len(message.level):
            self.tally.add(EMPTY, self._where, f"SAC {key[0]}, SIC {key[1]}")
            return
        if cell_m < LEAST_CELL_M or cell_m * end > MOST_RANGE_M or end > 2 * MOST_CELLS:
            most = f"at most {2 * MOST_CELLS}, {MOST_RANGE_M / 1e3:.0f} km"
            self.tally.add(ABSURD_RANGE, self._where, f"got {end} of {cell_m:.3g} m, needed {LEAST_CELL_M} m or more, {most}")
            return
        state, before = joiner.state, self._senders.get(key)
        if before is not None and before.number != sender and heard_s - before.heard_s < SECOND_S:
            names = self._feed.sender_name(before.number), self._feed.sender_name(sender)
            state.senders, state.second_s = names, heard_s
            state.second_messages += 1
            self.tally.add(SECOND_SENDER, self._where, " and ".join(names))
            return
        self._senders[key] = _Sender(sender, heard_s)
        state.heard_s, state.has_time_of_day = heard_s, message.time_of_day_s == message.time_of_day_s
        if not state.has_time_of_day and math.isnan(state.untimed_s):
            state.untimed_s = heard_s
        if not joiner.add(message, time_s, arrived_s):
            self.tally.add(OUT_OF_ORDER, self._where, f"number {message.number}")
        if joiner.cells > COLLECTED:  # a short part may make a long spoke
            self._collect(all_of_them=False)

    def _collect(self, *, all_of_them: bool) -> None:
        """Take what the radars have completed. Args: as of `SpokeJoiner.take`."""
        for joiner in self._joiners.values():
            self._keep(joiner.take(all_of_them=all_of_them))
        joiners = self._joiners.values()
        further = self._former_parts + sum(one.state.messages - one.state.spokes - one.waiting for one in joiners)
        if further:
            self.counts.ledger.beside[FURTHER_PARTS] = further
        size = sum(video.level.nbytes for video in self._videos)
        while size > MOST_WAITING_BYTES:
            oldest = self._videos.pop(0)
            size -= oldest.level.nbytes
            self.counts.dropped += len(oldest)

    def _keep(self, videos: list[RadarVideo]) -> None:
        """Show video, and let it wait for its cycle."""
        for video in videos:
            self._feed.on_video(video)
            self._room -= video.level.size
        self._videos += videos


def _joined(parts: list[RadarVideo]) -> tuple[RadarVideo, ...]:
    """The spokes of each radar and range scale in one batch, as long as their times do not fall, in order."""
    groups: list[list[RadarVideo]] = []
    newest: dict[int, list[RadarVideo]] = {}
    for part in parts:
        group, begins_s = newest.get(part.sensor), float(part.received_s[0])
        if group is None or group[-1].scale != part.scale or float(group[-1].received_s[-1]) > begins_s:
            groups.append(group := [])
            newest[part.sensor] = group
        group.append(part)
    return tuple(map(RadarVideo.join, groups))


def datagrams(reports: Reports, sensors: Sensors) -> list[bytes]:
    """CAT 240 datagrams of video, by time. SIC is the number of the radar from 1 on; numbers of messages begin at 0.

    Raises: InputError: cells of more than 2**32 fs, or a first cell that is at no whole number of them.
    """
    out: list[tuple[float, bytes]] = []
    for video in reports.video.parts:
        duration_fs = round(video.cell_m / HALF_LIGHT_M_FS)
        first = round(video.first_m / video.cell_m)
        if duration_fs >= 1 << 32 or abs(first * video.cell_m - video.first_m) > 0.01 * video.cell_m:
            raise InputError(
                f"video of radar {video.sensor + 1}: got cells of {video.cell_m} m from {video.first_m} m on, needed cells of at most "
                "640 m, and a whole number of them before the first"
            )
        middle = video.azimuth_rad * (FULL_TURN / (2.0 * np.pi))
        half = 0.5 * float(np.median(np.diff(middle) % FULL_TURN)) if len(middle) > 1 else 0.0  # of the step between spokes
        start, end = ((middle + off).round().astype(np.int64) % FULL_TURN for off in (-half, half))
        most = MOST_PART * 8 // max(video.bits, 8)
        rows = zip(video.time_s.tolist(), start.tolist(), end.tolist(), video.level, video.missing.tolist(), strict=True)
        for time_s, begin, stop, level, (lost, to) in rows:
            for low, high in _pieces(len(level), lost, to, most):
                message = VideoMessage(
                    SAC, video.sensor + 1, 0, begin, stop, first + low, duration_fs, level[low:high], time_s % DAY_S, video.bits
                )
                out.append((time_s, encode(message)))
    return [data for _, data in sorted(out, key=lambda pair: pair[0])]


def _pieces(cells: int, lost: int, to: int, most: int) -> list[tuple[int, int]]:
    """The cells of each message of a spoke. Args: lost, to: what did not come of it; most: cells of a message."""
    spans = [(0, cells)] if lost == to else [(0, lost), (to, cells)]
    return [(low, min(low + most, high)) for begin, high in spans for low in range(begin, high, most)]


def renumbered(messages: list[bytes], sent: Counter[bytes]) -> list[bytes]:
    """As `Format.renumber`."""
    out = []
    for data in messages:
        key = data[KEY_AT : KEY_AT + 2]
        out.append(data[:NUMBER_AT] + (sent[key] % (1 << 32)).to_bytes(4, "big") + data[NUMBER_AT + 4 :])
        sent[key] += 1
    return out


def _sending_times(blocks: Iterable[bytes]) -> Iterator[tuple[int, float]]:
    """As `Format.sending_times`. Source: I240/140."""
    for number, block in enumerate(blocks, 1):
        of_day_s = [one.time_of_day_s for one in decode(block)[0] if isinstance(one, VideoMessage)]
        yield from ((number, stamp_s) for stamp_s in of_day_s[:1] if math.isfinite(stamp_s))


VIDEO = Format(
    "video",
    decoder=VideoDecoder,
    options=(NAMED_BY_CODES, "date"),
    encode=datagrams,
    encodes=("video",),
    renumber=renumbered,
    in_datagrams=True,
    length=block_length,
    sending_times=_sending_times,
)
