"""Registration of radars on line: their azimuth bias, range bias and time lag from the AIS vessels that they see."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from coastwatch.batches import (
    AisAlarms,
    BearingAssociations,
    BearingTracks,
    Bools,
    Floats,
    Ints,
    Measurements,
    Members,
    Picture,
    Plots,
    RadarCorrections,
    RegistrationState,
    Sensors,
    Tracks,
)
from coastwatch.registration import votes
from coastwatch.registration.bearings import Waiting, compare, queue
from coastwatch.registration.evidence import CHANCE, Estimate, Evidence, Rows, Surprise, learn, solve
from coastwatch.registration.residuals import Echoes, Pairs, alone, compared, echoes, in_cover
from coastwatch.registration.votes import Votes
from coastwatch.stage import Method

Positive = Annotated[float, Field(gt=0.0)]
Count = Annotated[int, Field(ge=1)]
Share = Annotated[float, Field(gt=0.0, le=1.0)]

GATE = 13.8  # squared distance that two degrees of freedom exceed once in a thousand
UNSURE_M = 30.0  # an AIS track whose position is less certain is no reference
ACROSS_BINS = 1.5  # from the estimate to a significant window that cannot be the same bias
TRACKS_SIGMAS = 2.0  # of a plot: a correction that changes by more leaves tracks in the wrong place
TINY = 1e-30
NO_LAG = 2  # column of the state


@dataclass(frozen=True, eq=False)
class OnLineMemory:
    """What is known of each radar between two cycles; no row before the first."""

    time_s: float
    votes: Votes
    locked: Bools  # (R,) the bias has been acquired
    centre: Floats  # (R, 3) azimuth rad, range m, lag s at which it was
    evidence: Evidence
    known: Estimate  # what the evidence says
    surprise: Surprise
    waiting: Waiting
    quiet_s: Floats  # (R,) time without any residual


class OnLineRegistration(Method):
    """Acquisition by vote over azimuth, then robust recursive least squares; the estimate is taken over slowly.

    Acquisition: differences of azimuth between plots and AIS vessels at nearly equal range are counted in windows over
    +- `azimuth_search_deg`, each vessel once, until the best window cannot be chance (`false_alarm`). Tracking: residuals in polar
    coordinates of plots gated to one AIS vessel only, with the lag seen by how range and azimuth of moving vessels run ahead.
    A correction that jumps by more than two standard deviations of a plot ends the tracks that hold plots of that radar.
    Source: Y. Bar-Shalom, P. K. Willett, X. Tian, Tracking and Data Fusion, ch. 9.3 (bias estimation from common targets); the vote is
    after P. V. C. Hough's transform, US patent 3069654.
    """

    method: Literal["on_line"] = "on_line"
    azimuth_search_deg: Annotated[float, Field(gt=0.0, le=90.0)] = 20.0  # to each side
    range_search_m: Positive = 200.0  # to each side
    bin_deg: Positive = 0.5  # windows are two bins wide; never less than twice the radar's azimuth noise
    vote_memory_s: Positive = 30.0  # time constant of the votes
    false_alarm: Annotated[float, Field(gt=0.0, lt=1.0)] = (
        1e-6  # that a window is best by chance, vessels and plots evenly spread
    )
    least_vessels: Count = 4  # in cover of a radar; fewer begin no registration
    least_share: Share = 0.5  # of the vessels in cover, that the best window must explain
    memory_s: Positive = 300.0  # time constant of the least squares: a drift is followed so far behind
    drift_memory_s: Positive = 30.0  # the same while the newest residuals contradict the estimate
    apply_s: Positive = 10.0  # time constant with which the estimate is taken over
    reference_sigma_m: Positive = 5.0  # per axis, of what lies between an AIS position and its echo
    range_prior_m: Positive = 50.0  # standard deviation of a range bias before anything is known
    lag_prior_s: Positive = 1.5  # of a lag
    lag_known_s: Positive = 0.25  # a lag is applied when its standard deviation is under this
    settled_share: Positive = 0.25  # settled: the azimuth bias is known to this share of the radar's azimuth noise
    use_bearings: bool = True  # of cameras and sonars, for the lag
    drift_deg_h: Annotated[float, Field(ge=0.0)] = 0.5  # by which an azimuth bias may go off while nothing is compared

    def init(self) -> OnLineMemory:
        nothing = np.zeros((0, 3))
        nobody = Votes.none(0, 1), np.zeros(0, np.bool_), nothing, Evidence.empty()
        return OnLineMemory(
            -np.inf,
            *nobody,
            Estimate(nothing, nothing, np.zeros(0, np.int64), np.zeros(0)),
            Surprise.none(0),
            Waiting.empty(),
            np.zeros(0),
        )

    def step(
        self,
        memory: OnLineMemory,
        plots: Plots,
        ais_tracks: Tracks,
        alarms: AisAlarms,
        measurements: Measurements,
        picture: Picture,
        members: Members,
        bearing_tracks: BearingTracks,
        bearing_associations: BearingAssociations,
        time_s: float,
        sensors: Sensors,
        given: RadarCorrections,
    ) -> tuple[OnLineMemory, RadarCorrections]:
        """What to take out of the reports of each radar in the next cycle.

        Args: plots: of this cycle, in any order, with `given` taken out; ais_tracks, alarms: row by row; time_s: of the cycle.
        Returns: memory; one row a radar.
        """
        memory = self._for(memory, time_s, sensors)
        dt = time_s - memory.time_s if np.isfinite(memory.time_s) else 0.0
        said = echoes(plots, given, time_s, sensors)
        trusted = ~(alarms.impossible_speed | alarms.twice)
        trusted &= np.trace(ais_tracks.known_covariance(1.0)[:, :2, :2], axis1=1, axis2=2) <= UNSURE_M**2
        vessels = ais_tracks.take(trusted)
        search = np.radians(self.azimuth_search_deg)
        pairs = compared(said, vessels, given, self.range_search_m, search, sensors)
        seen = in_cover(said, vessels, sensors)
        counted = self._vote(memory, pairs, seen, dt, sensors)
        locked, centre, found = self._acquire(memory, counted, pairs, sensors)
        evidence = memory.evidence.take(~found[memory.evidence.radar])
        rows = self._rows(said, pairs, vessels, given, memory.known, locked & ~found, sensors)
        waiting, with_bearings = memory.waiting, Rows.empty()
        if self.use_bearings:
            unsure = memory.known.sigma[:, NO_LAG] > self.lag_known_s  # AIS tells more, where there is enough of it
            waiting = queue(memory.waiting, measurements, given, unsure, time_s)
            waiting, with_bearings = compare(waiting, picture, members, bearing_tracks, bearing_associations, sensors)
        rows = Rows.join([rows, with_bearings])
        heard = np.bincount(rows.radar, minlength=len(locked)) > 0
        surprise = memory.surprise.after(
            rows, memory.known.mean / self._units(sensors), float(np.exp(-dt / self.drift_memory_s))
        )
        memory_s = np.where(surprise.sigmas > CHANCE, self.drift_memory_s, self.memory_s)
        evidence = learn(evidence, rows, np.where(heard, np.exp(-dt / memory_s), 1.0))
        quiet_s = np.where(heard | found, 0.0, memory.quiet_s + dt)
        after = OnLineMemory(
            time_s, counted, locked, centre, evidence, self._solved(evidence, centre, sensors), surprise, waiting, quiet_s
        )
        return after, self._corrections(after, found, seen, given, dt, sensors)

    def _for(self, memory: OnLineMemory, time_s: float, sensors: Sensors) -> OnLineMemory:
        """This memory with room for the radars of the scenario."""
        n = len(sensors.radars)
        if len(memory.locked) == n:
            return memory
        windows = int(np.ceil(2.0 * np.radians(self.azimuth_search_deg) / self._bin_rad(sensors))) - 1
        centre, evidence = np.zeros((n, 3)), Evidence.empty()
        nobody = Votes.none(n, max(windows, 1)), np.zeros(n, np.bool_), centre, evidence
        return OnLineMemory(
            memory.time_s, *nobody, self._solved(evidence, centre, sensors), Surprise.none(n), Waiting.empty(), np.zeros(n)
        )

    def _bin_rad(self, sensors: Sensors) -> float:
        return float(max(np.radians(self.bin_deg), 2.0 * sensors.radars.azimuth_sigma_rad.max(initial=0.0)))

    def _units(self, sensors: Sensors) -> Floats:
        """Of the state. (R, 3)"""
        radars = sensors.radars
        return np.column_stack([radars.azimuth_sigma_rad, radars.range_sigma_m, np.ones(len(radars))])

    def _vote(self, memory: OnLineMemory, pairs: Pairs, seen: Ints, dt: float, sensors: Sensors) -> Votes:
        share = np.minimum(dt / sensors.radars.period_s, 1.0) if dt > 0.0 else np.ones(len(seen))
        search, keep = np.radians(self.azimuth_search_deg), float(np.exp(-dt / self.vote_memory_s))
        return votes.add(memory.votes, pairs, self._bin_rad(sensors), search, seen, share, keep)

    def _acquire(self, memory: OnLineMemory, counted: Votes, pairs: Pairs, sensors: Sensors) -> tuple[Bools, Floats, Bools]:
        """Which radars are locked, at what, and which of them now."""
        width = self._bin_rad(sensors)
        best, sure = votes.significant(counted, self.false_alarm, self.least_vessels, self.least_share)
        window = (best + 1.0) * width - np.radians(self.azimuth_search_deg)
        azimuth, distance, count = votes.middle(pairs, window, width, len(best))
        elsewhere = np.abs(window - memory.known.mean[:, 0]) > ACROSS_BINS * width
        found = sure & (count > 0) & (~memory.locked | elsewhere)
        centre = np.where(found[:, None], np.column_stack([azimuth, distance, memory.centre[:, NO_LAG]]), memory.centre)
        return memory.locked | found, centre, found

    def _solved(self, evidence: Evidence, centre: Floats, sensors: Sensors) -> Estimate:
        """The estimate in rad, m and s."""
        units, n = self._units(sensors), len(centre)
        prior = np.column_stack(
            [np.full(n, 2.0 * self._bin_rad(sensors)), np.full(n, self.range_prior_m), np.full(n, self.lag_prior_s)]
        )
        found = solve(evidence, centre / units, prior / units)
        return found._replace(mean=found.mean * units, sigma=found.sigma * units)

    def _rows(
        self,
        said: Echoes,
        pairs: Pairs,
        vessels: Tracks,
        given: RadarCorrections,
        known: Estimate,
        locked: Bools,
        sensors: Sensors,
    ) -> Rows:
        """The equations of the pairs that are inside the gate and belong to nobody else."""
        radars = sensors.radars
        own = self.reference_sigma_m
        r = pairs.radar
        range_sigma = np.sqrt(radars.range_sigma_m[r] ** 2 + pairs.range_variance_m2)
        azimuth_sigma = np.sqrt(radars.azimuth_sigma_rad[r] ** 2 + pairs.across_variance_m2 / pairs.distance_m**2)
        since = known.mean[r, NO_LAG] - given.time_lag_s[r]
        lag_sigma = np.minimum(known.sigma[r, NO_LAG], self.lag_prior_s)
        off_range = pairs.range_m - known.mean[r, 1] + pairs.range_rate_m_s * since
        off_azimuth = pairs.azimuth_rad - known.mean[r, 0] + pairs.azimuth_rate_rad_s * since
        wide_range = range_sigma**2 + own**2 + np.minimum(known.sigma[r, 1], own) ** 2 + (pairs.range_rate_m_s * lag_sigma) ** 2
        wide_azimuth = azimuth_sigma**2 + (own / pairs.distance_m) ** 2 + (pairs.azimuth_rate_rad_s * lag_sigma) ** 2
        wide_azimuth = wide_azimuth + np.minimum(known.sigma[r, 0], azimuth_sigma) ** 2
        inside = locked[r] & (off_range**2 / wide_range + off_azimuth**2 / wide_azimuth <= GATE)
        turn = np.floor(said.time_s[pairs.plot] / radars.period_s[r]).astype(np.int64)
        turn -= turn.min() if len(turn) else 0
        look = (r * (turn.max(initial=0) + 1) + turn) * len(vessels) + pairs.vessel
        good = np.flatnonzero(inside & alone(pairs.plot, inside) & alone(look, inside))
        p, r = pairs.take(good), r[good]
        n, zero = len(p), np.zeros(len(p))
        sigma_r, sigma_a = range_sigma[good], azimuth_sigma[good]
        lag = given.time_lag_s[r]
        along = np.column_stack([zero, radars.range_sigma_m[r], -p.range_rate_m_s]) / sigma_r[:, None]
        across = np.column_stack([radars.azimuth_sigma_rad[r], zero, -p.azimuth_rate_rad_s]) / sigma_a[:, None]
        return Rows(
            radar=np.concatenate([r, r]),
            reference=np.tile(vessels.track_id[p.vessel], 2),
            design=np.concatenate([along, across]),
            own=np.concatenate(
                [np.column_stack([own / sigma_r, zero]), np.column_stack([zero, own / (p.distance_m * sigma_a)])]
            ).reshape(2 * n, 2),
            value=np.concatenate(
                [(p.range_m - p.range_rate_m_s * lag) / sigma_r, (p.azimuth_rad - p.azimuth_rate_rad_s * lag) / sigma_a]
            ),
        )

    def _corrections(
        self,
        memory: OnLineMemory,
        found: Bools,
        seen: Ints,
        given: RadarCorrections,
        dt: float,
        sensors: Sensors,
    ) -> RadarCorrections:
        """The next corrections: at once where a bias was acquired, else a step towards the estimate."""
        units, known = self._units(sensors), memory.known
        old = np.column_stack([given.azimuth_bias_rad, given.range_bias_m, given.time_lag_s])
        # What is no larger than its deviation is more likely noise than error: shrunk by the positive-part James-Stein rule.
        shrunk = known.mean * np.maximum(1.0 - known.sigma**2 / np.maximum(known.mean**2, TINY), 0.0)
        wanted = np.where(memory.locked[:, None] | [False, False, True], shrunk, old)
        wanted[known.sigma[:, NO_LAG] > self.lag_known_s, NO_LAG] = old[known.sigma[:, NO_LAG] > self.lag_known_s, NO_LAG]
        new = old + (wanted - old) * (1.0 - np.exp(-dt / self.apply_s))
        # A bias smaller than the noise of a plot can wait for a better estimate: a radar that is right is not shifted.
        at_once = found[:, None] & (np.abs(memory.centre - old) > units) & [True, True, False]
        new = np.where(at_once, memory.centre, np.where(found[:, None], old, new))
        moved = np.abs(new - old)[:, :2] > TRACKS_SIGMAS * units[:, :2]
        sigma = np.where(memory.locked[:, None] | ((known.plots > 0.0)[:, None] & [False, False, True]), known.sigma, np.nan)
        unseen = np.radians(self.drift_deg_h) * memory.quiet_s / 3600.0
        sigma[:, 0] = np.sqrt(sigma[:, 0] ** 2 + unseen**2 + (memory.surprise.mean * units[:, 0]) ** 2)
        sure = memory.locked & (sigma[:, 0] <= self.settled_share * units[:, 0]) & (known.references >= self.least_vessels)
        hopeful = memory.locked | (seen > 0) | (memory.votes.looked > 0.0) | (known.plots > 0.0)
        state = np.where(sure, RegistrationState.SETTLED, np.where(hopeful, RegistrationState.ACQUIRING, 0))
        return RadarCorrections(
            azimuth_bias_rad=new[:, 0],
            range_bias_m=new[:, 1],
            time_lag_s=new[:, 2],
            estimated_lag_s=np.where(np.isfinite(sigma[:, NO_LAG]), known.mean[:, NO_LAG], np.nan),
            azimuth_sigma_rad=sigma[:, 0],
            range_sigma_m=sigma[:, 1],
            lag_sigma_s=sigma[:, 2],
            references=known.references,
            residuals=known.plots,
            state=state.astype(np.int64),
            jumped=moved[:, 0] | moved[:, 1],
        )
