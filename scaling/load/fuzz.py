"""Damaged and odd messages of every text and binary format in the decoders, and what they accept in the chain:

    python -m scaling.load.fuzz [--messages 1000000] [--seed 1] [--chain 0]

True messages are the seed: their fields are replaced by odd values, cut off, repeated, and their bytes changed. Check sums are mended in
most, so that the damage reaches the decoders. With `--chain N` the reports of each N messages go through a cycle of the whole chain.
Exit code 1: an exception left a decoder or the chain, or memory grew by more than a tenth after the first tenth.
"""

from __future__ import annotations

import argparse
import json
import sys
import traceback
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import nullcontext
from dataclasses import replace
from functools import reduce
from operator import xor
from random import Random
from typing import Any

from coastwatch.batches import Reports
from coastwatch.cycle import run_cycle, start_run
from coastwatch.formats.nmea.ais import Receivers
from coastwatch.formats.registry import FORMATS
from coastwatch.operators.cli.arguments import count, whole
from coastwatch.scenario import load_scenario
from coastwatch.server.deployment import with_track_sources
from coastwatch.server.feeds.address import parsed
from coastwatch.server.feeds.sending import encoded
from coastwatch.stage import serial, serial_regions
from scaling.load.options import errors_as_one_line
from scaling.load.processes import memory_bytes

SCENARIO, SOURCE = "guanabara", "vts"
ADDRESSES = {
    "ais": "ais+udp://:0",
    "asterix": "asterix+udp://:0",
    "json": "json+udp://:0",
    "ttm": f"ttm+udp://:0?source={SOURCE}&site=-22.9,-43.1",
    "heading": "heading+udp://:0",
}
KINDS = "radar", "ais", "statics", "bearing", "tracks", "headings"
TOGETHER = 300
"""Messages of a format that come in one period of cycles."""

MOST_GROWTH = 1.1
TEXTS = (
    b"", b"0", b"1", b"-1", b"99", b"1e30", b"1e400", b"nan", b"inf", b"-inf", b"12.5", b"5047.70", b"00106.3", b"9999999999", b"x",
    b"\xff", b" ", b"1,2", b"1e10", b"T", b"R", b"N", b"A", b"\x00", b"24", b"61", b"\\", b"*", b"9" * 400,
)  # fmt: skip
NUMBERS: tuple[Any, ...] = (
    0, 1, -1, 1e-320, 1e-200, 1e-100, 1e-10, 1e-3, 0.5, 30, 90.0, 180.0, 360.0, 1e3, 5e5, 1e6, 1e10, 1e100, 1e155, 1e300, 2**31, 2**62,
    2**63, 10**40, 84.9999, -84.9999, True, None, "x", "", [], {}, "2026-11-23T12:00:00Z", "0001-01-01T00:00:00Z",
    "9999-12-31T23:59:59Z", "1790000000", 1.79e12, -1e18, 1e18,
)  # fmt: skip
OWN_SHIP = (
    b"RATTM,01,2.5,45.0,T,10.0,90.0,T,0.1,1.0,N,NAME,T,,120000.00,A", b"RATTM,02,0.5,145.0,R,30.0,190.0,R,0.1,1.0,K,,T,,,",
    b"RATLL,03,2254.0000,S,04306.3000,W,NAME,120000.00,T,", b"GPRMC,120000.00,A,2254.0,S,04306.3,W,5.0,90.0,231126,,,A",
    b"GPGGA,120000.00,2254.0,S,04306.3,W,1,8,1.0,10,M,1,M,,", b"GPGLL,2254.0,S,04306.3,W,120000.00,A,A",
    b"GPVTG,90.0,T,,M,5.0,N,9.0,K,A", b"HEHDT,90.0,T", b"HETHS,90.0,A", b"RAOSD,90.0,A,90.0,P,5,P,,,N",
    b"GPZDA,120000.00,23,11,2026,00,00",
)  # fmt: skip
HEADINGS = b"HEHDT,90.0,T", b"HETHS,359.9,A", b"HETHS,0.1,E", b"HETHS,0.1,V"
PARTS = (
    b"AIVDM,2,1,3,A,55P5TL01VIaAL@7WKO@mBplU@<PDhh000000001S;AJ::4A80?4i@E53,0", b"AIVDM,2,2,3,A,1@0000000000000,2",
    b"AIVDM,3,1,7,B,55P5TL01VIaAL@7WKO,0", b"BSVDM,2,1,,A,55P5TL01VIaAL@7WKO@mBplU@,0",
)  # fmt: skip


