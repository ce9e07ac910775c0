"""Plots, tracks and service messages as ASTERIX: CAT 048 and 034 of radars, 010 of surface radars, 062 of other systems.

Source: EUROCONTROL Specification for Surveillance Data Exchange, Part 4 (CAT 048, edition 1.32), Part 2b (CAT 034, edition 1.29),
Part 7 (CAT 010, edition 1.1) and Part 9 (CAT 062, edition 1.20).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from datetime import UTC, date, datetime
from functools import cache
from itertools import pairwise
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from coastwatch.batches import Floats, RadarReports, Radars, Reports, Sensors
from coastwatch.errors import AddressError, InputError
from coastwatch.formats.asterix.system_tracks import SystemTracks, time_of_day_s
from coastwatch.formats.asterix.tracks import Track, quantity_of, reports_of, track_of, uint_of
from coastwatch.formats.decoding import Counts, FeedSettings, Item, Stamps, Waiting
from coastwatch.formats.format import NAMED_BY_CODES, Format
from coastwatch.formats.intake.faults import SET_ASIDE, Tally
from coastwatch.formats.intake.timestamps import nearest_s
from coastwatch.geodesy import NAUTICAL_MILE_M

DAMAGED = "damaged datagram"
OTHER_CATEGORY = SET_ASIDE + "other category"
UNKNOWN_RADAR = "SAC and SIC of no radar or track source"
NO_POSITION = "plot without range and azimuth"
TEST_TARGET = SET_ASIDE + "test target"
SERVICE = SET_ASIDE + "service message"
CLOCK = {48: "140", 34: "030", 10: "140", 62: "070"}
"""Item with the time of day, by category."""

TARGET_REPORT = 1  # message type of CAT 010
SAC = 25  # of what is sent from here
LARGEST_RANGE_NM = 65_535 / 256.0  # for which item 040 has room


class Plot(NamedTuple):
    """A plot of a radar."""

    radar: int
    time_s: float
    range_m: float
    azimuth_deg: float


@cache
def _library() -> Any:
    """The parts of libasterix that are needed. It takes a second to import."""
    from asterix import base, generated

    kinds = {48: generated.Cat_048_1_32, 34: generated.Cat_034_1_29, 10: generated.Cat_010_1_1, 62: generated.Cat_062_1_20}
    return SimpleNamespace(Raw=base.RawDatablock, Bits=base.Bits, kinds=kinds)


class Origin(NamedTuple):
    """What a SAC and SIC stand for."""

    is_track_source: bool
    number: int  # of the radar or track source


def origins_of(feed: FeedSettings, sensors: Sensors) -> dict[tuple[int, int], Origin]:
    """What each SAC and SIC that an address names stands for, as in asterix+udp://:8600?25/1=north. Raises: AddressError."""
    radars, sources = [str(name) for name in sensors.radars.name], [str(name) for name in sensors.track_sources.name]
    origins = {}
    for key, value in feed.options.items():
        if key in ("name", "date", "source"):
            continue
        sac, _, sic = key.partition("/")
        if not (sac.isdecimal() and sic.isdecimal()) or value not in (*radars, *sources):
            names = ", ".join([*radars, *sources]) or "none"
            raise AddressError(
                f"feed: got {key}={value} in {feed.text!r}, needed SAC/SIC=NAME with a radar or track source of {names}; "
                f"--set 'track_sources=[{{name=\"{value}\"}}]' makes a track source"
            )
        origins[int(sac), int(sic)] = (
            Origin(False, radars.index(value)) if value in radars else Origin(True, sources.index(value))
        )
    return origins


def date_of(feed: FeedSettings) -> float | None:
    """The beginning of the day in `?date=YYYY-MM-DD`, Unix time; None: there is none. Raises: AddressError."""
    text = feed.options.get("date")
    if text is None:
        return None
    try:
        begin_s = datetime.combine(date.fromisoformat(text), datetime.min.time(), UTC).timestamp()
    except ValueError:
        raise AddressError(f"feed: got date={text} in {feed.text!r}, needed the day of its first report, YYYY-MM-DD") from None
    if feed.checked:
        raise AddressError(f"feed: got date= in {feed.text!r}, needed --clock feeds with it: it is for replays")
    return begin_s


