"""Tracks by particles that are weighed by the video itself; filters that have a vessel push the others away.

Source: F. Heymann, J. Hoth, P. Banys, G. Siegert, Validation of Radar Image Tracking Algorithms with Simulated Data, section 3.3. Equation
(10) has no distance and does nothing after normalisation: here the weight falls with the distance from other filters.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, Literal, NamedTuple

import numpy as np
from pydantic import Field

from coastwatch.batches import Floats, Measurements, Plots, StandingEchoes, Tracks
from coastwatch.geodesy import to_plane
from coastwatch.kernels.filters.gaussian import Estimates
from coastwatch.stage import Count, NotNegative, Positive, Probability
from coastwatch.tracks.radar.region import RadarMethod, RegionInput, RegionOutput, is_usable
from coastwatch.tracks.radar.report import Reported, radars_of, report
from coastwatch.tracks.radar.repulsive_particles.memory import TURN_RAD, Particles, ParticlesMemory, Window

AHEAD_S = 5.0  # a plot stamped more than this after the cycle is dropped
STREAM, STARTS = 91, 92  # of random numbers
WIDEST_RAD = np.radians(30.0)  # half of the widest cloud that is looked at on time
KEPT_RAD = 2.0 * WIDEST_RAD + np.radians(4.0)  # of spokes in the memory
MARGIN_RAD = np.radians(2.0)
LEAST_DB, MOST_DB = -10.0, 25.0  # of a cell over the background, that count; outside the range nothing is seen
LEAST_START_DB = 0.5  # of all plots together: there is nothing to begin at
SMOOTHED = 0.2  # weight of a look in the level of a filter
PART_M = 150.0  # between two searches
POWER = 4  # of the repulsion
SIGMAS = 3.0  # of another filter, within which it pushes
MOST_TURNS = 5.0  # without a look, after which a filter ends: the video has stopped


class _Look(NamedTuple):
    """When the beam passes a filter."""

    time_s: float
    angle: float
    row: int


class RepulsiveParticles(RadarMethod):
    """Particle filters of course and speed on radar video, one a vessel. It cannot part vessels nearer than 250 m.

    Of a paper, for comparison.

    Particles are weighed by the level over the background in three by three cells. A few filters search at a time. `literal_equation`
    is as printed, which is as `none`; `start = "uniform"` begins filters anywhere in range, and needs cycles of one turn.
    """

    method: Literal["repulsive_particles"] = "repulsive_particles"
    particles: Annotated[int, Field(ge=10, le=100_000)] = 1000  # number in each filter
    seed: Annotated[int, Field(ge=0)] = 0  # whole number that all randomness starts from
    course_noise_deg: NotNegative = 1.0  # deviation of the course after a turn
    speed_noise_m_s: NotNegative = 0.12  # deviation of the speed after a turn
    position_noise_m: NotNegative = 3.0  # deviation per axis after a turn
    start_m: Positive = 30.0  # deviation around the plot where a filter begins
    start_speed_m_s: Positive = 12.0  # largest speed at the start
    sharpness: Positive = 0.5  # natural logarithm of the factor of the weight for each decibel over the background
    blind_m: NotNegative = 350.0  # nothing is looked for nearer to the radar
    searching: Count = 3  # number of filters that look for a vessel at a time; of the paper 1
    acquire_m: Positive = 60.0  # a filter that stays narrower than this has a vessel
    acquire_looks: Count = 5  # after so many looks
    end_m: Positive = 150.0  # a filter that is wider has lost its vessel
    least_db: NotNegative = 6.5  # of a vessel over the background
    repulsion: Literal["distance", "literal_equation", "none"] = "distance"
    reach_m: Positive = 50.0  # least deviation of a filter that pushes
    end_share: Probability = 0.3  # a filter whose mean keeps less of its weight is in the place of another, and ends
    start: Literal["plots", "uniform"] = "plots"  # filters begin at plots, or anywhere in range

    @property
    def takes_video(self) -> bool:
        """It takes video; plots only say where filters begin."""
        return True

    def init(self) -> ParticlesMemory:
        """No filter."""
        return ParticlesMemory.empty(P=self.particles)

    def step(self, memory: ParticlesMemory, given: RegionInput) -> tuple[ParticlesMemory, RegionOutput]:
        """The filters of one region that have a vessel, at the end of a cycle.

        Raises: ValueError where the memory is of other radars, or of another number of particles.
        """
        radars, count = given.sensors.radars, len(given.sensors.radars)
        if memory.filters.particle.shape[1] != self.particles:
            raise ValueError(f"memory of particles: got {memory.filters.particle.shape[1]} a filter, needed {self.particles}")
        if len(memory.site_m) not in (0, count):
            raise ValueError(f"memory of radar tracks: got {len(memory.site_m)} radars, needed {count}")
        if len(memory.site_m) != count or given.jumped.any():
            fresh = ParticlesMemory.empty(P=self.particles, R=count)
            memory = replace(fresh, next_filter=memory.next_filter, next_number=memory.next_number)
        origin_deg, good = given.sensors.region_origin_deg[given.region], is_usable(given.plots, given.time_s, AHEAD_S)
        usable = given.plots.take(good)
        for video in given.video:
            if not len(video):
                continue
            radar = video.sensor
            memory.site_m[radar] = to_plane(video.site_deg[-1], origin_deg)
            before = memory.windows.get(radar)
            empty = Window(video.first_m, video.cell_m, np.zeros(0), np.zeros(0), video.half_db[:0])
            window = (before or empty).with_spokes(video)
            of_later = (memory.filters.sensor == radar) & (
                memory.filters.looked_s > window.time_s[-1]
            )  # its clock was set back
            memory = replace(memory, filters=memory.filters.take(~of_later))
            period_s, range_m = float(radars.period_s[radar]), float(radars.range_m[radar])
            memory = self._looked(memory, window, radar, period_s, range_m)
            plots = usable.take(usable.sensor == radar)
            memory = self._begun(memory, window, radar, plots, period_s)
            memory = self._looked(memory, window, radar, period_s, range_m)
            memory = replace(memory, windows={**memory.windows, radar: window.newest(KEPT_RAD)})
        filters = memory.filters
        looked = given.time_s - filters.looked_s <= MOST_TURNS * radars.period_s[filters.sensor]
        memory = replace(memory, filters=filters.take(looked))
        tracks = self._reported(memory, given)
        return memory, RegionOutput(tracks, Measurements.empty(), StandingEchoes.empty(), int((~good).sum()))

    def _looked(self, memory: ParticlesMemory, window: Window, radar: int, period_s: float, range_m: float) -> ParticlesMemory:
        """The memory after all looks whose spokes have come, one after the other."""
        while True:
            filters, site_m = memory.filters, memory.site_m[radar]
            mine = np.flatnonzero(filters.sensor == radar)
            looks = [look for row in mine.tolist() if (look := self._next_look(filters, row, window, site_m, period_s))]
            if not looks:
                return memory
            look = min(looks)
            ended, memory = self._look(memory, window, look, period_s, range_m)
            if ended:
                kept = np.arange(len(filters)) != look.row
                memory = replace(memory, filters=memory.filters.take(kept))

    def _next_look(self, filters: Particles, row: int, window: Window, site_m: Floats, period_s: float) -> _Look | None:
        """When the beam passed a filter after its last look, if all spokes around are there."""
        mean = filters.particle[row, :, :2].mean(axis=0) - site_m
        away, azimuth = float(np.hypot(*mean)), float(np.arctan2(mean[0], mean[1]))
        half = min(3.0 * float(filters.sigma_m[row]) / max(away, 1.0), float(WIDEST_RAD)) + float(MARGIN_RAD)
        if half > WIDEST_RAD:  # it may be anywhere
            azimuth, half = float(window.angle[-1]) - 0.5 * TURN_RAD, 0.5 * TURN_RAD
        after_s = float(filters.looked_s[row]) + 0.5 * period_s
        since = float(np.interp(after_s, window.time_s, window.angle)) if after_s > window.time_s[0] else float(window.angle[0])
        angle = azimuth + TURN_RAD * np.ceil((since - azimuth) / TURN_RAD)
        if angle + half > window.angle[-1] + 1e-9 or after_s > window.time_s[-1]:
            return None
        return _Look(float(np.interp(angle, window.angle, window.time_s)), float(angle), row)

    def _look(
        self, memory: ParticlesMemory, window: Window, look: _Look, period_s: float, range_m: float
    ) -> tuple[bool, ParticlesMemory]:
        """Move, weigh and resample one filter, in place. Returns: whether it ends, and the memory."""
        f, row, n = memory.filters, look.row, self.particles
        random = np.random.default_rng([self.seed, STREAM, int(f.number[row]), int(f.looks[row])])
        x, dt = f.particle[row], max(look.time_s - float(f.time_s[row]), 0.0)
        noise = np.sqrt(dt / period_s) * random.standard_normal((n, 4))
        x[:, 2] += np.radians(self.course_noise_deg) * noise[:, 2]
        x[:, 3] = np.abs(x[:, 3] + self.speed_noise_m_s * noise[:, 3])
        x[:, 0] += x[:, 3] * np.sin(x[:, 2]) * dt + self.position_noise_m * noise[:, 0]
        x[:, 1] += x[:, 3] * np.cos(x[:, 2]) * dt + self.position_noise_m * noise[:, 1]
        site_m = memory.site_m[f.sensor[row]]
        over = _over(window, x[:, :2] - site_m, look.angle)
        away = np.hypot(*(x[:, :2] - site_m).T)
        weight = np.exp(self.sharpness * np.clip(over, 0.0, MOST_DB)) * ((away < range_m) & (away > self.blind_m))
        kept = self._kept(f, x[:, :2], int(f.number[row]), look.time_s)
        total = float((weight * kept).sum())
        if not total > 0.0:
            return True, memory
        at = np.searchsorted(np.cumsum(weight * kept / total), (np.arange(n) + random.random()) / n).clip(0, n - 1)
        f.particle[row] = x = x[at]
        bright, mean = float(np.median(over[at])), x[:, :2].mean(axis=0)
        sigma_m = float(np.sqrt(np.linalg.eigvalsh(np.cov(x[:, :2].T))[-1]))
        f.time_s[row] = f.looked_s[row] = look.time_s
        f.looks[row] += 1
        f.sigma_m[row] = sigma_m
        f.bright[row] = bright if np.isnan(f.bright[row]) else f.bright[row] + SMOOTHED * (bright - f.bright[row])
        narrow = sigma_m < self.acquire_m and bright > self.least_db
        f.good[row] = f.good[row] + 1 if narrow else 0
        if self._kept(f, mean[None], int(f.number[row]), look.time_s)[0] < self.end_share:
            return True, memory  # weights are normalised within a filter: repulsion moves none that is wholly inside
        if f.acquired[row]:
            f.acquired[row] = sigma_m < self.end_m and f.bright[row] > self.least_db
        elif f.good[row] >= self.acquire_looks:
            f.acquired[row] = True
            if f.acquired_number[row] < 0:
                f.acquired_number[row] = memory.next_number
                memory = replace(memory, next_number=memory.next_number + 1)
        waits = self.start == "uniform" and f.acquired_number[row] < 0
        return not (f.acquired[row] or f.good[row] or waits), memory

    def _kept(self, f: Particles, position_m: Floats, number: int, time_s: float) -> Floats:
        """What points keep of their weight beside the acquired filters that are older than this one. (n,)"""
        out = np.ones(len(position_m))
        if (
            self.repulsion != "distance"
        ):  # (10) is one number for all particles of a filter, and goes when weights are normalised
            return out
        for row in np.flatnonzero(f.acquired & (f.number < number)).tolist():
            x = f.particle[row]
            velocity = (x[:, 3:] * np.column_stack([np.sin(x[:, 2]), np.cos(x[:, 2])])).mean(axis=0)
            there = x[:, :2].mean(axis=0) + (time_s - f.time_s[row]) * velocity
            reach = SIGMAS * max(float(f.sigma_m[row]), self.reach_m)
            out *= (1.0 - np.exp(-((position_m - there) ** 2).sum(axis=1) / (2.0 * reach**2))) ** POWER
        return out

    def _begun(self, memory: ParticlesMemory, window: Window, radar: int, plots: Plots, period_s: float) -> ParticlesMemory:
        """The memory with as many searches as there may be, at plots of this cycle that are bright and nobody's."""
        site_m, n = memory.site_m[radar], self.particles
        reach_m = float(window.first_m + window.cell_m * window.half_db.shape[1])  # the far edge of the video
        bright = np.zeros(len(plots))
        for k, (time_s, position) in enumerate(zip(plots.time_s.tolist(), plots.position_m, strict=True)):
            angle = float(np.interp(time_s, window.time_s, window.angle))
            bright[k] = max(float(_over(window, position[None] - site_m, angle)[0]), 0.0)
            bright[k] *= float(self._kept(memory.filters, position[None], memory.next_filter, time_s)[0])
        wanted = self.searching - int((~memory.filters.acquired & (memory.filters.sensor == radar)).sum())
        for _ in range(max(wanted, 0)):
            f = memory.filters
            random = np.random.default_rng([self.seed, STARTS, memory.next_filter])
            x = np.empty((n, 4))
            if self.start == "uniform":
                every, away = random.uniform(-np.pi, np.pi, n), np.sqrt(random.random(n)) * reach_m
                x[:, :2] = site_m + away[:, None] * np.column_stack([np.sin(every), np.cos(every)])
                time_s, origin = float(window.time_s[-1]), -1
                looked_s = time_s - 0.25 * period_s
            else:
                for row in np.flatnonzero(~f.acquired).tolist():  # nor where another one searches
                    apart = np.hypot(*(plots.position_m - f.particle[row, :, :2].mean(axis=0)).T)
                    bright = np.where(apart > PART_M, bright, 0.0)
                if bright.sum() < LEAST_START_DB:
                    break
                at = int(random.choice(len(bright), p=bright / bright.sum()))
                x[:, :2] = plots.position_m[at] + self.start_m * random.standard_normal((n, 2))
                time_s, origin = float(plots.time_s[at]), int(plots.origin[at])
                looked_s = time_s - 0.75 * period_s
            x[:, 2], x[:, 3] = random.uniform(-np.pi, np.pi, n), random.uniform(0.0, self.start_speed_m_s, n)
            sigma_m = float(np.sqrt(np.linalg.eigvalsh(np.cov(x[:, :2].T))[-1]))
            new = Particles(
                number=np.array([memory.next_filter]),
                sensor=np.array([radar]),
                particle=x[None],
                time_s=np.array([time_s]),
                looked_s=np.array([looked_s]),
                looks=np.zeros(1, np.int64),
                good=np.zeros(1, np.int64),
                acquired=np.zeros(1, np.bool_),
                bright=np.full(1, np.nan),
                sigma_m=np.array([sigma_m]),
                started_s=np.array([time_s]),
                origin=np.array([origin]),
                acquired_number=np.array([-1]),
            )
            memory = replace(memory, filters=Particles.join([f, new]), next_filter=memory.next_filter + 1)
        return memory

    def _reported(self, memory: ParticlesMemory, given: RegionInput) -> Tracks:
        """The acquired filters, moved to the end of the cycle."""
        f = memory.filters.take(memory.filters.acquired)
        f = f.take(np.argsort(f.acquired_number, kind="stable"))
        sensors, region, time_s = given.sensors, given.region, given.time_s
        mean, covariance = np.zeros((len(f), 4)), np.zeros((len(f), 4, 4))
        x = f.particle
        velocity = x[:, :, 3:] * np.stack([np.sin(x[:, :, 2]), np.cos(x[:, :, 2])], axis=2)
        now = np.concatenate([x[:, :, :2] + (time_s - f.time_s)[:, None, None] * velocity, velocity], axis=2)
        if len(f):
            mean = now.mean(axis=1)
            off = now - mean[:, None]
            covariance = np.einsum("fpi,fpj->fij", off, off) / (self.particles - 1)
        radars = radars_of(sensors, region, memory.site_m)
        said = Reported(f.acquired_number, f.looked_s, f.started_s, f.origin)
        return report(
            Estimates(np.full(len(f), time_s), mean, covariance, np.zeros(len(f))), said, radars, time_s, sensors, region
        )


