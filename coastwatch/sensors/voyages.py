"""True motion of simulated vessels, known in closed form at any time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coastwatch.batches import Bools, Floats, Ints, Struct, Trajectories, column
from coastwatch.geodesy import from_plane, turn


@dataclass(frozen=True, eq=False)
class Voyages(Struct):
    """True motion, piece by piece: from each break on, velocity turns and grows at constant rates in the plane at the anchor.

    B breaks a vessel, in order, the first at the start; times are seconds after the start, infinite where there are no more.
    """

    start_s: float
    keep: float  # what a kick leaves of the deviation from the mean velocity
    anchor_deg: Floats = column(np.float64, "V", 2)
    break_s: Floats = column(np.float64, "V", "B")
    position_m: Floats = column(np.float64, "V", "B", 2)
    velocity_m_s: Floats = column(np.float64, "V", "B", 2)
    turn_rate_rad_s: Floats = column(np.float64, "V", "B")  # positive from east to north
    acceleration_m_s2: Floats = column(np.float64, "V", "B", 2)
    appear_s: Floats = column(np.float64, "V")
    disappear_s: Floats = column(np.float64, "V")
    kick_s: Floats = column(np.float64, "V", "C")  # NaN pads
    kick_m_s: Floats = column(np.float64, "V")  # NaN: stops, which no linear model foresees

    def present(self, row: Ints, time_s: Floats) -> Bools:
        """Whether vessels are there. Args: (M,), (M,) s since the epoch."""
        elapsed = time_s - self.start_s
        return np.asarray((elapsed >= self.appear_s[row]) & (elapsed < self.disappear_s[row]))

    def where(self, row: Ints, time_s: Floats) -> Floats:
        """Latitude and longitude, NaN where absent. Args: (M,), (M,). Returns: (M, 2)."""
        metres, _ = self._in_plane(row, time_s)
        metres[~self.present(row, time_s)] = np.nan
        return from_plane(metres, self.anchor_deg[row])

    def state(self, row: Ints, time_s: Floats) -> tuple[Floats, Floats]:
        """Latitude and longitude, NaN where absent, and velocity east and north there. Args: (M,), (M,). Returns: (M, 2), (M, 2)."""
        position, velocity = self.sailed(row, time_s)
        position[~self.present(row, time_s)] = np.nan
        return position, velocity

    def sailed(self, row: Ints, time_s: Floats) -> tuple[Floats, Floats]:
        """As `state`, whether the vessel is there or not. Args: (M,), (M,). Returns: (M, 2), (M, 2)."""
        metres, velocity = self._in_plane(row, time_s)
        position = from_plane(metres, self.anchor_deg[row])
        return position, np.einsum("mji,mj->mi", turn(position, self.anchor_deg[row]), velocity)

    def sampled(self, time_s: Floats) -> Trajectories:
        """The truth at common instants. Args: (T,) increasing."""
        v, t = len(self.anchor_deg), len(time_s)
        row, time = np.repeat(np.arange(v), t), np.tile(time_s, v)
        position, velocity = self.sailed(row, time)
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
    """Position and velocity after a time, turning or accelerating constantly.

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
