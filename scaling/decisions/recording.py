"""What does a full recording take: bytes a row by how a row is told, and the processor's time of writing and reading it?

Run: python -m scaling.decisions.recording [SCENARIO [VESSELS]]

The pictures of a scenario are told alone, against the cycle before, and against a key cycle of up to 20 cycles before. For the times
they are repeated side by side until there are as many vessels as asked, every repetition with other low bits, numbers and MMSI.
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from coastwatch import store
from coastwatch.batches import Floats, Members, Picture
from coastwatch.scenario import load_scenario
from coastwatch.server.run import run_scenario
from coastwatch.store import chunks
from coastwatch.store.chunks_codec import compressor, packed
from coastwatch.store.opening import writing
from coastwatch.store.tables import Base

CYCLES = 60
NONE = np.zeros(0, np.int64)


def seen(scenario: str) -> list[tuple[Picture, Members]]:
    """The last pictures of a scenario."""
    out: list[tuple[Picture, Members]] = []
    with tempfile.TemporaryDirectory() as folder:
        database = f"sqlite:///{Path(folder) / 'run.db'}"
        run_scenario(load_scenario(scenario), database=database, on_cycle=lambda c: out.append((c.picture, c.members)))
    return out[-CYCLES:]


def bytes_a_row(made: list[tuple[Picture, Members]]) -> dict[str, float]:
    """Of all cycles but the first key cycle."""
    size, rows, press = {"alone": 0, "against the cycle before": 0, "against a key cycle": 0}, 0, compressor()
    last = key = None
    for number, (picture, members) in enumerate(made):
        columns = chunks._columns(picture, members)
        part = chunks._part(columns, np.arange(len(picture)))
        if key is not None:
            size["alone"] += len(packed(part, None, NONE, NONE, press))
            for name, known in (("against the cycle before", last), ("against a key cycle", key)):
                told = chunks._against(columns, known, picture.vessel_id, press)
                fresh = chunks._fresh(picture.vessel_id, known)
                size[name] += sum(len(data) for *_, data in told)
                size[name] += len(packed(chunks._part(columns, fresh), None, NONE, NONE, press)) if len(fresh) else 0
            rows += len(picture)
        last = chunks._key(number, (part,))
        key = last if key is None or number % chunks.KEY_EVERY == 0 else key
    return {name: total / max(rows, 1) for name, total in size.items()}


def repeated(made: list[tuple[Picture, Members]], vessels: int) -> list[tuple[Picture, Members]]:
    """The vessels that are in all of some cycles, side by side many times."""
    some = made[-6:]
    stay = set.intersection(*(set(picture.vessel_id.tolist()) for picture, _ in some))
    times = -(-vessels // len(stay))
    count = times * len(stay)
    rng = np.random.default_rng(1)
    fixed = {
        "vessel_id": np.arange(1, count + 1),
        "since_s": 1.7e9 + rng.uniform(0.0, 1e5, count),
        "mmsi": np.where(rng.random(count) < 0.5, -1, rng.integers(2e8, 8e8, count)),
    }
    moved = np.repeat(rng.uniform(-3.0, 3.0, (times, 2)), len(stay), axis=0)
    row = np.repeat(np.arange(count), 1 + (fixed["mmsi"] >= 0))
    members = Members(row + 1, rng.integers(0, 10 * count, len(row)), np.arange(len(row)) % 7)
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
    """One line a cycle that is written, one a cycle that is read."""
    with store.open_store(str(Path(folder) / "recording.db")) as kept:
        world = load_scenario("guanabara")
        run = store.begin_run(
            kept, scenario="x", title="x", seed=1, version="0", settings={}, sensors=world.sensors(), plan=world.plan()
        )
        key, insert = None, chunks._store
        for number, (picture, members) in enumerate(made, chunks.KEY_EVERY - 1):
            empty = dict.fromkeys(("tracks", "pairs", "bearing_pairs", "reports", "history_points"), 0)
            flags = dict.fromkeys(("picture_kept", "associations_kept"), False)
            cycle = {"run_id": run, "number": number, "time_s": float(number), "vessels": len(picture), **empty, **flags}
            begun, told = time.process_time(), []
            with writing(kept) as connection:
                connection.execute(Base.metadata.tables["cycle"].insert(), [cycle])

                def timed(*given: object, told: list[float] = told) -> None:
                    told.append(time.process_time())
                    insert(*given)  # type: ignore[arg-type]

                chunks._store = timed
                key = chunks.record(connection, run, number, picture, members, key)
                chunks._store = insert
            ended = time.process_time()
            kind = "key" if key.cycle == number else "told against a key"
            print(f"  {kind:<20} encoded {1e3 * (told[0] - begun):5.0f} ms, written {1e3 * (ended - told[0]):5.0f} ms")
        for number in (chunks.KEY_EVERY, chunks.KEY_EVERY + 4):
            begun = time.process_time()
            store.recorded_at(kept, run, float(number))
            print(f"  cycle {number} read: {1e3 * (time.process_time() - begun):.0f} ms")


def main(scenario: str, vessels: int) -> None:
    made = seen(scenario)
    told = ", ".join(f"{name} {size:.0f}" for name, size in bytes_a_row(made).items())
    print(f"{scenario}: {len(made[-1][0])} vessels; bytes a row and its members: {told}")
    side_by_side = repeated(made, vessels)
    print(f"{len(side_by_side[0][0])} vessels, of the processor:")
    with tempfile.TemporaryDirectory() as folder:
        times(side_by_side, folder)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "context-driven-1000", int(sys.argv[2]) if len(sys.argv) > 2 else 267_000)
