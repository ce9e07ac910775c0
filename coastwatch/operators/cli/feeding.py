"""`feed`: a scenario or a recording to live feeds. It loads no server and, for a recording, no stage."""

from __future__ import annotations

import argparse
import errno
import os
import sys
import threading
from pathlib import Path

from coastwatch.formats.registry import FORMATS
from coastwatch.sensors import SIMULATIONS
from coastwatch.server.feeds.address import parsed
from coastwatch.server.feeds.sending import of_file, of_scenario, send
from coastwatch.server.processes import handled_by
from coastwatch.spelling import printable


def feed(options: argparse.Namespace) -> int:
    """Send a scenario or a recording to live feeds. Ctrl-C stops it: before anything was sent with exit code 130."""
    addresses, now, path = [parsed(text) for text in options.to], False, Path(options.source)
    if path.is_file() and path.suffix != ".toml":
        batches = of_file(path, [address.format for address in addresses])
    elif not path.exists() and (path.suffix or path.name != options.source):  # no name of a scenario has a dot or a slash
        raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), options.source)
    else:
        from coastwatch.scenario import load_scenario  # with all stages, which a recording does not need

        scenario = load_scenario(options.source, dict(options.settings))
        simulated = isinstance(scenario.input, SIMULATIONS)
        now = simulated and options.speed == 1.0
        batches = of_scenario(scenario, scenario.sensors(), [address.format for address in addresses], now=now)
    stop, began = threading.Event(), threading.Event()

    def end(*_: object) -> None:
        if not began.is_set() or stop.is_set():  # a second time it does not wait for what is being sent
            raise KeyboardInterrupt
        stop.set()

    def say(text: str) -> None:
        print(f"coastwatch: {printable(text)}", file=sys.stderr, flush=True)

    with handled_by(end):
        sent = send(batches, addresses, options.speed, stop, now=now, began=began, say=say)
    for address in addresses:
        unit = "datagrams" if FORMATS[address.format].in_datagrams else "lines"
        print(f"sent {sent[address.text]} {unit} to {address.text}")
    return 0
