"""Vessels that cross a disc around a radar and turn on the way, with clutter, misses and AIS messages of which some carry a wrong id.

Source: A. G. Hem, E. F. Brekke, Variations of joint integrated data association with radar and target-provided measurements, Journal of
Advances in Information Fusion 17(2), 2022, section VIII-A. What the paper leaves open is set here; the README of `hem-figure-2` says how.
"""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from coastwatch.batches import AisReports, Floats, RadarReports, Recording, Reports, Sensors, Trajectories
from coastwatch.geodesy import KNOT_M_S, from_plane
from coastwatch.sensors.simulated.radar import plots_of_positions, require_usable_radars
from coastwatch.stage import Count, Method, NotNegative, Plan, Positive, Share

MOTION, DETECTION, CLUTTER, AIS = 61, 62, 63, 64  # streams of random numbers
STEP_S = 0.5  # of the true motion
TURN_BACK_RAD, TURN_BACK_RAD_S = np.radians(35.0), 0.06  # a vessel farther off than this turns back until it has been near
NEAR_M = 50.0  # of the centre
SLACK_M = 1e-6  # so that a vessel on the edge is inside
FAST_KN, FASTER_KN = 14.0, 23.0  # ITU-R M.1371: speeds from which AIS reports more often
FIRST_MMSI = 257_000_000
LATE_S = 10.0  # where `births_within_s` is not given: when the last two fifths of the vessels start


