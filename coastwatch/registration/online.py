"""Online registration of radars: azimuth and range bias, time lag, site and scale of range from the AIS vessels that they see."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from coastwatch.batches import Bools, Floats, HullOffsets, Ints, RadarCorrections, RegistrationState, Sensors, Tracks
from coastwatch.geodesy import to_plane
from coastwatch.kernels.tables.lookup import find
from coastwatch.kernels.tables.row_numbers import require_rows
from coastwatch.registration.acquisition import PROBABLE_ODDS, Acquisition, Rules, decide_all
from coastwatch.registration.bearings import WaitingPlots, bearing_equations, waiting_plots
from coastwatch.registration.information import (
    DRIFT_SIGMAS,
    ERRORS,
    SCALE,
    SITE,
    Equations,
    Estimate,
    Information,
    add_equations,
    drift,
    solve,
)
from coastwatch.registration.inputs import RegistrationInput
from coastwatch.registration.noise import PlotScatter, noise_factors, scattered
from coastwatch.registration.polar import (
    ComparedVessels,
    Pairs,
    PolarMeasurements,
    Search,
    Sweeps,
    pair_with_vessels,
    polar_measurements,
    sweeps,
)
from coastwatch.registration.reference_cells import AROUND, AT_REST_M_S, Grid, ReferenceCells, Seen, count_looks, squares
from coastwatch.registration.references import References, draw_references, id_hash
from coastwatch.registration.residuals import (
    GATE_M,
    GATE_SIGMAS,
    EchoShares,
    forgotten,
    plot_equations,
    site_and_scale_differences,
    site_and_scale_units,
)
from coastwatch.stage import Count, Method, NotNegative, Positive, Probability

JUMP_SIGMAS = 2.0  # of a plot: a correction that changes by more leaves tracks in the wrong place
CANDIDATE_SIGMAS = 0.5  # of the azimuth noise: by which the bias of the most evidence may be off
TINY = 1e-30
LAG = 2  # column of the state (azimuth, range, lag, site east, site north, scale)
IS_LAG = np.arange(ERRORS) == LAG
OTHERS = slice(3, 6)  # site and scale
SITE_PRIOR_M, SCALE_PRIOR = (
    100.0,
    0.01,
)  # standard deviations of an error east and north, and of the scale, before anything is known
LEAST_SCALE = 0.002
HALVES_SIGMAS = 3.0  # residuals that contradict the estimate by so much halve the memory; twice this make it 17 times as short
ENDED = 0.05  # of the range noise: a correction of site or scale that is no longer estimated ends when it is so small
MOVES_M, AWAY_M = 1.0, 30.0  # between two plots of a cycle, and from the stated site, which may be rounded: a radar on board


@dataclass(frozen=True, eq=False)
class OnlineMemory:
    """What is known of each radar between two cycles; no row before the first."""

    time_s: float
    references: References  # the vessels that each radar is compared with
    reference_cells: tuple[ReferenceCells, ...]  # of each radar
    acquisition: Acquisition
    shares: EchoShares
    information: Information
    estimate: Estimate  # the solution of the information
    waiting: WaitingPlots
    scatter: PlotScatter
    quiet_s: Floats  # (R,) time without any residual

    @classmethod
    def of_radars(cls, radars: int, estimate: Estimate) -> OnlineMemory:
        """The memory of so many radars before the first cycle. Args: estimate: of no information."""
        return cls(
            time_s=-np.inf,
            references=References.empty(),
            reference_cells=tuple(ReferenceCells.empty() for _ in range(radars)),
            acquisition=Acquisition.empty(R=radars),
            shares=EchoShares.empty(),
            information=Information.empty(),
            estimate=estimate,
            waiting=WaitingPlots.empty(),
            scatter=PlotScatter.empty(),
            quiet_s=np.zeros(radars),
        )

    def check_rows(self) -> None:
        """Check the numbers of radars, as after reading a checkpoint. Raises: ValueError that names the field."""
        for part in (self.references, self.shares, self.information, self.waiting, self.scatter):
            require_rows(f"{type(part).__name__}.radar", part.radar, len(self.acquisition))
        for reference_cells in self.reference_cells:
            require_rows("Hits.reference_cell", reference_cells.hits.reference_cell, len(reference_cells))
            require_rows("Counts.reference_cell", reference_cells.counts.reference_cell, len(reference_cells))


class OnlineRegistration(Method):
    """Acquisition by evidence that adds up over minutes and vessels, then robust recursive least squares.

    - Acquisition: differences between plots and AIS vessels are counted for each vessel and polar cell. Likelihood ratios against the
      plots around a vessel are multiplied to the odds of each bias (`evidence`). Odds of 1 / `false_alarm` without a rival are taken.
    - Tracking: residuals in polar coordinates, weighted with the probability that a plot is the vessel's echo. A lag shows as a
      residual along the motion of the vessel, a wrong site of the radar as one that is the same to all sides.
    - Noise: a radar whose plots scatter about AIS vessels more than it states is taken at the noise that it shows (`noise`).
    - A correction that jumps by more than two standard deviations of a plot ends the tracks that hold plots of that radar.

    Source: Y. Bar-Shalom, P. K. Willett, X. Tian, Tracking and Data Fusion, ch. 9.3 (bias estimation from common targets); V. Vovk,
    R. Wang, E-values: calibration, combination and applications, 2021.
    """

    method: Literal["online"] = "online"
    reference_vessels: Count = 300  # AIS vessels that each radar is compared with, a fixed draw of those in cover
    watch_vessels: Count = 100  # that stay reference vessels of a radar whose bias is found: enough vessels to see a step of it
    azimuth_search_deg: Annotated[float, Field(gt=0.0, le=90.0)] = 20.0  # to each side
    range_search_m: Positive = 200.0  # to each side
    bin_deg: Positive = 0.75  # width in azimuth of the bins in which differences are counted
    decision_s: Positive = 15.0  # between two decisions on a radar
    vote_memory_s: Positive = 1800.0  # time constant of the evidence until a bias is found; then 30 to 120 s, for steps
    false_alarm: Probability = 1e-5  # of one decision: a bias needs odds of 1 / this
    least_vessels: Count = 4  # vessels in cover of a radar; fewer begin no registration
    least_voices: Count = 3  # vessels under way, or squares with vessels at rest, that speak for a bias
    memory_s: Positive = 300.0  # time constant of the least squares; a drift is followed with this delay
    drift_memory_s: Positive = 30.0  # the same while the newest residuals contradict the estimate
    apply_s: Positive = 10.0  # time constant with which corrections follow the estimate
    reference_sigma_m: Positive = 5.0  # per axis, of the offset between an AIS position and its echo; of large ships it is more
    range_prior_m: Positive = 50.0  # standard deviation of a range bias before anything is known
    site_least_m: NotNegative = 10.0  # an error of the site under this is not taken; a large number: none is
    lag_prior_s: Positive = 1.5  # of a lag
    lag_known_s: Positive = 0.25  # a lag is applied when its standard deviation is under this
    settled_share: Positive = 0.25  # settled: the azimuth bias is known to this share of the radar's azimuth noise
    noise_memory_s: NotNegative = 600.0  # time constant of the scatter of plots about AIS vessels; 0: radars err as they state
    use_bearings: bool = True  # of cameras and sonars, to estimate the lag
    drift_deg_h: NotNegative = 0.5  # growth of the azimuth uncertainty while nothing is compared

    def init(self) -> OnlineMemory:
        none = np.zeros((0, ERRORS))
        return OnlineMemory.of_radars(0, Estimate(none, none, np.zeros(0, np.int64), np.zeros(0)))

    def step(self, memory: OnlineMemory, given: RegistrationInput) -> tuple[OnlineMemory, RadarCorrections]:
        """The corrections of each radar for the reports of the next cycle."""
        sensors, corrections, time_s = given.sensors, given.corrections, given.time_s
        if not len(sensors.radars):
            return memory, corrections
        if len(memory.acquisition) != len(sensors.radars):
            none = np.zeros((len(sensors.radars), ERRORS))
            estimate = self._solved(Information.empty(), none[:, :3], none, sensors)
            memory = replace(OnlineMemory.of_radars(len(sensors.radars), estimate), time_s=memory.time_s)
        dt = time_s - memory.time_s if np.isfinite(memory.time_s) else 0.0
        measured = polar_measurements(given.plots, corrections, time_s)
        swept, alarmed = sweeps(measured, sensors), given.alarms.impossible_speed | given.alarms.twice
        references, rows = draw_references(
            memory.references, given.ais_tracks, alarmed, swept.site_deg, sensors, self.reference_vessels
        )
        vessels = ComparedVessels(given.ais_tracks.take(rows.row), rows.radar)
        is_reference = self._reference_vessels(vessels, memory.acquisition.found)
        search = self._search(vessels, swept, is_reference, memory.estimate, corrections, sensors)
        pairs = pair_with_vessels(measured, swept, vessels, corrections, search, sensors)
        group, reference_cells = self._count_looks(
            memory.reference_cells, vessels, is_reference, pairs, measured, swept, dt, sensors
        )
        seen = np.bincount(vessels.radar, minlength=len(sensors.radars))
        rules = Rules(
            self.decision_s, self.vote_memory_s, self.false_alarm, self.least_vessels, self.least_voices, self._grid()
        )
        acquisition, reference_cells = decide_all(
            memory.acquisition, reference_cells, memory.estimate.mean, seen, time_s, rules, sensors
        )
        acquired, found = acquisition.acquired, acquisition.found & ~acquisition.acquired
        information = memory.information.take(~acquired[memory.information.radar])
        memory_s = self._memory_s(information, acquisition, memory.estimate)
        shares = forgotten(memory.shares.take(~acquired[memory.shares.radar]), np.exp(-dt / memory_s))
        sigma_m, moves = self._offsets(vessels.tracks, given.hulls)
        information = information.take(~np.isin(information.reference, group[moves]))
        pairs = pairs.take(found[pairs.radar] & ~moves[pairs.vessel])
        shares, equations = plot_equations(given, measured, pairs, vessels.tracks, group, shares, memory.estimate, sigma_m)
        on_board = _moves(swept, sensors)[equations.radar]
        equations.design[on_board, SITE[0] : SITE[1] + 1] = 0.0  # no error of their site stays
        waiting = memory.waiting
        if self.use_bearings:
            unsure = memory.estimate.sigma[:, LAG] > self.lag_known_s  # AIS tells more, where there is enough of it
            waiting, with_bearings = bearing_equations(waiting_plots(memory.waiting, given, unsure), given)
            equations = Equations.join([equations, with_bearings])
        has_equations = np.bincount(equations.radar, minlength=len(found)) > 0
        keep = np.where(has_equations, np.exp(-dt / memory_s), 1.0)
        mean, keep_newest = memory.estimate.mean / self._units(sensors), float(np.exp(-dt / self.drift_memory_s))
        information = add_equations(information, equations, mean, keep, keep_newest)
        quiet_s = np.where(has_equations | acquired, 0.0, memory.quiet_s + dt)
        former = np.where(acquired[:, None], 0.0, memory.estimate.mean)
        estimate = self._solved(information, acquisition.centre, former, sensors)
        scatter = memory.scatter
        if self.noise_memory_s > 0.0:
            scatter = scattered(scatter, given, references, alarmed, float(np.exp(-dt / self.noise_memory_s)))
        after = OnlineMemory(
            time_s, references, reference_cells, acquisition, shares, information, estimate, waiting, scatter, quiet_s
        )
        return after, self._corrections(after, seen, swept, corrections, dt, sensors)

    def _grid(self) -> Grid:
        """The biases that are searched, in bins."""
        return Grid(float(np.radians(self.azimuth_search_deg)), self.range_search_m, float(np.radians(self.bin_deg)))

    def _units(self, sensors: Sensors) -> Floats:
        """Units of the state (azimuth, range, lag, site east, site north, scale) in the equations. (R, 6)"""
        azimuth, distance = sensors.radars.azimuth_sigma_rad, sensors.radars.range_sigma_m
        return np.column_stack([azimuth, distance, np.ones(len(azimuth)), site_and_scale_units(distance)])

    def _reference_vessels(self, vessels: ComparedVessels, found: Bools) -> Bools:
        """Which vessels are reference vessels: all of a radar whose bias is not found, else a fixed draw. (V,)"""
        order = np.lexsort((id_hash(vessels.tracks.track_id), vessels.radar))
        place = np.empty(len(order), np.int64)
        place[order] = np.arange(len(order)) - np.searchsorted(vessels.radar, vessels.radar)
        is_reference: Bools = ~found[vessels.radar] | (place < self.watch_vessels)
        return is_reference

    def _search(
        self,
        vessels: ComparedVessels,
        swept: Sweeps,
        is_reference: Bools,
        estimate: Estimate,
        corrections: RadarCorrections,
        sensors: Sensors,
    ) -> Search:
        """What is looked for: every bias with reference vessels, what is in the gate of the residuals with the others."""
        r, grid, units = vessels.radar, self._grid(), self._units(sensors)
        wide = np.array([grid.search_m, grid.search_rad + AROUND])
        # Residuals move by the change of the lag; those in azimuth count below one deviation of the noise in a second.
        lag_s = np.abs(estimate.mean[r, LAG] - corrections.time_lag_s[r])
        speed = np.hypot(vessels.tracks.velocity_m_s[:, 0], vessels.tracks.velocity_m_s[:, 1])
        gate = np.column_stack([GATE_M + speed * lag_s, (GATE_SIGMAS + lag_s) * units[r, 0]])
        at = to_plane(vessels.tracks.position_deg, swept.site_deg[r])
        by_others = site_and_scale_differences(np.arctan2(at[:, 0], at[:, 1]), np.hypot(at[:, 0], at[:, 1]))
        expected = estimate.mean[r][:, [1, 0]] + (by_others * estimate.mean[r][:, None, OTHERS]).sum(axis=2)
        centre = np.where(is_reference[:, None], 0.0, expected)
        wide = np.maximum(wide, np.abs(expected) + gate)  # an error that has grown beyond what is searched is followed
        return Search(centre, np.where(is_reference[:, None], wide, gate))

    def _count_looks(
        self,
        reference_cells: tuple[ReferenceCells, ...],
        compared: ComparedVessels,
        is_reference: Bools,
        pairs: Pairs,
        measured: PolarMeasurements,
        swept: Sweeps,
        dt: float,
        sensors: Sensors,
    ) -> tuple[Ints, tuple[ReferenceCells, ...]]:
        """The independent group of each vessel (V,), and the reference cells of each radar after this cycle."""
        radars, vessels, r = sensors.radars, compared.tracks, compared.radar
        at_m = to_plane(vessels.position_deg, swept.site_deg[r])
        square = squares(to_plane(vessels.position_deg, sensors.region_origin_deg[radars.region[r]]))
        at_rest = np.hypot(vessels.velocity_m_s[:, 0], vessels.velocity_m_s[:, 1]) < AT_REST_M_S
        after = []
        for k, mine in enumerate(reference_cells):
            rows = np.flatnonzero((r == k) & is_reference)
            if not len(rows):
                after.append(mine)
                continue
            seen = Seen(vessels.track_id[rows], at_m[rows], square[rows], at_rest[rows])
            at = find(rows, pairs.vessel)
            of_radar = replace(pairs, vessel=at).take(at >= 0)
            period_s = float(radars.period_s[k])
            turns = dt / period_s if dt > 0.0 else 1.0
            after.append(count_looks(mine, seen, of_radar, measured.time_s[of_radar.plot], turns, period_s, self._grid()))
        return np.where(at_rest, square, vessels.track_id), tuple(after)

    def _offsets(self, vessels: Tracks, hulls: HullOffsets) -> tuple[Floats, Bools]:
        """Standard deviation of the distance from each AIS position to its echo, per axis, and whether it changes now. (V,), (V,)"""
        at = find(hulls.mmsi, vessels.mmsi)
        sigma_m, moves = np.append(hulls.sigma_m, 0.0)[at], np.append(hulls.moves, False)[at]
        return np.hypot(self.reference_sigma_m, sigma_m), moves

    def _memory_s(self, information: Information, acquisition: Acquisition, estimate: Estimate) -> Floats:
        """Time constant of the least squares: shorter, the more the newest residuals contradict the estimate. (R,)

        It is as ever where the reference vessels contradict these residuals.
        """
        newest = drift(information, len(acquisition))
        to_candidate = acquisition.azimuth_rad - estimate.mean[:, 0]
        contradicted = np.where(np.isfinite(to_candidate), -np.sign(newest.mean) * to_candidate, 0.0)
        trusted = (newest.sigmas <= DRIFT_SIGMAS) | (contradicted <= 0.5 * self._grid().step_rad)
        least_s = self.drift_memory_s * np.minimum(DRIFT_SIGMAS / np.maximum(newest.sigmas, TINY), 1.0)
        shorter_s = np.maximum(self.memory_s / (1.0 + (newest.sigmas / HALVES_SIGMAS) ** 4), least_s)
        return np.where(trusted, shorter_s, self.memory_s)

    def _solved(self, information: Information, centre: Floats, former: Floats, sensors: Sensors) -> Estimate:
        """The estimate of each radar in rad, m, s, m, m and 1. Args: centre: (R, 3) of the acquisition; former: (R, 6) before."""
        units, n = self._units(sensors), len(centre)
        candidate_sigma = np.hypot(CANDIDATE_SIGMAS * units[:, 0], 0.5 * self._grid().step_rad)
        alike = self.range_prior_m, self.lag_prior_s, SITE_PRIOR_M, SITE_PRIOR_M, SCALE_PRIOR
        prior = np.column_stack([candidate_sigma, *(np.full(n, sigma) for sigma in alike)])
        about = np.column_stack([centre, np.zeros((n, 3))])
        least = np.array([0.0, 0.0, 0.0, self.site_least_m, self.site_least_m, LEAST_SCALE]) / units
        estimate = solve(information, about / units, prior / units, former / units, least)
        return estimate._replace(mean=estimate.mean * units, sigma=estimate.sigma * units)

    def _corrections(
        self, memory: OnlineMemory, seen: Ints, swept: Sweeps, before: RadarCorrections, dt: float, sensors: Sensors
    ) -> RadarCorrections:
        """The next corrections: at once where a bias was acquired, else a step towards the estimate."""
        units, estimate, acquisition = self._units(sensors), memory.estimate, memory.acquisition
        locked, acquired = acquisition.found[:, None], acquisition.acquired[:, None]
        old = _as_array(before)
        # What is no larger than its deviation is more likely noise than error: shrunk by the positive-part James-Stein rule.
        shrunk = estimate.mean * np.maximum(1.0 - estimate.sigma**2 / np.maximum(estimate.mean**2, TINY), 0.0)
        has_others = estimate.mean[:, OTHERS].any(axis=1, keepdims=True)
        shrunk = np.where(has_others, estimate.mean, shrunk)  # its errors are known together rather than one by one
        target = np.where(locked | IS_LAG, shrunk, old)
        target[estimate.sigma[:, LAG] > self.lag_known_s, LAG] = old[estimate.sigma[:, LAG] > self.lag_known_s, LAG]
        new = old + (target - old) * (1.0 - np.exp(-dt / self.apply_s))
        # A bias smaller than the noise of a plot can wait for a better estimate: a radar that is right is not shifted.
        centre = np.column_stack([acquisition.centre, np.zeros((len(old), 3))])
        at_once = acquired & (np.abs(centre - old) > units) & ~IS_LAG
        new = np.where(at_once, centre, np.where(acquired, old, new))
        begins = ((estimate.mean != 0.0) & (old == 0.0))[:, OTHERS].any(axis=1, keepdims=True)
        new = np.where(begins & locked, target, new)
        new[:, OTHERS][(target == 0.0)[:, OTHERS] & (np.abs(new) < ENDED * units)[:, OTHERS]] = 0.0
        moved = (np.abs(new - old) > JUMP_SIGMAS * units) & ~IS_LAG
        sigma = np.where(locked | ((estimate.plots > 0.0)[:, None] & IS_LAG), estimate.sigma, np.nan)
        quiet = np.radians(self.drift_deg_h) * memory.quiet_s / 3600.0
        newest = drift(memory.information, len(acquisition))
        behind = (newest.mean * units[:, 0]) ** 2 * np.maximum(1.0 - 1.0 / np.maximum(newest.sigmas, 1.0) ** 2, 0.0)
        sigma[:, 0] = np.sqrt(sigma[:, 0] ** 2 + quiet**2 + behind)
        return RadarCorrections(
            azimuth_bias_rad=new[:, 0],
            range_bias_m=new[:, 1],
            time_lag_s=new[:, 2],
            estimated_lag_s=np.where(np.isfinite(sigma[:, LAG]), estimate.mean[:, LAG], np.nan),
            azimuth_sigma_rad=sigma[:, 0],
            range_sigma_m=sigma[:, 1],
            lag_sigma_s=sigma[:, 2],
            site_error_m=new[:, list(SITE)],
            site_sigma_m=np.where(sigma[:, list(SITE)] > 0.0, sigma[:, list(SITE)], np.nan),
            range_scale=new[:, SCALE[0]],
            range_scale_sigma=np.where(sigma[:, SCALE[0]] > 0.0, sigma[:, SCALE[0]], np.nan),
            references=estimate.references,
            residuals=estimate.plots,
            state=self._state(memory, sigma[:, 0] / units[:, 0], seen),
            jumped=moved.any(axis=1),
            compared=np.where(np.isfinite(swept.from_s), seen, np.nan),
            candidate_azimuth_rad=acquisition.azimuth_rad,
            candidate_range_m=acquisition.range_m,
            odds=acquisition.odds,
            found_odds=acquisition.found_odds,
            voices=np.where(np.isfinite(acquisition.azimuth_rad), acquisition.groups, np.nan),
            rival_share=acquisition.rival_share,
            noise_factor=noise_factors(memory.scatter, len(seen), self.least_vessels),
        )

    def _state(self, memory: OnlineMemory, sigma_share: Floats, seen: Ints) -> Ints:
        """The state of each radar. Args: sigma_share: (R,) deviation of the azimuth bias over the azimuth noise."""
        acquisition, estimate = memory.acquisition, memory.estimate
        compared = (seen > 0) | (acquisition.begun_s < np.inf) | (estimate.plots > 0.0)
        probable = (
            (acquisition.odds >= PROBABLE_ODDS) & (acquisition.groups >= self.least_voices) & (seen >= self.least_vessels)
        )
        settled = (sigma_share <= self.settled_share) & (estimate.references >= self.least_vessels)
        state = np.where(compared, RegistrationState.ACQUIRING, RegistrationState.UNKNOWN)
        state = np.where(probable, RegistrationState.PROBABLE, state)
        state = np.where(acquisition.found, np.where(settled, RegistrationState.SETTLED, RegistrationState.FOUND), state)
        return np.where(acquisition.found & acquisition.doubtful, RegistrationState.DOUBTFUL, state).astype(np.int64)


def _as_array(corrections: RadarCorrections) -> Floats:
    """What is taken out of the reports of each radar: azimuth rad, range m, lag s, site east and north m, scale. (R, 6)"""
    plain = corrections.azimuth_bias_rad, corrections.range_bias_m, corrections.time_lag_s
    return np.column_stack([*plain, corrections.site_error_m, corrections.range_scale])


def _moves(swept: Sweeps, sensors: Sensors) -> Bools:
    """Which radars are on board: they are not at their stated site, or move from plot to plot. (R,)"""
    off = to_plane(swept.site_deg, sensors.radars.site_deg)
    moves: Bools = (np.hypot(off[:, 0], off[:, 1]) > AWAY_M) | (swept.shift_m > MOVES_M)
    return moves