class Messages:
    """Damaged messages of each format."""

    def __init__(self, seed: int) -> None:
        self._random = Random(seed)
        scenario = with_track_sources(load_scenario(SCENARIO, {"input.count": "40"}), [SOURCE])
        sensors, plan = scenario.sensors(), scenario.plan()
        reports = scenario.input.load(sensors, 1, plan).reports.between(-float("inf"), plan.instant_s(4))
        true = {name: encoded(reports, parsed(ADDRESSES[name]), sensors)[:2_000] for name in ("ais", "asterix", "json")}
        ship = scenario.radars[1].model_copy(update={"azimuth_reference": "heading"})
        self.scenario = scenario.model_copy(update={"radars": (scenario.radars[0], ship)})
        self._bodies = [line.partition(b"!")[2].rpartition(b"*")[0] for line in true["ais"]]
        self._datagrams = true["asterix"]
        self._objects = [json.loads(line) for line in true["json"]]
        self._objects += [
            {
                "type": "track",
                "source": SOURCE,
                "number": k,
                "latitude_deg": -22.9,
                "longitude_deg": -43.1,
                "sog_kn": 5.0,
                "cog_deg": 90.0,
            }
            for k in range(100)
        ]

    def of(self, name: str, time_s: float) -> bytes:
        """One message of a format. Args: time_s: now."""
        make: dict[str, Callable[[float], bytes]] = {
            "ais": self._ais,
            "asterix": self._asterix,
            "json": self._json,
            "ttm": self._target,
            "heading": lambda now_s: self._sentence(self._random.choice(HEADINGS), b"$", now_s),
        }
        return make[name](time_s)

    def _asterix(self, time_s: float) -> bytes:
        r, data = self._random, bytearray(self._random.choice(self._datagrams))
        for _ in range(r.choice((0, 1, 1, 3, 10))):
            data[r.randrange(len(data))] = r.randrange(256)
        return bytes(data[: r.randrange(len(data))] if r.random() < 0.1 else data)

    def _json(self, time_s: float) -> bytes:
        r, said = self._random, dict(self._random.choice(self._objects))
        said["time"] = time_s - r.choice((0.0, 0.5, 1.0, 2.9))
        for _ in range(r.choice((0, 1, 1, 2, 4))):
            said[r.choice((*said, "range_sigma_m", "azimuth_sigma_deg", "bearing_sigma_deg", "contact"))] = r.choice(NUMBERS)
        return self._damaged(json.dumps(said).encode())

    def _target(self, time_s: float) -> bytes:
        return self._sentence(self._random.choice(OWN_SHIP), b"$", time_s)

    def _ais(self, time_s: float) -> bytes:
        r = self._random
        if r.random() < 0.03:
            return self._sentence(b"GPZDA,120000.00,23,11,2026,00,00", b"$", time_s)
        body = r.choice(PARTS) if r.random() < 0.1 else r.choice(self._bodies)
        if r.random() < 0.3:  # another payload, so that fields inside take any value
            fields = body.split(b",")
            payload = bytearray(fields[5])
            for _ in range(r.choice((1, 3, 10))):
                payload[r.randrange(len(payload))] = r.choice(
                    b"0123456789:;<=>?@ABCDEFGHIJKLMNOPQRSTUVW`abcdefghijklmnopqrstuvw"
                )
            body = b",".join([*fields[:5], bytes(payload), *fields[6:]])
        return self._sentence(body, b"!", time_s)

    def _sentence(self, body: bytes, first: bytes, time_s: float) -> bytes:
        r, fields = self._random, body.split(b",")
        for _ in range(r.choice((0, 0, 1, 1, 2, 4))):
            fields[r.randrange(len(fields))] = r.choice(TEXTS)
        if r.random() < 0.1:
            fields = fields[: r.randrange(len(fields) + 1)]
        if r.random() < 0.05:
            fields += [r.choice(TEXTS)] * r.randrange(5)
        line = _with_sum(b",".join(fields), first)
        if r.random() < 0.5:
            clock = r.choice((b"%d" % time_s, b"%d" % time_s, b"%d" % (time_s * 1000), r.choice(TEXTS)))
            group = r.choice((b"", b",g:1-2-%d" % r.randrange(10**6), b",s:r%d" % r.randrange(100), b",g:" + r.choice(TEXTS)))
            line = _with_sum(b"c:" + clock + group, b"\\") + b"\\" + line
        return self._damaged(line)

    def _damaged(self, line: bytes) -> bytes:
        r = self._random
        if line and r.random() < 0.05:
            k = r.randrange(len(line))
            line = line[:k] + bytes([r.randrange(256)]) + line[k + 1 :]
        return line[: r.randrange(len(line) + 1)] if r.random() < 0.03 else line


