"""Tracks of a radar as TTM sentences over TCP, from any machine: `python -m scaling.load.hold.targets 127.0.0.1 10110`"""

from __future__ import annotations

import argparse
import math
import socket
import time
from functools import reduce
from operator import xor

TARGETS, TURN_S, SPEED_KN, RANGE_NM, AGAIN_S = 40, 3.0, 8.0, 4.0, 0.5
CIRCLE_NM = 0.4


def sentence(number: int, time_s: float) -> bytes:
    """The state of a target that goes round in a circle. Args: number: from 1 on; time_s: Unix time."""
    bearing = 2.0 * math.pi * number / TARGETS
    turn = time_s * SPEED_KN / 3600.0 / CIRCLE_NM + number
    east = RANGE_NM * math.sin(bearing) + CIRCLE_NM * math.sin(turn)
    north = RANGE_NM * math.cos(bearing) + CIRCLE_NM * math.cos(turn)
    course = math.degrees(math.atan2(math.cos(turn), -math.sin(turn))) % 360.0
    seen = f"{math.hypot(east, north):.3f},{math.degrees(math.atan2(east, north)) % 360.0:.2f},T"
    clock = time.strftime("%H%M%S", time.gmtime(time_s)) + f".{int(time_s % 1.0 * 100):02d}"
    body = f"RATTM,{number:02d},{seen},{SPEED_KN:.1f},{course:.1f},T,0.0,0.0,N,,T,,{clock},A"
    return b"$%s*%02X\r\n" % (body.encode(), reduce(xor, body.encode(), 0))


def main() -> None:
    """Send for ever; connect again where the connection is lost."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("host")
    parser.add_argument("port", type=int)
    options = parser.parse_args()
    while True:
        try:
            with socket.create_connection((options.host, options.port), timeout=5.0) as out:
                while True:
                    now_s = time.time()
                    out.sendall(b"".join(sentence(k, now_s) for k in range(1, TARGETS + 1)))
                    time.sleep(TURN_S - now_s % TURN_S)
        except OSError:
            time.sleep(AGAIN_S)


if __name__ == "__main__":
    main()
