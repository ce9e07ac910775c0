"""Method B of Hem and Brekke: the AIS messages of one id since the last plots as one measurement."""

from __future__ import annotations

from typing import Literal

import numpy as np

from coastwatch import kernels
from coastwatch.batches import Messages
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
    update_new,
    weigh,
)
from coastwatch.tracks.radar.motion import Filters
from coastwatch.tracks.radar.parts import Parts
from coastwatch.tracks.radar.table import RadarMemory


class PreciseBatch(MessageSettings):
    """The AIS messages of one id since the last plots as one measurement: method B of Hem and Brekke.

    Of a paper, for comparison.
    """

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
