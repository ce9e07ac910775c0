"""A recording over live sockets, AIS over TCP and radars as ASTERIX, against the same data read from files:

    python -m scaling.load.replayed [--scenario solent] [--minutes 60] [--speed 60] [--json]

The live run has `--clock feeds`. Its pictures are compared cycle by cycle, bit by bit, with those of a run on the files.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from dataclasses import fields
from datetime import UTC, datetime
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from coastwatch import store
from coastwatch.batches import Picture, RadarReports, Reports
from coastwatch.formats.asterix.decoder import AsterixDecoder
from coastwatch.formats.registry import FORMATS
from coastwatch.kernels.tables.lookup import find
from coastwatch.operators.cli.arguments import count
from coastwatch.scenario import Scenario, load_scenario
from coastwatch.sensors import Tables
from coastwatch.server.feeds.address import Address, parsed
from coastwatch.server.feeds.live_input import LiveInput
from coastwatch.server.feeds.sending import Batch, encoded, send
from coastwatch.server.live import LiveRun
from coastwatch.server.run import run_scenario
from coastwatch.server.timing import date_utc, machine

STEP_S, LATENESS_S, PATIENCE_S = 0.2, 2.0, 900.0
AIS, RADAR = "ais+tcp://127.0.0.1:1", "asterix+udp://127.0.0.1:1"


def recorded(name: str, minutes: int) -> tuple[Scenario, Reports, int]:
    """A scenario that begins where a live run of its reports does, these reports, and its cycles."""
    scenario = load_scenario(name, {"store.recording": "true", "store.overlap": "true"})
    plan = scenario.plan()
    cycles = min(plan.cycles, int(minutes * 60.0 / plan.period_s))
    found = scenario.input.load(scenario.sensors(), scenario.seed, plan).whole()
    stop_s = plan.instant_s(cycles - 1) + LATENESS_S + 2.0 * plan.period_s  # so that the last cycle does not wait
    reports = found.between(plan.start_s, stop_s)
    first_s = min(float(times.min()) for times in (reports.ais.received_s, reports.radar.time_s) if len(times))
    start = datetime.fromtimestamp(math.floor(first_s) - 1.0, UTC)
    return scenario.model_copy(update={"start_utc": start, "cycles": cycles, "warmup_s": 0.0}), reports, cycles


def batches(scenario: Scenario, reports: Reports) -> list[tuple[float, list[bytes], list[bytes]]]:
    """What is sent up to an instant: AIS lines and ASTERIX datagrams."""
    sensors = scenario.sensors()
    times = np.concatenate([reports.ais.received_s, reports.radar.received_s])
    out = []
    for after_s, until_s in pairwise(np.arange(math.floor(times.min()) - STEP_S, times.max() + 2 * STEP_S, STEP_S).tolist()):
        part = reports.between(after_s, until_s)
        if len(part):
            out.append((until_s, *(encoded(part, parsed(to), sensors) for to in (AIS, RADAR))))
    return out


def files(scenario: Scenario, sent: list[tuple[float, list[bytes], list[bytes]]], folder: Path) -> Scenario:
    """The scenario on files of the same lines and plots."""
    (folder / "ais.nmea").write_bytes(b"".join(line + b"\r\n" for _, lines, _ in sent for line in lines))
    decoder = AsterixDecoder(parsed(RADAR).settings(True), scenario.sensors())
    for until_s, _, datagrams in sent:
        decoder.decode([(until_s, datagram, 0) for datagram in datagrams], until_s)
    plots: RadarReports = decoder.reports_between(-math.inf, math.inf).radar
    name = scenario.sensors().radars.name[plots.sensor]
    columns = {"time": plots.time_s, "radar": name.astype(object), "range_m": plots.range_m, "azimuth": plots.azimuth_deg}
    pl.DataFrame(columns).write_parquet(folder / "plots.parquet")
    return scenario.model_copy(update={"input": Tables(nmea=(folder / "ais.nmea",), plots=(folder / "plots.parquet",))})


def live(scenario: Scenario, sent: list[tuple[float, list[bytes], list[bytes]]], cycles: int, speed: float, url: str) -> Any:
    """Run on sockets. Returns: the counters of the feeds, seconds it took, and how long the last cycle was after the last report."""
    feeds = [parsed("ais+listen://127.0.0.1:0"), parsed("asterix+udp://127.0.0.1:0")]
    source = LiveInput(feeds, scenario.sensors(), clock="feeds", lateness_s=LATENESS_S)
    run = LiveRun(scenario, source, lambda picture: None, database=url, resume=False)
    with source, run:
        ports = source.ports
        to = [parsed(AIS.replace(":1", f":{ports[0]}")), parsed(RADAR.replace("1:1", f"1:{ports[1]}"))]
        while run.error() != "waiting for the first cycle" and not run.ended:
            time.sleep(0.05)
        begun = time.monotonic()
        send(_as_batches(sent), to, speed, threading.Event())
        ended = time.monotonic()
        while run.cycles < cycles and not run.ended and time.monotonic() - ended < PATIENCE_S:
            time.sleep(0.02)
        behind_s = time.monotonic() - ended
        counters = source.feeds()
    if run.failed:
        raise RuntimeError(run.error())
    return counters, ended - begun, behind_s


def _as_batches(sent: list[tuple[float, list[bytes], list[bytes]]]) -> Iterator[Batch]:
    for until_s, lines, datagrams in sent:

        def encode(address: Address, lines: list[bytes] = lines, datagrams: list[bytes] = datagrams) -> list[bytes]:
            return datagrams if FORMATS[address.format].in_datagrams else lines

        yield until_s, encode


def differences(one: str, other: str, cycles: int) -> dict[str, Any]:
    """How the recorded pictures of two databases differ: cycles equal to the bit, vessels in one only, the largest distance."""
    out: dict[str, Any] = {
        "cycles": 0,
        "equal_cycles": 0,
        "vessels": 0,
        "vessels_in_one": 0,
        "vessels_elsewhere": 0,
        "largest_m": 0.0,
    }
    with store.open_store(one) as first, store.open_store(other) as second:
        for a, b in zip(*(store.replay(s, 1) for s in (first, second)), strict=False):
            if a.cycle >= cycles:
                break
            same = all(
                _same(getattr(a.picture, f.name), getattr(b.picture, f.name)) for f in fields(Picture) if f.name != "origin"
            )
            out["cycles"] += 1
            out["equal_cycles"] += same and all(
                _same(getattr(a.members, f), getattr(b.members, f)) for f in ("vessel_id", "source")
            )
            out["vessels"] += len(a.picture)
            at = find(b.picture.vessel_id, a.picture.vessel_id)
            out["vessels_in_one"] += int((at < 0).sum()) + len(b.picture) - int((at >= 0).sum())
            apart = (a.picture.position_deg[at >= 0] - b.picture.position_deg[at[at >= 0]]) * 111_195.0
            apart_m = np.hypot(apart[:, 0], apart[:, 1])
            out["vessels_elsewhere"] += int((apart_m > 0.0).sum())
            out["largest_m"] = max(out["largest_m"], float(apart_m.max(initial=0.0)))
    return out


def _same(one: Any, other: Any) -> bool:
    return bool(np.array_equal(one, other, equal_nan=one.dtype.kind == "f"))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenario", default="solent")
    parser.add_argument("--minutes", type=count, default=60, help="of the recording (default: 60)")
    parser.add_argument("--speed", type=float, default=60.0, help="times as fast as recorded (default: 60)")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    try:
        scenario, reports, cycles = recorded(options.scenario, options.minutes)
    except FileNotFoundError as error:
        print(f"skipped: {error}", file=sys.stderr)
        return
    sent = batches(scenario, reports)
    with tempfile.TemporaryDirectory() as folder:
        urls = [f"sqlite:///{folder}/{name}.db" for name in ("files", "live")]
        print(f"{cycles} cycles, {len(reports.ais)} AIS reports, {len(reports.radar)} plots", file=sys.stderr, flush=True)
        on_files = files(scenario, sent, Path(folder))
        run_scenario(on_files, database=urls[0])
        counters, send_s, behind_s = live(scenario, sent, cycles, options.speed, urls[1])
        found = {
            "date": date_utc(),
            "machine": machine(),
            "scenario": options.scenario,
            "minutes": cycles * scenario.period_s / 60.0,
            "speed_asked": options.speed,
            "speed": cycles * scenario.period_s / send_s,
            "behind_s": behind_s,
            **differences(urls[0], urls[1], cycles),
            "feeds": [
                {key: one[key] for key in ("name", "received", "records", "refused", "late", "dropped")} for one in counters
            ],
        }
    if options.json:
        print(json.dumps(found))
    else:
        for name, value in found.items():
            print(f"{name:18} {value}")


if __name__ == "__main__":
    main()
