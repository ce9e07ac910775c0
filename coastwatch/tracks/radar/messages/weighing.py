"""AIS messages as measurements of radar tracks: methods A, B and C of Hem and Brekke.

A message came, so its vessel was not missed; its absence says nothing; there are no false messages. Its id counts: a track that is
known by the id takes it, and a wrong id in a message near a known track begins no second one. The paper has positions alone; here a
message with speed and course measures the velocity too.

Source: A. G. Hem, E. F. Brekke, Variations of joint integrated data association with radar and target-provided measurements, Journal of
Advances in Information Fusion 17(2), 2022, sections V and VI.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from coastwatch import kernels
from coastwatch.batches import Bools, Floats, Ints, Messages
from coastwatch.geodesy import KNOT_M_S
from coastwatch.kernels.tracks.columns import NAMES, Candidates, PlotColumns
from coastwatch.kernels.tracks.existence import SURELY
from coastwatch.kernels.tracks.joint_update import Hypotheses
from coastwatch.kernels.tracks.vessel_ids import IDS
from coastwatch.tracks.radar import plots_alone
from coastwatch.tracks.radar.messages.settings import MessageSettings
from coastwatch.tracks.radar.motion import Filters
from coastwatch.tracks.radar.parts import LIKELY, Parts, begin_tracks, candidates_by_largest_noise
from coastwatch.tracks.radar.table import RadarMemory, Table

COARSE = 16.0  # times the squared distance of the gate: among messages in it, the models of each track decide
LEAST_LOG, MOST_LOG = -400.0, 200.0  # of a likelihood
WIDEST = 1e8  # ratio of the weights of a message that is kept: beyond it sums lose their digits


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


def take_at_once(
    parts: Parts, rules: MessageSettings, memory: RadarMemory, messages: Messages, size: Ints | None = None
) -> RadarMemory:
    """Weigh messages and update tracks by them. Args: size: (M,) messages of each id in the batch; none: no two are of one vessel."""
    table, batch, least = memory.table, columns_of(messages), parts.existence.least_model_probability
    pairs = parts.joint.predict_to_plots(table, near(parts, table, batch), batch)
    pairs = chosen(pairs, kernels.tracks.message_clusters.in_any_gate(tuple(table.filters), pairs, rules.limit))
    if memory.plots_alone.models:
        plots_alone.begin_at_tracks(memory.plots_alone, table, parts, pairs.slot)
    slot, start, plot = pairs.slot, pairs.start, pairs.plot
    if np.isnan(messages.velocity_m_s[:, 0]).all():
        candidate = Candidate(slot, start, plot, parts.joint.likelihood(table, pairs))
        probability, share, new = weigh(parts, rules, memory, candidate, messages.mmsi, alone=size is None)
        parts.joint.update_by_shares(table, pairs, share, batch, least)
    else:
        updated, likelihood = _updated(parts, table, pairs, messages)
        candidate = Candidate(slot, start, plot, likelihood)
        probability, share, new = weigh(parts, rules, memory, candidate, messages.mmsi, alone=size is None)
        mix = kernels.tracks.message_clusters.mix_filters
        mix(tuple(table.filters), table.estimates, slot, start, tuple(updated), share, least, parts.bank.models)
    record(parts, memory, candidate, probability, batch)
    if size is not None:
        new = first_of_new(parts, rules, new, size, batch.position, batch.covariance)
    before = len(memory.table)
    memory = begin_named(parts, rules, memory, batch, messages.mmsi, new)
    slots = memory.table.live[before:]
    begun = messages.take(np.flatnonzero(new >= rules.begin_existence))
    update_new(parts, memory.table.filters, slots, begun)
    kernels.filters.imm.combine_filters(tuple(memory.table.filters), memory.table.estimates, slots, parts.bank.models)
    return memory


def _updated(parts: Parts, table: Table, pairs: Hypotheses, messages: Messages) -> tuple[Filters, Floats]:
    """The filter of each pair after its message (A), and the likelihood of the message.

    A likelihood with a velocity is relative to the density of such a velocity of a new vessel. So messages with and without a
    velocity are weighed alike. Args: pairs: predicted to their messages.
    """
    of, (z, noise) = pairs.slot[pairs.track], measurements_of(messages.take(pairs.plot))
    z[:, :2], noise[:, :2, :2] = pairs.position, pairs.noise
    before = (column[of] for column in table.filters)
    *after, log_likelihood = kernels.filters.imm.update_filters(*before, z, noise, np.isfinite(z[:, 2]))
    return Filters(*after), exponential(log_likelihood - log_density_of_velocity(parts, messages)[pairs.plot])


def speed_variance(parts: Parts) -> float:
    """Of each component of the velocity of a new vessel."""
    return (parts.bank.prior.start_speed_kn * KNOT_M_S) ** 2


def log_density_of_velocity(parts: Parts, messages: Messages) -> Floats:
    """The logarithm of the density of each velocity, if its vessel is new; 0 where there is none. (M,)"""
    known = np.isfinite(messages.velocity_m_s[:, 0])
    v, covariance = messages.velocity_m_s[known], messages.velocity_covariance[known] + speed_variance(parts) * np.eye(2)
    square = np.einsum("mi,mij,mj->m", v, np.linalg.inv(covariance), v)
    out = np.zeros(len(messages))
    out[known] = -0.5 * (square + np.log(np.linalg.det(covariance))) - math.log(2.0 * math.pi)
    return out


def update_new(parts: Parts, filters: Filters, rows: Ints, messages: Messages) -> None:
    """Update filters that know one position by the velocity of the same message, in place. Args: rows: (M,) of the filters."""
    known = np.isfinite(messages.velocity_m_s[:, 0])
    rows, one, variance = rows[known], np.eye(2), speed_variance(parts)
    gain = variance * np.linalg.inv(variance * one + messages.velocity_covariance[known])
    filters.state[rows, :, 2:4] = (gain @ messages.velocity_m_s[known, :, None])[:, None, :, 0]
    filters.covariance[rows, :, 2:4, 2:4] = (variance * (one - gain))[:, None]


def near(parts: Parts, table: Table, batch: PlotColumns) -> Candidates:
    """The messages near tracks: a message is more accurate than a track, so that models differ more than the gate of their mean."""
    return candidates_by_largest_noise(parts, table.estimates, table.live, batch, COARSE)


def weigh(
    parts: Parts, rules: MessageSettings, memory: RadarMemory, candidate: Candidate, mmsi: Ints, alone: bool
) -> tuple[Floats, Floats, Floats]:
    """Weigh messages; existence and ids of the tracks after them, in place.

    Args: mmsi: (M,) of the messages; alone: no two of them are of one vessel.
    Returns: probability of each pair (A,), the same given that the track exists (A,), and of each message that it is of a vessel
    without a track (M,).
    """
    table, upkeep, count = memory.table, parts.existence, len(mmsi)
    slot, start, message, likelihood = candidate
    of = candidate.track
    kernels.tracks.existence.fade(table.existing, slot, table.updated_s[slot], upkeep.chain)
    r = table.existence[slot]
    ids, named = table.vessel_ids, mmsi[message]
    carries = kernels.tracks.vessel_ids.likelihoods(ids, slot[of], named, rules.correct_id)
    new = np.full(count, upkeep.new_vessels_per_m2 * (1.0 - rules.silent_share) / IDS)
    second = np.zeros(count)
    if not alone:  # a second message of a vessel, with a wrong id
        sends = 1.0 - table.id_probability[slot[of], 0]
        second[:] = np.bincount(message, r[of] * likelihood * sends * (1.0 - rules.correct_id) / IDS, count)
    weight = r[of] * likelihood * carries / (new + second)[message]
    largest = np.full(count, WIDEST)
    np.maximum.at(largest, message, weight)
    weight *= WIDEST / largest[message]
    probability: Floats = kernels.association.marginals.marginals(message, of, weight, count, len(slot), upkeep.exact_up_to)
    taken = np.minimum(np.bincount(of, probability, len(slot)), 1.0)
    exists = (1.0 - taken) * r + taken
    share = probability / exists[of]
    kernels.tracks.vessel_ids.update(ids, slot, start, named, share, rules.correct_id)
    table.existence[slot] = np.minimum(exists, SURELY)
    free = np.maximum(1.0 - np.bincount(message, probability, count), 0.0)
    return probability, share, free * new / (new + second)


def first_of_new(parts: Parts, rules: MessageSettings, new: Floats, size: Ints, place_m: Floats, covariance: Floats) -> Floats:
    """The probability that each message begins a track (M,), less that it is a second one, with a wrong id, of a new vessel.

    Of two messages at one place the one whose id has more of them is the first, then the lower row.
    Args: new: (M,) without that; size: (M,) messages of each id; place_m (M, 2), covariance (M, 2, 2): of the tracks they begin.
    """
    rows = np.flatnonzero(new >= rules.begin_existence)
    if len(rows) < 2:
        return new
    from scipy.spatial import cKDTree  # slow to import, and few runs use it

    rows = rows[np.lexsort((rows, -size[rows]))]
    reach_m = math.sqrt(2.0 * rules.limit * float(np.trace(covariance[rows], axis1=1, axis2=2).max()))
    pairs = cKDTree(place_m[rows]).query_pairs(reach_m, output_type="ndarray")
    first, second = rows[pairs.min(axis=1)], rows[pairs.max(axis=1)]
    apart, total = place_m[first] - place_m[second], covariance[first] + covariance[second]
    square = np.einsum("ai,aij,aj->a", apart, np.linalg.inv(total), apart)
    likelihood = np.exp(-0.5 * square) / (2.0 * np.pi * np.sqrt(np.linalg.det(total)))
    wrong = np.bincount(second, new[first] * likelihood, len(new)) * (1.0 - rules.correct_id)
    unborn = parts.existence.new_vessels_per_m2 * (1.0 - rules.silent_share)
    return np.asarray(new * unborn / (unborn + wrong))


def predict(parts: Parts, memory: RadarMemory, slots: Ints, until_s: float) -> None:
    """Predict the filters in these slots to a time, in place."""
    table = memory.table
    dt = np.maximum(until_s - table.updated_s[slots], 0.0)
    before, predict_filters = (column[slots] for column in table.filters), kernels.filters.imm.predict_filters
    after = predict_filters(*before, dt, parts.bank.prior.renewal_s, parts.bank.models)
    for column, predicted in zip(table.filters, after, strict=True):
        column[slots] = predicted
    table.updated_s[slots] += dt


def record(parts: Parts, memory: RadarMemory, candidate: Candidate, probability: Floats, batch: PlotColumns) -> None:
    """Note which tracks took which messages, in place."""
    table = memory.table
    likely = np.flatnonzero(probability > LIKELY)
    slots, rows = candidate.slot[candidate.track[likely]], candidate.message[likely]
    kernels.tracks.track_life.record(table.life, slots, rows, batch)
    np.maximum.at(table.message_s, slots, batch.time[rows])
    table.misses[slots] = 0
    table.note_moved(parts.clutter, candidate.slot)


def begin_named(
    parts: Parts, rules: MessageSettings, memory: RadarMemory, batch: PlotColumns, mmsi: Ints, existence: Floats
) -> RadarMemory:
    """Begin a track at each message that is probably of a vessel without one. Args: mmsi, existence: (M,)."""
    rows = np.flatnonzero(existence >= rules.begin_existence)
    if not len(rows):
        return memory
    memory = begin_tracks(parts.bank, memory, rows, batch)
    table = memory.table
    slots = table.live[-len(rows) :]
    table.existence[slots] = np.minimum(existence[rows], SURELY)
    table.visibility[slots] = parts.existence.new_visibility
    table.ids[slots, 0] = mmsi[rows]
    table.id_probability[slots, 1] = rules.correct_id
    table.id_probability[slots, NAMES + 1] = 1.0 - rules.correct_id
    return memory


def begin_unnamed(rules: MessageSettings, table: Table, slots: Ints) -> None:
    """Say of tracks that plots began that their id is unknown, in place."""
    table.id_probability[slots, 0] = rules.silent_share
    table.id_probability[slots, NAMES + 1] = 1.0 - rules.silent_share


def chosen(pairs: Hypotheses, kept: Bools) -> Hypotheses:
    """Some of these pairs. Args: kept: (A,)."""
    track = pairs.track[kept]
    rows, first = np.flatnonzero(kept), np.flatnonzero(np.diff(track, prepend=-1))
    start = np.append(first, len(track))
    plot, position, noise, likelihood = pairs.plot[rows], pairs.position[rows], pairs.noise[rows], pairs.likelihood[rows]
    return Hypotheses(pairs.slot[track[first]], start, plot, position, noise, likelihood)


def columns_of(messages: Messages) -> PlotColumns:
    """Messages as a batch of measurements of no radar."""
    m = messages
    return PlotColumns(m.time_s, m.position_m, m.covariance, np.full(len(m), -1), m.origin)


def measurements_of(messages: Messages) -> tuple[Floats, Floats]:
    """Position and velocity of messages (M, 4), NaN rates where there is none, and their covariance (M, 4, 4)."""
    noise = np.zeros((len(messages), 4, 4))
    noise[:, :2, :2], noise[:, 2:, 2:] = messages.covariance, messages.velocity_covariance
    return np.concatenate([messages.position_m, messages.velocity_m_s], axis=1), noise


def exponential(log_likelihood: Floats) -> Floats:
    """Likelihoods (A,) within the range of floating-point numbers."""
    return np.exp(np.clip(log_likelihood, LEAST_LOG, MOST_LOG))