class Crossing(Method):
    """Vessels that start at the edge of a disc around the first radar, pass near its centre and leave. The radar stamps a turn alike.

    Of a paper, for comparison.
    """

    method: Literal["crossing"] = "crossing"
    count: Annotated[int, Field(ge=1, le=1000)] = 5  # vessels
    radius_m: Annotated[float, Field(gt=100.0)] = 500.0
    speed_from_m_s: NotNegative = 4.0
    speed_to_m_s: NotNegative = 12.0
    heading_deg: Annotated[float, Field(ge=0.0, le=90.0)] = 20.0  # greatest angle off the centre at the start
    births_within_s: NotNegative | None = (
        None  # vessels start evenly in this time; none: three fifths at once, the others after 10 s
    )
    returns: bool = True  # vessels turn back towards the centre until they were near; false: they go where noise takes them
    noise_m2_s3: NotNegative = 0.01  # density of the white acceleration
    turns_per_s: NotNegative = 1.0 / 30.0  # rate at which a vessel begins a turn of 0.02 to 0.12 rad/s and 5 to 15 s
    looks_every: Count = 1  # cycles between two turns of the radar
    range_sigma_m: NotNegative | None = None  # true noise of the radar's range; none: as the radar states
    detection_probability: Share = 0.9  # of a visible vessel, in one turn of the radar
    clutter_per_m2: NotNegative = 5e-7  # false plots in one turn
    echo_sigma_m: NotNegative = 6.6  # of the echo's place on a vessel, per axis, on top of the radar's noise
    hide_share: Share = 0.0  # of the visible vessels that become invisible in a turn
    show_share: Share = 0.52  # of the invisible vessels that become visible in a turn
    ais_share: Share = 0.5  # of the vessels
    ais_interval_s: Positive = 6.0  # give or take a tenth
    ais_fast_intervals_s: tuple[Positive, Positive] | None = None  # of vessels of 14 to 23 kn, and above; none: as all others
    ais_sigma_m: NotNegative = 3.0  # per axis
    wrong_id_share: Share = 0.01  # of the messages

    def load(self, sensors: Sensors, seed: int, plan: Plan) -> Recording:
        """The reports of a run; the vessels start with the first turn, at the end of the first cycle.

        Raises: InputError if the scenario has no radar.
        """
        require_usable_radars(sensors.radars, "crossing")
        first_s, span_s = plan.instant_s(0), plan.instant_s(plan.cycles - 1) - plan.instant_s(0)
        time_s = np.arange(0.0, span_s + STEP_S, STEP_S)
        state = self._motion(np.random.default_rng([seed, MOTION]), len(time_s))
        site_deg = sensors.radars.site_deg[0]
        present = np.isfinite(state[..., 0])
        filled = np.where(present[..., None], state, 0.0)
        position_deg = from_plane(filled[..., :2], site_deg)
        truth = Trajectories.without_model(np.arange(self.count), first_s + time_s, position_deg, filled[..., 2:], present)
        radar = self._plots(sensors, seed, state, plan)
        reports = Reports(radar, self._messages(seed, state, first_s, site_deg))
        return Recording(reports=reports, truth=truth)

    def _motion(self, rng: np.random.Generator, steps: int) -> Floats:
        """East, north and their rates of each vessel at each step, NaN where it is absent. (V, T, 4)"""
        out = np.full((self.count, steps, 4), np.nan)
        root = np.linalg.cholesky(np.array([[STEP_S**3 / 3.0, STEP_S**2 / 2.0], [STEP_S**2 / 2.0, STEP_S]]))
        for vessel in range(self.count):
            azimuth, speed = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(self.speed_from_m_s, self.speed_to_m_s)
            course = azimuth + np.pi + np.radians(rng.uniform(-self.heading_deg, self.heading_deg))
            place, velocity = self.radius_m * _unit(azimuth), speed * _unit(course)
            rate, until_s, near = 0.0, 0.0, False
            if self.births_within_s is not None:
                first = int(np.ceil(rng.uniform(0.0, self.births_within_s) / STEP_S))
            else:
                first = 0 if vessel < 3 * self.count // 5 else int(LATE_S / STEP_S)
            slack = 20.0 if self.returns else SLACK_M
            for k in range(first, steps):
                if np.hypot(*place) > self.radius_m + (0.0 if near and self.returns else slack):
                    break
                out[vessel, k] = *place, *velocity
                near |= bool(np.hypot(*place) < NEAR_M)
                if k * STEP_S >= until_s:
                    rate, until_s = self._next_turn(rng, place, velocity, near, k * STEP_S)
                noise = np.sqrt(self.noise_m2_s3) * rng.standard_normal((2, 2)) @ root.T
                half = 0.5 * rate * STEP_S
                chord = STEP_S * np.sinc(half / np.pi)
                place = place + chord * _turned(velocity, half) + noise[:, 0]
                velocity = _turned(velocity, 2.0 * half) + noise[:, 1]
        return out

    def _next_turn(
        self, rng: np.random.Generator, place: Floats, velocity: Floats, near: bool, now_s: float
    ) -> tuple[float, float]:
        """The turn rate from now on, and until when."""
        angle = np.arctan2(-place[1], -place[0]) - np.arctan2(velocity[1], velocity[0])
        off = float(np.angle(np.exp(1j * angle)))
        if self.returns and not near and abs(off) > TURN_BACK_RAD:
            return float(np.sign(off)) * TURN_BACK_RAD_S, now_s + abs(off) / TURN_BACK_RAD_S
        if rng.random() < STEP_S * self.turns_per_s:
            rate = float(rng.choice([-1.0, 1.0])) * rng.uniform(0.02, 0.12)
            return rate, now_s + rng.uniform(5.0, 15.0)
        return 0.0, 0.0

    def _plots(self, sensors: Sensors, seed: int, state: Floats, plan: Plan) -> RadarReports:
        radars, rng, other = sensors.radars, np.random.default_rng([seed, DETECTION]), np.random.default_rng([seed, CLUTTER])
        # At first as many are visible as in the long run.
        steady = self.show_share / (self.hide_share + self.show_share) if self.hide_share > 0.0 else 1.0
        visible = rng.random(self.count) < steady
        range_sigma_m = float(radars.range_sigma_m[0]) if self.range_sigma_m is None else self.range_sigma_m
        place, time, origin = [], [], []
        for cycle in range(0, plan.cycles, self.looks_every):
            now_s = plan.instant_s(cycle)
            here = state[:, round((now_s - plan.instant_s(0)) / STEP_S), :2]
            seen = np.isfinite(here[:, 0]) & visible & (rng.random(self.count) < self.detection_probability)
            false = other.poisson(self.clutter_per_m2 * np.pi * self.radius_m**2)
            distance, azimuth = self.radius_m * np.sqrt(other.random(false)), other.uniform(0.0, 2.0 * np.pi, false)
            echo = self._measured(here[seen], range_sigma_m, radars.azimuth_sigma_rad[0], rng)
            place.append(np.concatenate([echo, distance[:, None] * np.column_stack([np.sin(azimuth), np.cos(azimuth)])]))
            time.append(np.full(len(place[-1]), now_s))
            origin.append(np.concatenate([np.flatnonzero(seen), np.full(false, -1)]))
            draw = rng.random(self.count)
            visible = np.where(visible, draw >= self.hide_share, draw < self.show_share)
        of = np.concatenate(origin).astype(np.int64)
        return plots_of_positions(np.concatenate(place), np.concatenate(time), of, radars.site_deg[0])

    def _measured(self, place: Floats, range_sigma_m: float, azimuth_sigma_rad: float, rng: np.random.Generator) -> Floats:
        """Positions with the noise of the echo's place, and of range and azimuth, which vanishes at the radar. (M, 2)"""
        distance = np.hypot(*place.T)[:, None]
        ahead = place / np.maximum(distance, 1e-9)
        across = np.column_stack([ahead[:, 1], -ahead[:, 0]])
        noise = self.echo_sigma_m * rng.standard_normal(place.shape)
        noise += range_sigma_m * rng.standard_normal(distance.shape) * ahead
        noise += azimuth_sigma_rad * distance * rng.standard_normal(distance.shape) * across
        return np.asarray(place + noise)

    def _interval_s(self, state: Floats) -> float:
        """Until the next message of a vessel in this state, (4,); NaN: it is absent."""
        if self.ais_fast_intervals_s is None or not np.hypot(*state[2:]) >= FAST_KN * KNOT_M_S:
            return self.ais_interval_s
        return self.ais_fast_intervals_s[int(np.hypot(*state[2:]) >= FASTER_KN * KNOT_M_S)]

    def _messages(self, seed: int, state: Floats, first_s: float, site_deg: Floats) -> AisReports:
        rng, rows = np.random.default_rng([seed, AIS]), []
        for vessel in range(self.count):
            if rng.random() >= self.ais_share:
                continue
            time_s = rng.uniform(0.0, self.ais_interval_s)
            while time_s < (state.shape[1] - 1) * STEP_S:
                step = time_s / STEP_S
                here = (1.0 - step % 1.0) * state[vessel, int(step), :2] + step % 1.0 * state[vessel, int(step) + 1, :2]
                if np.isfinite(here[0]):
                    wrong = rng.random() < self.wrong_id_share
                    mmsi = int(rng.integers(200_000_000, 800_000_000)) if wrong else FIRST_MMSI + vessel
                    rows.append((time_s, *(here + self.ais_sigma_m * rng.standard_normal(2)), mmsi, vessel))
                time_s += self._interval_s(state[vessel, int(step)]) * rng.uniform(0.9, 1.1)
        found = np.array(sorted(rows), np.float64).reshape(-1, 5)
        unknown, time = np.full(len(found), np.nan), first_s + found[:, 0]
        return AisReports(
            time_s=time,
            received_s=time,
            mmsi=found[:, 3].astype(np.int64),
            position_deg=from_plane(found[:, 1:3], site_deg),
            sog_kn=unknown,
            cog_deg=unknown,
            class_b=np.zeros(len(found), np.bool_),
            origin=found[:, 4].astype(np.int64),
        )


def _unit(angle: float) -> Floats:
    return np.array([np.cos(angle), np.sin(angle)])


def _turned(velocity: Floats, angle: float) -> Floats:
    """A velocity turned to port."""
    cos, sin = np.cos(angle), np.sin(angle)
    return np.array([cos * velocity[0] - sin * velocity[1], sin * velocity[0] + cos * velocity[1]])
