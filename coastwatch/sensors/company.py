"""Vessels that keep close to others: convoys and passings, made of voyages that were drawn alone."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from coastwatch.batches import Floats, Ints
from coastwatch.geodesy import difference_m, offset_deg
from coastwatch.sensors.vessels import Share
from coastwatch.sensors.voyages import Voyages
from coastwatch.stage import Settings

CONVOYS, PASSINGS = 61, 62  # streams of random numbers: a change of one leaves the others as they are
SHIFTS = 3  # each leaves of the error what two planes differ by over it: 0.5 m after the first, under 1 mm after the third


class Convoys(Settings):
    """Vessels in a line, on one course and at one speed all the time. The first of each sails as it would have alone."""

    share: Share = 0.0  # of the vessels sail in convoys
    ships: Annotated[int, Field(ge=2, le=50)] = 3  # in each
    spacing_from_m: Annotated[float, Field(gt=0.0, le=10_000.0)] = 50.0  # from ship to ship, one draw a convoy, uniform
    spacing_to_m: Annotated[float, Field(gt=0.0, le=10_000.0)] = 150.0  # the most of it
    line: Literal["astern", "abreast", "any"] = "any"  # how the line lies to the first course: along, across, at random

    @model_validator(mode="after")
    def _spacing_has_an_order(self) -> Self:
        if self.spacing_from_m > self.spacing_to_m:
            raise ValueError(f"spacing_from_m: got {self.spacing_from_m}, needed at most spacing_to_m = {self.spacing_to_m}")
        return self


class Passings(Settings):
    """Pairs of vessels that come close once, at a time uniform over the run; the second is where it must be for that."""

    share: Share = 0.0  # of the vessels pass another one, in pairs
    distance_m: Annotated[float, Field(ge=0.0, le=10_000.0)] = 30.0  # between them when they are abreast
    overtaking_share: Share = 0.5  # of the pairs sail the same way, each at its own speed; the others meet head-on


def in_company(convoys: Convoys, passings: Passings, voyages: Voyages, span_s: float, seed: int) -> Voyages:
    """The voyages of a run with its convoys and passings. Vessels in neither sail as before.

    Args: span_s: length of the run. Vessels may leave the area, and its water, for their company.
    """
    count = len(voyages.anchor_deg)
    rng = np.random.default_rng([seed, CONVOYS])
    order = rng.permutation(count)
    number = round(convoys.share * count) // convoys.ships
    in_convoys, free = np.split(order, [number * convoys.ships])
    if number:
        voyages = _lined_up(convoys, voyages, in_convoys.reshape(number, convoys.ships), rng)
    pairs = min(round(passings.share * count), len(free)) // 2
    if pairs:
        voyages = _passing(passings, voyages, free[:pairs], free[pairs : 2 * pairs], span_s, seed)
    return voyages


def _lined_up(convoys: Convoys, voyages: Voyages, ships: Ints, rng: np.random.Generator) -> Voyages:
    """The voyages with convoys. Args: ships: (C, S) rows, the first of each convoy first."""
    spacing = rng.uniform(convoys.spacing_from_m, convoys.spacing_to_m, len(ships))
    velocity = voyages.velocity_m_s[ships[:, 0], 0]
    bearing = np.arctan2(velocity[:, 0], velocity[:, 1])
    turned = {"astern": np.full(len(ships), np.pi), "abreast": np.full(len(ships), 0.5 * np.pi)}
    bearing += turned.get(convoys.line, rng.uniform(0.0, 2.0 * np.pi, len(ships)))
    ahead = spacing[:, None] * np.column_stack([np.sin(bearing), np.cos(bearing)])
    place = np.arange(ships.shape[1])[None, :, None] * ahead[:, None]
    like = np.arange(len(voyages.anchor_deg))
    like[ships] = ships[:, :1]
    rows = {f.name: getattr(voyages, f.name)[like] for f in fields(voyages) if f.name not in ("start_s", "keep", "anchor_deg")}
    anchor = voyages.anchor_deg[like]
    anchor[ships] = offset_deg(anchor[ships], place)
    return replace(voyages, anchor_deg=anchor, **rows)


def _passing(passings: Passings, voyages: Voyages, first: Ints, second: Ints, span_s: float, seed: int) -> Voyages:
    """The voyages with each `second` turned and moved so that it passes its `first`. Args: first, second: (P,) rows."""
    rng = np.random.default_rng([seed, PASSINGS])
    time_s = voyages.start_s + rng.uniform(0.0, span_s, len(first))
    side = np.where(rng.random(len(first)) < 0.5, -1.0, 1.0)
    same_way = rng.permutation(len(first)) < round(passings.overtaking_share * len(first))
    (_, wanted), (_, sailed) = voyages.sailed(first, time_s), voyages.sailed(second, time_s)
    angle = np.arctan2(wanted[:, 1], wanted[:, 0]) - np.arctan2(sailed[:, 1], sailed[:, 0]) + np.where(same_way, 0.0, np.pi)
    voyages = _turned(voyages, second, angle)
    course = wanted / np.maximum(np.hypot(wanted[:, 0], wanted[:, 1]), 1e-9)[:, None]
    abreast = (side * passings.distance_m)[:, None] * np.column_stack([-course[:, 1], course[:, 0]])
    anchor = voyages.anchor_deg.copy()
    anchor[second] = anchor[first]
    for _ in range(SHIFTS):
        voyages = replace(voyages, anchor_deg=anchor)
        (here, _), (there, _) = voyages.sailed(first, time_s), voyages.sailed(second, time_s)
        anchor = anchor.copy()
        anchor[second] = offset_deg(anchor[second], abreast - difference_m(there, here))
    return replace(voyages, anchor_deg=anchor)


def _turned(voyages: Voyages, rows: Ints, angle_rad: Floats) -> Voyages:
    """The voyages with some turned as a whole, east towards north. Args: rows: (P,), angle_rad: (P,)."""
    cos, sin = np.cos(angle_rad)[:, None], np.sin(angle_rad)[:, None]
    out = {}
    for name in ("position_m", "velocity_m_s", "acceleration_m_s2"):
        of_all = getattr(voyages, name).copy()
        east, north = of_all[rows, :, 0], of_all[rows, :, 1]
        of_all[rows] = np.stack([cos * east - sin * north, sin * east + cos * north], axis=2)
        out[name] = of_all
    return replace(voyages, **out)
