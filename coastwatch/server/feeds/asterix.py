"""Plots and service messages of radars as ASTERIX CAT 048 and 034, both ways.

Source: EUROCONTROL Specification for Surveillance Data Exchange, Part 4 (CAT 048, edition 1.32) and Part 2b (CAT 034, edition 1.29).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np

from coastwatch.batches import RadarReports, Radars, Reports
from coastwatch.geodesy import NAUTICAL_MILE_M
from coastwatch.sensors.recorded.faults import SET_ASIDE, Tally
from coastwatch.server.feeds.address import Address, AddressError
from coastwatch.server.feeds.decoding import Waiting
from coastwatch.server.feeds.transport import Item

DAMAGED = "damaged datagram"
OTHER_CATEGORY = SET_ASIDE + "other category"
UNKNOWN_RADAR = "SAC and SIC of no radar"
NO_POSITION = "plot without range and azimuth"
TEST_TARGET = SET_ASIDE + "test target"
SERVICE = SET_ASIDE + "service message"
DAY_S = 86_400.0
SAC = 25  # of what is sent from here


@cache
def _library() -> Any:
    """The parts of libasterix that are needed. It takes a second to import."""
    from asterix import base, generated

    return SimpleNamespace(Raw=base.RawDatablock, Bits=base.Bits, plots=generated.Cat_048_1_32, service=generated.Cat_034_1_29)


def numbers_of(address: Address, names: list[str]) -> dict[tuple[int, int], int]:
    """The radar of each SAC and SIC that an address names, as in asterix+udp://:8600?25/1=north.

    Args: names: of the radars. Raises: AddressError.
    """
    out = {}
    for key, value in address.options.items():
        if key == "name":
            continue
        sac, _, sic = key.partition("/")
        if not (sac.isdecimal() and sic.isdecimal()) or value not in names:
            raise AddressError(
                f"feed: got {key}={value} in {address.text!r}, needed SAC/SIC=RADAR with a radar of {', '.join(names) or 'none'}"
            )
        out[int(sac), int(sic)] = names.index(value)
    return out


class AsterixDecoder:
    """The datagrams of one feed. Where its address names no radar, SIC 1 is the first radar of the scenario, 2 the second."""

    def __init__(self, address: Address, radars: Radars) -> None:
        """Raises: AddressError."""
        self.tally, self.newest_s, self.first_s = Tally(), -math.inf, math.inf
        self._name, self._radars = address.name, radars
        self._numbers = numbers_of(address, [str(name) for name in radars.name])
        self._waiting = Waiting(RadarReports, ("sensor", "range_m", "azimuth_deg"))

    @property
    def late(self) -> int:
        """As of `Decoder`."""
        return self._waiting.late

    @property
    def records(self) -> int:
        """As of `Decoder`."""
        return self._waiting.records

    def take(self, items: list[Item], reference_s: float | None) -> None:
        """As of `Decoder`. A time of day is that nearest to the reference, or to the arrival."""
        plots = [plot for when, data in items for plot in self._plots(data, when if reference_s is None else reference_s)]
        if not plots:
            return
        table = np.array(plots, np.float64)
        sensor = table[:, 0].astype(np.int64)
        self._waiting.add(
            RadarReports(
                sensor=sensor,
                time_s=table[:, 1].copy(),
                received_s=table[:, 1].copy(),
                range_m=table[:, 2].copy(),
                azimuth_deg=table[:, 3].copy(),
                site_deg=self._radars.site_deg[sensor],
                origin=np.full(len(table), -1, np.int64),
            )
        )

    def cut(self, after_s: float, until_s: float) -> Reports:
        """As `Cut`."""
        empty = Reports.empty()
        return Reports(self._waiting.cut(after_s, until_s), empty.ais, empty.statics, empty.bearing, empty.tracks)

    def _plots(self, data: bytes, about_s: float) -> Iterator[tuple[float, float, float, float]]:
        """Radar, time, range and azimuth of each plot of a datagram. What cannot be used is counted."""
        lib = _library()
        try:
            blocks = lib.Raw.parse(lib.Bits.from_bytes(data))
            if isinstance(blocks, ValueError):
                raise blocks
            for block in blocks:
                category = block.get_category()
                if category not in (34, 48):
                    self.tally.add(OTHER_CATEGORY, self._name, str(category))
                    continue
                kind = lib.plots if category == 48 else lib.service
                records = kind.cv_uap.parse(block.get_raw_records())
                if isinstance(records, ValueError):
                    raise records
                for record in records:
                    plot = self._plot(record, category == 48, about_s)
                    if plot is not None:
                        yield plot
        except Exception as error:  # whatever a library raises on damaged bytes
            self.tally.add(DAMAGED, self._name, f"{type(error).__name__}: {error}")

    def _plot(self, record: Any, is_plot: bool, about_s: float) -> tuple[float, float, float, float] | None:
        source, clock = record.get_item("010"), record.get_item("140" if is_plot else "030")
        number = None if source is None else self._number(*(source.variation.get_item(x).as_uint() for x in ("SAC", "SIC")))
        if number is None:
            self.tally.add(UNKNOWN_RADAR, self._name, "no item 010" if source is None else str(source.as_uint()))
            return None
        time_s = about_s if clock is None else nearest_s(clock.variation.content.as_quantity("s"), about_s)
        self.newest_s, self.first_s = max(self.newest_s, time_s), min(self.first_s, time_s)
        if not is_plot:
            self.tally.add(SERVICE, self._name)
            return None
        position = record.get_item("040")
        if position is None:
            self.tally.add(NO_POSITION, self._name)
            return None
        if _is_test(record.get_item("020")):
            self.tally.add(TEST_TARGET, self._name)
            return None
        rho, theta = (position.variation.get_item(name).variation.content for name in ("RHO", "THETA"))
        return number, time_s, rho.as_quantity("NM") * NAUTICAL_MILE_M, theta.as_quantity("°")

    def _number(self, sac: int, sic: int) -> int | None:
        if self._numbers:
            return self._numbers.get((sac, sic))
        return sic - 1 if 1 <= sic <= len(self._radars) else None


def nearest_s(of_day_s: float, about_s: float) -> float:
    """The instant nearest to another one at this time of day, UTC."""
    return about_s + (of_day_s - about_s + 0.5 * DAY_S) % DAY_S - 0.5 * DAY_S


def _is_test(descriptor: Any) -> bool:
    """Whether a target report descriptor (item 020) says that the plot is of a test target."""
    if descriptor is None:
        return False
    found = descriptor.variation.get_item("TST")
    return found is not None and bool(found.as_uint())


def datagrams(reports: RadarReports, most_plots: int = 40) -> Iterator[bytes]:
    """CAT 048 datagrams of plots, of one radar each, in order. SIC is the number of the radar from 1 on."""
    kind = _library().plots
    start = np.flatnonzero(np.append(True, np.diff(reports.sensor) != 0)[: len(reports)]).tolist()
    for begin, end in zip(start, [*start[1:], len(reports)], strict=True):
        for low in range(begin, end, most_plots):
            rows = range(low, min(low + most_plots, end))
            yield kind.create([_record(kind, reports, row) for row in rows]).unparse().to_bytes()


def _record(kind: Any, reports: RadarReports, row: int) -> Any:
    range_nm, azimuth = float(reports.range_m[row]) / NAUTICAL_MILE_M, float(reports.azimuth_deg[row]) % 360.0
    return kind.cv_record.create(
        {
            "010": (("SAC", SAC), ("SIC", int(reports.sensor[row]) + 1)),
            "140": (float(reports.time_s[row]) % DAY_S, "s"),
            "020": ((("TYP", 1), 0, 0, 0, 0, 0, None),),
            "040": (("RHO", (range_nm, "NM")), ("THETA", (azimuth, "°"))),
        }
    )
