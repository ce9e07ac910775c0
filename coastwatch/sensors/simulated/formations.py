"""Vessels close to each other: convoys and close passings, made from vessels whose motion was drawn independently."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from coastwatch.batches import Floats, Ints
from coastwatch.errors import InputError
from coastwatch.geodesy import difference_m, offset_deg
from coastwatch.sensors.simulated.trajectories import PiecewiseMotion
from coastwatch.stage import Settings, Share

CONVOYS, PASSINGS = 61, 62  # streams of random numbers: a change of one does not change the others
SHIFTS = 3  # iterations; two tangent planes differ a little, so 0.5 m remain after the first and under 1 mm after the third


class Convoys(Settings):
    """Vessels in a line with equal course and speed throughout. The first of each keeps its own motion."""

    share: Share = 0.0  # of the vessels are in convoys
    ships: Annotated[int, Field(ge=2, le=50)] = 3  # vessels in each
    spacing_from_m: Annotated[float, Field(gt=0.0, le=10_000.0)] = (
        50.0  # between neighbours, one draw per convoy, uniform from this
    )
    spacing_to_m: Annotated[float, Field(gt=0.0, le=10_000.0)] = 150.0  # to this
    line: Literal["astern", "abreast", "any"] = "any"  # direction of the line: along the first course, across it, or random

    @model_validator(mode="after")
    def _spacing_has_an_order(self) -> Self:
        if self.spacing_from_m > self.spacing_to_m:
            raise InputError(f"spacing_from_m: got {self.spacing_from_m}, needed at most spacing_to_m = {self.spacing_to_m}")
        return self


class Passings(Settings):
    """Pairs of vessels that pass each other closely once, at a random time of the run. The second is moved to meet the first."""

    share: Share = 0.0  # of the vessels are in such pairs
    distance_m: Annotated[float, Field(ge=0.0, le=10_000.0)] = 30.0  # between them when they are abreast
    overtaking_share: Share = 0.5  # of the pairs have the same course and their own speeds; the others meet head-on


def in_formation(convoys: Convoys, passings: Passings, vessels: PiecewiseMotion, span_s: float, seed: int) -> PiecewiseMotion:
    """The motion of a run with its convoys and passings. Vessels in neither keep their motion.

    Args: span_s: length of the run. Vessels that are moved may be outside the area and its water.
    """
    count = len(vessels.anchor_deg)
    rng = np.random.default_rng([seed, CONVOYS])
    order = rng.permutation(count)
    number = round(convoys.share * count) // convoys.ships
    in_convoys, free = np.split(order, [number * convoys.ships])
    if number:
        vessels = _in_line(convoys, vessels, in_convoys.reshape(number, convoys.ships), rng)
    pairs = min(round(passings.share * count), len(free)) // 2
    if pairs:
        vessels = _passing(passings, vessels, free[:pairs], free[pairs : 2 * pairs], span_s, seed)
    return vessels


def _in_line(convoys: Convoys, vessels: PiecewiseMotion, ships: Ints, rng: np.random.Generator) -> PiecewiseMotion:
    """The motion with convoys. Args: ships: (C, S) rows, the first of each convoy first."""
    spacing = rng.uniform(convoys.spacing_from_m, convoys.spacing_to_m, len(ships))
    velocity = vessels.velocity_m_s[ships[:, 0], 0]
    bearing = np.arctan2(velocity[:, 0], velocity[:, 1])
    turned = {"astern": np.full(len(ships), np.pi), "abreast": np.full(len(ships), 0.5 * np.pi)}
    bearing += turned.get(convoys.line, rng.uniform(0.0, 2.0 * np.pi, len(ships)))
    ahead = spacing[:, None] * np.column_stack([np.sin(bearing), np.cos(bearing)])
    place = np.arange(ships.shape[1])[None, :, None] * ahead[:, None]
    like = np.arange(len(vessels.anchor_deg))
    like[ships] = ships[:, :1]
    rows = {f.name: getattr(vessels, f.name)[like] for f in fields(vessels) if f.name not in ("start_s", "keep", "anchor_deg")}
    anchor = vessels.anchor_deg[like]
    anchor[ships] = offset_deg(anchor[ships], place)
    return replace(vessels, anchor_deg=anchor, **rows)


def _passing(
    passings: Passings, vessels: PiecewiseMotion, first: Ints, second: Ints, span_s: float, seed: int
) -> PiecewiseMotion:
    """The motion with each `second` turned and moved so that it passes its `first`. Args: first, second: (P,) rows."""
    rng = np.random.default_rng([seed, PASSINGS])
    time_s = vessels.start_s + rng.uniform(0.0, span_s, len(first))
    side = np.where(rng.random(len(first)) < 0.5, -1.0, 1.0)
    same_way = rng.permutation(len(first)) < round(passings.overtaking_share * len(first))
    (_, wanted), (_, other) = vessels.state_unmasked(first, time_s), vessels.state_unmasked(second, time_s)
    angle = np.arctan2(wanted[:, 1], wanted[:, 0]) - np.arctan2(other[:, 1], other[:, 0]) + np.where(same_way, 0.0, np.pi)
    vessels = _turned(vessels, second, angle)
    course = wanted / np.maximum(np.hypot(wanted[:, 0], wanted[:, 1]), 1e-9)[:, None]
    abreast = (side * passings.distance_m)[:, None] * np.column_stack([-course[:, 1], course[:, 0]])
    anchor = vessels.anchor_deg.copy()
    anchor[second] = anchor[first]
    for _ in range(SHIFTS):
        vessels = replace(vessels, anchor_deg=anchor)
        (here, _), (there, _) = vessels.state_unmasked(first, time_s), vessels.state_unmasked(second, time_s)
        anchor = anchor.copy()
        anchor[second] = offset_deg(anchor[second], abreast - difference_m(there, here))
    return replace(vessels, anchor_deg=anchor)


def _turned(vessels: PiecewiseMotion, rows: Ints, angle_rad: Floats) -> PiecewiseMotion:
    """The motion with some vessels rotated from east towards north. Args: rows: (P,); angle_rad: (P,)."""
    cos, sin = np.cos(angle_rad)[:, None], np.sin(angle_rad)[:, None]
    out = {}
    for name in ("position_m", "velocity_m_s", "acceleration_m_s2"):
        of_all = getattr(vessels, name).copy()
        east, north = of_all[rows, :, 0], of_all[rows, :, 1]
        of_all[rows] = np.stack([cos * east - sin * north, sin * east + cos * north], axis=2)
        out[name] = of_all
    return replace(vessels, **out)
