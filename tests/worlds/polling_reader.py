"""A reader in a process of its own: asks for a box now, then, in a span and for a vessel, again and again, until its input is closed."""

from __future__ import annotations

import json
import sys
import threading

import past_world
import store_world as world

from coastwatch import store as kept


def main(path: str) -> None:
    over = threading.Event()
    threading.Thread(target=lambda: (sys.stdin.read(), over.set()), daemon=True).start()
    looks, torn, newest = 0, 0, set()
    with kept.open_store(path, create=False) as store:
        run = kept.latest_run(store)
        print("ready", flush=True)
        while not over.is_set():
            now = kept.picture(store, run)
            times = set(now.column("time_s"))
            torn += len(times) != 1
            newest |= times
            kept.picture(store, run, max(times), past_world.BOXES[0])
            kept.traffic(store, run, past_world.BOXES[0], world.START_S, max(times))
            kept.history(store, run, vessel_id=now.column("vessel_id")[0])
            looks += 1
    print(json.dumps({"looks": looks, "torn": torn, "cycles": len(newest)}))


if __name__ == "__main__":
    main(sys.argv[1])
