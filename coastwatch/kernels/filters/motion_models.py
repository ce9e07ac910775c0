"""How a vessel may move: constant velocity, a turn, a change of speed, and a jump of its velocity. Scalar code, compiled by numba.

Each motion moves a mean in place and writes its Jacobian F, the transition matrix of a linearised (extended) Kalman filter, where it
may differ from the unit matrix. The fifth
component of the state is the manoeuvre: of a turn its rate (rad/s, positive to port, from east towards north), of a change of speed
the acceleration along the track (m/s2). Constant velocity has none: it stands at its prior and goes with nothing.
Process noises are densities of continuous time, so that two short predictions are one long one.

Source: Y. Bar-Shalom, X. R. Li, T. Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001, sections 6.2.2 (white
acceleration) and 11.7 (coordinated turn).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from coastwatch.kernels.arrays import Records
from coastwatch.kernels.filters import kalman
from coastwatch.kernels.filters.kalman import EAST, EAST_RATE, MANOEUVRE, NORTH, NORTH_RATE, SIZE
from coastwatch.kernels.jit import jit

STRAIGHT, TURNING, SPEEDING = 0, 1, 2
MODEL = np.dtype(
    [
        ("kind", "i8"),  # STRAIGHT, TURNING or SPEEDING
        ("noise", "f8"),  # q, density of the white acceleration, m2/s3
        ("manoeuvre_mean", "f8"),  # turn rate or acceleration before anything is known
        ("manoeuvre_sigma", "f8"),
        ("manoeuvre_noise", "f8"),  # density of its drift, rad2/s3 or m2/s5
        ("prior_probability", "f8"),
        ("sojourn", "f8"),  # mean time in the model, s
        ("jump_rate", "f8"),  # of jumps of the velocity, 1/s
        ("jump_variance", "f8"),  # of such a jump, per axis, m2/s2
    ]
)
SMALL_TURN = 0.1  # rad: below it series replace sin(a) / a and the like; their next terms are under 1e-15 of the first
SLOW = 0.5  # m/s: a vessel slower than this has no direction in which to gain speed


def table(**columns: ArrayLike) -> Records:
    """Models as the filters take them, (J,) MODEL. Args: columns of MODEL, (J,) each or one number for all; the others are zero."""
    out = np.zeros(np.broadcast_shapes(*(np.shape(column) for column in columns.values())), MODEL)
    for name, column in columns.items():
        out[name] = column
    return out


@jit
def constant_velocity(mean, dt, transition):  # type: ignore[no-untyped-def]
    """East and north go on by their rates. x(t + dt) = x + dt v; the manoeuvre is forgotten."""
    transition[EAST, EAST_RATE] = transition[NORTH, NORTH_RATE] = dt
    transition[MANOEUVRE, MANOEUVRE] = 0.0
    mean[EAST] += dt * mean[EAST_RATE]
    mean[NORTH] += dt * mean[NORTH_RATE]
    mean[MANOEUVRE] = 0.0


@jit
def coordinated_turn(mean, dt, transition):  # type: ignore[no-untyped-def]
    """The velocity turns by a = w dt, w the manoeuvre; with s = sin(a) / w and c = (1 - cos(a)) / w:

    x = x + s vx - c vy,  y = y + c vx + s vy,  vx = cos(a) vx - sin(a) vy,  vy = sin(a) vx + cos(a) vy.
    """
    vx, vy, w = mean[EAST_RATE], mean[NORTH_RATE], mean[MANOEUVRE]
    a = w * dt
    if abs(a) < SMALL_TURN:
        a2 = a * a
        s = dt * (1.0 - a2 / 6.0 * (1.0 - a2 / 20.0 * (1.0 - a2 / 42.0 * (1.0 - a2 / 72.0))))
        c = 0.5 * dt * a * (1.0 - a2 / 12.0 * (1.0 - a2 / 30.0 * (1.0 - a2 / 56.0 * (1.0 - a2 / 90.0))))
        # derivatives of s and c by w
        ds = -dt * dt * a / 3.0 * (1.0 - a2 / 10.0 * (1.0 - a2 / 28.0 * (1.0 - a2 / 54.0 * (1.0 - a2 / 88.0))))
        dc = 0.5 * dt * dt * (1.0 - a2 / 4.0 * (1.0 - a2 / 18.0 * (1.0 - a2 / 40.0 * (1.0 - a2 / 70.0))))
        sin, cos = w * s, 1.0 - w * c
    else:
        sin, cos = math.sin(a), math.cos(a)
        s, c = sin / w, (1.0 - cos) / w
        ds, dc = (dt * cos - s) / w, (dt * sin - c) / w
    f = transition
    f[EAST, EAST_RATE], f[EAST, NORTH_RATE], f[EAST, MANOEUVRE] = s, -c, ds * vx - dc * vy
    f[NORTH, EAST_RATE], f[NORTH, NORTH_RATE], f[NORTH, MANOEUVRE] = c, s, dc * vx + ds * vy
    f[EAST_RATE, EAST_RATE], f[EAST_RATE, NORTH_RATE], f[EAST_RATE, MANOEUVRE] = cos, -sin, -dt * (sin * vx + cos * vy)
    f[NORTH_RATE, EAST_RATE], f[NORTH_RATE, NORTH_RATE], f[NORTH_RATE, MANOEUVRE] = sin, cos, dt * (cos * vx - sin * vy)
    mean[EAST] += s * vx - c * vy
    mean[NORTH] += c * vx + s * vy
    mean[EAST_RATE], mean[NORTH_RATE] = cos * vx - sin * vy, sin * vx + cos * vy


@jit
def speed_change(mean, dt, transition):  # type: ignore[no-untyped-def]
    """The speed grows by a dt along the course u, a the manoeuvre: v = v + a dt u, x = x + dt v + a dt^2 / 2 u.

    u = v / sqrt(|v|^2 + SLOW^2), so that a vessel at rest has no course.
    """
    vx, vy = mean[EAST_RATE], mean[NORTH_RATE]
    speed, gain, half = math.sqrt(vx * vx + vy * vy + SLOW * SLOW), dt * mean[MANOEUVRE], 0.5 * dt
    ux, uy = vx / speed, vy / speed
    ratio = gain / speed
    f = transition
    f[EAST_RATE, EAST_RATE], f[EAST_RATE, NORTH_RATE] = 1.0 + ratio * (1.0 - ux * ux), -ratio * ux * uy
    f[NORTH_RATE, EAST_RATE], f[NORTH_RATE, NORTH_RATE] = -ratio * ux * uy, 1.0 + ratio * (1.0 - uy * uy)
    f[EAST_RATE, MANOEUVRE], f[NORTH_RATE, MANOEUVRE] = dt * ux, dt * uy
    f[EAST, EAST_RATE], f[EAST, NORTH_RATE] = half * (1.0 + f[EAST_RATE, EAST_RATE]), half * f[EAST_RATE, NORTH_RATE]
    f[NORTH, EAST_RATE], f[NORTH, NORTH_RATE] = half * f[NORTH_RATE, EAST_RATE], half * (1.0 + f[NORTH_RATE, NORTH_RATE])
    f[EAST, MANOEUVRE], f[NORTH, MANOEUVRE] = half * dt * ux, half * dt * uy
    mean[EAST] += dt * vx + half * gain * ux
    mean[NORTH] += dt * vy + half * gain * uy
    mean[EAST_RATE] += gain * ux
    mean[NORTH_RATE] += gain * uy


@jit
def move(model, mean, dt, transition):  # type: ignore[no-untyped-def]
    """Move a mean in place by one MODEL, and write the Jacobian F of that motion, (5, 5)."""
    transition[:] = 0.0
    for a in range(SIZE):
        transition[a, a] = 1.0
    if model.kind == TURNING:
        coordinated_turn(mean, dt, transition)
    elif model.kind == SPEEDING:
        speed_change(mean, dt, transition)
    else:
        constant_velocity(mean, dt, transition)
        mean[MANOEUVRE] = model.manoeuvre_mean


@jit
def add_velocity_noise(covariance, variance, dt):  # type: ignore[no-untyped-def]
    """Add noise to the velocity, of this variance after dt, of which every part of dt had its share. In place.

    Q = variance [[dt^2 / 3, dt / 2], [dt / 2, 1]] of position and velocity on each axis. White acceleration of density q has the
    variance q dt. A jump of the velocity, at a time of dt at which all are alike, has the variance of the jump.
    """
    for a in (EAST, NORTH):
        rate = a + 2
        covariance[a, a] += variance * dt * dt / 3.0
        covariance[a, rate] += 0.5 * variance * dt
        covariance[rate, a] += 0.5 * variance * dt
        covariance[rate, rate] += variance


@jit
def add_process_noise(model, dt, covariance):  # type: ignore[no-untyped-def]
    """Add the process noise Q of one MODEL over dt to a covariance in place: white acceleration, and drift of the manoeuvre."""
    add_velocity_noise(covariance, model.noise * dt, dt)
    if model.kind == STRAIGHT:
        covariance[MANOEUVRE, MANOEUVRE] += model.manoeuvre_sigma * model.manoeuvre_sigma
    else:
        covariance[MANOEUVRE, MANOEUVRE] += model.manoeuvre_noise * dt


@jit
def predict(model, mean, covariance, dt, transition):  # type: ignore[no-untyped-def]
    """Predict a state in place by one MODEL over dt > 0: x = f(x), P = F P F' + Q. transition: (5, 5) to work in."""
    if model.kind == STRAIGHT:
        mean[EAST] += dt * mean[EAST_RATE]
        mean[NORTH] += dt * mean[NORTH_RATE]
        mean[MANOEUVRE] = model.manoeuvre_mean
        kalman.predict_straight(covariance, dt)
    else:
        if model.kind == TURNING:
            coordinated_turn(mean, dt, transition)
        else:
            speed_change(mean, dt, transition)
        kalman.predict(covariance, transition)
    add_process_noise(model, dt, covariance)
