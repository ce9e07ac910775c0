"""Fused tracks by one filter a vessel that takes the plots and reports behind the tracks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from coastwatch import kernels
from coastwatch.batches import Associations, Floats, FusedTracks, Ints, Measurements, Rows, Tracks
from coastwatch.fused_tracks.continuity import Going, continuity
from coastwatch.fused_tracks.covariance_intersection import intersected
from coastwatch.fused_tracks.membership import Grouped, at_time, states, unwritten
from coastwatch.kernels.threads import in_blocks
from coastwatch.stage import Method

Positive = Annotated[float, Field(gt=0.0)]
NotNegative = Annotated[float, Field(ge=0.0)]
Estimates = tuple[Floats, Floats, Floats]  # position (V, 2) degrees, velocity (V, 2), covariance (V, 4, 4)
Filters = tuple[Floats, Floats, Floats, Floats]  # the first four of `Bank`
Company = tuple[
    Rows, Rows, Rows, Ints, Ints
]  # vessels (F,); start, row: the tracks of each vessel; their sources; kinds of sources
Models = tuple[Ints, Floats, Floats, Floats, Floats, Floats, Floats]
Four = tuple[Positive, Positive, Positive, Positive]

KINDS = np.array([0, 0, 0, 1], np.int64)  # steady, changing speed, agile: constant velocity; turning: coordinated turn
FEW = 512  # filters that keep a thread busy for long enough
SEARCH_STEPS = 16  # of the covariance intersection at which a filter begins


@dataclass(frozen=True, eq=False)
class Bank:
    """The filters of V vessels, each in the plane at its anchor, and which tracks are in them."""

    anchor_deg: Floats  # (V, 2)
    filters: Floats  # (V, J, WIDTH), see coastwatch.kernels.kicked_imm
    mode: Floats  # (V, J)
    newest_s: Floats  # (V,) time of the newest measurement
    track_id: Ints  # (L,) every track of the last cycle, in its order
    row: Rows  # (L,) its filter, -1 where none

    @property
    def arrays(self) -> Filters:
        """What there is of each filter."""
        return self.anchor_deg, self.filters, self.mode, self.newest_s


class CentralImm(Method):
    """One IMM a vessel over the plots and AIS reports that its tracks took: no error of theirs is counted twice.

    Models: steady (constant velocity, kicked now and then), changing speed, agile, turning. A vessel begins where the covariance
    intersection of its tracks is, when a second track joins the first; one that never had two tracks is its track. The filter
    goes on while nothing that it heard was of another vessel, and on plots alone when the AIS has gone; where a pair is broken both
    begin again. Where AIS is in the vessel, shares of a plot's variance are added along and across the beam: what is wrong with a
    radar's registration is the same from plot to plot, and would else outweigh the AIS. Late reports are brought forward.

    Source: P. Rangel et al., Enhancing Performance and Reliability in Maritime Target Fusion Through a Context-Driven Approach,
    section III-F (fusion by IMM); Y. Bar-Shalom, P. K. Willett, X. Tian, Tracking and Data Fusion, 2011, section 8.2 (central fusion).
    """

    method: Literal["central_imm"] = "central_imm"
    noise_m2_s3: tuple[NotNegative, NotNegative, NotNegative, NotNegative] = (1e-5, 3e-3, 0.2, 1e-5)  # density of acceleration
    sojourn_s: Four = (600.0, 300.0, 60.0, 3000.0)  # mean time in each model
    share: Four = (0.4, 0.1, 0.1, 0.4)  # of each model where a filter begins
    kick_m_s: NotNegative = 0.2  # standard deviation of a kick of a steady vessel, per axis
    kick_interval_s: Positive = 60.0  # mean time between kicks
    turn_rate_noise_rad2_s3: NotNegative = 3e-10  # density of the drift of the turn rate
    turn_rate_sigma_deg_s: Positive = 0.5  # of turn rates before anything is known
    range_registration: NotNegative = 0.5  # share of a plot's variance along the beam that is added where AIS is in the vessel
    azimuth_registration: NotNegative = 1.5  # the same across the beam
    unknown_velocity_sigma_m_s: Positive = 0.5  # of tracks that come without covariance

    def init(self) -> Bank:
        """No filter."""
        return Bank(*self._unwritten(0), np.zeros(0, np.int64), np.zeros(0, np.int32))

    def step(
        self,
        memory: Bank,
        tracks: Tracks,
        measurements: Measurements,
        associations: Associations,
        time_s: float,
        kinds: Ints,
    ) -> tuple[Bank, FusedTracks]:
        """One estimate a vessel.

        Args: tracks: (N); measurements: that went into them since the last cycle; associations: of the tracks; kinds: SourceKind of
        each source.
        Returns: memory and FusedTracks, one row for each vessel number.
        """
        vessel = associations.vessel
        if len(vessel) == 0:
            return self.init(), FusedTracks.empty()
        groups = Grouped(*associations.by_vessel)
        plan = continuity(memory.track_id, memory.row, memory.newest_s, groups, vessel, tracks, measurements)
        filters = self._unwritten(len(plan.going) + len(plan.begins))
        out = self._alone(groups, tracks)
        told = self._heard(memory, plan, groups, tracks, measurements, kinds, filters)
        self._shown(plan, told, time_s, filters, out)
        self._begun(plan, groups, tracks, time_s, filters, out)
        return Bank(*filters, tracks.track_id, plan.filter_of), at_time(time_s, out)

    def _unwritten(self, count: int) -> Filters:
        """So many filters of which nothing is written yet."""

        j = len(KINDS)
        return (
            np.empty((count, 2)),
            np.empty((count, j, kernels.filters.velocity_jumps.WIDTH)),
            np.empty((count, j)),
            np.empty(count),
        )

    def _alone(self, groups: Grouped, tracks: Tracks) -> Estimates:
        """Estimates of which those of vessels of one track are written: they are that track."""

        out = unwritten(len(groups))
        in_blocks(
            kernels.filters.fused_filters.single, len(groups), *groups, states(tracks), self.unknown_velocity_sigma_m_s, out
        )
        return out

    def _heard(
        self, memory: Bank, plan: Going, groups: Grouped, tracks: Tracks, m: Measurements, kinds: Ints, filters: Filters
    ) -> Company:
        """Takes the filters that go on into this cycle's, and tells them the measurements of their vessels' tracks.

        Returns: their vessels, and the tracks of each, as the kernels take them.
        """

        count, z = len(plan.going), np.empty((len(m), 10))
        who = plan.going, *groups, tracks.source, kinds
        begin, order = kernels.filters.fused_filters.told(plan.filter_of, plan.heard_row, m.time_s, m.sensor, count)
        in_blocks(kernels.filters.fused_filters.continued, count, plan.of, memory.arrays, filters, least=FEW)
        given = m.position_deg, m.velocity_m_s, m.covariance, m.site_deg, m.sensor
        shares = self.range_registration, self.azimuth_registration
        in_blocks(kernels.filters.fused_filters.expressed, count, *who, begin, order, given, filters[0], shares, z, least=FEW)
        in_blocks(
            kernels.filters.velocity_jumps.absorb,
            count,
            *filters[1:],
            m.time_s,
            z,
            order,
            begin,
            self._models(),
            np.empty(count),
            least=FEW,
        )
        return who

    def _shown(self, plan: Going, who: Company, time_s: float, filters: Filters, out: Estimates) -> None:
        """The anchors of the filters that go on to where the vessels are at this time, and those into their rows of `out`."""

        count = len(plan.going)
        mean, spread = np.empty((count, 5)), np.empty((count, 5, 5))
        in_blocks(
            kernels.filters.velocity_jumps.foresee, count, *filters[1:], float(time_s), self._models(), mean, spread, least=FEW
        )
        in_blocks(kernels.filters.fused_filters.shown, count, *who, mean, spread, filters, out)

    def _begun(self, plan: Going, groups: Grouped, tracks: Tracks, time_s: float, filters: Filters, out: Estimates) -> None:
        """Vessels whose filters begin, from their tracks alone, into their rows of `out`, and those filters."""

        intersected(groups, plan.begins, tracks, self.unknown_velocity_sigma_m_s, SEARCH_STEPS, out)
        share, turn = np.array(self.share) / sum(self.share), np.radians(self.turn_rate_sigma_deg_s) ** 2
        given = plan.begins, len(plan.going), float(time_s), share, float(turn), out, filters
        in_blocks(kernels.filters.fused_filters.begun, len(plan.begins), *given)

    def _models(self) -> Models:
        """The models as the kernel takes them."""
        j = len(KINDS)
        turn_noise, kick_rate, kick_variance = np.zeros(j), np.zeros(j), np.zeros(j)
        turn_noise[-1] = self.turn_rate_noise_rad2_s3
        kick_rate[0], kick_variance[0] = 1.0 / self.kick_interval_s, self.kick_m_s**2
        turn_sigma = np.full(j, np.radians(self.turn_rate_sigma_deg_s))
        return KINDS, np.array(self.noise_m2_s3), turn_noise, turn_sigma, np.array(self.sojourn_s), kick_rate, kick_variance
