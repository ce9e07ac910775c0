"""Sixteen vessels from fixed start states around one radar, in clutter, with AIS of class A or B: the scenario of Liland 2017.

Source: E. Liland, AIS aided multi hypothesis tracker, master thesis, NTNU, 2017, section 5.2, Tables 5.1 and 5.2. What the thesis leaves
open is that of its stored program; the README of `liland-tracking` lists it.
"""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from coastwatch.batches import AisReports, Bools, Floats, Ints, RadarReports, Recording, Reports, Sensors, Trajectories
from coastwatch.batches.ais_codes import PositionAccuracy
from coastwatch.errors import InputError
from coastwatch.geodesy import KNOT_M_S, from_plane
from coastwatch.sensors.simulated.ais import itu_interval_s
from coastwatch.sensors.simulated.radar import Burst, plots_of_positions, require_usable_radars
from coastwatch.stage import CountOrZero, Method, NotNegative, Plan, Positive, Share

DETECTION, CLUTTER, AIS, BEFORE = 71, 72, 73, 74  # streams of random numbers
STEP_S, STEPS_PER_LOOK, LOOKS = 0.625, 4, 60  # of the true motion; looks after the first one
LOOK_S = STEP_S * STEPS_PER_LOOK
CENTRE_M = np.array([100.0, -100.0])  # the radar, in the plane of the table
FIRST_MMSI = 257_000_000
# Table 5.1, as east, north, and their rates. Rows 0 and 3 print speed and course in place of the rates.
START = np.array(
    [
        (-2000, 2100, -10, 0),
        (100, -2000, -2, 8),
        (-4000, 300, 12, -1),
        (-4000, 0, 12, 0),
        (-4000, -200, 17, 1),
        (4000, -2000, 1, -8),
        (3000, 4000, 2, -8),
        (200, 5000, 10, -1),
        (-3500, -3500, 10, 5),
        (-4100, 3200, 17, -2),
        (3600, 3000, -10, 3),
        (5000, 1000, -7, -2),
        (2000, 100, -10, 8),
        (0, -5000, 10, 2),
        (-400, 300, 17, 0),
        (0, 2000, 15, 15),
    ],
    np.float64,
)
TURNING = {0: (10.0, 270.0, 0.9), 3: (12.0, 90.0, -0.2)}  # vessel: speed m/s, course deg, mean turn rate deg/s
TURN_SIGMA_DEG_S, SPEED_SIGMA_M_S2 = 3.0, 0.8
SENT_S = np.array([-2, -1, -5, -np.inf, -4, -3, -2, -1, -6, -10, -7, -5, -2, -4, -8, -9])  # report before the first look
CLASSES = {"S0": ("", ""), "S1": ("B", ""), "S2": ("A", ""), "S3": ("B", "B"), "S4": ("A", "A")}  # of even and odd vessels
PROGRAM_KNOT = 0.514444  # the program multiplies by it where it should divide


