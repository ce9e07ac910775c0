"""Fused tracks by one filter a vessel that takes the plots and reports behind the tracks."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from coastwatch.batches import Associations, Bools, Floats, FusedTracks, Ints, Measurements, SourceKind, Tracks
from coastwatch.fused_tracks.continuity import former, going_on, newest
from coastwatch.fused_tracks.covariance_intersection import intersected
from coastwatch.fused_tracks.membership import at_time, by_vessel
from coastwatch.geodesy import difference_m, offset_deg
from coastwatch.kernels.lookup import find
from coastwatch.stage import Method

Positive = Annotated[float, Field(gt=0.0)]
NotNegative = Annotated[float, Field(ge=0.0)]
Estimates = tuple[Floats, ...]  # position (V, 2) degrees, velocity (V, 2), covariance (V, 4, 4)
Models = tuple[Ints, Floats, Floats, Floats, Floats, Floats, Floats]
Four = tuple[Positive, Positive, Positive, Positive]

KINDS = np.array([0, 0, 0, 1], np.int64)  # steady, changing speed, agile: constant velocity; turning: coordinated turn
SEARCH_STEPS = 16  # of the covariance intersection at which a filter begins


@dataclass(frozen=True, eq=False)
class Bank:
    """The filters of V vessels, each in the plane at its anchor, and which tracks are in them."""

    anchor_deg: Floats  # (V, 2)
    filters: Floats  # (V, J, WIDTH), see coastwatch.kernels.kicked_imm
    mode: Floats  # (V, J)
    newest_s: Floats  # (V,) time of the newest measurement
    track_id: Ints  # (L,) sorted
    row: Ints  # (L,) of the filter

    @property
    def arrays(self) -> tuple[Floats, ...]:
        """What there is of each filter."""
        return self.anchor_deg, self.filters, self.mode, self.newest_s

    def take(self, rows: Ints) -> Bank:
        """These filters, without their tracks."""
        none = np.zeros(0, np.int64)
        anchor, filters, mode, newest_s = (part[rows] for part in self.arrays)
        return Bank(anchor, filters, mode, newest_s, none, none)


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
        from coastwatch.kernels.kicked_imm import WIDTH

        j, none = len(KINDS), np.zeros(0, np.int64)
        return Bank(np.zeros((0, 2)), np.zeros((0, j, WIDTH)), np.zeros((0, j)), np.zeros(0), none, none)

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
        covariance = tracks.known_covariance(self.unknown_velocity_sigma_m_s)
        size = np.bincount(vessel)
        going = going_on(vessel, former(memory.track_id, memory.row, tracks.track_id), len(size))
        rows = np.flatnonzero(going >= 0)
        bank = self._heard(memory.take(going[rows]), rows, tracks, measurements, vessel, kinds)
        whole = np.flatnonzero(newest(vessel, tracks.updated_s, len(size))[rows] <= bank.newest_s)
        rows, bank = rows[whole], bank.take(whole)
        begins = size > 1
        begins[rows] = False
        bank, followed = self._shown(bank, time_s)
        begun, first = self._begun(tracks, covariance, vessel, begins, time_s)
        lead = np.zeros(len(size), np.int64)
        lead[vessel] = np.arange(len(vessel))
        out = tracks.position_deg[lead], tracks.velocity_m_s[lead], covariance[lead]
        shown = (size > 1) | (np.bincount(vessel, kinds[tracks.source] == SourceKind.RADAR) > 0)
        for given, of_filter, of_tracks in zip(out, followed, first, strict=True):
            given[rows[shown[rows]]] = of_filter[shown[rows]]
            given[begins] = of_tracks
        bank = _with_tracks(bank, begun, np.append(rows, np.flatnonzero(begins)), tracks.track_id, vessel)
        return bank, FusedTracks(np.full(len(size), float(time_s)), *out)

    def _heard(self, bank: Bank, rows: Ints, tracks: Tracks, measurements: Measurements, vessel: Ints, kinds: Ints) -> Bank:
        """The filters after the measurements of their vessels' tracks. Args: rows: (B,) the vessel of each filter."""
        from coastwatch.kernels.kicked_imm import absorb

        filter_of = np.full(int(vessel.max()) + 1, -1, np.int64)
        filter_of[rows] = np.arange(len(rows))
        order = np.argsort(tracks.track_id, kind="stable")
        at = find(tracks.track_id[order], measurements.track_id)
        mine = np.where(at >= 0, filter_of[vessel[order[at]]], -1)
        m, mine = measurements.take(mine >= 0), mine[mine >= 0]
        with_ais = np.bincount(vessel, kinds[tracks.source] == SourceKind.AIS)[rows] > 0
        z = np.empty((len(m), 10))
        z[:, :2] = difference_m(m.position_deg, bank.anchor_deg[mine])
        z[:, 2:4] = m.velocity_m_s
        place = m.covariance[:, :2, :2] + self._registration(m) * with_ais[mine, None, None]
        z[:, 4:7] = place[:, [0, 1, 1], [0, 0, 1]]
        z[:, 7:] = m.covariance[:, [2, 3, 3], [2, 2, 3]]
        taken = np.lexsort((m.sensor, m.time_s, mine))
        begin = np.searchsorted(mine[taken], np.arange(len(rows) + 1))
        filters, mode, newest_s = bank.filters.copy(), bank.mode.copy(), bank.newest_s.copy()
        absorb(filters, mode, newest_s, m.time_s, z, taken, begin, self._models(), np.empty(len(rows)))
        return replace(bank, filters=filters, mode=mode, newest_s=newest_s)

    def _registration(self, m: Measurements) -> Floats:
        """What is added to the covariance of each plot's place, along and across its beam; nothing for AIS. (M, 2, 2)"""
        out, plots = np.zeros((len(m), 2, 2)), m.sensor >= 0
        beam = difference_m(m.position_deg[plots], m.site_deg[plots])
        along = beam / np.maximum(np.hypot(beam[:, 0], beam[:, 1]), 1.0)[:, None]
        across = np.column_stack([-along[:, 1], along[:, 0]])
        for share, axis in ((self.range_registration, along), (self.azimuth_registration, across)):
            variance = np.einsum("mi,mij,mj->m", axis, m.covariance[plots, :2, :2], axis)
            out[plots] += (share * variance)[:, None, None] * axis[:, :, None] * axis[:, None, :]
        return out

    def _shown(self, bank: Bank, time_s: float) -> tuple[Bank, Estimates]:
        """The filters with their anchors at where the vessels are at this time, and what they make of the vessels then."""
        from coastwatch.kernels.kicked_imm import foresee

        mean, spread = np.empty((len(bank.mode), 5)), np.empty((len(bank.mode), 5, 5))
        foresee(bank.filters, bank.mode, bank.newest_s, float(time_s), self._models(), mean, spread)
        position, filters = offset_deg(bank.anchor_deg, mean[:, :2]), bank.filters.copy()
        filters[:, :, :2] -= mean[:, None, :2]
        return replace(bank, anchor_deg=position, filters=filters), (position, mean[:, 2:4], spread[:, :4, :4])

    def _begun(self, tracks: Tracks, covariance: Floats, vessel: Ints, begins: Bools, time_s: float) -> tuple[Bank, Estimates]:
        """Filters of these vessels from their tracks alone, and the same as estimates. Args: begins: (V,) which."""
        from coastwatch.kernels.kicked_imm import WIDTH

        which = np.flatnonzero(begins).astype(np.int32)
        count = len(which)
        first = at_time(time_s, intersected(by_vessel(vessel), which, tracks, self.unknown_velocity_sigma_m_s, SEARCH_STEPS))
        filters = np.zeros((count, len(KINDS), WIDTH))
        low = np.tril_indices(4)
        filters[:, :, 2:4] = first.velocity_m_s[:, None]
        filters[:, :, 5:15] = first.covariance[:, None, low[0], low[1]]
        filters[:, :, 19] = np.radians(self.turn_rate_sigma_deg_s) ** 2
        mode = np.tile(np.array(self.share) / sum(self.share), (count, 1))
        none = np.zeros(0, np.int64)
        bank = Bank(first.position_deg, filters, mode, np.full(count, float(time_s)), none, none)
        return bank, (first.position_deg, first.velocity_m_s, first.covariance)

    def _models(self) -> Models:
        """The models as the kernel takes them."""
        j = len(KINDS)
        turn_noise, kick_rate, kick_variance = np.zeros(j), np.zeros(j), np.zeros(j)
        turn_noise[-1] = self.turn_rate_noise_rad2_s3
        kick_rate[0], kick_variance[0] = 1.0 / self.kick_interval_s, self.kick_m_s**2
        turn_sigma = np.full(j, np.radians(self.turn_rate_sigma_deg_s))
        return KINDS, np.array(self.noise_m2_s3), turn_noise, turn_sigma, np.array(self.sojourn_s), kick_rate, kick_variance


def _with_tracks(bank: Bank, begun: Bank, rows: Ints, track_id: Ints, vessel: Ints) -> Bank:
    """Both banks as one, with the tracks of their vessels. Args: rows: the vessel of each filter, of the first bank, then the second."""
    filter_of = np.full(int(vessel.max()) + 1, -1, np.int64)
    filter_of[rows] = np.arange(len(rows))
    row = filter_of[vessel]
    order = np.argsort(track_id, kind="stable")
    order = order[row[order] >= 0]
    anchor, filters, mode, newest_s = (np.concatenate(both) for both in zip(bank.arrays, begun.arrays, strict=True))
    return Bank(anchor, filters, mode, newest_s, track_id[order], row[order])