class AsterixDecoder:
    """The datagrams of one feed. With `date=` its first time of day is of that day, and the others are near the newest one.

    Where its address names nothing, SIC 1 is the first radar of the scenario, 2 the second, and CAT 062 is of the only track source.
    """

    def __init__(self, feed: FeedSettings, sensors: Sensors) -> None:
        """Raises: AddressError."""
        self.tally, self.counts, self.checked = Tally(), Counts(), feed.checked
        self.stamps = Stamps(feed.name, feed.checked, self.tally)
        self._name, self._sensors = feed.name, sensors
        self._messages, self._where = 0, feed.name  # datagrams that have come, and the location of the one that is decoded
        self._origins, self._date_s = origins_of(feed, sensors), date_of(feed)
        self._waiting = Waiting(self.counts, self.tally, "radar", "tracks")
        self.reports_between = self._waiting.reports_between

    @property
    def has_dates(self) -> bool:
        """As of `Decoder`: whether the date of its first time of day is known."""
        return self._date_s is not None

    @property
    def waiting(self) -> int:
        """As of `Decoder`."""
        return self._waiting.rows

    def decode(self, items: list[Item], reference_s: float | None) -> None:
        """As of `Decoder`. A time of day is that nearest to the reference, or to the arrival."""
        plots: list[Plot] = []
        tracks: list[tuple[int, Track]] = []
        for when, data, _ in items:
            self._messages += 1
            self._where = f"{self._name}:{self._messages}"
            for decoded in self._targets_of(data, when, when if reference_s is None else reference_s):
                if isinstance(decoded, Plot):
                    plots.append(decoded)
                else:
                    tracks.append(decoded)
        if plots:
            table = np.array(plots, np.float64)
            self._waiting.add("radar", _radar_reports(table, self._sensors.radars))
        for source in sorted({number for number, _ in tracks}):
            self._waiting.add("tracks", reports_of(source, [track for number, track in tracks if number == source]))

    def _targets_of(self, data: bytes, arrived_s: float, about_s: float) -> Iterator[Plot | tuple[int, Track]]:
        """The plots and the tracks, with the number of their source, of a datagram. What cannot be used is counted.

        A block of another category, and what is damaged, count as one record.
        """
        lib, ledger = _library(), self.counts.ledger
        try:
            blocks = lib.Raw.parse(lib.Bits.from_bytes(data))
            if isinstance(blocks, ValueError):
                raise blocks
            for block in blocks:
                category = block.get_category()
                if category not in lib.kinds:
                    ledger.read += 1
                    self.tally.add(OTHER_CATEGORY, self._where, str(category))
                    continue
                records = lib.kinds[category].cv_uap.parse(block.get_raw_records())
                if isinstance(records, ValueError):
                    raise records
                for record in records:
                    decoded = self._one(record, category, arrived_s, about_s)
                    ledger.read += 1
                    if decoded is not None:
                        yield decoded
        except Exception as error:  # whatever a library raises on damaged bytes
            ledger.read += 1
            self.tally.add(DAMAGED, self._where, f"{type(error).__name__}: {error}")

    def _one(self, record: Any, category: int, arrived_s: float, about_s: float) -> Plot | tuple[int, Track] | None:
        """What a record holds; None: nothing that is used, which is counted."""
        identity, clock = record.get_item("010"), record.get_item(CLOCK[category])
        if identity is None:
            self.tally.add(UNKNOWN_RADAR, self._where, "no item 010")
            return None
        sac, sic = uint_of(identity, "SAC"), uint_of(identity, "SIC")
        origin = self._origin(category, sac, sic)
        if origin is None:
            self.tally.add(UNKNOWN_RADAR, self._where, self._remedy(category, sac, sic))
            return None
        stamp_s = about_s if clock is None else self._instant_s(clock.variation.content.as_quantity("s"), about_s)
        time_s = self.stamps.time_s(stamp_s, arrived_s)
        if math.isnan(time_s):
            return None
        if category == 34 or (category == 10 and record.get_item("000").as_uint() != TARGET_REPORT):
            self.tally.add(SERVICE, self._where)
            return None
        descriptor = record.get_item("020")
        if category != 62 and descriptor is not None and uint_of(descriptor, "TST"):
            self.tally.add(TEST_TARGET, self._where)
            return None
        if origin.is_track_source:
            track = track_of(record, category, time_s, self._sensors.track_sources.site_deg[origin.number])
            if isinstance(track, str):
                self.tally.add(track, self._where)
                return None
            return origin.number, track
        return self._plot(record, category, origin.number, time_s)

    def _instant_s(self, of_day_s: float, about_s: float) -> float:
        """When it is this time of day: on the date of the address, or nearest to the newest report or to `about_s`."""
        if self._date_s is None:
            return nearest_s(of_day_s, about_s)
        return nearest_s(of_day_s, self.stamps.newest_s) if math.isfinite(self.stamps.newest_s) else self._date_s + of_day_s

    def _plot(self, record: Any, category: int, radar: int, time_s: float) -> Plot | None:
        position = record.get_item("040") if category in (48, 10) else None
        if position is None:
            self.tally.add(NO_POSITION, self._where)
            return None
        if category == 10:
            return Plot(radar, time_s, quantity_of(position, "RHO", "m"), quantity_of(position, "TH", "°"))
        return Plot(radar, time_s, quantity_of(position, "RHO", "NM") * NAUTICAL_MILE_M, quantity_of(position, "THETA", "°"))

    def _remedy(self, category: int, sac: int, sic: int) -> str:
        """What of the address would say whose these codes are."""
        if category == 62 and not len(self._sensors.track_sources):
            return f"{sac}/{sic}; no track source: --set 'track_sources=[{{name=\"a\"}}]' makes one"
        kind = "track source" if category == 62 else "radar"
        if category != 62 and not len(self._sensors.radars):
            return f"{sac}/{sic}; the scenario has no radar"
        return f"{sac}/{sic}; its address needs ?{sac}/{sic}=NAME with the name of a {kind}"

    def _origin(self, category: int, sac: int, sic: int) -> Origin | None:
        if self._origins:
            return self._origins.get((sac, sic))
        if category == 62:
            return Origin(True, 0) if len(self._sensors.track_sources) == 1 else None
        return Origin(False, sic - 1) if 1 <= sic <= len(self._sensors.radars) else None


