"""How simulated vessels move: the settings, and one draw of all voyages of a run."""

from __future__ import annotations

from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from coastwatch.batches import Floats, Ints
from coastwatch.geodesy import KNOT_M_S
from coastwatch.sensors.voyages import Voyages, advanced
from coastwatch.stage import Settings

MOTION, KICKS, PRESENCE = 1, 2, 3  # streams of random numbers: a change of one leaves the others as they are
KICK_INTERVAL_S = {"rw60": 60.0, "rw1": 1.0, "ou": 10.0}
# Standard deviation of one kick per axis over fraction * highest speed (for `ou`: of the bounded deviation). The paper's words
# taken literally are 1; these give the physical bounds of the specification's table, see coastwatch/scores/README.md.
KICK_SHARE = {"rw60": 0.2, "rw1": 0.5, "ou": 0.5}
MANOEUVRE_SHARE = 0.15  # of that, for vessels that turn or accelerate: the paper scales their noise by the smaller acceleration

Share = Annotated[float, Field(ge=0.0, le=1.0)]
Weight = Annotated[float, Field(ge=0.0)]


class VesselMotion(Settings):
    """How the vessels move."""

    speed_from_kn: Annotated[float, Field(ge=0.0, le=60.0)] = 0.0  # speeds are uniform between the two
    speed_to_kn: Annotated[float, Field(gt=0.0, le=60.0)] = 15.0  # also the highest speed that the process noise refers to
    linear_weight: Weight = 1.0  # vessels that go straight on, relative to the other two weights
    circular_weight: Weight = 0.0  # vessels that turn at a constant rate, half of them to each side
    accelerated_weight: Weight = 0.0  # vessels that change speed at a constant rate
    turn_rate_from_deg_s: Annotated[float, Field(ge=0.0, le=10.0)] = 0.2  # of circular motion, uniform between the two
    turn_rate_to_deg_s: Annotated[float, Field(ge=0.0, le=10.0)] = 0.8  # of circular motion
    acceleration_from_m_s2: Annotated[float, Field(ge=0.0, le=1.0)] = 0.005  # of accelerated motion, uniform between the two
    acceleration_to_m_s2: Annotated[float, Field(ge=0.0, le=1.0)] = (
        0.03  # less where the speed would leave its range in the run
    )
    process_noise: Literal["rw60", "rw1", "ou", "none"] = "rw60"  # a kick each minute, each second, or a bounded perturbation
    process_noise_fraction: Annotated[float, Field(ge=0.0, le=1.0)] = 0.1  # f: of the highest speed
    kick_share: float | None = Field(
        default=None, ge=0.0, le=10.0, description="kick per axis over f * highest speed; none: rw60 0.2, rw1 0.5, ou 0.5"
    )
    ou_time_s: Annotated[float, Field(gt=0.0)] = 300.0  # in which a bounded perturbation dies out
    stopping_share: Share = 0.0  # vessels that come to a standstill during the run
    stopping_s: Annotated[float, Field(gt=0.0)] = 60.0  # from first braking to standstill
    entering_share: Share = 0.0  # vessels that appear only during the run
    leaving_share: Share = 0.0  # vessels that disappear during the run

    @model_validator(mode="after")
    def _ranges_have_an_order(self) -> Self:
        for name, unit in (("speed", "kn"), ("turn_rate", "deg_s"), ("acceleration", "m_s2")):
            low, high = getattr(self, f"{name}_from_{unit}"), getattr(self, f"{name}_to_{unit}")
            if low > high:
                raise ValueError(f"{name}_from_{unit}: got {low}, needed at most {name}_to_{unit} = {high}")
        if self.linear_weight + self.circular_weight + self.accelerated_weight <= 0.0:
            raise ValueError("linear_weight, circular_weight, accelerated_weight: got 0, needed one above 0")
        return self

    @property
    def keep(self) -> float:
        """What a kick leaves of the deviation from the mean velocity; 1: a random walk."""
        return float(np.exp(-KICK_INTERVAL_S["ou"] / self.ou_time_s)) if self.process_noise == "ou" else 1.0

    @property
    def kick_m_s(self) -> float:
        """Standard deviation of a kick, per axis, of vessels that go straight on."""
        if self.process_noise == "none":
            return 0.0
        share = KICK_SHARE[self.process_noise] if self.kick_share is None else self.kick_share
        bounded = np.sqrt(1.0 - self.keep**2) if self.process_noise == "ou" else 1.0
        return float(bounded * share * self.process_noise_fraction * self.speed_to_kn * KNOT_M_S)


LINEAR, CIRCULAR, ACCELERATED = 0, 1, 2
START, KICK, BRAKE, STAND = 0, 1, 2, 3


def set_out(motion: VesselMotion, anchor_deg: Floats, start_s: float, span_s: float, seed: int) -> Voyages:
    """The voyages of one run. Args: anchor_deg: (V, 2) where each vessel is at the start; span_s: length of the run."""
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
    position, velocities, rates, accelerations = _sailed(
        break_s, codes[order], np.take_along_axis(jumps, order[..., None], axis=1), motion, velocity, turn_rate, acceleration
    )
    return Voyages(
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
    """When each vessel is perturbed, infinite beyond the run, and standard normal draws. (V, C), (V, C, 2)"""
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


def _sailed(
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
