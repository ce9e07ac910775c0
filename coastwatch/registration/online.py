"""Online registration of radars: azimuth bias, range bias and time lag from the AIS vessels that they see."""

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
from coastwatch.kernels.tables.row_numbers import require_rows
from coastwatch.registration.bearings import WaitingPlots, bearing_equations, waiting_plots
from coastwatch.registration.hough import Accumulator, accumulate, detect_peak, window_medians
from coastwatch.registration.information import DRIFT_SIGMAS, DriftTest, Equations, Estimate, Information, add_equations, solve
from coastwatch.registration.polar import (
    Pairs,
    PolarMeasurements,
    is_only_one,
    pair_with_vessels,
    polar_measurements,
    sweeps,
)
from coastwatch.registration.references import References, draw_references
from coastwatch.stage import Method

Positive = Annotated[float, Field(gt=0.0)]
Count = Annotated[int, Field(ge=1)]
Share = Annotated[float, Field(gt=0.0, le=1.0)]

GATE = 13.8  # squared distance that two degrees of freedom exceed once in a thousand
OTHER_BIAS_BINS = 1.5  # from the estimate to a significant window that cannot be the same bias
JUMP_SIGMAS = 2.0  # of a plot: a correction that changes by more leaves tracks in the wrong place
TINY = 1e-30
LAG = 2  # column of the state (azimuth, range, lag)


@dataclass(frozen=True, eq=False)
class OnlineMemory:
    """What is known of each radar between two cycles; no row before the first."""

    time_s: float
    references: References  # the vessels that each radar is compared with
    votes: Accumulator
    locked: Bools  # (R,) the bias has been acquired
    centre: Floats  # (R, 3) azimuth rad, range m, lag s at which it was
    information: Information
    estimate: Estimate  # the solution of the information
    drift_test: DriftTest
    waiting: WaitingPlots
    quiet_s: Floats  # (R,) time without any residual

    def check_rows(self) -> None:
        """Check the numbers of radars, as after reading a checkpoint. Raises: ValueError that names the field."""
        for part in (self.information, self.waiting):
            require_rows(f"{type(part).__name__}.radar", part.radar, len(self.locked))


