"""A recorded day of AIS through `coastwatch fuse`: sentences a second of processor, peak memory, share of each stage:

    python -m scaling.load.ais_stream --sentences N [--transponders N] [--feed FILE] [--period S] [--set KEY=VALUE ...]

The baseline of the same run is decoding alone: the same file read to reports and not fused. Both run in processes of their own.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any, NamedTuple

from coastwatch.operators.cli.arguments import count, pair
from coastwatch.server.timing import date_utc, machine
from scaling.load.ais_feed import write_feed

DECODE = """
import sys
from pathlib import Path
from coastwatch.sensors.recorded.nmea.feed import Nmea
feed = Nmea(files=(Path(sys.argv[1]),))
(now_s, stop_s), stream = feed.span(lambda: None, float("-inf"), False), feed.stream()
while now_s < stop_s:
    stream.between(now_s, now_s + 10.0)
    now_s += 10.0
"""
TRANSPONDERS = 1933
KIB = 1024


class Cost(NamedTuple):
    """What a process took."""

    processor_s: float  # user and system, of all its threads
    peak_bytes: int  # largest resident size, with the pages of shared libraries
    printed: str


def main() -> None:
    """Measure and print."""
    options = _options()
    with tempfile.TemporaryDirectory() as folder:
        feed = Path(options.feed or Path(folder) / "feed.nmea")
        if not feed.exists():
            print(f"writing {options.sentences:,} sentences to {feed}", file=sys.stderr)
            write_feed(feed, options.sentences, options.transponders, options.seed)
        with feed.open("rb") as lines:
            sentences = sum(1 for _ in lines)
        database = f"sqlite:///{Path(folder) / 'x.db'}"
        settings = [word for key, value in options.set for word in ("--set", f"{key}={value}")]
        settings += ["--period", str(options.period)] if options.period else []
        decoded = _run([sys.executable, "-c", DECODE, str(feed)])
        fuse = "from coastwatch.operators.cli import main; raise SystemExit(main())"
        fused = _run(
            [sys.executable, "-c", fuse, "fuse", "--ais", str(feed), "--db", database, "--restart", "--json", *settings]
        )
    print("\n".join(report(sentences, decoded, fused)))


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sentences", type=count, default=1_000_000)
    parser.add_argument("--transponders", type=count, default=TRANSPONDERS)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--feed", metavar="FILE", help="a feed to measure; it is written if it does not exist")
    parser.add_argument("--period", type=float, help="of a cycle (default: that of `fuse`)")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", type=pair, help="a setting of the scenario")
    return parser.parse_args()


def _run(command: list[str]) -> Cost:
    """Run a command to its end. Raises: SystemExit if it fails."""
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    printed = process.stdout.read()
    _, status, used = os.wait4(process.pid, 0)  # the cost of this process alone, which subprocess does not give
    process.returncode = os.waitstatus_to_exitcode(status)
    if status:
        raise SystemExit(f"{' '.join(command[3:])}: failed, status {process.returncode}")
    return Cost(used.ru_utime + used.ru_stime, used.ru_maxrss * KIB, printed)


def report(sentences: int, decoded: Cost, fused: Cost) -> list[str]:
    """The figures as lines. Args: fused: what it printed is the JSON of `coastwatch fuse`."""
    said: dict[str, Any] = json.loads(fused.printed)
    m = machine()
    lines = [
        f"# {date_utc()}, {m['processors']} x {m['processor']}, load {m['load']}",
        f"{sentences:,} sentences, {said['cycles']:,} cycles, {said['vessels']:,} vessels in the last picture",
        f"{'':<14}{'processor s':>12}{'sentences/s':>13}{'peak MB':>9}",
    ]
    for name, cost in (("decoding alone", decoded), ("whole fuse", fused)):
        rate = sentences / max(cost.processor_s, math.ulp(1.0))
        lines.append(f"{name:<14}{cost.processor_s:>12.1f}{rate:>13,.0f}{cost.peak_bytes / 1e6:>9.0f}")
    lines += [f"fuse / decoding: {fused.processor_s / decoded.processor_s:.2f}", "share of the stages' time on the wall clock"]
    shares = {stage: times["share"] for stage, times in said["timings_s"].items()}
    lines += [f"  {stage:<20}{100.0 * share:6.1f} %" for stage, share in sorted(shares.items(), key=lambda kv: -kv[1])]
    return lines


if __name__ == "__main__":
    main()