def _radar_reports(table: Floats, radars: Radars) -> RadarReports:
    """Plots as reports. Args: table: (M, 4), rows of `Plot`."""
    sensor = table[:, 0].astype(np.int64)
    return RadarReports(
        sensor=sensor,
        time_s=table[:, 1].copy(),
        received_s=table[:, 1].copy(),
        range_m=table[:, 2].copy(),
        azimuth_deg=table[:, 3].copy(),
        site_deg=radars.site_deg[sensor],
    )


def datagrams(reports: RadarReports, most_plots: int = 40) -> Iterator[bytes]:
    """CAT 048 datagrams of plots, of one radar each, in order. SIC is the number of the radar from 1 on.

    Raises: InputError: a range for which item 040 has no room.
    """
    kind = _library().kinds[48]
    start = np.flatnonzero(np.append(True, np.diff(reports.sensor) != 0)[: len(reports)]).tolist()
    for begin, end in pairwise([*start, len(reports)]):
        for low in range(begin, end, most_plots):
            rows = range(low, min(low + most_plots, end))
            yield kind.create([_record(kind, reports, row) for row in rows]).unparse().to_bytes()


def _record(kind: Any, reports: RadarReports, row: int) -> Any:
    range_nm, azimuth = float(reports.range_m[row]) / NAUTICAL_MILE_M, float(reports.azimuth_deg[row]) % 360.0
    if not range_nm <= LARGEST_RANGE_NM:
        raise InputError(
            f"plots of radar {int(reports.sensor[row]) + 1}: got a range of {range_nm:.1f} NM, needed at most {LARGEST_RANGE_NM:.3f} NM: "
            "CAT 048 has no room for more"
        )
    return kind.cv_record.create(
        {
            "010": (("SAC", SAC), ("SIC", int(reports.sensor[row]) + 1)),
            "140": (time_of_day_s(float(reports.time_s[row])), "s"),
            "020": ((("TYP", 1), 0, 0, 0, 0, 0, None),),
            "040": (("RHO", (range_nm, "NM")), ("THETA", (azimuth, "°"))),
        }
    )


def encode(reports: Reports, sensors: Sensors) -> list[bytes]:
    """CAT 048 datagrams of plots."""
    return list(datagrams(reports.radar))


def block_length(data: bytes, begin: int) -> int:
    """The length that a data block says of itself, as `Format.length`."""
    length = int.from_bytes(data[begin + 1 : begin + 3], "big") if len(data) >= begin + 3 else 0
    if len(data) >= begin + 3 and length <= 3:
        raise ValueError(f"an ASTERIX data block of {length} bytes, needed more than 3")
    return length


ASTERIX = Format(
    "asterix",
    decoder=AsterixDecoder,
    options=(NAMED_BY_CODES, "date", "source"),
    encode=encode,
    encodes=("radar",),
    pictures=SystemTracks,
    in_datagrams=True,
    length=block_length,
)