def _over(window: Window, off_m: Floats, angle: float) -> Floats:
    """The mean level over the background in three by three cells around each point, dB. (n,)

    Args: off_m: (n, 2) from the radar; angle: of the beam in this turn, within half a turn of the points.
    """
    away, azimuth = np.hypot(*off_m.T), np.arctan2(off_m[:, 0], off_m[:, 1])
    turned = angle + (azimuth - angle + np.pi) % TURN_RAD - np.pi
    after = np.searchsorted(window.angle, turned).clip(0, len(window) - 1)
    before = np.maximum(after - 1, 0)
    nearest = np.where(turned - window.angle[before] < window.angle[after] - turned, before, after)
    cell = np.floor((away - window.first_m) / window.cell_m).astype(np.int64)
    spokes, cells = window.half_db.shape
    step = (window.angle[-1] - window.angle[0]) / max(spokes - 1, 1)
    seen = (np.abs(window.angle[nearest] - turned) <= 2.0 * step) & (cell >= 0) & (cell < cells)
    total = np.zeros(len(off_m))
    for spoke in (-1, 0, 1):
        for beside in (-1, 0, 1):
            total += window.half_db[(nearest + spoke).clip(0, spokes - 1), (cell + beside).clip(0, cells - 1)]
    return np.where(seen, total / 18.0, LEAST_DB)