class StartStates(Method):
    """Sixteen vessels with fixed start states and paths; 60 looks of a radar, each stamped alike, and AIS between them.

    Of a paper, for comparison.

    The first look is at the end of the cycle after `lead_in`.
    """

    method: Literal["start_states"] = "start_states"
    path_seed: CountOrZero = 5447  # of the paths, which all runs share
    transponders: Literal["S0", "S1", "S2", "S3", "S4"] = "S0"  # none; half class B; half class A; all class B; all class A
    intervals: Literal["thesis", "itu"] = "thesis"  # between AIS reports: 6 s (A) and 30 s (B), or those of Table 2.4
    detection_probability: Share = 0.9
    clutter_per_m2: NotNegative = 1e-5  # false plots in one look
    burst: Burst = Burst()  # clutter on top of that; its times are after the first look
    plot_sigma_m: NotNegative = 2.5  # per axis
    accurate_sigma: NotNegative = 1.0  # of an AIS report that states a high accuracy, per axis: the same number of m and m/s
    inaccurate_sigma: NotNegative = 3.0  # the same number of a report that states a low one
    inaccurate_share: Share = 0.5  # of the reports
    loss: Share = 0.0  # share of the reports that are not received
    lead_in: CountOrZero = 0  # looks before the first, without clutter or miss, for trackers that begin tracks themselves
    shadow_from_deg: Annotated[float, Field(ge=0.0, le=360.0)] = 0.0  # start of a sector without plots, clockwise
    shadow_to_deg: Annotated[float, Field(ge=0.0, le=360.0)] = 0.0  # its end; equal to its start: no such sector
    shadow_beyond_m: Positive = 800.0  # from the radar

    def load(self, sensors: Sensors, seed: int, plan: Plan) -> Recording:
        """The reports of a run. A vessel is present in the truth while the radar reaches it, from the first look on.

        Raises: InputError if the scenario has no radar, or another time between two cycles than a look.
        """
        require_usable_radars(sensors.radars, "start_states")
        if plan.period_s != LOOK_S:
            raise InputError(f"period_s: got {plan.period_s}, needed {LOOK_S} where input.method is start_states")
        path, site_deg, reach_m = paths(self.path_seed), sensors.radars.site_deg[0], float(sensors.radars.range_m[0])
        path[..., :2] -= CENTRE_M
        first_s = plan.instant_s(self.lead_in)
        time_s = first_s + STEP_S * np.arange(path.shape[1], dtype=np.float64)
        present = np.hypot(path[..., 0], path[..., 1]) <= reach_m
        position_deg = from_plane(path[..., :2], site_deg)
        truth = Trajectories.without_model(np.arange(len(path)), time_s, position_deg, path[..., 2:], present)
        radar = self._plots(path, seed, first_s, site_deg, reach_m)
        ais = self._messages(path, seed, first_s, site_deg, reach_m)
        return Recording(reports=Reports(radar, ais), truth=truth)

    def in_shadow(self, position_m: Floats) -> Bools:
        """Whether positions east and north of the radar are in the shadow. Args: (..., 2). Returns: (...)."""
        azimuth_deg = np.degrees(np.arctan2(position_m[..., 0], position_m[..., 1]))
        width = (self.shadow_to_deg - self.shadow_from_deg) % 360.0
        hidden: Bools = (azimuth_deg - self.shadow_from_deg) % 360.0 < width
        return hidden & (np.hypot(position_m[..., 0], position_m[..., 1]) > self.shadow_beyond_m)

    def _plots(self, path: Floats, seed: int, first_s: float, site_deg: Floats, reach_m: float) -> RadarReports:
        detection, clutter, before = (np.random.default_rng([seed, stream]) for stream in (DETECTION, CLUTTER, BEFORE))
        place, time, origin = [], [], []
        for look in range(-self.lead_in, LOOKS + 1):
            if look < 0:
                here = path[:, 0, :2] + look * LOOK_S * path[:, 0, 2:]
                seen, rng, false = np.ones(len(path), np.bool_), before, 0
            else:
                here = path[:, look * STEPS_PER_LOOK, :2]
                seen, rng = detection.random(len(path)) < self.detection_probability, detection
                density = self.clutter_per_m2 + float(self.burst.density(np.array(look * LOOK_S)))
                false = clutter.poisson(density * np.pi * reach_m**2)
            echo = here + self.plot_sigma_m * rng.standard_normal(here.shape)
            distance, azimuth = reach_m * np.sqrt(clutter.random(false)), clutter.uniform(0.0, 2.0 * np.pi, false)
            seen &= np.hypot(*here.T) <= reach_m
            every = np.concatenate([echo[seen], distance[:, None] * np.column_stack([np.sin(azimuth), np.cos(azimuth)])])
            of = np.append(np.flatnonzero(seen), np.full(false, -1))
            clear = ~self.in_shadow(every)
            place.append(every[clear])
            origin.append(of[clear])
            time.append(np.full(int(clear.sum()), first_s + look * LOOK_S))
        return plots_of_positions(np.concatenate(place), np.concatenate(time), np.concatenate(origin), site_deg)

    def _messages(self, path: Floats, seed: int, first_s: float, site_deg: Floats, reach_m: float) -> AisReports:
        rng, class_b, (who, step) = np.random.default_rng([seed, AIS]), self.class_b(), self._sent(path)
        now_s = np.floor(step * STEP_S)
        state = path[who, step]
        state[:, :2] += (now_s - step * STEP_S)[:, None] * state[:, 2:]
        low = rng.random(len(who)) < self.inaccurate_share
        sigma = np.where(low, self.inaccurate_sigma, self.accurate_sigma)
        received = (rng.random(len(who)) >= self.loss) & (np.hypot(state[:, 0], state[:, 1]) < reach_m)
        state += sigma[:, None] * rng.standard_normal(state.shape)
        time_s = first_s + now_s
        return AisReports(
            time_s=time_s,
            received_s=time_s,
            mmsi=FIRST_MMSI + who,
            position_deg=from_plane(state[:, :2], site_deg),
            sog_kn=np.hypot(state[:, 2], state[:, 3]) / KNOT_M_S,
            cog_deg=np.degrees(np.arctan2(state[:, 2], state[:, 3])) % 360.0,
            class_b=class_b[who] > 0,
            origin=who,
            accuracy=np.where(low, PositionAccuracy.LOW, PositionAccuracy.HIGH),
            covariance=sigma[:, None, None] ** 2 * np.eye(2),
        ).take(received)

    def class_b(self) -> Ints:
        """The AIS of each vessel: 1 class B, 0 class A, -1 none. (16,)"""
        of = {"": -1, "A": 0, "B": 1}
        return np.array([of[CLASSES[self.transponders][vessel % 2]] for vessel in range(len(START))])

    def _sent(self, path: Floats) -> tuple[Ints, Ints]:
        """Vessel and step of each report, by step. A report is due at a whole second, and none in the second of a look."""
        class_b, sent_s = self.class_b(), SENT_S.copy()
        vessels, steps = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
        for step in range(1, path.shape[1]):
            now_s = np.floor(step * STEP_S)
            if now_s % LOOK_S == 0.0:
                continue
            wait_s = self._interval_s(path[:, step, 2:], path[:, step - 1, 2:], class_b)
            due = np.flatnonzero((class_b >= 0) & (now_s - sent_s >= wait_s))
            sent_s[due] = now_s
            vessels.append(due)
            steps.append(np.full(len(due), step))
        return np.concatenate(vessels), np.concatenate(steps)

    def _interval_s(self, velocity: Floats, before: Floats, class_b: Ints) -> Floats:
        """Until the next report of each vessel. Args: velocity, before: (V, 2) m/s now and a step before."""
        if self.intervals == "itu":
            return itu_interval_s(velocity, before, STEP_S, class_b > 0)
        speed_kn = PROGRAM_KNOT * np.hypot(velocity[:, 0], velocity[:, 1])
        slow_b = np.where(speed_kn > 2.0, 30.0, 180.0)
        return np.select(
            [speed_kn > 23.0, speed_kn > 14.0],
            [np.where(class_b > 0, 10.0, 2.0), np.where(class_b > 0, 5.0, 4.0)],
            np.where(class_b > 0, slow_b, 6.0),
        )


