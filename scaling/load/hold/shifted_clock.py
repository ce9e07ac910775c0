"""`coastwatch` with a clock that a file shifts: `python -m scaling.load.hold.shifted_clock FILE serve ...`

The file holds seconds that are added to the time of the machine. It stands for a machine whose clock is set.
"""

from __future__ import annotations

import sys
import threading
import time
from contextlib import suppress
from pathlib import Path

from coastwatch.operators.cli import main

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


if __name__ == "__main__":
    shift(Path(sys.argv[1]))
    sys.argv = ["coastwatch", *sys.argv[2:]]
    sys.exit(main())