def _with_sum(body: bytes, first: bytes) -> bytes:
    return first + body + b"*%02X" % reduce(xor, body, 0)


def decoders(messages: Messages) -> dict[str, Any]:
    """A decoder of each format, as a live server makes them."""
    sensors = messages.scenario.sensors()
    return {
        name: decode(parsed(ADDRESSES[name]).settings(True), sensors)
        for name in ADDRESSES
        if (decode := FORMATS[name].decoder) is not None
    }


def fuzzed(number: int, seed: int, chain: int) -> Iterator[tuple[int, Counter[str], Counter[str]]]:
    """After each hundredth: messages so far, exceptions by format and place, and reports that were accepted by format."""
    messages, random = Messages(seed), Random(seed + 1)
    scenario, sensors = messages.scenario, messages.scenario.sensors()
    found, broken, taken = decoders(messages), Counter[str](), Counter[str]()
    receivers = Receivers([found["ais"]])
    period_s, start_s = scenario.plan().period_s, scenario.plan().start_s
    memory = start_run(scenario, sensors)
    done, cycle, told = 0, 0, 0
    while done < number:
        cycle += 1
        now_s = start_s + cycle * period_s
        parts = []
        for name, decoder in found.items():
            items = [(now_s, messages.of(name, now_s), random.randrange(20)) for _ in range(TOGETHER)]
            done += len(items)
            try:
                decoder.decode(items, None)
                part = (
                    receivers.reports_between(now_s - period_s, now_s)
                    if name == "ais"
                    else decoder.reports_between(now_s - period_s, now_s)
                )
            except Exception as error:
                broken[f"{name}: {_where(error)}"] += 1
                continue
            taken[name] += sum(len(getattr(part, kind)) for kind in KINDS)
            parts.append(part)
        if chain and (cycle * TOGETHER * len(found)) % chain < TOGETHER * len(found):
            reports = Reports.merged([replace(part, tracks=Reports().tracks) for part in parts])
            reports = replace(reports, tracks=type(reports.tracks).join([part.tracks for part in parts]))
            try:
                memory, _ = run_cycle(
                    scenario, sensors, memory, reports, now_s, serial, lambda _: nullcontext(), serial_regions
                )
            except Exception as error:
                broken[f"chain: {_where(error)}"] += 1
                memory = start_run(scenario, sensors)
        if done * 100 // number > told or done >= number:
            told = done * 100 // number
            yield done, broken, taken


def _where(error: Exception) -> str:
    at = traceback.extract_tb(error.__traceback__)[-1]
    return f"{type(error).__name__}: {str(error)[:80]} in {at.filename.rpartition('coastwatch/')[2]}:{at.lineno}"


def main() -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--messages", type=count, default=1_000_000)
    parser.add_argument("--seed", type=whole, default=1)
    parser.add_argument(
        "--chain", type=whole, default=0, metavar="N", help="a cycle of the chain after each N messages; 0: none"
    )
    options = parser.parse_args()
    first = last = 0
    broken, taken = Counter[str](), Counter[str]()
    for done, broken, taken in fuzzed(options.messages, options.seed, options.chain):  # noqa: B007 - the last ones count
        last = memory_bytes()[0]
        if not first and done * 10 >= options.messages:
            first = last
        print(
            f"\r{done:,} messages, {sum(broken.values())} exceptions, {last / 2**20:.0f} MiB",
            end="",
            file=sys.stderr,
            flush=True,
        )
    print(file=sys.stderr)
    growth = last / first
    print(f"seed {options.seed}: {options.messages:,} messages over {', '.join(ADDRESSES)}")
    print("accepted reports:", ", ".join(f"{name} {number:,}" for name, number in sorted(taken.items())))
    print(f"memory: {first / 2**20:.0f} MiB after a tenth, {last / 2**20:.0f} MiB at the end ({growth:.2f})")
    print(f"exceptions: {sum(broken.values())}")
    for kind, number in broken.most_common():
        print(f"  {number} x {kind}")
    return int(bool(broken) or growth > MOST_GROWTH)


if __name__ == "__main__":
    with errors_as_one_line():
        raise SystemExit(main())