def paths(path_seed: int) -> Floats:
    """East, north and their rates of each vessel at each step, in the plane of the table. (16, 241, 4)

    The draws are those of the program, whose generator is the old one of numpy.
    """
    rng = np.random.RandomState(path_seed)
    variance = (STEP_S**4 / 4.0, STEP_S**3 / 3.0, STEP_S**2)
    noise = np.kron(np.array([[variance[0], variance[1]], [variance[1], variance[2]]]), np.eye(2)).astype(np.float32)
    out = np.empty((len(START), LOOKS * STEPS_PER_LOOK + 1, 4))
    out[:, 0] = START
    polar = {vessel: list(start[:2]) for vessel, start in TURNING.items()}
    for step in range(1, out.shape[1]):
        for vessel in range(len(START)):
            before = out[vessel, step - 1]
            if vessel in polar:
                speed, course = polar[vessel]
                turn, faster = rng.normal(TURNING[vessel][2], TURN_SIGMA_DEG_S), rng.normal(0.0, SPEED_SIGMA_M_S2)
                velocity = _along(speed, course)
                polar[vessel] = [max(0.0, speed + STEP_S * faster), (course + STEP_S * turn) % 360.0]
                out[vessel, step] = *(before[:2] + STEP_S * velocity), *_along(*polar[vessel])
            else:
                kick = rng.multivariate_normal(np.zeros(4), noise)
                out[vessel, step] = *(before[:2] + STEP_S * before[2:] + kick[:2]), *(before[2:] + kick[2:])
    return out


def _along(speed_m_s: float, course_deg: float) -> Floats:
    """The velocity east and north."""
    return speed_m_s * np.array([np.sin(np.radians(course_deg)), np.cos(np.radians(course_deg))])
