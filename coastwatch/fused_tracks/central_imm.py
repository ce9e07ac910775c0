"""Fused tracks by one filter a vessel that takes the plots and reports behind the tracks."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar, Literal, NamedTuple

import numpy as np

from coastwatch import kernels
from coastwatch.batches import (
    Bools,
    Floats,
    FusedTracks,
    Ints,
    Measurements,
    Rows,
    SourceKind,
    Struct,
    Tracks,
    VesselBearings,
    column,
)
from coastwatch.fused_tracks.covariance_intersection import intersect
from coastwatch.fused_tracks.inputs import FusionInput, FusionMethod
from coastwatch.fused_tracks.vessel_tracks import Estimates, VesselTracks
from coastwatch.geodesy import difference_m, offset_deg
from coastwatch.kernels.threads import in_blocks
from coastwatch.stage import NotNegative, Positive, PositiveShare

Four = tuple[Positive, Positive, Positive, Positive]

MODELS = 4  # steady, changing speed, agile: constant velocity; turning: coordinated turn
FEW = 512  # fewer filters are not worth a thread
ALONG_M = 1e5  # standard deviation of a bearing along the line of sight: 1000 times what any vessel is known to
LEAST_GAIN = 0.25  # of the variance of an AIS track: a smaller difference from it is not tested more narrowly
LESS_CERTAIN = 2.0  # times the variance of its AIS track: a filter above that is not reported
SEARCH_STEPS = 16  # of the covariance intersection at which a filter begins
JUMP_FACTORS = 2.0 ** np.arange(0.0, 3.5, 0.5)  # times the size of a jump that is stated: what is compared
SOJOURN_FACTORS = np.array([1 / 16, 1 / 4, 1.0, 4.0, 16.0])  # times the time in the steady model that is stated
JUMP_DOUBT, SOJOURN_DOUBT = 2.0, 1.0  # log-likelihood by which each step from what is stated must be better
ROUNDED = 2.0**20  # evidence is summed in units of one over this


@dataclass(frozen=True, eq=False)
class VesselFilters(Struct):
    """The filters of F vessels, each in the plane at its anchor, and which tracks are in them."""

    anchor_deg: Floats = column(np.float64, "F", 2)
    state: Floats = column(np.float64, "F", "J", 5)
    covariance: Floats = column(np.float64, "F", "J", 5, 5)
    mode_probability: Floats = column(np.float64, "F", "J")
    updated_s: Floats = column(np.float64, "F")  # time of the newest measurement
    judged_s: Floats = column(np.float64, "F")  # time up to which jumps of the velocity are decided
    track_id: Ints = column(np.int64, "L")  # every track of the last cycle, in its order
    filter_of_track: Rows = column(np.int32, "L", rows_of="F", least=-1)  # -1 where none
    held_id: Ints = column(np.int64, "H")  # vessels without tracks whose filters bearings continue, sorted
    held_filter: Ints = column(np.int64, "H", rows_of="F")
    held_since_s: Floats = column(np.float64, "H")
    evidence: Floats = column(np.float64, "A")  # log-likelihood of each alternative of jumps and sojourns, over all vessels
    learnt_s: float = -np.inf  # time of the evidence

    @property
    def arrays(self) -> tuple[Floats, Floats, Floats, Floats, Floats]:
        """State, covariance, mode probability and times of each filter, as the kernels take them."""
        return self.state, self.covariance, self.mode_probability, self.updated_s, self.judged_s


class FilterPlan(NamedTuple):
    """Which filters of the last cycle are continued, and which begin."""

    continued: Ints  # (G,) vessels whose filters are continued: the first filters of this cycle; held ones come last
    before: Ints  # (G,) their filters of the last cycle
    new: Ints  # (B,) vessels of several tracks whose filters begin: the filters after those
    filter_of_track: Rows  # (N,) -1 where none
    track_of_measurement: Rows  # (M,) -1 where it is not among them
    held_id: Ints  # (H,) vessels without tracks whose filters are continued, sorted
    held_since_s: Floats  # (H,)


class CentralImm(FusionMethod):
    """One IMM a vessel over the plots and AIS reports in its tracks, so that no error counts twice.

    - Models: steady (constant velocity, which may jump), changing speed, agile, turning.
    - `velocity_jump_m_s` and the steady model's `sojourn_s` are priors, from the simulated scenario `context-driven-1000`: a jump of
      0.15 m/s a minute. Water and ships differ, so a centre learns both from the velocities that its vessels with AIS report.
      Jumps of 1 to 8 times the prior and sojourns of 1/16 to 16 times it are weighed by their likelihood. Each step from the prior
      must be likelier by a factor (7 and 2.7), so few vessels change little. A vessel whose AIS has an alarm, or whose filter
      contradicts its AIS, teaches nothing.
    - A filter begins when a vessel gets a second track, at the covariance intersection of its tracks. The estimate of a vessel that
      never had two tracks is its track.
    - A filter is continued while all its measurements are of one vessel, also on plots alone after the loss of AIS. If a vessel
      splits, both parts begin again.
    - If AIS is in the vessel, shares of a plot's variance are added along and across the beam. The registration error of a radar is
      the same in every plot, and would otherwise outweigh the AIS.
    - A plot that contradicts the filter of a vessel with AIS counts less: it may be an echo of another vessel (`plot_doubt`).
    - A vessel is reported as its AIS track where the filter contradicts that track (`ais_doubt`), or is far less certain. An efficient
      estimate differs from a consistent one by the difference of their covariances. So plots of a neighbour, or of a radar that errs
      more than it states, hardly make the vessel worse than its AIS. That track counts as no surer than one report: of a vessel that
      moves more than its model says it is too sure.
    - A velocity that AIS reports decides whether the vessel has jumped since the last one. Plots decide it in vessels without AIS,
      and after a minute without a report.
    - A late report is moved to the filter's time by the velocity.
    - A bearing that is of the vessel with `bearing_probability` moves the filter across the line of sight. A vessel that has lost
      its tracks goes on by bearings for `bearing_hold_s`. Its filter begins with the first bearing, if it has but one track.

    Source: P. Rangel et al., Enhancing Performance and Reliability in Maritime Target Fusion Through a Context-Driven Approach,
    section III-F (fusion by IMM); Y. Bar-Shalom, P. K. Willett, X. Tian, Tracking and Data Fusion, 2011, section 8.2 (central fusion);
    J. A. Hausman, Specification tests in econometrics, Econometrica 46(6), 1978 (difference of two estimates).
    """

    of_measurements: ClassVar[bool] = True
    method: Literal["central_imm"] = "central_imm"
    noise_m2_s3: tuple[NotNegative, NotNegative, NotNegative, NotNegative] = (1e-5, 3e-3, 0.2, 1e-5)  # density of acceleration
    sojourn_s: Four = (600.0, 300.0, 1000.0, 3000.0)  # mean time in each model; the first is a prior
    share: Four = (0.4, 0.1, 0.1, 0.4)  # of each model where a filter begins
    velocity_jump_m_s: NotNegative = 0.2  # prior: standard deviation of a velocity jump of a steady vessel, per axis
    velocity_jump_interval_s: Positive = 60.0  # mean time between velocity jumps
    learning_memory_s: NotNegative = 3600.0  # time constant of the evidence of motion; 0: the priors hold
    turn_rate_noise_rad2_s3: NotNegative = 3e-10  # density of the drift of the turn rate
    turn_rate_sigma_deg_s: Positive = 0.5  # of turn rates before anything is known
    range_registration: NotNegative = 0.5  # share of a plot's variance along the beam that is added where AIS is in the vessel
    azimuth_registration: NotNegative = 1.5  # share of the variance across the beam, the same
    plot_doubt: Positive = 9.2  # normalised innovation squared from which a plot counts less, where AIS is in the vessel
    ais_doubt: Positive = 9.2  # normalised squared distance from the AIS track at which the vessel is reported as that track
    unknown_velocity_sigma_m_s: Positive = 0.5  # of tracks that come without covariance
    bearing_probability: PositiveShare = 0.99  # least, of bearings that are used; 1: none
    bearing_gate_sigmas: Positive = 4.0  # bearings farther from the filter are not used
    bearing_floor_m: NotNegative = 5.0  # standard deviation across the line of sight beside that of the bearing: the hull
    bearing_pause_s: NotNegative = (
        6.0  # after a plot or report for which bearings less certain than the filter are not used; 0: all are
    )
    bearing_registration: NotNegative = 20.0  # times the variance of the sensor's bias is added: all bearings share it
    bearing_hold_s: NotNegative = 180.0  # longest that bearings alone continue a vessel; 0: not at all

    def init(self) -> VesselFilters:
        """No filter."""
        return VesselFilters.empty(J=MODELS, A=len(JUMP_FACTORS) + len(SOJOURN_FACTORS))

    def step(self, memory: VesselFilters, given: FusionInput) -> tuple[VesselFilters, FusedTracks]:
        """One estimate a vessel: memory, and one row for each vessel number.

        Those of the associations come first, then those that only bearings name, with NaN where no filter is continued.
        """
        tracks, associations, bearings, time_s = given.tracks, given.associations, given.bearings, given.time_s
        vessels, kind = VesselTracks.of(associations), given.kinds[tracks.source]
        count = max(vessels.vessel_count, int(bearings.vessel.max(initial=-1)) + 1)
        if count == 0:
            return replace(self.init(), evidence=memory.evidence, learnt_s=memory.learnt_s), FusedTracks.empty()
        certain = self.bearing_probability < 1.0
        bearings = bearings.take(np.flatnonzero((bearings.probability >= self.bearing_probability) & certain))
        plan = plan_filters(memory, vessels, associations.vessel, tracks, given.measurements, bearings)
        plan = self._with_held(memory, plan, bearings, vessels.vessel_count, time_s)
        has_ais = np.bincount(associations.vessel, kind == SourceKind.AIS, count) > 0
        reported = np.bincount(associations.vessel, kind == SourceKind.RADAR, count) > 0
        reported[: vessels.vessel_count] |= vessels.size > 1
        reported[vessels.vessel_count :] = True
        first = intersect(vessels.take(plan.new), tracks, self.unknown_velocity_sigma_m_s, SEARCH_STEPS)
        filters = self._filters(memory, plan, tracks, first, time_s)
        models = self._models(memory.evidence)
        tracked_s = np.full(count, -np.inf)
        np.maximum.at(tracked_s, associations.vessel, tracks.updated_s)
        evidence = self._update(
            filters, plan, given.measurements, has_ais[plan.continued], tracked_s[plan.continued], bearings, models
        )
        out = self._single_tracks(vessels, tracks, count)
        for estimate, of_tracks in zip(out, first, strict=True):
            estimate[plan.new] = of_tracks
        self._report(filters, plan, reported, time_s, models, out)
        contradicted = self._leave_to_ais(tracks, associations.vessel, kind, out)
        wrong = np.isin(tracks.track_id, given.alarms.track_id[given.alarms.twice | given.alarms.impossible_speed])
        teaches = ~np.isin(plan.continued, np.append(contradicted, associations.vessel[wrong]))
        return self._learnt(memory, filters, evidence[teaches], time_s), out.at_time(time_s)

    def _learnt(self, memory: VesselFilters, filters: VesselFilters, evidence: Floats, time_s: float) -> VesselFilters:
        """The filters with the evidence of the last cycles and of this one: (G, A + B) of the vessels that teach.

        The sum is of whole numbers, so that it is the same in every order of the vessels.
        """
        if self.learning_memory_s == 0.0:
            return filters
        sound = np.isfinite(evidence).all(axis=1)
        new = np.rint(evidence[sound] * ROUNDED).astype(np.int64).sum(axis=0) / ROUNDED
        keep = np.exp(-(time_s - memory.learnt_s) / self.learning_memory_s) if np.isfinite(memory.learnt_s) else 0.0
        return replace(filters, evidence=keep * memory.evidence + new, learnt_s=time_s)

    def learnt_motion(self, evidence: Floats) -> tuple[float, float]:
        """Standard deviation of a velocity jump (m/s) and mean time in the steady model (s) by this evidence (A + B,)."""
        of_jumps, of_sojourns = np.split(evidence, [len(JUMP_FACTORS)])
        jump, sojourn = (
            _mean_factor(JUMP_FACTORS, of_jumps, JUMP_DOUBT),
            _mean_factor(SOJOURN_FACTORS, of_sojourns, SOJOURN_DOUBT),
        )
        return self.velocity_jump_m_s * jump, self.sojourn_s[0] * sojourn

    def _with_held(
        self, memory: VesselFilters, plan: FilterPlan, bearings: VesselBearings, vessels: int, time_s: float
    ) -> FilterPlan:
        """The plan with the filters of vessels that have lost their tracks, but not their bearings, after those continued."""
        lost = np.flatnonzero(bearings.vessel >= vessels)
        held_id, one = np.unique(bearings.vessel_id[lost], return_index=True)
        one = lost[one]
        at = kernels.tables.match_ids.index_of(memory.held_id, held_id)
        of_track = kernels.tables.match_ids.index_of(memory.track_id, bearings.track_id[one])
        filter_of_track = np.append(memory.filter_of_track, -1)[of_track]
        before = np.where(at >= 0, np.append(memory.held_filter, -1)[at], filter_of_track)
        since_s = np.where(at >= 0, np.append(memory.held_since_s, time_s)[at], time_s)
        held = np.flatnonzero((before >= 0) & (time_s - since_s < self.bearing_hold_s))
        begun = plan.filter_of_track >= len(plan.continued)
        return FilterPlan(
            np.append(plan.continued, bearings.vessel[one[held]]),
            np.append(plan.before, before[held]),
            plan.new,
            np.where(begun, plan.filter_of_track + len(held), plan.filter_of_track).astype(np.int32),
            plan.track_of_measurement,
            held_id[held],
            since_s[held],
        )

    def _filters(
        self, memory: VesselFilters, plan: FilterPlan, tracks: Tracks, first: Estimates, time_s: float
    ) -> VesselFilters:
        """The filters of the last cycle that are continued, then the new ones, at the first estimates (B) of their vessels."""
        old = len(plan.continued)
        columns = memory.anchor_deg, *memory.arrays
        anchor, state, covariance, mode, updated, judged = (
            _continued(column, plan.before, len(plan.new)) for column in columns
        )
        anchor[old:], state[old:, :, 2:4] = first.position_deg, first.velocity_m_s[:, None]
        covariance[old:, :, :4, :4] = first.covariance[:, None]
        covariance[old:, :, 4, 4] = np.radians(self.turn_rate_sigma_deg_s) ** 2
        mode[old:], updated[old:], judged[old:] = np.array(self.share) / sum(self.share), time_s, time_s
        return VesselFilters(
            anchor_deg=anchor,
            state=state,
            covariance=covariance,
            mode_probability=mode,
            updated_s=updated,
            judged_s=judged,
            track_id=tracks.track_id,
            filter_of_track=plan.filter_of_track,
            held_id=plan.held_id,
            held_filter=np.arange(old - len(plan.held_id), old),
            held_since_s=plan.held_since_s,
            evidence=memory.evidence,
        )

    def _update(
        self,
        filters: VesselFilters,
        plan: FilterPlan,
        measurements: Measurements,
        has_ais: Bools,
        tracked_s: Floats,
        bearings: VesselBearings,
        models: Any,
    ) -> Floats:
        """Update the continued filters (G) by the measurements of their vessels' tracks, and by bearings.

        Args: has_ais: (G,) whether AIS is in each; tracked_s: (G,) of the newest plot or report; models: (J,) MODEL.
        Returns: (G, A + B) evidence of each for the alternatives.
        """
        count = len(plan.continued)
        filter_of = np.append(plan.filter_of_track, -1)[plan.track_of_measurement]
        mine = np.flatnonzero((filter_of >= 0) & (filter_of < count))
        mine = mine[np.lexsort((measurements.sensor[mine], measurements.time_s[mine], filter_of[mine]))]
        m, filter_of, kernel = measurements.take(mine), filter_of[mine], kernels.filters.fused_filters
        z = np.concatenate([difference_m(m.position_deg, filters.anchor_deg[filter_of]), m.velocity_m_s], axis=1)
        noise = np.zeros((len(m), 4, 4))
        noise[:, :2, :2], noise[:, 2:, 2:] = m.covariance[:, :2, :2], m.covariance[:, 2:, 2:]
        plots = np.flatnonzero((m.sensor >= 0) & has_ais[filter_of])
        noise[plots, :2, :2] += self._registration(m.take(plots))
        doubt = np.full(len(m), np.inf)
        doubt[plots] = self.plot_doubt
        decides = np.isfinite(z[:, 2]) | ~has_ais[filter_of]
        measured = kernel.TimedMeasurements(m.time_s, z, noise, doubt, decides)
        if len(bearings) > 0:
            of_line, lines = self._across_lines_of_sight(filters, plan, bearings, has_ais, tracked_s)
            filter_of = np.append(filter_of, of_line)
            both = kernel.TimedMeasurements(*(np.concatenate(pair) for pair in zip(measured, lines, strict=True)))
            order = np.lexsort((both.time, filter_of))
            filter_of, measured = filter_of[order], kernel.TimedMeasurements(*(column[order] for column in both))
        begin = np.searchsorted(filter_of, np.arange(count + 1))
        jumps, sojourns = self.velocity_jump_m_s * JUMP_FACTORS, self.sojourn_s[0] * SOJOURN_FACTORS
        evidence = np.zeros((count, len(jumps) + len(sojourns)))
        compared = kernel.Alternatives(jumps**2, sojourns)
        in_blocks(kernel.update, count, filters.arrays, measured, begin, models, compared, evidence, least=FEW)
        return evidence

    def _across_lines_of_sight(
        self, filters: VesselFilters, plan: FilterPlan, bearings: VesselBearings, has_ais: Bools, tracked_s: Floats
    ) -> tuple[Ints, kernels.filters.fused_filters.TimedMeasurements]:
        """Filter (B,) and TimedMeasurements of the bearings of continued filters that are in the gate.

        All bearings of a camera share its error of a vessel, the hull and the place on it that is seen. So those less certain than a
        filter that plots or reports keep would drag it. Args: has_ais, tracked_s: (G,) as of `_update`.
        """
        filter_of_vessel = np.full(int(bearings.vessel.max()) + 1, -1)
        named = plan.continued < len(filter_of_vessel)
        filter_of_vessel[plan.continued[named]] = np.flatnonzero(named)
        filter_of = filter_of_vessel[bearings.vessel]
        some = np.flatnonzero((filter_of >= 0) & np.isfinite(bearings.time_s))
        filter_of, b = filter_of[some], bearings.take(some)
        before = kernels.filters.imm.estimate_filters(*(column[filter_of] for column in filters.arrays[:3]))
        variance = b.variance + self.bearing_registration * b.bias_variance
        site_m = difference_m(b.site_deg, filters.anchor_deg[filter_of])
        ahead_s = b.time_s - filters.updated_s[filter_of]
        position, noise, near, better = _bearing_positions(
            before, ahead_s, site_m, b.bearing_rad, variance, self.bearing_floor_m, self.bearing_gate_sigmas
        )
        near &= better | (b.time_s >= tracked_s[filter_of] + self.bearing_pause_s) | (self.bearing_pause_s == 0.0)
        order = np.flatnonzero(near)
        order = order[np.lexsort((b.bearing_rad[order], b.time_s[order], filter_of[order]))]
        z, full = np.full((len(order), 4), np.nan), np.zeros((len(order), 4, 4))
        z[:, :2], full[:, :2, :2] = position[order], noise[order]
        of, undoubted = filter_of[order], np.full(len(order), np.inf)
        return of, kernels.filters.fused_filters.TimedMeasurements(b.time_s[order], z, full, undoubted, ~has_ais[of])

    def _registration(self, plots: Measurements) -> Floats:
        """Covariance of the error of registration of plots: shares of their variance along and across the beam. (M, 2, 2)"""
        beam = difference_m(plots.position_deg, plots.site_deg)
        along = beam / np.maximum(np.hypot(beam[:, 0], beam[:, 1]), 1.0)[:, None]
        across = np.column_stack([-along[:, 1], along[:, 0]])
        out = np.zeros((len(plots), 2, 2))
        for share, axis in ((self.range_registration, along), (self.azimuth_registration, across)):
            variance = (axis[:, None] @ plots.covariance[:, :2, :2] @ axis[:, :, None])[:, 0, 0]
            out += (share * variance)[:, None, None] * axis[:, :, None] * axis[:, None, :]
        return out

    def _report(
        self, filters: VesselFilters, plan: FilterPlan, reported: Bools, time_s: float, models: Any, out: Estimates
    ) -> None:
        """Put the anchors of the continued filters where their vessels are, and write the estimates of those vessels.

        A vessel of AIS alone is reported as its track. Args: reported: (V,) whether a vessel is reported by its filter.
        """
        count = len(plan.continued)
        mean, covariance = np.empty((count, 5)), np.empty((count, 5, 5))
        kernel = kernels.filters.fused_filters.estimate
        in_blocks(kernel, count, filters.arrays, float(time_s), models, mean, covariance, least=FEW)
        filters.anchor_deg[:count] = offset_deg(filters.anchor_deg[:count], mean[:, :2])
        filters.state[:count, :, :2] -= mean[:, None, :2]
        chosen = np.flatnonzero(reported[plan.continued])
        vessel = plan.continued[chosen]
        out.position_deg[vessel], out.velocity_m_s[vessel] = filters.anchor_deg[chosen], mean[chosen, 2:4]
        out.covariance[vessel] = covariance[chosen, :4, :4]

    def _leave_to_ais(self, tracks: Tracks, vessel: Ints, kind: Ints, out: Estimates) -> Ints:
        """Write the most certain AIS track of each vessel whose estimate contradicts it, is far less certain, or is not finite.

        Args: vessel, kind: (N,) of each track. Returns: those that contradict it.
        """
        ais = np.flatnonzero((kind == SourceKind.AIS) & np.isfinite(tracks.covariance).all(axis=(1, 2)))
        ais = ais[np.lexsort((np.trace(tracks.covariance[ais, :2, :2], axis1=1, axis2=2), vessel[ais]))]
        of, first = np.unique(vessel[ais], return_index=True)
        ais = ais[first]
        unsound = ~np.isfinite(out.covariance[of].sum(axis=(1, 2)) + out.position_deg[of].sum(axis=1))
        of_ais, of_report = tracks.covariance[ais, :2, :2], tracks.report_covariance[ais]
        surer = np.trace(of_ais, axis1=1, axis2=2) < np.trace(of_report, axis1=1, axis2=2)
        of_ais = np.where(surer[:, None, None], of_report, of_ais)  # its model of motion may be too quiet
        of_fused = np.where(unsound[:, None, None], of_ais, out.covariance[of, :2, :2])
        variance, axes = np.linalg.eigh(of_ais - of_fused)
        apart_m = np.einsum("nij,ni->nj", axes, difference_m(tracks.position_deg[ais], out.position_deg[of]))
        ais_m2, fused_m2 = (np.trace(covariance, axis1=1, axis2=2) for covariance in (of_ais, of_fused))
        distance = np.sum(apart_m**2 / np.maximum(variance, LEAST_GAIN * ais_m2[:, None] / 2.0), axis=1)
        left = unsound | (distance > self.ais_doubt) | (fused_m2 > LESS_CERTAIN * ais_m2)
        contradicts: Ints = of[unsound | (distance > self.ais_doubt)]
        of, ais = of[left], ais[left]
        out.position_deg[of], out.velocity_m_s[of] = tracks.position_deg[ais], tracks.velocity_m_s[ais]
        out.covariance[of] = tracks.covariance[ais]
        return contradicts

    def _single_tracks(self, vessels: VesselTracks, tracks: Tracks, count: int) -> Estimates:
        """So many estimates, of which those of vessels of one track are written: they are that track. Those without are NaN."""
        out, single = Estimates.empty(count), np.flatnonzero(vessels.size == 1)
        for estimate in out:
            estimate[vessels.vessel_count :] = np.nan
        track = tracks.take(vessels.row[vessels.start[single]])
        out.position_deg[single], out.velocity_m_s[single] = track.position_deg, track.velocity_m_s
        out.covariance[single] = track.known_covariance(self.unknown_velocity_sigma_m_s)
        return out

    def _models(self, evidence: Floats) -> Any:
        """The models as the kernels take them, with what this evidence says of the steady one. (J,) MODEL"""
        jump_m_s, sojourn_s = self.learnt_motion(evidence)
        models = kernels.filters.motion_models
        return models.table(
            kind=[models.STRAIGHT, models.STRAIGHT, models.STRAIGHT, models.TURNING],
            noise=self.noise_m2_s3,
            manoeuvre_noise=[0.0, 0.0, 0.0, self.turn_rate_noise_rad2_s3],
            manoeuvre_sigma=np.radians(self.turn_rate_sigma_deg_s),
            sojourn=[sojourn_s, *self.sojourn_s[1:]],
            jump_rate=[1.0 / self.velocity_jump_interval_s, 0.0, 0.0, 0.0],
            jump_variance=[jump_m_s**2, 0.0, 0.0, 0.0],
        )


def _mean_factor(factor: Floats, evidence: Floats, doubt: float) -> float:
    """The geometric mean of factors by their evidence, and a prior by which each step from 1 is less likely."""
    steps = np.abs(np.arange(len(factor)) - np.flatnonzero(factor == 1.0))
    weight = evidence - doubt * steps
    weight = np.exp(weight - weight.max())
    return float(np.exp(np.log(factor) @ weight / weight.sum()))


def _continued(column: Floats, rows: Ints, new: int) -> Floats:
    """These rows of a column, and zero rows for new filters."""
    out = np.empty((len(rows) + new, *column.shape[1:]))
    np.take(column, rows, axis=0, out=out[: len(rows)], mode="clip")  # else numpy takes into an array of its own first
    out[len(rows) :] = 0.0
    return out


def plan_filters(
    memory: VesselFilters,
    vessels: VesselTracks,
    vessel: Ints,
    tracks: Tracks,
    measurements: Measurements,
    bearings: VesselBearings,
) -> FilterPlan:
    """Decide which filters of the last cycle are continued.

    A filter is continued if all of its tracks that still exist are in one vessel, and that vessel has no track of another filter.
    Then none of its measurements was of another vessel. The newest update of every track must also have come with a measurement:
    otherwise the filter would get none. A filter begins for a vessel of two tracks or more, or of one and a bearing.
    Args: memory: of the last cycle; vessel: (N,) of each track.
    """
    no_id, no_time = np.zeros(0, np.int64), np.zeros(0)
    if vessels.vessel_count == 0:
        none = np.zeros(0, np.int32)
        return FilterPlan(no_id, no_id, no_id, none, np.full(len(measurements), -1, np.int32), no_id, no_time)
    begin = vessels.start[:-1]
    at = kernels.tables.match_ids.index_of(memory.track_id, tracks.track_id)
    track_of_measurement = kernels.tables.match_ids.index_of(tracks.track_id, measurements.track_id)
    filter_before = np.append(memory.filter_of_track, -1)[at]
    measured_s = np.full(len(tracks) + 1, -np.inf)  # the last is of measurements of no track
    np.maximum.at(measured_s, track_of_measurement, measurements.time_s)
    of_entry = filter_before[vessels.row]
    before = np.maximum.reduceat(of_entry, begin)
    lowest = np.minimum.reduceat(np.where(of_entry >= 0, of_entry, len(memory.updated_s)), begin)
    tracks_here = np.add.reduceat(of_entry >= 0, begin, dtype=np.int64)
    tracks_alive = np.bincount(filter_before[filter_before >= 0], minlength=len(memory.updated_s) + 1)
    newest_s = np.maximum(np.maximum.reduceat(measured_s[vessels.row], begin), np.append(memory.updated_s, -np.inf)[before])
    whole = (before == lowest) & (tracks_alive[before] == tracks_here)
    whole &= np.maximum.reduceat(tracks.updated_s[vessels.row], begin) <= newest_s
    has_bearing = np.zeros(vessels.vessel_count, np.bool_)
    has_bearing[bearings.vessel[bearings.vessel < vessels.vessel_count]] = True
    continued, new = np.flatnonzero(whole), np.flatnonzero(~whole & ((vessels.size > 1) | has_bearing))
    filter_of = np.full(vessels.vessel_count, -1, np.int32)
    filter_of[continued] = np.arange(len(continued))
    filter_of[new] = len(continued) + np.arange(len(new))
    return FilterPlan(continued, before[continued], new, filter_of[vessel], track_of_measurement, no_id, no_time)


def _bearing_positions(
    before: tuple[Floats, Floats],
    ahead_s: Floats,
    site_m: Floats,
    bearing_rad: Floats,
    variance: Floats,
    floor_m: float,
    gate_sigmas: float,
) -> tuple[Floats, Floats, Bools, Bools]:
    """Position (B, 2) and noise (B, 2, 2) as which a filter takes each bearing, and whether the bearing is in the gate (B,).

    The last array says whether the bearing is more certain than the filter, across the line of sight. (B,)

    The position is where the line of sight is nearest to the predicted vessel, so that the update is the extended Kalman update
    by the bearing. Vessels predicted on top of the sensor or behind it are not in the gate.
    Args: before: mean (B, 5) and covariance (B, 5, 5) of the filters; ahead_s: (B,) of the bearings from these; site_m: (B, 2) east,
    north of the sensor; bearing_rad, variance: (B,); floor_m: standard deviation across the line that is added.
    Source: Y. Bar-Shalom, X. R. Li, T. Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001, section 10.3.
    """
    mean, covariance = before
    t = ahead_s[:, None]
    predicted = mean[:, :2] + t * mean[:, 2:4] - site_m
    along = np.column_stack([np.sin(bearing_rad), np.cos(bearing_rad)])
    across = np.column_stack([along[:, 1], -along[:, 0]])
    distance, innovation = (predicted * along).sum(axis=1), (predicted * across).sum(axis=1)
    to_position = np.concatenate([across, t * across], axis=1)
    own = np.einsum("bi,bij,bj->b", to_position, covariance[:, :4, :4], to_position)
    across_variance = distance**2 * variance + floor_m**2
    near = (innovation**2 <= gate_sigmas**2 * (own + across_variance)) & (distance > gate_sigmas * np.sqrt(own))
    noise = across_variance[:, None, None] * across[:, :, None] * across[:, None]
    noise += ALONG_M**2 * along[:, :, None] * along[:, None]
    return site_m + distance[:, None] * along, noise, near, across_variance <= own
