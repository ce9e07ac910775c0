"""A sea with a past: vessels that sail, turn, come, go and (where asked) jump, around places of which one is on the antimeridian."""

from __future__ import annotations

from typing import Any

import numpy as np
import store_world as world

from coastwatch.batches import Picture
from coastwatch.geodesy import offset_deg
from coastwatch.scenario import StoreSettings
from coastwatch.store import Store

PLACES = np.array([[-22.9, -43.2], [0.0, 180.0], [60.0, 10.0]])
BOXES = (
    (-22.92, -43.22, -22.89, -43.19),
    (-0.02, 179.985, 0.01, -179.98),
    (59.99, 9.98, 60.02, 10.01),
    (10.0, 10.0, 11.0, 11.0),
)
KEEP = StoreSettings(history_max_s=30.0, recording=False)


def pictures(seed: int, cycles: int, vessels: int = 60, jumps: float = 0.0) -> list[Picture]:
    """Args: jumps: part of the vessels that is somewhere else after a cycle."""
    rng = np.random.default_rng([seed, 81])
    home = rng.integers(0, len(PLACES), vessels)
    place = offset_deg(PLACES[home], rng.normal(0.0, 1500.0, (vessels, 2)))
    velocity = rng.normal(0.0, 6.0, (vessels, 2)) * (rng.random((vessels, 1)) < 0.7)
    there = rng.random(vessels) < 0.8
    made = []
    for number in range(cycles):
        turns = rng.random(vessels) < 0.05
        velocity = np.where(turns[:, None], rng.normal(0.0, 6.0, (vessels, 2)), velocity)
        place = offset_deg(place, velocity * world.PERIOD_S)
        off = rng.random(vessels) < jumps
        place = np.where(
            off[:, None],
            offset_deg(PLACES[rng.integers(0, len(PLACES), vessels)], rng.normal(0.0, 3000.0, (vessels, 2))),
            place,
        )
        there = there ^ (rng.random(vessels) < 0.03)
        k = np.flatnonzero(there)
        made.append(picture(k, place[k], velocity[k], world.instant_s(number)))
    return made


def picture(k: np.ndarray, place: np.ndarray, velocity: np.ndarray, time_s: float) -> Picture:
    """Vessels k + 1, all heard at this time. Args: place: (V, 2) degrees; velocity: (V, 2) m/s east and north."""
    n = len(k)
    seen, covariance = np.full(n, time_s), np.broadcast_to(np.eye(4), (n, 4, 4)).copy()
    mmsi = np.where(k % 2 == 1, 710_000_000 + k, -1)
    return Picture(k + 1, seen, place, velocity, covariance, seen, seen, mmsi, np.zeros(n, np.int64), np.full(n, -1))


def write(store: Store, run: int, made: list[Picture], first: int = 0, keep: StoreSettings = KEEP, **more: Any) -> None:
    """Write pictures as the cycles from a number on."""
    for number, picture in enumerate(made, first):
        world.write(store, run, number, cycle=world.cycle_of(number, 0, picture), keep=keep, **more)
