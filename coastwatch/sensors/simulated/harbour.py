"""What a harbour has besides vessels on free courses: lanes, anchorages, moored rows, and things that stand and give echoes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from typing import Annotated, Any, Self

import numpy as np
from pydantic import Field, model_validator

from coastwatch.batches import Floats, Ints
from coastwatch.errors import InputError
from coastwatch.geodesy import KNOT_M_S, NAUTICAL_MILE_M, earth_centred, offset_deg, scale_m_deg, wrap_deg
from coastwatch.sensors.simulated.trajectories import PiecewiseMotion, VesselMotion
from coastwatch.stage import Latitude, Longitude, Settings, Share

HARBOUR, STANDING = 63, 64  # streams of random numbers: a change of one does not change the others
SWAYS = 12  # of a vessel to the sides, on one way along its lane
BERTH_M = 70.0  # between berths of an anchorage
BERTHS = 13  # in a line of them
APART_M = 69.0  # at least, between vessels of anchorages: a little less than between berths
TRIES = 100  # draws of places before anchorages are refused as too small
CLUSTER_ECHOES, CLUSTER_M = 5, 120.0  # standing echoes of a cluster and their standard deviation about its middle, per axis


class Row(Settings):
    """Things in a strip: vessels that are moored, or standing echoes. They are spread evenly over it."""

    latitude_deg: Latitude  # of the middle
    longitude_deg: Longitude  # of the middle
    count: Annotated[int, Field(ge=1, le=10_000)]  # number of things
    bearing_deg: Annotated[float, Field(ge=0.0, lt=360.0)] = 0.0  # of the strip's length, clockwise from north
    length_m: Annotated[float, Field(ge=0.0, le=50_000.0)] = 300.0  # of the strip
    width_m: Annotated[float, Field(ge=0.0, le=50_000.0)] = 100.0  # of the strip


class Lanes(Settings):
    """Straight lanes with traffic both ways. Vessels keep to the right of the middle and turn back where the lane ends."""

    share: Share = 0.0  # of the vessels that are not moored follow a lane
    count: Annotated[int, Field(ge=1, le=100)] = (
        3  # number of lanes; the middle of each is drawn over the area, its direction at random
    )
    length_nm: Annotated[float, Field(gt=0.0, le=100.0)] = 7.0
    offset_m: Annotated[float, Field(gt=0.0, le=10_000.0)] = 60.0  # from the middle of the lane to the nearest vessel
    spread_m: Annotated[float, Field(ge=0.0, le=10_000.0)] = 60.0  # beyond that: the positive half of a normal distribution
    sway_m: Annotated[float, Field(ge=0.0, le=1000.0)] = 25.0  # standard deviation to the sides, while under way


class Anchorages(Settings):
    """Round anchorages whose vessels lie still, each at a place of its own."""

    share: Share = 0.0  # of the vessels that are not moored lie at anchor
    count: Annotated[int, Field(ge=1, le=100)] = 3  # number of anchorages; the middle of each is drawn over the area
    spread_m: Annotated[float, Field(gt=0.0, le=10_000.0)] = 700.0  # standard deviation about the middle, per axis
    berth_share: Share = 0.4  # of them lie in three lines of berths, 70 m apart, instead


class StandingEchoes(Settings):
    """Things that do not move and give echoes to all radars: quays, rocks, buoys, moored boats. They are nobody with AIS."""

    count: Annotated[int, Field(ge=0, le=100_000)] = 0  # number that is drawn over the area, besides those of `rows`
    clustered_share: Share = 0.6  # of these stand in clusters of five, as along a quay
    rows: tuple[Row, ...] = ()  # more of them
    detection_from: Share = 0.2  # probability that a radar detects one in a turn: one draw each, uniform from this
    detection_to: Share = 1.0  # probability: to this

    @model_validator(mode="after")
    def _detection_has_an_order(self) -> Self:
        if self.detection_from > self.detection_to:
            raise InputError(f"detection_from: got {self.detection_from}, needed at most detection_to = {self.detection_to}")
        return self


class Area(Settings):
    """A rectangle by its middle and its sides."""

    middle_deg: tuple[float, float]
    width_m: float
    height_m: float

    def drawn(self, rng: np.random.Generator, count: int) -> Floats:
        """Positions that are spread evenly over it. (count, 2) deg"""
        draws = rng.uniform(-0.5, 0.5, (count, 2))
        north, _ = scale_m_deg(np.array(self.middle_deg[0]))
        latitude = np.clip(self.middle_deg[0] + draws[:, 0] * self.height_m / north, -85.0, 85.0)
        _, east = scale_m_deg(latitude)
        return np.column_stack([latitude, wrap_deg(self.middle_deg[1] + draws[:, 1] * self.width_m / east)])


def standing(echoes: StandingEchoes, area: Area, seed: int) -> tuple[Floats, Floats]:
    """Positions of the standing echoes, and the probability that a radar detects each in a turn. (E, 2) deg, (E,)"""
    rng = np.random.default_rng([seed, STANDING])
    clusters = round(echoes.clustered_share * echoes.count / CLUSTER_ECHOES)
    spread = CLUSTER_M * rng.standard_normal((clusters * CLUSTER_ECHOES, 2))
    clustered = offset_deg(np.repeat(area.drawn(rng, clusters), CLUSTER_ECHOES, axis=0), spread)
    single = area.drawn(rng, max(echoes.count - len(clustered), 0))
    position = np.concatenate([clustered[: echoes.count], single, in_rows(echoes.rows, rng)])
    return position, rng.uniform(echoes.detection_from, echoes.detection_to, len(position))


def in_rows(rows: Sequence[Row], rng: np.random.Generator) -> Floats:
    """Positions of the things of all rows, row by row. (N, 2) deg"""
    made = [np.zeros((0, 2))]
    for row in rows:
        along, across = rng.uniform(-0.5, 0.5, (2, row.count)) * np.array([[row.length_m], [row.width_m]])
        bearing = np.radians(row.bearing_deg)
        ahead, aside = np.array([np.sin(bearing), np.cos(bearing)]), np.array([np.cos(bearing), -np.sin(bearing)])
        middle = np.tile([row.latitude_deg, row.longitude_deg], (row.count, 1))
        made.append(offset_deg(middle, along[:, None] * ahead + across[:, None] * aside))
    return np.concatenate(made)


def in_harbour(
    lanes: Lanes,
    anchorages: Anchorages,
    moored: Sequence[Row],
    motion: VesselMotion,
    vessels: PiecewiseMotion,
    area: Area,
    span_s: float,
    seed: int,
) -> PiecewiseMotion:
    """The motion of a run with its lanes, anchorages and moored rows. Other vessels keep their motion.

    Args: moored: the first vessels are theirs, row by row; motion: has the speeds in lanes; span_s: length of the run.
    Raises: InputError if there are fewer vessels than moored ones.
    """
    count, fixed = len(vessels.anchor_deg), sum(row.count for row in moored)
    if fixed > count:
        raise InputError(f"input.moored: got {fixed} vessels, needed at most input.count = {count}")
    if lanes.share + anchorages.share > 1.0:
        raise InputError(f"lanes.share + anchorages.share: got {lanes.share} + {anchorages.share}, needed at most 1 in all")
    rng = np.random.default_rng([seed, HARBOUR])
    free = fixed + rng.permutation(count - fixed)
    under_way, rest = np.split(free, [round(lanes.share * len(free))])
    at_anchor = np.sort(rest[: round(anchorages.share * len(free))])
    still = np.concatenate([np.arange(fixed), at_anchor])
    places = np.concatenate([in_rows(moored, rng), _at_anchor(anchorages, area, len(at_anchor), rng)])
    parts = [_at_rest(still, places)] if len(still) else []
    if len(under_way):
        parts.append(_along_lanes(lanes, motion, area, np.sort(under_way), span_s, rng))
    for rows, columns in parts:
        vessels = _with_rows(vessels, rows, columns)
    return vessels


def _at_anchor(anchorages: Anchorages, area: Area, count: int, rng: np.random.Generator) -> Floats:
    """Positions of vessels at anchor, no two nearer than APART_M. (count, 2) deg

    Raises: InputError where so many do not find a place.
    """
    middles, found = area.drawn(rng, anchorages.count), np.zeros((0, 2))
    for _ in range(TRIES):
        left = count - len(found)
        middle = middles[rng.integers(0, anchorages.count, left)]
        berth = BERTH_M * np.column_stack([rng.integers(0, BERTHS, left) - BERTHS // 2, rng.integers(0, 3, left)])
        spread = anchorages.spread_m * rng.standard_normal((left, 2))
        at_berth = rng.random(left) < anchorages.berth_share
        found = np.concatenate([found, offset_deg(middle, np.where(at_berth[:, None], berth, spread))])
        from scipy.spatial import cKDTree

        pairs = cKDTree(earth_centred(found)).query_pairs(APART_M, output_type="ndarray")
        found = np.delete(found, pairs[:, 1], axis=0)
        if len(found) == count:
            return found
    raise InputError(f"input.anchorages: got {count} vessels, needed about {len(found)} at most, or larger or more anchorages")


def _at_rest(rows: Ints, position_deg: Floats) -> tuple[Ints, dict[str, Floats]]:
    """These vessels and the columns of their motion: one piece without velocity."""
    n = len(rows)
    return rows, {
        "anchor_deg": position_deg,
        "break_s": np.zeros((n, 1)),
        "position_m": np.zeros((n, 1, 2)),
        "velocity_m_s": np.zeros((n, 1, 2)),
        "turn_rate_rad_s": np.zeros((n, 1)),
    }


def _along_lanes(
    lanes: Lanes, motion: VesselMotion, area: Area, rows: Ints, span_s: float, rng: np.random.Generator
) -> tuple[Ints, dict[str, Floats]]:
    """These vessels and the columns of their motion: ways along the lane in SWAYS pieces, and half circles at its ends.

    The standard deviation of their kicks is NaN, as no linear model with kicks at known times moves so: they have no physical bound.
    """
    n, length = len(rows), lanes.length_nm * NAUTICAL_MILE_M
    lane = rng.integers(0, lanes.count, n)
    middle, direction = area.drawn(rng, lanes.count)[lane], rng.uniform(0.0, np.pi, lanes.count)[lane]
    direction += np.pi * (rng.random(n) < 0.5)
    speed = (KNOT_M_S * rng.uniform(max(motion.speed_from_kn, 0.1), motion.speed_to_kn, n))[:, None]
    side = (lanes.offset_m + np.abs(lanes.spread_m * rng.standard_normal(n)))[:, None]
    begun = rng.random((n, 1)) * length  # of the first way
    ways = int(np.ceil(span_s * float(speed.max()) / length)) + 2
    left = np.where(np.arange(ways) == 0, length - begun, length)  # of each way
    sway = lanes.sway_m * rng.standard_normal((n, ways, SWAYS + 1)) * (left / length)[:, :, None]
    sway[:, :, [0, -1]] = 0.0
    half_turn_s = np.pi * side / speed
    way_s = left / speed
    start_s = np.cumsum(np.column_stack([np.zeros(n), (way_s + half_turn_s)[:, :-1]]), axis=1)
    piece_s = (way_s / SWAYS)[:, :, None]
    break_s = start_s[:, :, None] + piece_s * np.arange(SWAYS + 1)  # the last piece of a way is the half circle
    along = 0.5 * length - left[:, :, None] * (1.0 - np.arange(SWAYS + 1) / SWAYS)
    across = side[:, :, None] + sway
    across_speed = np.concatenate([np.diff(sway, axis=2) / piece_s, np.zeros((n, ways, 1))], axis=2)
    # In the frame of the way: along it and to its right. The next way goes back, with the frame turned by half a circle.
    back = np.where(np.arange(ways) % 2 == 0, 1.0, -1.0)[None, :, None, None]
    ahead = np.column_stack([np.sin(direction), np.cos(direction)])[:, None, None, :] * back
    right = np.stack([ahead[..., 1], -ahead[..., 0]], axis=-1)
    position = along[..., None] * ahead + across[..., None] * right
    velocity = speed[:, :, None, None] * ahead + across_speed[..., None] * right
    turn_rate = np.zeros((n, ways, SWAYS + 1))
    turn_rate[:, :, -1] = speed / side
    pieces = ways * (SWAYS + 1)
    return rows, {
        "anchor_deg": middle,
        "break_s": break_s.reshape(n, pieces),
        "position_m": position.reshape(n, pieces, 2),
        "velocity_m_s": velocity.reshape(n, pieces, 2),
        "turn_rate_rad_s": turn_rate.reshape(n, pieces),
        "kick_m_s": np.full(n, np.nan),
    }


def _with_rows(vessels: PiecewiseMotion, rows: Ints, columns: dict[str, Floats]) -> PiecewiseMotion:
    """The motion with these columns of some vessels; they are present throughout and have no other breaks."""
    width = max(vessels.break_s.shape[1], columns["break_s"].shape[1])
    made: dict[str, Any] = {f.name: getattr(vessels, f.name) for f in fields(vessels)}
    pieces = {"break_s": np.inf, "position_m": 0.0, "velocity_m_s": 0.0, "turn_rate_rad_s": 0.0, "acceleration_m_s2": 0.0}
    for name, padding in pieces.items():
        former = made[name]
        wide = np.full((len(former), width, *former.shape[2:]), padding)
        wide[:, : former.shape[1]] = former
        wide[rows] = padding
        if name in columns:
            wide[rows, : columns[name].shape[1]] = columns[name]
        made[name] = wide
    for name, value in {
        "anchor_deg": columns["anchor_deg"],
        "appear_s": -np.inf,
        "disappear_s": np.inf,
        "kick_s": np.nan,
        "kick_m_s": columns.get("kick_m_s", vessels.kick_m_s[rows]),
    }.items():
        made[name] = made[name].copy()
        made[name][rows] = value
    return PiecewiseMotion(**made)