class OnlineRegistration(Method):
    """Acquisition by a Hough transform over azimuth, then robust recursive least squares; corrections follow the estimate slowly.

    - Acquisition: azimuth differences between plots and AIS vessels at nearly equal range are counted in windows over
      +- `azimuth_search_deg`, each vessel once. The best window is accepted when it cannot be chance (`false_alarm`).
    - Tracking: residuals in polar coordinates, of plots with one AIS vessel in their gate. A lag shows as a residual along the
      motion of the vessel.
    - A correction that jumps by more than two standard deviations of a plot ends the tracks that hold plots of that radar.

    Source: Y. Bar-Shalom, P. K. Willett, X. Tian, Tracking and Data Fusion, ch. 9.3 (bias estimation from common targets); the vote is
    after P. V. C. Hough's transform, US patent 3069654.
    """

    method: Literal["online"] = "online"
    reference_vessels: Count = 300  # AIS vessels that each radar is compared with, a fixed draw of those in cover
    azimuth_search_deg: Annotated[float, Field(gt=0.0, le=90.0)] = 20.0  # to each side
    range_search_m: Positive = 200.0  # to each side
    bin_deg: Positive = 0.5  # windows are two bins wide; never less than twice the radar's azimuth noise
    vote_memory_s: Positive = 30.0  # time constant of the votes
    false_alarm: Annotated[float, Field(gt=0.0, lt=1.0)] = (
        1e-6  # that a window is best by chance, vessels and plots evenly spread
    )
    least_vessels: Count = 4  # vessels in cover of a radar; fewer begin no registration
    least_share: Share = 0.5  # of the vessels in cover, that the best window must explain
    memory_s: Positive = 300.0  # time constant of the least squares; a drift is followed with this delay
    drift_memory_s: Positive = 30.0  # the same while the newest residuals contradict the estimate
    apply_s: Positive = 10.0  # time constant with which corrections follow the estimate
    reference_sigma_m: Positive = 5.0  # per axis, of the offset between an AIS position and its echo
    range_prior_m: Positive = 50.0  # standard deviation of a range bias before anything is known
    lag_prior_s: Positive = 1.5  # of a lag
    lag_known_s: Positive = 0.25  # a lag is applied when its standard deviation is under this
    settled_share: Positive = 0.25  # settled: the azimuth bias is known to this share of the radar's azimuth noise
    use_bearings: bool = True  # of cameras and sonars, to estimate the lag
    drift_deg_h: Annotated[float, Field(ge=0.0)] = 0.5  # growth of the azimuth uncertainty while nothing is compared

    def init(self) -> OnlineMemory:
        none = np.zeros((0, 3))
        return OnlineMemory(
            time_s=-np.inf,
            references=References.empty(),
            votes=Accumulator.none(0, 1),
            locked=np.zeros(0, np.bool_),
            centre=none,
            information=Information.empty(),
            estimate=Estimate(none, none, np.zeros(0, np.int64), np.zeros(0)),
            drift_test=DriftTest.none(0),
            waiting=WaitingPlots.empty(),
            quiet_s=np.zeros(0),
        )

    def step(
        self,
        memory: OnlineMemory,
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
    ) -> tuple[OnlineMemory, RadarCorrections]:
        """The corrections of each radar for the reports of the next cycle.

        Args: plots: of this cycle, in any order, with the corrections `given` applied; ais_tracks, alarms: row by row; time_s: its end.
        Returns: memory; one row a radar.
        """
        if not len(sensors.radars):
            return memory, given
        memory = self._sized(memory, time_s, sensors)
        dt = time_s - memory.time_s if np.isfinite(memory.time_s) else 0.0
        measured = polar_measurements(plots, given, time_s)
        swept, alarmed = sweeps(measured, sensors), alarms.impossible_speed | alarms.twice
        drawn = draw_references(memory.references, ais_tracks, alarmed, swept.site_deg, sensors, self.reference_vessels)
        references, compared = drawn
        vessels, search = ais_tracks.take(compared.row), (self.range_search_m, float(np.radians(self.azimuth_search_deg)))
        pairs = pair_with_vessels(measured, swept, vessels, compared.radar, given, search, sensors)
        votes = self._vote(memory, pairs, compared.radar, dt, sensors)
        locked, centre, acquired = self._acquire(memory, votes, pairs, sensors)
        information = memory.information.take(~acquired[memory.information.radar])
        equations = self._plot_equations(measured, pairs, vessels, given, memory.estimate, locked & ~acquired, sensors)
        waiting = memory.waiting
        if self.use_bearings:
            unsure = memory.estimate.sigma[:, LAG] > self.lag_known_s  # AIS tells more, where there is enough of it
            seen = picture, members, bearing_associations
            waiting = waiting_plots(memory.waiting, measurements, *seen, given, unsure, time_s)
            waiting, with_bearings = bearing_equations(waiting, picture, members, bearing_tracks, bearing_associations, sensors)
            equations = Equations.join([equations, with_bearings])
        has_equations = np.bincount(equations.radar, minlength=len(locked)) > 0
        mean, keep = memory.estimate.mean / self._units(sensors), float(np.exp(-dt / self.drift_memory_s))
        drift_test = memory.drift_test.after(equations, mean, keep)
        memory_s = np.where(drift_test.sigmas > DRIFT_SIGMAS, self.drift_memory_s, self.memory_s)
        information = add_equations(information, equations, np.where(has_equations, np.exp(-dt / memory_s), 1.0))
        quiet_s = np.where(has_equations | acquired, 0.0, memory.quiet_s + dt)
        estimate = self._solved(information, centre, sensors)
        after = OnlineMemory(time_s, references, votes, locked, centre, information, estimate, drift_test, waiting, quiet_s)
        return after, self._corrections(after, acquired, compared.radar, given, dt, sensors)

    def _sized(self, memory: OnlineMemory, time_s: float, sensors: Sensors) -> OnlineMemory:
        """This memory with one row for each radar of the scenario."""
        n = len(sensors.radars)
        if len(memory.locked) == n:
            return memory
        windows = int(np.ceil(2.0 * np.radians(self.azimuth_search_deg) / self._bin_rad(sensors))) - 1
        centre, information = np.zeros((n, 3)), Information.empty()
        return OnlineMemory(
            time_s=memory.time_s,
            references=References.empty(),
            votes=Accumulator.none(n, max(windows, 1)),
            locked=np.zeros(n, np.bool_),
            centre=centre,
            information=information,
            estimate=self._solved(information, centre, sensors),
            drift_test=DriftTest.none(n),
            waiting=WaitingPlots.empty(),
            quiet_s=np.zeros(n),
        )

    def _bin_rad(self, sensors: Sensors) -> float:
        """Width of a bin of the vote, the same for all radars."""
        return float(max(np.radians(self.bin_deg), 2.0 * sensors.radars.azimuth_sigma_rad.max(initial=0.0)))

    def _units(self, sensors: Sensors) -> Floats:
        """Units of the state (azimuth, range, lag) in the equations. (R, 3)"""
        radars = sensors.radars
        return np.column_stack([radars.azimuth_sigma_rad, radars.range_sigma_m, np.ones(len(radars))])

    def _vote(self, memory: OnlineMemory, pairs: Pairs, radar_of_vessel: Ints, dt: float, sensors: Sensors) -> Accumulator:
        """The votes after this cycle."""
        share = np.minimum(dt / sensors.radars.period_s, 1.0) if dt > 0.0 else np.ones(len(sensors.radars))
        search, keep = np.radians(self.azimuth_search_deg), float(np.exp(-dt / self.vote_memory_s))
        return accumulate(memory.votes, pairs, radar_of_vessel, self._bin_rad(sensors), search, share, keep)

    def _acquire(self, memory: OnlineMemory, votes: Accumulator, pairs: Pairs, sensors: Sensors) -> tuple[Bools, Floats, Bools]:
        """Which radars have a bias that was acquired, its centre, and which of them acquired it now. (R,), (R, 3), (R,)"""
        width = self._bin_rad(sensors)
        best, is_bias = detect_peak(votes, self.false_alarm, self.least_vessels, self.least_share)
        window = (best + 1.0) * width - np.radians(self.azimuth_search_deg)
        azimuth, distance, count = window_medians(pairs, window, width, len(best))
        elsewhere = np.abs(window - memory.estimate.mean[:, 0]) > OTHER_BIAS_BINS * width
        acquired = is_bias & (count > 0) & (~memory.locked | elsewhere)
        centre = np.where(acquired[:, None], np.column_stack([azimuth, distance, memory.centre[:, LAG]]), memory.centre)
        return memory.locked | acquired, centre, acquired

    def _solved(self, information: Information, centre: Floats, sensors: Sensors) -> Estimate:
        """The estimate of each radar in rad, m and s."""
        units, n = self._units(sensors), len(centre)
        prior = np.column_stack(
            [np.full(n, 2.0 * self._bin_rad(sensors)), np.full(n, self.range_prior_m), np.full(n, self.lag_prior_s)]
        )
        found = solve(information, centre / units, prior / units)
        return found._replace(mean=found.mean * units, sigma=found.sigma * units)

    def _plot_equations(
        self,
        measured: PolarMeasurements,
        pairs: Pairs,
        vessels: Tracks,
        given: RadarCorrections,
        estimate: Estimate,
        locked: Bools,
        sensors: Sensors,
    ) -> Equations:
        """The equations of pairs inside the gate whose plot has no other vessel and whose vessel no other plot in a turn."""
        radars, r = sensors.radars, pairs.radar
        offset_sigma = self.reference_sigma_m
        range_sigma = np.sqrt(radars.range_sigma_m[r] ** 2 + pairs.range_variance_m2)
        azimuth_sigma = np.sqrt(radars.azimuth_sigma_rad[r] ** 2 + pairs.across_variance_m2 / pairs.distance_m**2)
        lag_change = estimate.mean[r, LAG] - given.time_lag_s[r]
        lag_sigma = np.minimum(estimate.sigma[r, LAG], self.lag_prior_s)
        range_residual = pairs.range_m - estimate.mean[r, 1] + pairs.range_rate_m_s * lag_change
        azimuth_residual = pairs.azimuth_rad - estimate.mean[r, 0] + pairs.azimuth_rate_rad_s * lag_change
        range_variance = range_sigma**2 + offset_sigma**2 + np.minimum(estimate.sigma[r, 1], offset_sigma) ** 2
        range_variance = range_variance + (pairs.range_rate_m_s * lag_sigma) ** 2
        azimuth_variance = azimuth_sigma**2 + (offset_sigma / pairs.distance_m) ** 2
        azimuth_variance = azimuth_variance + (pairs.azimuth_rate_rad_s * lag_sigma) ** 2
        azimuth_variance = azimuth_variance + np.minimum(estimate.sigma[r, 0], azimuth_sigma) ** 2
        distance2 = range_residual**2 / range_variance + azimuth_residual**2 / azimuth_variance
        inside = locked[r] & (distance2 <= GATE)
        turn = np.floor(measured.time_s[pairs.plot] / radars.period_s[r]).astype(np.int64)
        turn -= turn.min() if len(turn) else 0
        vessel_in_turn = turn * len(vessels) + pairs.vessel
        good = np.flatnonzero(inside & is_only_one(pairs.plot, inside) & is_only_one(vessel_in_turn, inside))
        good = good[
            np.lexsort((measured.time_s[pairs.plot[good]], pairs.vessel[good]))
        ]  # sums do not depend on the order of arrival

        p, r = pairs.take(good), r[good]
        n, zero, lag = len(p), np.zeros(len(p)), given.time_lag_s[r]
        range_sigma, azimuth_sigma = range_sigma[good], azimuth_sigma[good]
        along = np.column_stack([zero, radars.range_sigma_m[r], -p.range_rate_m_s]) / range_sigma[:, None]
        across = np.column_stack([radars.azimuth_sigma_rad[r], zero, -p.azimuth_rate_rad_s]) / azimuth_sigma[:, None]
        along_offset = np.column_stack([offset_sigma / range_sigma, zero])
        across_offset = np.column_stack([zero, offset_sigma / (p.distance_m * azimuth_sigma)])
        along_value = (p.range_m - p.range_rate_m_s * lag) / range_sigma
        across_value = (p.azimuth_rad - p.azimuth_rate_rad_s * lag) / azimuth_sigma
        return Equations(
            radar=np.concatenate([r, r]),
            reference=np.tile(vessels.track_id[p.vessel], 2),
            design=np.concatenate([along, across]),
            offset=np.concatenate([along_offset, across_offset]).reshape(2 * n, 2),
            value=np.concatenate([along_value, across_value]),
        )

    def _corrections(
        self,
        memory: OnlineMemory,
        acquired: Bools,
        radar_of_vessel: Ints,
        given: RadarCorrections,
        dt: float,
        sensors: Sensors,
    ) -> RadarCorrections:
        """The next corrections: at once where a bias was acquired, else a step towards the estimate."""
        units, estimate = self._units(sensors), memory.estimate
        old = np.column_stack([given.azimuth_bias_rad, given.range_bias_m, given.time_lag_s])
        # What is no larger than its deviation is more likely noise than error: shrunk by the positive-part James-Stein rule.
        shrunk = estimate.mean * np.maximum(1.0 - estimate.sigma**2 / np.maximum(estimate.mean**2, TINY), 0.0)
        target = np.where(memory.locked[:, None] | [False, False, True], shrunk, old)
        target[estimate.sigma[:, LAG] > self.lag_known_s, LAG] = old[estimate.sigma[:, LAG] > self.lag_known_s, LAG]
        new = old + (target - old) * (1.0 - np.exp(-dt / self.apply_s))
        # A bias smaller than the noise of a plot can wait for a better estimate: a radar that is right is not shifted.
        at_once = acquired[:, None] & (np.abs(memory.centre - old) > units) & [True, True, False]
        new = np.where(at_once, memory.centre, np.where(acquired[:, None], old, new))
        moved = np.abs(new - old)[:, :2] > JUMP_SIGMAS * units[:, :2]
        sigma = np.where(
            memory.locked[:, None] | ((estimate.plots > 0.0)[:, None] & [False, False, True]), estimate.sigma, np.nan
        )
        drift = np.radians(self.drift_deg_h) * memory.quiet_s / 3600.0
        sigma[:, 0] = np.sqrt(sigma[:, 0] ** 2 + drift**2 + (memory.drift_test.mean * units[:, 0]) ** 2)
        settled = (
            memory.locked & (sigma[:, 0] <= self.settled_share * units[:, 0]) & (estimate.references >= self.least_vessels)
        )
        seen = np.bincount(radar_of_vessel, minlength=len(units))
        acquiring = memory.locked | (seen > 0) | (memory.votes.swept > 0.0) | (estimate.plots > 0.0)
        state = np.where(settled, RegistrationState.SETTLED, np.where(acquiring, RegistrationState.ACQUIRING, 0))
        return RadarCorrections(
            azimuth_bias_rad=new[:, 0],
            range_bias_m=new[:, 1],
            time_lag_s=new[:, 2],
            estimated_lag_s=np.where(np.isfinite(sigma[:, LAG]), estimate.mean[:, LAG], np.nan),
            azimuth_sigma_rad=sigma[:, 0],
            range_sigma_m=sigma[:, 1],
            lag_sigma_s=sigma[:, 2],
            references=estimate.references,
            residuals=estimate.plots,
            state=state.astype(np.int64),
            jumped=moved[:, 0] | moved[:, 1],
        )
