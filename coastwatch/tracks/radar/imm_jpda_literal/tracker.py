"""IMM-JPDA with unscented filters in course and speed, as a paper has it; and how its tracks begin and end.

Source: F. Heymann, J. Hoth, P. Banys, G. Siegert, Validation of Radar Image Tracking Algorithms with Simulated Data, section 3.2. What the
paper leaves open is a setting here.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, Literal, NamedTuple, Self

import numpy as np
from pydantic import Field, model_validator

from coastwatch import kernels
from coastwatch.batches import Bools, Floats, Ints, StandingEchoes
from coastwatch.kernels.filters.gaussian import Estimates
from coastwatch.kernels.filters.unscented import COURSE, MODELS, RATE, SPEED, MotionRules
from coastwatch.kernels.tracks.columns import PlotColumns
from coastwatch.kernels.tracks.initiation import StartRules
from coastwatch.kernels.tracks.polar_update import PolarPlots
from coastwatch.stage import NotNegative, Positive, Probability
from coastwatch.tracks.radar.clutter import ClutterSettings, empty_map, false_plots_per_m2, learn
from coastwatch.tracks.radar.imm_jpda_literal.memory import NEWEST, Confirmed, ImmJpdaMemory, Preliminary, Tentative
from coastwatch.tracks.radar.region import RadarMethod, RegionInput, RegionOutput, cut, is_usable
from coastwatch.tracks.radar.report import Reported, radars_of, report, report_measurements

AHEAD_S = 5.0  # a plot stamped more than this after the cycle is dropped
SLICE_S = 1.0  # plots are taken in slices of this length, at most half a turn
SLACK = 0.1  # of a turn, after which a look without a plot is over
LIKELY = 0.5  # a look has a plot, and a plot its track, from this probability on
EXACT = 8  # tracks or plots of a cluster up to which all joint assignments are summed
MOST_LOOKS = 62  # bits of a number
LEAST_SPEED_M_S = 0.5  # of the Jacobian at the change to course and speed
LEAST_DT_S = 0.1  # between the first two plots

Looks = Annotated[int, Field(ge=1, le=MOST_LOOKS)]


class _Batch(NamedTuple):
    """The plots of one radar in a slice of time."""

    columns: PlotColumns
    plots: PolarPlots
    site_m: Floats  # (2,)
    radar: int
    period_s: float


class ImmJpdaLiteral(RadarMethod):
    """IMM of constant velocity and constant turn rate with unscented filters in course and speed; JPDA; M of N looks.

    Of a paper, for comparison.

    `imm_jpda` has the same association with the motion models of Coastwatch.
    """

    method: Literal["imm_jpda_literal"] = "imm_jpda_literal"
    course_noise_deg: NotNegative = 0.10  # deviation of the course of CV after a second
    speed_noise_m_s: NotNegative = 0.05  # deviation of the speed of both models after a second
    rate_noise_deg_s: NotNegative = 0.06  # deviation of the turn rate of CTRV after a second
    straight_s: Positive = 200.0  # mean time in CV
    turning_s: Positive = 60.0  # mean time in CTRV
    start_rate_deg_s: Positive = 0.6  # deviation of the turn rate at confirmation
    start_straight: Probability = 0.6  # probability of CV at confirmation
    start_speed_m_s: Positive = 8.0  # deviation of each component of the velocity before anything is known
    start_acceleration_m_s2: NotNegative = 0.05  # deviation of a preliminary track's acceleration
    detection_probability: Probability = 0.95  # of a vessel in one look
    false_plots_per_m2: Positive = 3e-7  # in one look, before any is known
    gate: Positive = 13.8  # squared distance of a plot from a track
    max_speed_m_s: Positive = 18.0  # between the first two plots
    confirm_hits: Looks = 3  # M: number of looks with a plot
    confirm_looks: Looks = 4  # N: out of so many looks
    end_misses: Looks = 30  # M_t: number of looks without a plot that end a track
    end_looks: Looks = 32  # N_t: out of so many looks
    end_m: Positive = 400.0  # a track whose position is less certain ends
    end_m_s: Positive = 10.0  # a track whose speed is less certain ends
    mixing: Literal["unbiased", "zero_padding"] = "unbiased"  # the turn rate that CV lacks is that of CTRV, or zero
    start: Literal["cartesian", "literal_start"] = "cartesian"  # preliminary tracks are in velocities, or in course and speed
    stamp: Literal["beam", "frame_time"] = "beam"  # plots have the time of the beam, or that of the end of the cycle
    clutter: ClutterSettings = ClutterSettings(learnt=True, cell_m=500.0)

    @model_validator(mode="after")
    def _hits_fit_into_looks(self) -> Self:
        for hits, looks in (("confirm_hits", "confirm_looks"), ("end_misses", "end_looks")):
            got, most = (self.model_dump()[name] for name in (hits, looks))
            if got > most:
                raise ValueError(f"{hits}: got {got}, needed at most {looks} = {most}")
        return self

    def init(self) -> ImmJpdaMemory:
        return ImmJpdaMemory.empty()

    def step(self, memory: ImmJpdaMemory, given: RegionInput) -> tuple[ImmJpdaMemory, RegionOutput]:
        """The confirmed tracks of one region at the end of a cycle.

        Raises: ValueError where the memory is of a scenario with other radars.
        """
        plots, time_s, sensors, region = given.plots, given.time_s, given.sensors, given.region
        memory, radars, good = self._fitting(memory, given), sensors.radars, is_usable(plots, time_s, AHEAD_S)
        plots = plots.take(good)
        ours = np.flatnonzero(radars.region == region)
        slice_s = min(SLICE_S, 0.5 * float(radars.period_s[ours].min(initial=np.inf)))
        if self.stamp == "frame_time":
            plots = replace(plots, time_s=np.full(len(plots), time_s))
        plots, batches = cut(plots, slice_s, by_radar=True)
        taken = np.full(len(plots), -1)
        for batch in batches:
            radar, rows = int(batch.columns.sensor[0]), slice(batch.first, batch.first + len(batch.columns.time))
            memory.site_m[radar] = plots.site_m[rows][-1]
            memory.newest_plot_s[radar] = max(float(batch.columns.time[-1]), float(memory.newest_plot_s[radar]))
            measured = _Batch(
                batch.columns,
                _polar(batch.columns, memory.site_m[radar]),
                memory.site_m[radar],
                radar,
                float(radars.period_s[radar]),
            )
            memory, taken[rows] = self._take(memory, measured)
            memory = self._end_looks(memory, measured, float(radars.range_m[radar]))
        recent = time_s - memory.confirmed.hit_s <= (self.end_looks + 1) * radars.period_s  # else no look can end it
        confirmed = memory.confirmed.take(np.flatnonzero(recent.any(axis=1)))
        memory = replace(memory, confirmed=confirmed)
        mean, covariance = kernels.filters.unscented.cartesian(confirmed.columns, float(time_s), self._motion)
        columns = radars_of(sensors, region, memory.site_m, memory.newest_plot_s)
        every = np.arange(len(confirmed))
        said = Reported(
            number=confirmed.number,
            updated_s=confirmed.hit_s.max(axis=1, initial=-np.inf),
            started_s=confirmed.started_s,
            origin=kernels.tracks.report.most_frequent_origins(confirmed.origins, np.minimum(confirmed.plots, NEWEST), every),
        )
        now = Estimates(np.full(len(confirmed), time_s), mean, covariance, np.zeros(len(confirmed)))
        tracks = report(now, said, columns, time_s, sensors, region)
        measurements = report_measurements(tracks, taken, plots, sensors, region)
        return memory, RegionOutput(tracks, measurements, StandingEchoes.empty(), int((~good).sum()))

    @property
    def _motion(self) -> MotionRules:
        speed = self.speed_noise_m_s**2
        course, rate = np.radians([self.course_noise_deg, self.rate_noise_deg_s]) ** 2
        noise = np.array([[course, speed], [speed, rate]])
        return MotionRules(np.array([self.straight_s, self.turning_s]), noise, self.mixing == "zero_padding")

    def _start(self, period_s: float) -> StartRules:
        return StartRules(
            gate=self.gate,
            max_speed=self.max_speed_m_s,
            half=0.5 * period_s,
            acceleration=self.start_acceleration_m_s2,
            noise=self._motion.noise[0].copy(),
            in_course=self.start == "literal_start",
        )

    def _fitting(self, memory: ImmJpdaMemory, given: RegionInput) -> ImmJpdaMemory:
        """The memory with arrays for the radars; without tracks where the registration of a radar jumped."""
        radars = given.sensors.radars
        count, known = len(radars), len(memory.newest_plot_s)
        if known not in (0, count):
            raise ValueError(f"memory of radar tracks: got {known} radars, needed {count}")
        if known != count or given.jumped.any():
            memory = replace(ImmJpdaMemory.empty(R=count), next_number=memory.next_number)
        if self.clutter.learnt and not len(memory.clutter.side):
            memory = replace(memory, clutter=empty_map(self.clutter, radars, np.ones(len(radars), np.bool_)))
        return memory

    def _take(self, memory: ImmJpdaMemory, batch: _Batch) -> tuple[ImmJpdaMemory, Ints]:
        """The memory after the plots of a batch, and the number of the confirmed track that took each plot, -1: none. (M,)"""
        columns, plots, radar, known = batch.columns, batch.plots, batch.radar, memory.confirmed
        tracks, count = known.columns, len(columns.time)
        update = kernels.tracks.polar_update
        pairs = update.predict_to_plots(
            tracks, plots, known.hit_s[:, radar].copy(), 0.5 * batch.period_s, batch.site_m, self.gate, self._motion
        )
        per_m2 = np.full(count, self.false_plots_per_m2)
        if self.clutter.learnt:
            per_m2 = false_plots_per_m2(self.clutter, memory.clutter, radar, columns.position, self.false_plots_per_m2)
        within = -float(np.expm1(-0.5 * self.gate))  # P_G, of two numbers
        found = self.detection_probability
        density = per_m2 * plots.polar[:, 0]  # of one metre and one radian
        weight = found * (known.mode_probability[pairs.track] * pairs.likelihood).sum(axis=1)
        weight = weight / ((1.0 - found * within) * density[pairs.plot])
        marginals = kernels.association.marginals
        share = marginals.marginals(pairs.plot, pairs.track, weight, count, len(known), EXACT)
        update.update_by_shares(tracks, plots, pairs, share, batch.site_m)
        by, hit, best = marginals.plots_of_tracks(pairs.plot, pairs.track, share, count, len(known), LIKELY)
        taken = np.append(known.number, -1)[by]
        _record(known, hit, best[hit], columns, radar)
        free = np.bincount(pairs.plot, minlength=count) == 0
        memory = self._begin(memory, batch, free)
        if self.clutter.learnt:
            false = np.where(free, 1.0, np.maximum(1.0 - np.bincount(pairs.plot, share, count), 0.0))
            false[~free & (np.bincount(pairs.plot, minlength=count) == 0)] = 0.0  # a preliminary track took it
            position, period_s = columns.position, batch.period_s
            memory = replace(
                memory, clutter=learn(self.clutter, memory.clutter, radar, columns.time, position, false, period_s)
            )
        return memory, taken

    def _begin(self, memory: ImmJpdaMemory, batch: _Batch, free: Bools) -> ImmJpdaMemory:
        """Plots in no gate go to preliminary tracks, then to tentative ones; the others are tentative tracks. `free` is written."""
        columns, plots, rules, initiation = batch.columns, batch.plots, self._start(batch.period_s), kernels.tracks.initiation
        known, single, radar = memory.preliminary, memory.tentative, batch.radar
        order = np.flatnonzero(known.sensor == radar)
        order = order[np.argsort(-known.hits[order], kind="stable")]
        of = (known.time_s, known.state, known.covariance)
        took = initiation.update_preliminary(of, known.hit_s, order, plots, free, batch.site_m, rules)
        hit = np.flatnonzero(took >= 0)
        at = took[hit]
        known.looks[hit] += 1
        known.hits[hit] += 1
        known.hit_s[hit] = known.looked_s[hit] = columns.time[at]
        known.origin[hit] = columns.origin[at]
        mine = np.flatnonzero(single.sensor == radar)
        of_mine = single.take(mine)
        second = initiation.pair_tentative(of_mine.time_s, of_mine.position_m, of_mine.variance_m2, plots, free, rules)
        begun = self._begun(of_mine.take(second >= 0), second[second >= 0], batch)
        left = np.ones(len(single), np.bool_)
        left[mine[second >= 0]] = False
        rest = np.flatnonzero(free)
        new = Tentative(
            sensor=np.full(len(rest), radar),
            time_s=columns.time[rest],
            position_m=columns.position[rest],
            covariance=columns.covariance[rest],
            variance_m2=np.column_stack([plots.variance[rest, 0], plots.polar[rest, 0] ** 2 * plots.variance[rest, 1]]),
            origin=columns.origin[rest],
        )
        return replace(
            memory,
            preliminary=Preliminary.join([known, begun]),
            tentative=Tentative.join([single.take(left), new]),
        )

    def _begun(self, first: Tentative, second: Ints, batch: _Batch) -> Preliminary:
        """The preliminary tracks of these pairs of plots. Args: first: (B,); second: (B,) rows of the batch."""
        columns, count = batch.columns, len(second)
        dt = np.maximum(columns.time[second] - first.time_s, LEAST_DT_S)[:, None, None]
        position, noise = columns.position[second], columns.covariance[second]
        velocity = (position - first.position_m) / dt[:, :, 0]
        state, covariance = np.hstack([position, velocity]), np.zeros((count, 4, 4))
        covariance[:, :2, :2], covariance[:, :2, 2:], covariance[:, 2:, :2] = noise, noise / dt, noise / dt
        covariance[:, 2:, 2:] = (noise + first.covariance) / dt**2
        if self.start == "literal_start":
            state, covariance = _in_course(state, covariance)
        else:  # velocities by two plots and by those of ships
            own = np.trace(noise, axis1=1, axis2=2) / dt[:, 0, 0] ** 2
            known = self.start_speed_m_s**2 / (self.start_speed_m_s**2 + own)
            state[:, 2:] *= known[:, None]
            covariance[:, :2, 2:] *= known[:, None, None]
            covariance[:, 2:, :2] *= known[:, None, None]
            covariance[:, 2:, 2:] = (known * own)[:, None, None] * np.eye(2)
        newest = columns.time[second]
        none = np.zeros(count, np.int64)
        return Preliminary(
            sensor=first.sensor,
            time_s=newest,
            state=state,
            covariance=covariance,
            looked_s=newest.copy(),
            looks=none,
            hits=none.copy(),
            hit_s=newest.copy(),
            started_s=first.time_s,
            origin=columns.origin[second],
        )

    def _end_looks(self, memory: ImmJpdaMemory, batch: _Batch, range_m: float) -> ImmJpdaMemory:
        """Count the looks of this radar that are over without a plot; confirm tracks, and end those with too few plots."""
        known, waiting, single, radar = memory.confirmed, memory.preliminary, memory.tentative, batch.radar
        newest_s, turn_s = float(memory.newest_plot_s[radar]), batch.period_s
        over = newest_s - (1.0 + SLACK) * turn_s
        best = known.mode_probability.argmax(axis=1)
        place = known.state[np.arange(len(known)), best]
        near = np.hypot(*(place[:, :2] - batch.site_m).T) <= range_m
        for _ in range(self.end_looks):  # with so many missed a track ends
            missed = np.flatnonzero(near & (known.looked_s[:, radar] < over))
            if not len(missed):
                break
            known.looked_s[missed, radar] += turn_s
            known.looks[missed] += 1
            known.hit_bits[missed] = (known.hit_bits[missed] << 1) & ((1 << self.end_looks) - 1)
            until = known.looked_s[missed, radar]
            kernels.filters.unscented.predict_tracks(known.columns, missed, until.copy(), self._motion)
        while True:
            missed = np.flatnonzero(
                (waiting.sensor == radar) & (waiting.looked_s < over) & (waiting.looks < self.confirm_looks)
            )
            if not len(missed):
                break
            waiting.looked_s[missed] += turn_s
            waiting.looks[missed] += 1
        certain = waiting.hits >= self.confirm_hits
        hopeless = waiting.hits + self.confirm_looks - waiting.looks < self.confirm_hits
        new = self._confirmed(waiting.take(certain), memory.next_number, known.looked_s.shape[1])
        kept = known.take(~self._ended(known))
        return replace(
            memory,
            confirmed=Confirmed.join([kept, new]),
            preliminary=waiting.take(~certain & ~hopeless),
            tentative=single.take((single.sensor != radar) | (single.time_s >= over)),
            next_number=memory.next_number + len(new),
        )

    def _ended(self, known: Confirmed) -> Bools:
        """Which tracks end: by looks without a plot, or by their covariance. (N,)"""
        row, best = np.arange(len(known)), known.mode_probability.argmax(axis=1)
        covariance = known.covariance[row, best]
        hits = ((known.hit_bits[:, None] >> np.arange(self.end_looks)) & 1).sum(axis=1)
        misses = np.minimum(known.looks, self.end_looks) - hits
        variance = np.maximum(covariance[:, 0, 0], covariance[:, 1, 1])
        lost = (variance > self.end_m**2) | (covariance[:, SPEED, SPEED] > self.end_m_s**2)
        ended: Bools = lost | (misses >= self.end_misses)
        return ended

    def _confirmed(self, old: Preliminary, number: int, radars: int) -> Confirmed:
        """These preliminary tracks in the filter."""
        count = len(old)
        state, covariance = old.state, old.covariance
        if self.start == "cartesian":
            state, covariance = _in_course(state, covariance)
        both, spread = np.zeros((count, MODELS, 5)), np.zeros((count, MODELS, 5, 5))
        both[:, :, :RATE], spread[:, :, :RATE, :RATE] = state[:, None], covariance[:, None]
        spread[:, 1, RATE, RATE] = np.radians(self.start_rate_deg_s) ** 2
        hit_s, looked_s = np.full((count, radars), -np.inf), np.tile(old.looked_s[:, None], (1, radars))
        hit_s[np.arange(count), old.sensor] = old.hit_s
        origins = np.full((count, NEWEST), -1)
        origins[:, 0] = old.origin
        return Confirmed(
            number=number + np.arange(count),
            time_s=old.time_s,
            state=both,
            covariance=spread,
            mode_probability=np.tile([self.start_straight, 1.0 - self.start_straight], (count, 1)),
            looks=np.ones(count, np.int64),
            hit_bits=np.ones(count, np.int64),
            looked_s=looked_s,
            hit_s=hit_s,
            started_s=old.started_s,
            plots=np.ones(count, np.int64),
            origins=origins,
        )


def _polar(columns: PlotColumns, site_m: Floats) -> PolarPlots:
    """Plots as they were measured from a site."""
    off = columns.position - site_m
    range_m = np.maximum(np.hypot(*off.T), 1.0)
    along = off / range_m[:, None]
    across = np.column_stack([along[:, 1], -along[:, 0]])
    variance = [np.einsum("mi,mij,mj->m", axis, columns.covariance, axis) for axis in (along, across)]
    return PolarPlots(
        columns.time,
        np.ascontiguousarray(columns.position),
        np.column_stack([range_m, np.arctan2(off[:, 0], off[:, 1])]),
        np.column_stack([variance[0], variance[1] / range_m**2]),
    )


def _in_course(state: Floats, covariance: Floats) -> tuple[Floats, Floats]:
    """States and covariances of velocities as those of course and speed, by the Jacobian. (B, 4), (B, 4, 4)"""
    speed = np.maximum(np.hypot(state[:, 2], state[:, 3]), LEAST_SPEED_M_S)
    course = np.arctan2(state[:, 2], state[:, 3])
    sin, cos = np.sin(course), np.cos(course)
    jacobian = np.tile(np.eye(4), (len(state), 1, 1))
    jacobian[:, COURSE, 2], jacobian[:, COURSE, 3] = cos / speed, -sin / speed
    jacobian[:, SPEED, 2], jacobian[:, SPEED, 3] = sin, cos
    return np.column_stack([state[:, :2], course, speed]), jacobian @ covariance @ jacobian.swapaxes(1, 2)


def _record(known: Confirmed, hit: Ints, plot: Ints, columns: PlotColumns, radar: int) -> None:
    """Record that each of these tracks had this plot in its look, in place. Args: hit: (B,) rows; plot: (B,) rows of the batch."""
    known.looks[hit] += 1
    known.hit_bits[hit] = ((known.hit_bits[hit] << 1) | 1) & ((1 << MOST_LOOKS) - 1)
    known.looked_s[hit, radar] = known.hit_s[hit, radar] = columns.time[plot]
    known.plots[hit] += 1
    known.origins[hit, 1:] = known.origins[hit, :-1]
    known.origins[hit, 0] = columns.origin[plot]
