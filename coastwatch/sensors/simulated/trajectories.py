"""How simulated vessels move: the settings, one draw of all their motion, and their true state at any time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from coastwatch.batches import Bools, Floats, Ints, Struct, Trajectories, column
from coastwatch.errors import InputError
from coastwatch.geodesy import KNOT_M_S, from_plane, turn
from coastwatch.stage import NotNegative, Positive, Settings, Share

MOTION, KICKS, PRESENCE = 1, 2, 3  # streams of random numbers: a change of one does not change the others
KICK_INTERVAL_S = {"rw60": 60.0, "rw1": 1.0, "ou": 10.0}
# Standard deviation of one kick per axis over fraction * highest speed (for `ou`: of the bounded deviation). Read literally, the
# paper says 1; these values give the physical bounds of the specification's table, see coastwatch/scores/README.md.
KICK_SHARE = {"rw60": 0.2, "rw1": 0.5, "ou": 0.5}
MANOEUVRE_SHARE = 0.15  # of that, for vessels that turn or accelerate: the paper scales their noise by the smaller acceleration


class VesselMotion(Settings):
    """How the vessels move."""

    speed_from_kn: Annotated[float, Field(ge=0.0, le=60.0)] = 0.0  # speeds are uniform from this
    speed_to_kn: Annotated[float, Field(gt=0.0, le=60.0)] = 15.0  # to this, which also scales the process noise
    linear_weight: NotNegative = 1.0  # relative number of vessels on a straight course
    circular_weight: NotNegative = 0.0  # of vessels with a constant turn rate, half to each side
    accelerated_weight: NotNegative = 0.0  # of vessels with a constant acceleration along the course
    turn_rate_from_deg_s: Annotated[float, Field(ge=0.0, le=10.0)] = 0.2  # of circular motion, uniform from this
    turn_rate_to_deg_s: Annotated[float, Field(ge=0.0, le=10.0)] = 0.8  # to this
    acceleration_from_m_s2: Share = 0.005  # of accelerated motion, uniform from this
    acceleration_to_m_s2: Share = 0.03  # to this; less if the speed would leave its range
    process_noise: Literal["rw60", "rw1", "ou", "none"] = "rw60"  # a kick each minute, each second, or a bounded deviation
    process_noise_fraction: Share = 0.1  # f: of the highest speed
    velocity_jump_share: float | None = Field(
        default=None,
        ge=0.0,
        le=10.0,
        description="velocity jump per axis over f * highest speed; none: rw60 0.2, rw1 0.5, ou 0.5",
    )
    ou_time_s: Positive = 300.0  # time constant of the bounded deviation
    stopping_share: Share = 0.0  # vessels that stop during the run
    stopping_s: Positive = 60.0  # duration of braking
    entering_share: Share = 0.0  # vessels that appear only during the run
    leaving_share: Share = 0.0  # vessels that disappear during the run

    @model_validator(mode="after")
    def _ranges_have_an_order(self) -> Self:
        for name, unit in (("speed", "kn"), ("turn_rate", "deg_s"), ("acceleration", "m_s2")):
            low, high = getattr(self, f"{name}_from_{unit}"), getattr(self, f"{name}_to_{unit}")
            if low > high:
                raise InputError(f"{name}_from_{unit}: got {low}, needed at most {name}_to_{unit} = {high}")
        if self.linear_weight + self.circular_weight + self.accelerated_weight <= 0.0:
            raise InputError("linear_weight, circular_weight, accelerated_weight: got 0, needed one above 0")
        return self

    @property
    def keep(self) -> float:
        """Share of the deviation from the mean velocity that remains after a kick; 1: a random walk."""
        return float(np.exp(-KICK_INTERVAL_S["ou"] / self.ou_time_s)) if self.process_noise == "ou" else 1.0

    @property
    def kick_m_s(self) -> float:
        """Standard deviation of a kick, per axis, of vessels on a straight course."""
        if self.process_noise == "none":
            return 0.0
        share = KICK_SHARE[self.process_noise] if self.velocity_jump_share is None else self.velocity_jump_share
        bounded = np.sqrt(1.0 - self.keep**2) if self.process_noise == "ou" else 1.0
        return float(bounded * share * self.process_noise_fraction * self.speed_to_kn * KNOT_M_S)


@dataclass(frozen=True, eq=False)
class PiecewiseMotion(Struct):
    """True motion of V vessels: after each break a constant turn rate and acceleration, in the tangent plane at the anchor.

    Each vessel has B breaks in order of time, the first at the start. Times are seconds after the start, infinite for padding.
    """

    start_s: float
    keep: float  # share of the deviation from the mean velocity that remains after a kick
    anchor_deg: Floats = column(np.float64, "V", 2)
    break_s: Floats = column(np.float64, "V", "B")
    position_m: Floats = column(np.float64, "V", "B", 2)
    velocity_m_s: Floats = column(np.float64, "V", "B", 2)
    turn_rate_rad_s: Floats = column(np.float64, "V", "B")  # positive from east to north
    acceleration_m_s2: Floats = column(np.float64, "V", "B", 2)
    appear_s: Floats = column(np.float64, "V")
    disappear_s: Floats = column(np.float64, "V")
    kick_s: Floats = column(np.float64, "V", "C")  # NaN pads
    kick_m_s: Floats = column(np.float64, "V")  # NaN: the vessel stops or sways in a lane, which no linear model predicts

    def present(self, row: Ints, time_s: Floats) -> Bools:
        """Whether vessels are in the area. Args: row: (M,); time_s: (M,) since the epoch. Returns: (M,)."""
        elapsed = time_s - self.start_s
        return np.asarray((elapsed >= self.appear_s[row]) & (elapsed < self.disappear_s[row]))

    def position(self, row: Ints, time_s: Floats) -> Floats:
        """Latitude and longitude, deg, NaN if absent. Args: row, time_s: (M,). Returns: (M, 2)."""
        metres, _ = self._in_plane(row, time_s)
        metres[~self.present(row, time_s)] = np.nan
        return from_plane(metres, self.anchor_deg[row])

    def state(self, row: Ints, time_s: Floats) -> tuple[Floats, Floats]:
        """Latitude and longitude, deg, NaN if absent, and velocity east and north. Args: row, time_s: (M,). Returns: (M, 2) each."""
        position, velocity = self.state_unmasked(row, time_s)
        position[~self.present(row, time_s)] = np.nan
        return position, velocity

    def state_unmasked(self, row: Ints, time_s: Floats) -> tuple[Floats, Floats]:
        """As `state`, also of vessels that are absent. Args: row, time_s: (M,). Returns: (M, 2), (M, 2)."""
        metres, velocity = self._in_plane(row, time_s)
        position = from_plane(metres, self.anchor_deg[row])
        return position, np.einsum("mji,mj->mi", turn(position, self.anchor_deg[row]), velocity)

    def sampled(self, time_s: Floats) -> Trajectories:
        """The truth at common instants. Args: (T,) increasing."""
        v, t = len(self.anchor_deg), len(time_s)
        row, time = np.repeat(np.arange(v), t), np.tile(time_s, v)
        position, velocity = self.state_unmasked(row, time)
        return Trajectories(
            vessel=np.arange(v),
            time_s=time_s,
            position_deg=position.reshape(v, t, 2),
            velocity_m_s=velocity.reshape(v, t, 2),
            present=self.present(row, time).reshape(v, t),
            kick_s=self.start_s + self.kick_s,
            kick_m_s=self.kick_m_s,
            turn_rate_rad_s=self.turn_rate_rad_s[:, 0],
            acceleration_m_s2=self.acceleration_m_s2[:, 0],
            kick_keep=np.full(v, self.keep),
        )

    def _in_plane(self, row: Ints, time_s: Floats) -> tuple[Floats, Floats]:
        b = self.break_s.shape[1]
        elapsed = time_s - self.start_s
        horizon = 1.0 + max(float(np.max(elapsed, initial=0.0)), 0.0)
        keys = (np.minimum(self.break_s, horizon) + 2.0 * horizon * np.arange(len(self.break_s))[:, None]).ravel()
        wanted = np.clip(elapsed, 0.0, horizon - 0.5) + 2.0 * horizon * row
        piece = np.searchsorted(keys, wanted, side="right") - 1 - b * row
        at = (row, np.maximum(piece, 0))
        span = elapsed - self.break_s[at]
        return advanced(self.position_m[at], self.velocity_m_s[at], self.turn_rate_rad_s[at], self.acceleration_m_s2[at], span)


def advanced(
    position_m: Floats, velocity_m_s: Floats, turn_rate_rad_s: Floats, acceleration_m_s2: Floats, span_s: Floats
) -> tuple[Floats, Floats]:
    """Position and velocity after a time at a constant turn rate or acceleration.

    Args: (M, 2), (M, 2), (M,), (M, 2), (M,). Returns: (M, 2), (M, 2).
    """
    half = 0.5 * turn_rate_rad_s * span_s
    ahead = span_s * np.cos(half) * np.sinc(half / np.pi)
    aside = span_s * np.sin(half) * np.sinc(half / np.pi)
    cos, sin = np.cos(2.0 * half), np.sin(2.0 * half)
    east, north = velocity_m_s[:, 0], velocity_m_s[:, 1]
    moved = np.stack([ahead * east - aside * north, aside * east + ahead * north], axis=1)
    turned = np.stack([cos * east - sin * north, sin * east + cos * north], axis=1)
    span = span_s[:, None]
    return position_m + moved + 0.5 * span * span * acceleration_m_s2, turned + span * acceleration_m_s2


LINEAR, CIRCULAR, ACCELERATED = 0, 1, 2
START, KICK, BRAKE, STAND = 0, 1, 2, 3


def draw_motion(motion: VesselMotion, anchor_deg: Floats, start_s: float, span_s: float, seed: int) -> PiecewiseMotion:
    """The motion of the vessels of one run. Args: anchor_deg: (V, 2) positions at the start; span_s: length of the run."""
    velocity, turn_rate, acceleration, kind = _first_motion(motion, len(anchor_deg), span_s, seed)
    kick_s, draws = _kicks(motion, len(anchor_deg), span_s, seed)
    kick_m_s = np.where(kind == LINEAR, 1.0, MANOEUVRE_SHARE) * motion.kick_m_s
    brake_s, appear_s, disappear_s = _presence(motion, len(anchor_deg), span_s, seed)
    stand_s = brake_s + motion.stopping_s
    times = np.column_stack([np.zeros(len(anchor_deg)), kick_s, brake_s, stand_s])
    codes = np.array([START, *[KICK] * kick_s.shape[1], BRAKE, STAND])
    order = np.argsort(times, axis=1, kind="stable")
    jumps = np.zeros((*times.shape, 2))
    jumps[:, 1:-2] = draws * kick_m_s[:, None, None]
    break_s = np.take_along_axis(times, order, axis=1)
    position, velocities, rates, accelerations = _integrated(
        break_s, codes[order], np.take_along_axis(jumps, order[..., None], axis=1), motion, velocity, turn_rate, acceleration
    )
    return PiecewiseMotion(
        start_s=start_s,
        anchor_deg=anchor_deg,
        break_s=break_s,
        position_m=position,
        velocity_m_s=velocities,
        turn_rate_rad_s=rates,
        acceleration_m_s2=accelerations,
        appear_s=appear_s,
        disappear_s=disappear_s,
        kick_s=np.where(np.isfinite(kick_s), kick_s, np.nan),
        kick_m_s=np.where(np.isfinite(brake_s), np.nan, kick_m_s),
        keep=motion.keep,
    )


def chosen(count: int, share: float, rng: np.random.Generator) -> Ints:
    """Exactly this share of the numbers 0..count-1, rounded, at random, in order."""
    return np.sort(rng.permutation(count)[: round(share * count)])


def _first_motion(motion: VesselMotion, count: int, span_s: float, seed: int) -> tuple[Floats, Floats, Floats, Ints]:
    rng = np.random.default_rng([seed, MOTION])
    speed = rng.uniform(motion.speed_from_kn, motion.speed_to_kn, count) * KNOT_M_S
    course = rng.uniform(0.0, 2.0 * np.pi, count)
    ahead = np.column_stack([np.sin(course), np.cos(course)])
    weights = np.array([motion.linear_weight, motion.circular_weight, motion.accelerated_weight])
    edges = np.round(np.cumsum(weights) / weights.sum() * count)
    kind = np.empty(count, np.int64)
    kind[rng.permutation(count)] = np.searchsorted(edges, np.arange(count), side="right")
    side = np.where(rng.permutation(count) % 2 == 0, 1.0, -1.0)
    rate = np.radians(rng.uniform(motion.turn_rate_from_deg_s, motion.turn_rate_to_deg_s, count)) * side
    gain = rng.uniform(motion.acceleration_from_m_s2, motion.acceleration_to_m_s2, count)
    low, high = motion.speed_from_kn * KNOT_M_S, motion.speed_to_kn * KNOT_M_S
    upward = high - speed > speed - low
    room = np.where(upward, high - speed, speed - low) / max(span_s, 1.0)
    gain = np.where(upward, 1.0, -1.0) * np.minimum(gain, room)
    acceleration = np.where(kind == ACCELERATED, gain, 0.0)[:, None] * ahead
    return speed[:, None] * ahead, np.where(kind == CIRCULAR, rate, 0.0), acceleration, kind


def _kicks(motion: VesselMotion, count: int, span_s: float, seed: int) -> tuple[Floats, Floats]:
    """Times of the kicks of each vessel, infinite after the run, and standard normal draws. (V, C), (V, C, 2)"""
    if motion.process_noise == "none":
        return np.zeros((count, 0)), np.zeros((count, 0, 2))
    rng = np.random.default_rng([seed, KICKS])
    interval = KICK_INTERVAL_S[motion.process_noise]
    number = np.arange(int(np.ceil(span_s / interval)))
    times = (rng.random((count, 1)) + number) * interval
    return np.where(times < span_s, times, np.inf), rng.standard_normal((count, len(number), 2))


def _presence(motion: VesselMotion, count: int, span_s: float, seed: int) -> tuple[Floats, Floats, Floats]:
    """When each vessel brakes, appears and disappears, in seconds after the start; infinite: never. Each (V,)."""
    rng = np.random.default_rng([seed, PRESENCE])
    out = []
    for share, otherwise in ((motion.stopping_share, np.inf), (motion.entering_share, -np.inf), (motion.leaving_share, np.inf)):
        times, rows = rng.uniform(0.0, span_s, count), chosen(count, share, rng)
        made = np.full(count, otherwise)
        made[rows] = times[rows]
        out.append(made)
    return out[0], np.minimum(out[1], out[2]), np.maximum(out[1], out[2])


def _integrated(
    break_s: Floats, code: Ints, jump: Floats, motion: VesselMotion, velocity: Floats, turn_rate: Floats, acceleration: Floats
) -> tuple[Floats, Floats, Floats, Floats]:
    """Position, velocity, turn rate and acceleration after each break. (V, B, 2), (V, B, 2), (V, B), (V, B, 2)"""
    spans = np.nan_to_num(np.diff(np.where(np.isfinite(break_s), break_s, np.nan), axis=1))
    mean, position, moving = velocity, np.zeros_like(velocity), np.ones((len(velocity), 1), np.bool_)
    kept: list[tuple[Floats, ...]] = [(position, velocity, turn_rate, acceleration)]
    for b in range(1, break_s.shape[1]):
        position, velocity = advanced(position, velocity, turn_rate, acceleration, spans[:, b - 1])
        _, mean = advanced(position, mean, turn_rate, acceleration, spans[:, b - 1])
        now = np.isfinite(break_s[:, b])
        kick, brake, stand = ((now & (code[:, b] == what))[:, None] for what in (KICK, BRAKE, STAND))
        velocity = np.where(kick & moving, mean + motion.keep * (velocity - mean) + jump[:, b], velocity)
        velocity = np.where(stand, 0.0, velocity)
        acceleration = np.where(brake, -velocity / motion.stopping_s, np.where(stand, 0.0, acceleration))
        turn_rate = np.where((brake | stand)[:, 0], 0.0, turn_rate)
        moving = moving & ~brake
        kept.append((position, velocity, turn_rate, acceleration))
    positions, velocities, rates, accelerations = (np.stack(part, axis=1) for part in zip(*kept, strict=True))
    return positions, velocities, rates, accelerations
