"""Methods A, B and C of Hem and Brekke: each AIS message at its own time, those of an id as one measurement, or the newest of an id."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from coastwatch import kernels
from coastwatch.batches import Messages
from coastwatch.geodesy import KNOT_M_S
from coastwatch.kernels.filters.gaussian import Estimates
from coastwatch.tracks.radar.bank.compiled import CompiledBank, by_track
from coastwatch.tracks.radar.messages.settings import MessageSettings
from coastwatch.tracks.radar.messages.weighing import (
    Candidate,
    begin_named,
    columns_of,
    exponential,
    first_of_new,
    log_density_of_velocity,
    measurements_of,
    near,
    predict,
    record,
    take_at_once,
    update_new,
    weigh,
)
from coastwatch.tracks.radar.motion import Filters
from coastwatch.tracks.radar.parts import Parts
from coastwatch.tracks.radar.table import RadarMemory, Table


class Sequential(MessageSettings):
    """AIS messages as measurements, each at its own time: method A of Hem and Brekke.

    A track says whose messages are in it (`Tracks.held_mmsi`), so that its AIS track is not fused with it again.
    """

    method: Literal["sequential"] = "sequential"

    def take(self, parts: Parts, memory: RadarMemory, messages: Messages, until_s: float) -> RadarMemory:
        """The memory after these messages. Messages whose gates have no track in common are taken together."""
        for some in rounds(parts, self, memory.table, messages):
            memory = take_at_once(parts, self, memory, some)
        return memory


def rounds(parts: Parts, rules: MessageSettings, table: Table, messages: Messages) -> list[Messages]:
    """The messages that are taken at once, in turn: each later than those before it that share a track or an id with it."""
    batch, count = columns_of(messages), len(messages)
    pairs = near(parts, table, batch)
    ids, name = np.unique(messages.mmsi, return_inverse=True)
    reach_m = parts.existence.max_speed_kn * KNOT_M_S * float(np.ptp(batch.time))
    reach_m += math.sqrt(2.0 * rules.limit * float(batch.covariance.max()))
    from scipy.spatial import cKDTree  # slow to import, and few runs use it

    close = cKDTree(batch.position).query_pairs(reach_m, output_type="ndarray")  # one may begin a track that the other is of
    message = np.concatenate([pairs.plot, np.arange(count)])
    node = np.concatenate([len(ids) + pairs.track, name])
    order, by_later = np.argsort(message, kind="stable"), np.lexsort(close.T)
    find = kernels.tracks.message_clusters.rounds
    turn = find(count, message[order], node[order], len(ids) + len(table.track_id), close[by_later].astype(np.int64))
    return [messages.take(np.flatnonzero(turn == number)) for number in range(int(turn.max(initial=-1)) + 1)]


class PreciseBatch(MessageSettings):
    """The AIS messages of one id since the last plots as one measurement: method B of Hem and Brekke."""

    method: Literal["precise_batch"] = "precise_batch"

    def take(self, parts: Parts, memory: RadarMemory, messages: Messages, until_s: float) -> RadarMemory:
        """The memory after these messages. Each track in reach is run through those of an id."""
        table, models = memory.table, parts.bank.models
        messages = messages.take(np.argsort(messages.mmsi, kind="stable"))
        begin = np.flatnonzero(np.diff(messages.mmsi, prepend=-1))
        end = np.append(begin[1:], len(messages))
        first = columns_of(messages.take(begin))
        pairs = by_track(near(parts, table, first), len(models))
        of = pairs.slot[pairs.track]
        born = _begun(parts, messages.take(begin), len(models))
        both = Filters(*(np.concatenate([a[of], b]) for a, b in zip(table.filters, born, strict=True)))
        time = np.concatenate([table.updated_s[of], first.time])
        rows = np.concatenate([begin[pairs.plot], begin + 1]), np.concatenate([end[pairs.plot], end])
        run = kernels.tracks.message_clusters.run_through
        measured = messages.time_s, *measurements_of(messages)
        log_likelihood, fit = run(tuple(both), time, rows, measured, until_s, self.limit, parts.bank.prior.renewal_s, models)
        kept, many = np.flatnonzero(fit[: len(of)]), len(of)
        of_new = log_likelihood[many:] + log_density_of_velocity(parts, messages.take(begin))
        found = exponential(log_likelihood[kept] - of_new[pairs.plot[kept]])
        slot, number = np.unique(of[kept], return_inverse=True)
        start = np.searchsorted(number, np.arange(len(slot) + 1))
        candidate = Candidate(slot, start, pairs.plot[kept], found)
        predict(parts, memory, slot, until_s)
        probability, share, new = weigh(parts, self, memory, candidate, messages.mmsi[begin], alone=False)
        mean, spread = kernels.filters.imm.estimate_filters(*(column[many:] for column in both))
        new = first_of_new(parts, self, new, end - begin, mean[:, :2], spread[:, :2, :2])
        others, least = tuple(column[kept] for column in both), parts.existence.least_model_probability
        mix = kernels.tracks.message_clusters.mix_filters
        mix(tuple(table.filters), table.estimates, slot, start, others, share, least, models)
        last = columns_of(messages.take(end - 1))
        record(parts, memory, candidate, probability, last)
        begun = np.flatnonzero(new >= self.begin_existence)
        memory = begin_named(parts, self, memory, last, messages.mmsi[begin], new)
        if len(begun):
            table = memory.table
            slots = table.live[-len(begun) :]
            for column, run_on in zip(table.filters, both, strict=True):
                column[slots] = run_on[many + begun]
            table.updated_s[slots] = time[many + begun]
            kernels.filters.imm.combine_filters(tuple(table.filters), table.estimates, slots, models)
        return memory


def _begun(parts: Parts, messages: Messages, models: int) -> Filters:
    """Filters that know one message each."""
    batch, count = columns_of(messages), len(messages)
    filters = Filters(np.empty((count, models, 5)), np.empty((count, models, 5, 5)), np.empty((count, models)))
    estimates = Estimates(np.empty(count), np.empty((count, 4)), np.empty((count, 4, 4)), np.empty(count))
    CompiledBank(parts.bank.prior).initialise(filters, estimates, np.arange(count), np.arange(count), batch)
    update_new(parts, filters, np.arange(count), messages)
    return filters


class NoisyBatch(MessageSettings):
    """The newest AIS message of each id since the last plots, taken at the time of the plots that follow: method C.

    Of a paper, for comparison.
    """

    method: Literal["noisy_batch"] = "noisy_batch"
    sigma_m: Annotated[float, Field(gt=0.0)] = 8.0  # per axis, in place of their own noise: they are older than the plots

    def take(self, parts: Parts, memory: RadarMemory, messages: Messages, until_s: float) -> RadarMemory:
        """The memory after these messages, as if they were of this time."""
        order = np.argsort(messages.mmsi, kind="stable")
        newest = order[np.diff(messages.mmsi[order], append=-1) != 0]
        ids, size = np.unique(messages.mmsi, return_counts=True)
        messages = messages.take(np.sort(newest))
        noise = np.tile(self.sigma_m**2 * np.eye(2), (len(messages), 1, 1))
        now = replace(messages, time_s=np.full(len(messages), until_s), covariance=noise)
        return take_at_once(parts, self, memory, now, size[np.searchsorted(ids, now.mmsi)])
