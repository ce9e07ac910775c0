"""`video`: what radar video comes from a file or a feed, and the settings to begin with."""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from itertools import islice

import numpy as np

from coastwatch.batches import Array
from coastwatch.errors import AddressError, InputError
from coastwatch.formats.asterix.spokes import SpokeJoiner
from coastwatch.formats.asterix.video import VideoText, decode
from coastwatch.formats.decoding import Item
from coastwatch.formats.intake.faults import SET_ASIDE, Tally
from coastwatch.formats.video_state import VideoState
from coastwatch.geodesy import NAUTICAL_MILE_M
from coastwatch.plots.video.levels import CLEANED, levels_of
from coastwatch.sensors.recorded.wire.stream import items_of, wire_file
from coastwatch.server.feeds.address import parsed
from coastwatch.server.feeds.transport import Receiver
from coastwatch.spelling import printable

MOST_DATAGRAMS = 200_000
MOST_RADARS = 64
LEVEL_SPOKES = 4_096  # of a radar whose levels are looked at
BEAM_DEG, RPM = 1.0, 24.0  # where nothing tells them
EXAMPLES = "turns.pcap, video+file:blocks.ast, video+udp://239.192.0.1:8600?interface=192.168.1.10"


@dataclass
class _Radar:
    """One SAC and SIC."""

    joiner: SpokeJoiner
    levels: list[Array] = field(default_factory=list)  # (C,) of whole spokes of the newest scale

    def take(self) -> None:
        """Keep the levels of the newest spokes."""
        for video in self.joiner.take():
            if self.levels and len(self.levels[0]) != video.level.shape[1]:
                self.levels.clear()
            whole = video.level[video.missing[:, 1] == 0]
            self.levels = [*self.levels, *whole][-LEVEL_SPOKES:]


def video(options: argparse.Namespace) -> int:
    """Say what video comes, and print settings. Returns: 1 where none comes."""
    text = options.source
    tally = Tally()
    items = _received(text, options.seconds) if "+udp:" in text else _recorded(text, options.seconds, tally)
    radars, texts = _surveyed(items, tally)
    for line in [*_told(text, radars, texts, tally), *_settings(text, radars)]:
        print(printable(line))
    return 0 if radars else 1


def _received(text: str, seconds: float) -> Iterator[Item]:
    """What comes from a feed in so many seconds. Raises: AddressError, OSError."""
    address = parsed(text)
    if address.format != "video":
        raise AddressError(f"video: got {text!r}, needed a file or a feed of video, e.g. {EXAMPLES}")
    with Receiver([address]) as receiver:
        until_s = time.monotonic() + seconds
        while (left_s := until_s - time.monotonic()) > 0.0:
            time.sleep(min(left_s, 0.1))
            yield from receiver.inboxes[0].pop_first(MOST_DATAGRAMS)


def _recorded(text: str, seconds: float, tally: Tally) -> Iterator[Item]:
    """What a file has in its first so many seconds; of one without times of arrival, its first datagrams. Raises: OSError, InputError."""
    file = wire_file(text, "video")
    if file.format != "video":
        raise InputError(f"video: got {text!r}, needed a file or a feed of video, e.g. {EXAMPLES}")
    until_s = math.inf
    for item in islice(items_of(file, tally), MOST_DATAGRAMS):
        until_s = item[0] + seconds if until_s == math.inf and math.isfinite(item[0]) else until_s
        if item[0] > until_s:
            return
        yield item


def _surveyed(items: Iterable[Item], tally: Tally) -> tuple[dict[tuple[int, int], _Radar], dict[tuple[int, int], str]]:
    """The radars, and the texts that they sent, by SAC and SIC."""
    radars: dict[tuple[int, int], _Radar] = {}
    texts: dict[tuple[int, int], str] = {}
    for number, (arrived_s, data, _) in enumerate(items):
        found, faults = decode(data)
        for fault in faults:
            kind, _, got = fault.partition("; ")
            tally.add(kind, f"datagram {number + 1}", got)
        for message in found:
            key = message.sac, message.sic
            if isinstance(message, VideoText):
                texts[key] = message.text
                continue
            if not len(message.level) or not message.duration_fs or (key not in radars and len(radars) >= MOST_RADARS):
                tally.add("video without cells, without range, or of too many radars", f"datagram {number + 1}", "")
                continue
            if key not in radars:
                radars[key] = _Radar(SpokeJoiner(0, np.zeros(2), VideoState(f"{key[0]}/{key[1]}", *key)))
            radar, of_day_s = radars[key], message.time_of_day_s
            radar.joiner.state.has_time_of_day = of_day_s == of_day_s
            known_s = of_day_s if of_day_s == of_day_s else (arrived_s if arrived_s == arrived_s else 0.0)
            radar.joiner.add(message, known_s, arrived_s)
        if number % 256 == 0:
            for each in radars.values():
                each.take()
    for radar in radars.values():
        radar.take()
    return radars, texts


