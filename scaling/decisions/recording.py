"""What does a full recording take: bytes a vessel and cycle, and the processor's time of writing and reading it?

    python -m scaling.decisions.recording [SCENARIO [VESSELS]]

The last pictures of a scenario are repeated side by side until there are as many vessels as asked. Every repetition has other low
bits, numbers and MMSI.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np

from coastwatch import store
from coastwatch.batches import Floats, Members, Picture
from coastwatch.operators.cli.arguments import count
from coastwatch.scenario import load_scenario
from coastwatch.server.run import run_scenario
from coastwatch.store.recording import record
from coastwatch.store.schema.database import reading, writing
from coastwatch.store.schema.tables import CYCLE, RECORDING

CYCLES = 6


def seen(scenario: str) -> list[tuple[Picture, Members]]:
    """The last pictures of a scenario."""
    out: list[tuple[Picture, Members]] = []
    with tempfile.TemporaryDirectory() as folder:
        database = f"sqlite:///{Path(folder) / 'run.db'}"
        run_scenario(load_scenario(scenario), database=database, on_cycle=lambda c: out.append((c.picture, c.members)))
    return out[-CYCLES:]


def repeated(made: list[tuple[Picture, Members]], vessels: int) -> list[tuple[Picture, Members]]:
    """The vessels that are in all of some cycles, side by side many times."""
    some = made[-CYCLES:]
    stay = set.intersection(*(set(picture.vessel_id.tolist()) for picture, _ in some))
    times = -(-vessels // len(stay))
    most = times * len(stay)
    rng = np.random.default_rng(1)
    fixed = {
        "vessel_id": np.arange(1, most + 1),
        "since_s": 1.7e9 + rng.uniform(0.0, 1e5, most),
        "mmsi": np.where(rng.random(most) < 0.5, -1, rng.integers(200_000_000, 800_000_000, most)),
    }
    moved = np.repeat(rng.uniform(-3.0, 3.0, (times, 2)), len(stay), axis=0)
    row = np.repeat(np.arange(most), 1 + (fixed["mmsi"] >= 0))
    members = Members(row + 1, rng.integers(0, 10 * most, len(row)), np.arange(len(row)) % 7)
    out = []
    for picture, _ in some:
        one = Picture.join([picture.take(np.isin(picture.vessel_id, list(stay)))] * times)
        covariance = _stirred(rng, one.covariance, 30)
        covariance = 0.5 * (covariance + covariance.transpose(0, 2, 1))
        rest = (one.flags, one.origin)
        place, velocity = _stirred(rng, one.position_deg + moved, 20), _stirred(rng, one.velocity_m_s, 30)
        when = one.time_s, place, velocity, covariance, fixed["since_s"], _stirred(rng, one.updated_s, 8), fixed["mmsi"]
        out.append((Picture(fixed["vessel_id"], *when, *rest), members))
    return out


def _stirred(rng: np.random.Generator, values: Floats, bits: int) -> Floats:
    words = np.ascontiguousarray(values).view(np.uint64) ^ rng.integers(0, 1 << bits, values.shape, dtype=np.uint64)
    return words.view(np.float64)


def times(made: list[tuple[Picture, Members]], folder: str) -> None:
    """Print what each cycle took."""
    with store.open_store(str(Path(folder) / "recording.db")) as kept:
        world = load_scenario("guanabara")
        run = store.begin_run(
            kept, scenario="x", title="x", seed=1, version="0", settings={}, sensors=world.sensors(), plan=world.plan()
        )
        for number, (picture, members) in enumerate(made):
            empty = dict.fromkeys(("tracks", "pairs", "bearing_pairs", "reports", "history_points"), 0)
            flags = {"picture_kept": False, "associations_kept": False, "recorded": True}
            cycle = {"run_id": run, "number": number, "time_s": float(number), "vessels": len(picture), **empty, **flags}
            begun = time.process_time()
            with writing(kept) as connection:
                connection.execute(CYCLE.insert(), [cycle])
                record(connection, run, number, picture, members)
            written = time.process_time()
            list(store.replay(kept, run, float(number), float(number)))
            print(f"  written {1e3 * (written - begun):.0f} ms, read {1e3 * (time.process_time() - written):.0f} ms")
        columns = [column.name for column in RECORDING.columns][4:]
        sizes = ", ".join(f"sum(length({name})) * 1.0 / sum(vessels) AS {name}" for name in columns)
        with reading(kept) as connection:
            row = connection.exec_driver_sql(f"SELECT {sizes} FROM recording").one()
        each = ", ".join(f"{name} {size:.1f}" for name, size in zip(columns, row, strict=True))
        print(f"  bytes a vessel: {sum(row):.1f}: {each}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenario", nargs="?", default="guanabara", help="default: guanabara")
    parser.add_argument("vessels", nargs="?", type=count, default=267_000, help="default: 267,000")
    asked = parser.parse_args()
    side_by_side = repeated(seen(asked.scenario), asked.vessels)
    print(f"{len(side_by_side[0][0])} vessels like {asked.scenario}:")
    with tempfile.TemporaryDirectory() as folder:
        times(side_by_side, folder)


if __name__ == "__main__":
    main()
