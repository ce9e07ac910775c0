"""`coastwatch` with a clock that a file shifts: `python -m scaling.load.hold.shifted_clock FILE serve`

The file holds seconds that are added to the time of the machine. It stands for a machine whose clock is set.
"""

from __future__ import annotations

import argparse
import sys
import threading
import time
from contextlib import suppress
from pathlib import Path

from coastwatch.operators.cli import main as coastwatch

LOOK_S = 0.1


def shift(path: Path) -> None:
    """Have `time.time` go by the file from now on."""
    true, shift_s = time.time, [0.0]
    time.time = lambda: true() + shift_s[0]

    def look() -> None:
        while True:
            with suppress(OSError, ValueError):
                shift_s[0] = float(path.read_text("utf-8"))
            time.sleep(LOOK_S)

    threading.Thread(target=look, daemon=True).start()


def main() -> int:
    """Run a command of `coastwatch` with the shifted clock. Returns: its exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("file", type=Path, help="holds the seconds")
    parser.add_argument("words", nargs=argparse.REMAINDER, help="of the command")
    options = parser.parse_args()
    shift(options.file)
    sys.argv = ["coastwatch", *options.words]
    return coastwatch()


if __name__ == "__main__":
    sys.exit(main())
