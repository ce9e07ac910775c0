"""Names, ship types and sizes that simulated vessels send: invented, equal for equal seeds."""

from __future__ import annotations

import numpy as np

from coastwatch.batches import AisStatics, Array, Floats, Ints
from coastwatch.sensors.simulated.ais import AisTruth, Transponders

WHO, WHEN, WHAT, LIES = 31, 32, 33, 34  # streams of random numbers
FIRST_WORDS = "AMBER BOLD CALM CORAL DAWN EAST GOLDEN GRAND IVORY LONE NORTH NOBLE QUIET SILVER SWIFT WILD"
LAST_WORDS = "ALBATROSS BRIGHT CURRENT DOLPHIN EAGLE FORTUNE GULL HARBOUR HORIZON ISLAND PEARL SPIRIT STAR TIDE WAVE WIND"
FIRST, LAST = np.array(FIRST_WORDS.split()), np.array(LAST_WORDS.split())
LETTERS = np.array(list("ABCDEFGHIJKLMNOPQRSTUVWXYZ"))
# ITU-R M.1371 ship type, its share, smallest and largest length in metres.
TYPES = np.array(
    [
        (30, 0.20, 10.0, 45.0),  # fishing
        (36, 0.08, 8.0, 20.0),  # sailing
        (37, 0.12, 8.0, 30.0),  # pleasure craft
        (52, 0.10, 20.0, 40.0),  # tug
        (60, 0.10, 20.0, 300.0),  # passenger
        (70, 0.25, 80.0, 400.0),  # cargo
        (80, 0.15, 80.0, 330.0),  # tanker
    ]
)
LENGTH_OVER_BEAM = 6.0


def transmit_static_data(
    truth: AisTruth, senders: Transponders, reports_mmsi: Ints, start_s: float, stop_s: float, seed: int
) -> AisStatics:
    """Static reports in order of arrival: of each transponder one soon after the start, then one per interval.

    Args: reports_mmsi: (M,) of the position reports that were received; vessels that are not among them are out of range.
    """
    mine = ~senders.clone
    mmsi, silent = senders.mmsi[mine], senders.silent[mine]
    count = len(mmsi)
    name, call_sign, kind, length = _drawn(count, seed)
    first = np.random.default_rng([seed, WHEN]).random(count) * truth.static_within_s
    times = (
        start_s + first[:, None] + truth.static_interval_s * np.arange(int((stop_s - start_s) / truth.static_interval_s) + 1)
    )
    until = np.inf if truth.silent_to_s is None else truth.silent_to_s
    quiet = silent[:, None] & (times - start_s >= truth.silent_from_s) & (times - start_s < until)
    row, sent = np.nonzero((times <= stop_s) & ~quiet & np.isin(mmsi, reports_mmsi)[:, None])
    made = AisStatics(
        received_s=times[row, sent],
        mmsi=mmsi[row],
        name=name[row],
        call_sign=call_sign[row],
        ship_type=_sent_types(truth, TYPES[kind, 0].astype(np.int64), seed)[row],
        length_m=length[row],
        beam_m=np.maximum(np.round(length[row] / LENGTH_OVER_BEAM), 2.0),
    )
    return made.take(np.lexsort((made.mmsi, made.received_s)))


def true_types(senders: Transponders, count: int, seed: int) -> Ints:
    """The true ITU-R M.1371 ship type of the vessels 0..count-1, with and without AIS. Returns: (count,)."""
    mine = ~senders.clone
    kind = np.random.default_rng([seed, WHAT]).choice(len(TYPES), count, p=TYPES[:, 1])
    kind[senders.row[mine]] = _drawn(int(mine.sum()), seed)[2]
    return np.asarray(TYPES[kind, 0], np.int64)


def _drawn(count: int, seed: int) -> tuple[Array, Array, Ints, Floats]:
    """Name, call sign, row of TYPES and length in metres of this many transponders."""
    rng = np.random.default_rng([seed, WHO])
    number = np.arange(count)
    name = _joined(FIRST[rng.integers(0, len(FIRST), count)], " ", LAST[rng.integers(0, len(LAST), count)])
    name = np.where(number < 256, name, _joined(name, " ", (number % 1000).astype("U3"))).astype("U20")
    call = np.ascontiguousarray(LETTERS[rng.integers(0, 26, (count, 4))]).view("U4").ravel() if count else np.zeros(0, "U4")
    call_sign = _joined(call, rng.integers(0, 10, count).astype("U1")).astype("U7")
    kind = rng.choice(len(TYPES), count, p=TYPES[:, 1])
    length = np.round(rng.uniform(TYPES[kind, 2], TYPES[kind, 3]))
    return name, call_sign, kind, length


def _sent_types(truth: AisTruth, ship_type: Ints, seed: int) -> Ints:
    """The ship type that each transponder sends: 0 if it was never set, another if it was set wrong. Args: ship_type: (C,) true."""
    rng = np.random.default_rng([seed, LIES])
    missing, wrong, other = rng.random(len(ship_type)), rng.random(len(ship_type)), rng.choice(len(TYPES), len(ship_type))
    sent = np.where(wrong < truth.type_wrong_share, TYPES[other, 0].astype(np.int64), ship_type)
    return np.where(missing < truth.type_missing_share, 0, sent)


def _joined(*parts: Array | str) -> Array:
    out: Array = np.asarray(parts[0])
    for part in parts[1:]:
        out = np.strings.add(out, part)
    return out