def _told(text: str, radars: dict[tuple[int, int], _Radar], texts: dict[tuple[int, int], str], tally: Tally) -> Iterator[str]:
    """What comes, in lines."""
    if not radars:
        yield f"{text}: no radar video"
    for key, radar in sorted(radars.items()):
        s, name = radar.joiner.state, f"SAC {key[0]}, SIC {key[1]}"
        turn = f"{s.period_s:.3f} s a turn, {60.0 / s.period_s:.1f} rpm" if s.turns and s.period_s > 0.0 else "not known yet"
        spokes = f"{s.spokes_a_turn} a turn" if s.turns else f"{s.spokes} so far"
        yield name + (f": {texts[key]}" if key in texts else "")
        yield f"  turn          {turn}" + ("" if s.turns else ", as no whole turn came: try a longer --seconds")
        yield f"  spokes        {spokes}, {s.parts} message{'s' * (s.parts > 1)} each; lost: {s.spokes_lost} spokes, {s.parts_lost} parts"
        yield f"  cells         {s.cells} of {s.cell_m:.2f} m, from {s.first_m:.0f} m to {s.range_m / NAUTICAL_MILE_M:.2f} NM"
        yield f"  depth         {s.bits} bits, {'compressed (zlib)' if s.compressed else 'not compressed'}"
        clock = (
            "stands: that of arrival is taken"
            if s.clock_stuck
            else "sent"
            if s.has_time_of_day
            else "not sent: that of arrival is taken"
        )
        yield f"  time of day   {clock}"
        if s.out_of_order:
            yield f"  out of order  {s.out_of_order} messages"
        if radar.levels:
            found = levels_of(np.stack(radar.levels))
            yield f"  levels        mean {found.mean:.1f}, highest {found.highest}, {100.0 * found.zero_share:.0f} % of cells are 0"
    for key in sorted(texts.keys() - radars.keys()):
        yield f"SAC {key[0]}, SIC {key[1]}: no video, text {texts[key]}"
    for fault in tally.faults():
        kind = fault.kind.removeprefix(SET_ASIDE)
        yield f"left out: {fault.count} {kind} (first at {fault.first})"


def _settings(text: str, radars: dict[tuple[int, int], _Radar]) -> Iterator[str]:
    """The settings to begin with, in lines of TOML, and how to serve."""
    if not radars:
        return
    yield ""
    yield "# settings to begin with: the position, beam and pulse of each radar are in its data sheet"
    cleaned, sites = False, list[str]()
    for key, radar in sorted(radars.items()):
        s, found = radar.joiner.state, levels_of(np.stack(radar.levels or [np.zeros(1, np.uint8)]))
        cleaned |= found.zero_share >= CLEANED
        name, range_nm = f"radar-{key[0]}-{key[1]}", math.ceil(100.0 * s.range_m / NAUTICAL_MILE_M - 1e-6) / 100.0
        is_turning, pulse_m = bool(s.turns) and s.period_s > 0.0, f"{max(45.0, 1.5 * s.cell_m):.0f}"
        rpm = f"{60.0 / s.period_s if is_turning else RPM:.1f}"
        yield "[[radars]]"
        yield f'name = "{name}"'
        yield "latitude_deg = 0.0 # of its antenna"
        yield "longitude_deg = 0.0 # of its antenna"
        yield f"range_nm = {range_nm}"
        yield f"rpm = {rpm}" + ("" if is_turning else " # not known yet")
        yield f"beam_deg = {BEAM_DEG} # width at half power"
        yield f"pulse_m = {pulse_m} # length in range"
        if found.db_per_level is not None:
            meaning = "levels are linear in amplitude" if found.db_per_level == 0.0 else "by the deviation of the noise"
            yield f"db_per_level = {found.db_per_level:g} # {meaning}"
        step = "" if found.db_per_level is None else f",{found.db_per_level:g}"
        sites.append(f"--radar '{name},LATITUDE,LONGITUDE,{range_nm},{rpm},,,{BEAM_DEG},{pulse_m}{step}'")
        yield ""
    yield "[extraction]"
    if cleaned:
        yield 'method = "absolute" # most cells are 0: the radar has cleaned its video'
        yield "least_level = 1"
    else:
        yield 'method = "cfar"'
    names = "&".join(f"{sac}/{sic}=radar-{sac}-{sic}" for sac, sic in sorted(radars))
    yield ""
    if "+udp:" in text:
        address, _, options = text.partition("?")
        kept = [option for option in options.split("&") if option and "/" not in option.partition("=")[0]]
        yield f"# coastwatch serve SCENARIO --feed '{address}?{'&'.join([*kept, names])}'"
    else:
        yield "[input]"
        yield 'method = "video_files"'
        path = wire_file(text, "video").path
        yield f'files = ["video+file:{path}?{names}"]'
        yield ""
        more = " --set extraction.method=absolute --set extraction.least_level=1" if cleaned else ""
        yield f"# or: coastwatch fuse --video 'video+file:{path}?{names}' {' '.join(sites)}{more}"
