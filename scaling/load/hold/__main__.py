"""One server for hours, with something that must not break it every ten minutes:

    python -m scaling.load.hold --hours 2 [--every 600] [--vessels 3000] [--fuzz 1000000] [--seed 1] [--json]

Feeds: AIS, ASTERIX, JSON lines and TTM, with ten times the vessels of guanabara. After each disturbance it prints what was done, how
long cycles needed to be on time again, which vessels changed their id, and what was lost. Exit code 1: cycles were late for more than
30 s, a vessel was renamed, an alarm was lost or doubled, or memory grew by more than a tenth.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from pathlib import Path

from coastwatch.operators.cli.arguments import count
from coastwatch.server.timing import date_utc, machine
from scaling.load.hold.disturbances import DISTURBANCES, World, in_turn
from scaling.load.hold.senders import HERE_ADDRESS, OtherMachine, end, honest
from scaling.load.hold.server import Server, small_disk
from scaling.load.hold.watching import Watching, alarms_of, runs_of
from scaling.load.hostile import HOST, START_UP_S
from scaling.load.kills import COASTWATCH

WARM_UP_S, SETTLE_S, LONGEST_S, HOUR_S = 150.0, 45.0, 240.0, 3600.0
MOST_LATE_S, MOST_GROWTH = 30.0, 1.1


@dataclass(frozen=True)
class Row:
    """What one disturbance did."""

    name: str
    said: str
    on_time_after_s: float  # after its end
    known: int  # vessels with the MMSI of an honest sender, before
    renamed: int  # of these, those that are another vessel afterwards
    renamed_quiet: int  # the same over as long a time before the disturbance
    merged: int  # cycles
    not_stored: int  # pictures
    alarms_lost: int  # that the stream told, and that the database does not have
    alarms_twice: int  # new ones that overlap one of the same vessel and kind
    memory_mb: float
    memory_ratio: float  # to an hour before, or to the start
    troubles: list[str]

    @property
    def is_right(self) -> bool:
        late = self.on_time_after_s > MOST_LATE_S or self.memory_ratio > MOST_GROWTH
        return not (late or self.alarms_lost or self.alarms_twice or self.renamed > self.renamed_quiet)


def disturb(world: World, watching: Watching, act: Callable[[World], str], begun_s: float, before: tuple[int, float]) -> Row:
    """Do one thing and see what becomes of the server. Args: before: alarms that were there twice; memory at the start, bytes."""
    first = watching.names()
    time.sleep(SETTLE_S)
    names, at_s = watching.names(), time.monotonic()
    quiet = sum(names.get(mmsi, vessel) != vessel for mmsi, vessel in first.items())
    said = act(world)
    over_s = time.monotonic()
    late_s = watching.wait_until_on_time(over_s, LONGEST_S)
    time.sleep(max(over_s + SETTLE_S - time.monotonic(), 0.0))
    later, now_s = watching.names(), time.monotonic()
    told = set(watching.alarms)
    time.sleep(5.0)  # what was told is written by then
    stored, twice = alarms_of(world.server.database)
    memory = watching.memory(now_s - 20.0, now_s)
    hour = watching.memory(now_s - HOUR_S - 60.0, now_s - HOUR_S + 60.0) if now_s - begun_s > HOUR_S else before[1]
    return Row(
        act.__name__,
        said,
        round(late_s, 1),
        len(names),
        sum(later.get(mmsi, vessel) != vessel for mmsi, vessel in names.items()),
        quiet,
        int(watching.difference("cycles_merged", at_s, now_s)),
        int(watching.difference("store_skipped", at_s, now_s)),
        len(told - stored),
        twice - before[0],
        round(memory / 1e6),
        round(memory / hour, 3),
        watching.troubles(at_s, now_s),
    )


def hold(hours: float, every_s: float, vessels: int, fuzz: int, seed: int) -> tuple[list[Row], dict[str, float]]:
    """Hold a server for so long. Returns: a row for each disturbance, and what is there at the end."""
    seconds, rows = hours * HOUR_S, list[Row]()
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        disk, others = folder / "disk", folder / "others"
        disk.mkdir()
        others.mkdir()
        has_small_disk = small_disk(disk, stack)
        radar = OtherMachine.made(stack)
        server = Server(disk, vessels, HERE_ADDRESS if radar else HOST, others)
        made = subprocess.run(
            [COASTWATCH, "token", "add", "hold", "--role", "admin", "--tokens", str(server.tokens)],
            check=True, capture_output=True, text=True,
        )  # fmt: skip
        token = made.stdout.split()[-1]
        stack.enter_context(server)
        if radar is not None:
            radar.power_on(server.ports["ttm"])
            stack.callback(radar.end)
        sender = honest(server, seconds + WARM_UP_S, seed)
        stack.callback(end, sender)
        watching = stack.enter_context(Watching(server, token))
        _wait_for_vessels(watching, vessels)
        time.sleep(WARM_UP_S)
        begun_s = time.monotonic()
        start = watching.memory(begun_s - 20.0, begun_s)
        world = World(server, radar, has_small_disk, max(every_s - 2 * SETTLE_S - 60.0, 60.0), fuzz, seed, token)
        for k, act in enumerate(in_turn()):
            due_s = begun_s + k * every_s
            if due_s + every_s > begun_s + seconds:
                break
            time.sleep(max(due_s - time.monotonic(), 0.0))
            world.count = k
            twice = alarms_of(server.database)[1]
            rows.append(disturb(world, watching, act, begun_s, (twice, start)))
            print(json.dumps(asdict(rows[-1])), file=sys.stderr, flush=True)
            if sender.poll() is not None:
                raise RuntimeError("the honest sender has ended")
        last = watching.looks[-1].counts
        end_of = {
            "runs": runs_of(server.database),
            "server begun": server.begun,
            "questions without an answer": watching.unanswered,
            "alarms": len(watching.alarms),
            "cycles": watching.looks[-1].cycle,
            "events forgotten": last.get("store_forgotten", 0) + last.get("alarms_forgotten", 0),
        }
    return rows, end_of


def _wait_for_vessels(watching: Watching, vessels: int) -> None:
    """Wait until the picture has most of the vessels. Raises: TimeoutError."""
    until_s = time.monotonic() + START_UP_S
    while time.monotonic() < until_s:
        if watching.looks and watching.looks[-1].counts.get("vessels", 0) > 0.5 * vessels:
            return
        time.sleep(1.0)
    raise TimeoutError(f"the picture has {watching.looks[-1].counts.get('vessels') if watching.looks else 'no'} vessels")


def main() -> int:
    """Run, and print the table. Returns: 1 where something was lost."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--hours", type=float, default=2.0, help=f"{len(DISTURBANCES)} disturbances come in turn (default: 2)")
    parser.add_argument("--every", type=float, default=600.0, metavar="S", help="a disturbance so often (default: 600)")
    parser.add_argument("--vessels", type=count, default=3_000)
    parser.add_argument("--fuzz", type=count, default=1_000_000, metavar="N", help="datagrams (default: 1,000,000)")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    rows, end_of = hold(options.hours, options.every, options.vessels, options.fuzz, options.seed)
    right = all(row.is_right for row in rows)
    about = {"date": date_utc(), "machine": machine(), **vars(options)}
    if options.json:
        print(json.dumps(about | {"rows": [asdict(row) for row in rows], "end": end_of, "right": right}))
        return int(not right)
    print(about)
    heads = (
        "disturbance", "on time after s", "renamed", "in quiet", "of", "merged", "not stored", "alarms lost", "twice", "MB", "ratio",
        "right", "done; troubles said",
    )  # fmt: skip
    print("| " + " | ".join(heads) + " |\n|" + "---|" * len(heads))
    for row in rows:
        cells = (
            row.name, row.on_time_after_s, row.renamed, row.renamed_quiet, row.known, row.merged, row.not_stored, row.alarms_lost,
            row.alarms_twice, row.memory_mb, row.memory_ratio, "yes" if row.is_right else "NO",
            f"{row.said}; {', '.join(row.troubles) or 'none'}",
        )  # fmt: skip
        print("| " + " | ".join(str(cell) for cell in cells) + " |")
    for name, value in end_of.items():
        print(f"{name}: {value}")
    return int(not right)


if __name__ == "__main__":
    sys.exit(main())
