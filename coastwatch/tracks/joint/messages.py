"""AIS messages as measurements of radar tracks: methods A, B and C of Hem and Brekke.

A message came, so its vessel was not missed; its absence says nothing; there are no false messages. Its id counts: a track that is
known by the id takes it, and a wrong id in a message near a known track begins no second one. The paper has positions alone; here a
message with speed and course measures the velocity too.

Source: A. G. Hem, E. F. Brekke, Variations of joint integrated data association with radar and target-provided measurements, Journal of
Advances in Information Fusion 17(2), 2022, sections V and VI.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Annotated, NamedTuple

import numpy as np
from pydantic import Field

from coastwatch import kernels
from coastwatch.batches import Bools, Floats, Ints, Measurements, Messages, Sensors, Tracks
from coastwatch.geodesy import KNOT_M_S, to_plane, turn, within_any
from coastwatch.kernels.tracks.columns import NAMES, Candidates, PlotColumns
from coastwatch.kernels.tracks.existence import SURELY
from coastwatch.kernels.tracks.joint_update import Hypotheses
from coastwatch.kernels.tracks.vessel_ids import IDS
from coastwatch.stage import Settings
from coastwatch.tracks.joint.association import LIKELY, JointAssociation, by_track
from coastwatch.tracks.motion import Filters
from coastwatch.tracks.table import RadarMemory, Table, begin_tracks
from coastwatch.tracks.track_management import Probability

COARSE = 16.0  # times the squared distance of the gate: among messages in it, the models of each track decide
LEAST_LOG, MOST_LOG = -400.0, 200.0  # of a likelihood
WIDEST = 1e8  # ratio of the weights of a message that is kept: beyond it sums lose their digits


class MessageSettings(Settings):
    """AIS messages as measurements of radar tracks."""

    correct_id: Probability = 0.99  # probability that a message carries the id of its vessel
    silent_share: Probability = 0.5  # of the vessels without a track, that send no messages
    gate_sigmas: Annotated[float, Field(gt=0.0)] = 6.0  # a message farther from a track, by all of its models, is not of it
    begin_existence: Probability = 0.05  # a message begins a track that exists with this probability or more


class NoisyMessages(MessageSettings):
    """AIS messages taken at the time of the plots that follow."""

    sigma_m: Annotated[float, Field(gt=0.0)] = 8.0  # per axis, in place of their own noise: they are older than the plots


def messages_of(reports: Measurements, ais: Tracks, sensors: Sensors, region: int) -> Messages:
    """The AIS reports of a cycle inside the range of a radar of a region, in its plane.

    Args: reports: that went into these AIS tracks.
    """
    ours = sensors.radars.take(sensors.radars.region == region)
    reports = reports.take(within_any(reports.position_deg, ours.site_deg, ours.range_m))
    at = kernels.tables.match_ids.index_of(ais.track_id, reports.track_id)
    origin_deg = sensors.region_origin_deg[region]
    axes = turn(reports.position_deg, origin_deg)
    back = np.swapaxes(axes, 1, 2)
    return Messages(
        time_s=reports.time_s,
        position_m=to_plane(reports.position_deg, origin_deg),
        covariance=axes @ reports.covariance[:, :2, :2] @ back,
        mmsi=ais.mmsi[at],
        origin=ais.origin[at],
        velocity_m_s=(axes @ reports.velocity_m_s[:, :, None])[:, :, 0],
        velocity_covariance=axes @ reports.covariance[:, 2:, 2:] @ back,
    )


def positions_alone(messages: Messages) -> Messages:
    """These messages without their velocities."""
    unknown = np.full((len(messages), 2), np.nan)
    return replace(messages, velocity_m_s=unknown, velocity_covariance=np.tile(unknown[:, :, None], (1, 1, 2)))


class Candidate(NamedTuple):
    """Which messages, or clusters of them, may be of which tracks: A pairs, sorted by track."""

    slot: Ints  # (T,)
    start: Ints  # (T + 1,) first pair of each track
    message: Ints  # (A,)
    likelihood: Floats  # (A,) of the message, given the track

    @property
    def track(self) -> Ints:
        """Of each pair, as a row of slot. (A,)"""
        return np.repeat(np.arange(len(self.slot)), np.diff(self.start))


@dataclass(frozen=True)
class MessageAssociation(JointAssociation):
    """As `JointAssociation`, with AIS messages."""

    messages: MessageSettings

    def take_one_by_one(self, memory: RadarMemory, messages: Messages, until_s: float) -> RadarMemory:
        """Method A: each message at its own time. Messages whose gates have no track in common are taken together."""
        batch = _columns(messages)
        order = self._rounds(memory, batch, messages.mmsi)
        for number in range(int(order.max(initial=-1)) + 1):
            rows = np.flatnonzero(order == number)
            memory = self._take(memory, messages.take(rows))
        return memory

    def take_clusters(self, memory: RadarMemory, messages: Messages, until_s: float) -> RadarMemory:
        """Method B: the messages of one id are one measurement. Each track in reach is run through them."""
        table, models = memory.table, self.bank.models
        messages = messages.take(np.argsort(messages.mmsi, kind="stable"))
        begin = np.flatnonzero(np.diff(messages.mmsi, prepend=-1))
        end = np.append(begin[1:], len(messages))
        first = _columns(messages.take(begin))
        pairs = by_track(self._near(table, first), len(models))
        of = np.repeat(pairs.slot, np.diff(pairs.start))
        born = self._begun(messages.take(begin), len(models))
        both = Filters(*(np.concatenate([a[of], b]) for a, b in zip(table.filters, born, strict=True)))
        time = np.concatenate([table.updated_s[of], first.time])
        rows = np.concatenate([begin[pairs.plot], begin + 1]), np.concatenate([end[pairs.plot], end])
        run = kernels.tracks.message_clusters.run_through
        measured = messages.time_s, *_measured(messages)
        log_likelihood, fit = run(tuple(both), time, rows, measured, until_s, self._limit, self.bank.prior.renewal_s, models)
        kept, many = np.flatnonzero(fit[: len(of)]), len(of)
        of_new = log_likelihood[many:] + self._log_density_of_velocity(messages.take(begin))
        found = _exponential(log_likelihood[kept] - of_new[pairs.plot[kept]])
        slot, number = np.unique(of[kept], return_inverse=True)
        start = np.searchsorted(number, np.arange(len(slot) + 1))
        candidate = Candidate(slot, start, pairs.plot[kept], found)
        self._predict(memory, slot, until_s)
        probability, share, new = self._weigh(memory, candidate, messages.mmsi[begin], alone=False)
        mean, spread = kernels.filters.imm.estimate_filters(*(column[many:] for column in both))
        new = self._first_of_new(new, end - begin, mean[:, :2], spread[:, :2, :2])
        others = tuple(column[kept] for column in both)
        given = share, self.management.least_model_probability, models
        kernels.tracks.message_clusters.mix_filters(tuple(table.filters), table.estimates, slot, start, others, *given)
        last = _columns(messages.take(end - 1))
        self._record(memory, candidate, probability, last)
        begun = np.flatnonzero(new >= self.messages.begin_existence)
        memory = self._begin_named(memory, last, messages.mmsi[begin], new)
        if len(begun):
            table = memory.table
            slots = table.live[-len(begun) :]
            for column, run_on in zip(table.filters, both, strict=True):
                column[slots] = run_on[many + begun]
            table.updated_s[slots] = time[many + begun]
            kernels.filters.imm.combine_filters(tuple(table.filters), table.estimates, slots, models)
        return memory

    def take_newest(self, memory: RadarMemory, messages: Messages, until_s: float) -> RadarMemory:
        """Method C: the newest message of each id, as if it were of this time, with the noise `messages.sigma_m`."""
        assert isinstance(self.messages, NoisyMessages)
        order = np.argsort(messages.mmsi, kind="stable")
        newest = order[np.diff(messages.mmsi[order], append=-1) != 0]
        ids, size = np.unique(messages.mmsi, return_counts=True)
        messages = messages.take(np.sort(newest))
        noise = np.tile(self.messages.sigma_m**2 * np.eye(2), (len(messages), 1, 1))
        now = replace(messages, time_s=np.full(len(messages), until_s), covariance=noise)
        return self._take(memory, now, size[np.searchsorted(ids, now.mmsi)])

    def _take(self, memory: RadarMemory, messages: Messages, size: Ints | None = None) -> RadarMemory:
        """Weigh messages and update tracks by them. Args: size: (M,) messages of each id in the batch; none: no two are of one vessel."""
        table, batch = memory.table, _columns(messages)
        pairs = self._predict_to(table, self._near(table, batch), batch)
        pairs = _chosen(pairs, kernels.tracks.message_clusters.in_any_gate(tuple(table.filters), pairs, self._limit))
        slot, start, plot = pairs.slot, pairs.start, pairs.plot
        if np.isnan(messages.velocity_m_s[:, 0]).all():
            candidate = Candidate(slot, start, plot, self._likelihood(table, pairs))
            probability, share, new = self._weigh(memory, candidate, messages.mmsi, alone=size is None)
            self._update(table, pairs, share, batch)
        else:
            updated, likelihood = self._updated(table, pairs, messages)
            candidate = Candidate(slot, start, plot, likelihood)
            probability, share, new = self._weigh(memory, candidate, messages.mmsi, alone=size is None)
            given = share, self.management.least_model_probability, self.bank.models
            mix = kernels.tracks.message_clusters.mix_filters
            mix(tuple(table.filters), table.estimates, slot, start, tuple(updated), *given)
        self._record(memory, candidate, probability, batch)
        if size is not None:
            new = self._first_of_new(new, size, batch.position, batch.covariance)
        before = len(memory.table)
        memory = self._begin_named(memory, batch, messages.mmsi, new)
        slots = memory.table.live[before:]
        begun = messages.take(np.flatnonzero(new >= self.messages.begin_existence))
        self._update_new(memory.table.filters, slots, begun)
        kernels.filters.imm.combine_filters(tuple(memory.table.filters), memory.table.estimates, slots, self.bank.models)
        return memory

    def _updated(self, table: Table, pairs: Hypotheses, messages: Messages) -> tuple[Filters, Floats]:
        """The filter of each pair after its message (A), and the likelihood of the message.

        A likelihood with a velocity is relative to the density of such a velocity of a new vessel. So messages with and without a
        velocity are weighed alike. Args: pairs: predicted to their messages.
        """
        of, (z, noise) = np.repeat(pairs.slot, np.diff(pairs.start)), _measured(messages.take(pairs.plot))
        z[:, :2], noise[:, :2, :2] = pairs.position, pairs.noise
        before = (column[of] for column in table.filters)
        *after, log_likelihood = kernels.filters.imm.update_filters(*before, z, noise, np.isfinite(z[:, 2]))
        return Filters(*after), _exponential(log_likelihood - self._log_density_of_velocity(messages)[pairs.plot])

    @property
    def _speed_variance(self) -> float:
        """Of each component of the velocity of a new vessel."""
        return (self.bank.prior.start_speed_kn * KNOT_M_S) ** 2

    def _log_density_of_velocity(self, messages: Messages) -> Floats:
        """The logarithm of the density of each velocity, if its vessel is new; 0 where there is none. (M,)"""
        known = np.isfinite(messages.velocity_m_s[:, 0])
        v, covariance = messages.velocity_m_s[known], messages.velocity_covariance[known] + self._speed_variance * np.eye(2)
        square = np.einsum("mi,mij,mj->m", v, np.linalg.inv(covariance), v)
        out = np.zeros(len(messages))
        out[known] = -0.5 * (square + np.log(np.linalg.det(covariance))) - math.log(2.0 * math.pi)
        return out

    def _update_new(self, filters: Filters, rows: Ints, messages: Messages) -> None:
        """Update filters that know one position by the velocity of the same message, in place. Args: rows: (M,) of the filters."""
        known = np.isfinite(messages.velocity_m_s[:, 0])
        rows, one = rows[known], np.eye(2)
        gain = self._speed_variance * np.linalg.inv(self._speed_variance * one + messages.velocity_covariance[known])
        filters.state[rows, :, 2:4] = (gain @ messages.velocity_m_s[known, :, None])[:, None, :, 0]
        filters.covariance[rows, :, 2:4, 2:4] = (self._speed_variance * (one - gain))[:, None]

    @property
    def _limit(self) -> float:
        """Squared Mahalanobis distance of the gate of messages.

        It is wider than that of plots: no message is clutter, and one outside the gate would begin a second track of its vessel.
        """
        return self.messages.gate_sigmas**2

    def _near(self, table: Table, batch: PlotColumns) -> Candidates:
        """The messages near tracks: a message is more accurate than a track, so that models differ more than the gate of their mean."""
        return self._gated(table.estimates, table.live, batch, COARSE)

    def _weigh(self, memory: RadarMemory, candidate: Candidate, mmsi: Ints, alone: bool) -> tuple[Floats, Floats, Floats]:
        """Weigh messages; existence and ids of the tracks after them, in place.

        Args: mmsi: (M,) of the messages; alone: no two of them are of one vessel.
        Returns: probability of each pair (A,), the same given that the track exists (A,), and of each message that it is of a vessel
        without a track (M,).
        """
        table, rules, count = memory.table, self.messages, len(mmsi)
        slot, start, message, likelihood = candidate
        of = candidate.track
        kernels.tracks.existence.fade(table.existing, slot, table.updated_s[slot], self.management.chain)
        r = table.existence[slot]
        ids, named = table.vessel_ids, mmsi[message]
        carries = kernels.tracks.vessel_ids.likelihoods(ids, slot[of], named, rules.correct_id)
        new = np.full(count, self.management.new_vessels_per_m2 * (1.0 - rules.silent_share) / IDS)
        second = np.zeros(count)
        if not alone:  # a second message of a vessel, with a wrong id
            sends = 1.0 - table.id_probability[slot[of], 0]
            second[:] = np.bincount(message, r[of] * likelihood * sends * (1.0 - rules.correct_id) / IDS, count)
        weight = r[of] * likelihood * carries / (new + second)[message]
        largest = np.full(count, WIDEST)
        np.maximum.at(largest, message, weight)
        weight *= WIDEST / largest[message]
        probability: Floats = kernels.association.marginals.marginals(
            message, of, weight, count, len(slot), self.management.exact_up_to
        )
        taken = np.minimum(np.bincount(of, probability, len(slot)), 1.0)
        exists = (1.0 - taken) * r + taken
        share = probability / exists[of]
        kernels.tracks.vessel_ids.update(ids, slot, start, named, share, rules.correct_id)
        table.existence[slot] = np.minimum(exists, SURELY)
        free = np.maximum(1.0 - np.bincount(message, probability, count), 0.0)
        return probability, share, free * new / (new + second)

    def _first_of_new(self, new: Floats, size: Ints, place_m: Floats, covariance: Floats) -> Floats:
        """The probability that each message begins a track (M,), less that it is a second one, with a wrong id, of a new vessel.

        Of two messages at one place the one whose id has more of them is the first, then the lower row.
        Args: new: (M,) without that; size: (M,) messages of each id; place_m (M, 2), covariance (M, 2, 2): of the tracks they begin.
        """
        rows = np.flatnonzero(new >= self.messages.begin_existence)
        if len(rows) < 2:
            return new
        from scipy.spatial import cKDTree  # as in `_rounds`

        rows = rows[np.lexsort((rows, -size[rows]))]
        reach_m = math.sqrt(2.0 * self._limit * float(np.trace(covariance[rows], axis1=1, axis2=2).max()))
        pairs = cKDTree(place_m[rows]).query_pairs(reach_m, output_type="ndarray")
        first, second = rows[pairs.min(axis=1)], rows[pairs.max(axis=1)]
        apart, total = place_m[first] - place_m[second], covariance[first] + covariance[second]
        square = np.einsum("ai,aij,aj->a", apart, np.linalg.inv(total), apart)
        likelihood = np.exp(-0.5 * square) / (2.0 * np.pi * np.sqrt(np.linalg.det(total)))
        wrong = np.bincount(second, new[first] * likelihood, len(new)) * (1.0 - self.messages.correct_id)
        unborn = self.management.new_vessels_per_m2 * (1.0 - self.messages.silent_share)
        return np.asarray(new * unborn / (unborn + wrong))

    def _predict(self, memory: RadarMemory, slots: Ints, until_s: float) -> None:
        """Predict the filters in these slots to a time, in place."""
        table = memory.table
        dt = np.maximum(until_s - table.updated_s[slots], 0.0)
        given = dt, self.bank.prior.renewal_s, self.bank.models
        after = kernels.filters.imm.predict_filters(*(column[slots] for column in table.filters), *given)
        for column, predicted in zip(table.filters, after, strict=True):
            column[slots] = predicted
        table.updated_s[slots] += dt

    def _record(self, memory: RadarMemory, candidate: Candidate, probability: Floats, batch: PlotColumns) -> None:
        """Note which tracks took which messages, in place."""
        table = memory.table
        likely = np.flatnonzero(probability > LIKELY)
        slots, rows = candidate.slot[candidate.track[likely]], candidate.message[likely]
        kernels.tracks.track_life.record(table.life, slots, rows, batch)
        np.maximum.at(table.message_s, slots, batch.time[rows])
        table.misses[slots] = 0
        table.note_moved(self.clutter, candidate.slot)

    def _begin(self, memory: RadarMemory, batch: PlotColumns, existence: Floats) -> RadarMemory:
        before = len(memory.table)
        memory = super()._begin(memory, batch, existence)
        slots = memory.table.live[before:]
        memory.table.id_probability[slots, 0] = self.messages.silent_share
        memory.table.id_probability[slots, NAMES + 1] = 1.0 - self.messages.silent_share
        return memory

    def _begin_named(self, memory: RadarMemory, batch: PlotColumns, mmsi: Ints, existence: Floats) -> RadarMemory:
        """Begin a track at each message that is probably of a vessel without one. Args: mmsi, existence: (M,)."""
        rows = np.flatnonzero(existence >= self.messages.begin_existence)
        if not len(rows):
            return memory
        memory = begin_tracks(self.bank, memory, rows, batch)
        table = memory.table
        slots = table.live[-len(rows) :]
        table.existence[slots] = np.minimum(existence[rows], SURELY)
        table.visibility[slots] = self.management.new_visibility
        table.ids[slots, 0] = mmsi[rows]
        table.id_probability[slots, 1] = self.messages.correct_id
        table.id_probability[slots, NAMES + 1] = 1.0 - self.messages.correct_id
        return memory

    def _begun(self, messages: Messages, models: int) -> Filters:
        """Filters that know one message each."""
        batch, count = _columns(messages), len(messages)
        filters = Filters(np.empty((count, models, 5)), np.empty((count, models, 5, 5)), np.empty((count, models)))
        estimates = kernels.tracks.columns.Estimates(
            np.empty(count), np.empty((count, 4)), np.empty((count, 4, 4)), np.empty(count)
        )
        self.bank.initialise(filters, estimates, np.arange(count), np.arange(count), batch)
        self._update_new(filters, np.arange(count), messages)
        return filters

    def _rounds(self, memory: RadarMemory, batch: PlotColumns, mmsi: Ints) -> Ints:
        """The round in which each message is taken: later than those before it that share a track or an id with it. (M,)"""
        table, count = memory.table, len(mmsi)
        pairs = self._near(table, batch)
        _, name = np.unique(mmsi, return_inverse=True)
        reach_m = self.management.max_speed_kn * KNOT_M_S * float(np.ptp(batch.time))
        reach_m += math.sqrt(2.0 * self._limit * float(batch.covariance.max()))
        from scipy.spatial import cKDTree  # slow to import, and few runs use it

        near = cKDTree(batch.position).query_pairs(reach_m, output_type="ndarray")  # one may begin a track that the other is of
        first = np.concatenate([pairs.plot, np.arange(count), near[:, 0]])
        second = np.concatenate([count + pairs.track, count + len(table.track_id) + name, near[:, 1]])
        group = kernels.association.connected_components.components(first, second, count + len(table.track_id) + count)[:count]
        order = np.argsort(group, kind="stable")  # the messages are in order of time
        begin = np.flatnonzero(np.diff(group[order], prepend=-1))
        place = np.arange(count) - np.repeat(begin, np.diff(np.append(begin, count)))
        out = np.empty(count, np.int64)
        out[order] = place
        return out


def _chosen(pairs: Hypotheses, kept: Bools) -> Hypotheses:
    """Some of these pairs. Args: kept: (A,)."""
    track = np.repeat(np.arange(len(pairs.slot)), np.diff(pairs.start))[kept]
    rows, first = np.flatnonzero(kept), np.flatnonzero(np.diff(track, prepend=-1))
    start = np.append(first, len(track))
    plot, position, noise, likelihood = pairs.plot[rows], pairs.position[rows], pairs.noise[rows], pairs.likelihood[rows]
    return Hypotheses(pairs.slot[track[first]], start, plot, position, noise, likelihood)


def _columns(messages: Messages) -> PlotColumns:
    """Messages as a batch of measurements of no radar."""
    m = messages
    return PlotColumns(m.time_s, m.position_m, m.covariance, np.full(len(m), -1), m.origin)


def _measured(messages: Messages) -> tuple[Floats, Floats]:
    """Position and velocity of messages (M, 4), NaN rates where there is none, and their covariance (M, 4, 4)."""
    noise = np.zeros((len(messages), 4, 4))
    noise[:, :2, :2], noise[:, 2:, 2:] = messages.covariance, messages.velocity_covariance
    return np.concatenate([messages.position_m, messages.velocity_m_s], axis=1), noise


def _exponential(log_likelihood: Floats) -> Floats:
    """Likelihoods (A,) within the range of floating-point numbers."""
    return np.exp(np.clip(log_likelihood, LEAST_LOG, MOST_LOG))


@dataclass
class MessagesInTurn:
    """The messages of a cycle, given to a method as the time of the plots goes on: `coastwatch.tracks.region.TakeMessages`."""

    take: Callable[[RadarMemory, Messages, float], RadarMemory]  # memory, messages and time to memory
    messages: Messages
    done: int = 0

    def __call__(self, memory: RadarMemory, until_s: float) -> RadarMemory:
        end = int(np.searchsorted(self.messages.time_s, until_s, side="right"))
        if end <= self.done:
            return memory
        part = self.messages.take(np.arange(self.done, end))
        self.done = end
        return self.take(memory, part, until_s)


def in_order(messages: Messages, memory: RadarMemory, late_s: float) -> Messages:
    """The messages sorted by time, without those so much older than a track that no gate would hold them."""
    newest_s = float(memory.table.updated_s[memory.table.live].max(initial=-np.inf))
    order = np.lexsort((messages.position_m[:, 1], messages.position_m[:, 0], messages.mmsi, messages.time_s))
    return messages.take(order[messages.time_s[order] >= newest_s - late_s])
