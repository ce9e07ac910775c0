"""Joint probabilistic data association of tracks that live by hits: M of N plots begin a track, looks without one end it.

Sources: Y. Bar-Shalom, X. R. Li, Multitarget-Multisensor Tracking, 1995, section 6.2; F. Heymann et al., Validation of Radar Image Tracking
Algorithms with Simulated Data, section 3.2.1 (the life of tracks).
"""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar, Literal

import numpy as np

from coastwatch import kernels
from coastwatch.batches import Floats, Ints
from coastwatch.kernels.tracks.columns import Candidates, PlotColumns
from coastwatch.stage import Probability
from coastwatch.tracks.radar.association.nearest_neighbour import associate, update_by_single_plots
from coastwatch.tracks.radar.life.hits import remove_duplicates
from coastwatch.tracks.radar.parts import Parts, begin_tracks, candidates_by_largest_noise
from coastwatch.tracks.radar.plot_association import PlotAssociation
from coastwatch.tracks.radar.table import RadarMemory, Status

LIKELY = 0.5  # a look has a plot, and a plot its track, from this probability on
EXACT = 8  # tracks or plots of a cluster up to which all joint assignments are summed


class Jpda(PlotAssociation):
    """Each confirmed track weighs all plots in its gate. Plots that are likely of none begin tracks, which take one plot a look."""

    upkeep: ClassVar[str] = "hits"
    banks: ClassVar[tuple[str, ...]] = ("compiled",)
    method: Literal["jpda"] = "jpda"
    least_model_probability: Probability = 1e-4  # of a motion model, after an update

    def track_batch(self, parts: Parts, memory: RadarMemory, batch: PlotColumns) -> tuple[RadarMemory, Ints]:
        """Weigh the plots of a batch of one radar. Returns: memory, the slot of the track that likely took each plot, -1 for none."""
        rules, clutter, radar = parts.hits, parts.clutter, int(batch.sensor[0])
        period_s = float(parts.sensors.radars.period_s[radar])
        per_m2 = memory.false_plots_per_m2(clutter, batch, rules.false_plots_per_m2)
        slot, free_probability = self._weigh(parts, memory, batch, per_m2)
        table = memory.table
        rest = np.flatnonzero(free_probability > LIKELY)
        begins = rest
        if len(rest):
            others = replace(table, live=table.live[table.status[table.live] != Status.CONFIRMED])
            few = PlotColumns._make(column[rest] for column in batch)
            taken, free = associate(rules, others, few, period_s, per_m2[rest], clutter.learnt is True)
            begins, rows = rest[free], rest[taken >= 0]
            slot[rows] = taken[taken >= 0]
            update_by_single_plots(parts, table, np.where(np.isin(np.arange(len(slot)), rows), slot, -1), batch)
        false = np.where(table.moving(slot), 0.0, free_probability)
        memory = memory.with_clutter(clutter, batch, false, period_s)
        if len(begins):
            memory = begin_tracks(parts.bank, memory, begins, batch)
        return memory, slot

    def end_cycle(self, parts: Parts, memory: RadarMemory, time_s: float) -> RadarMemory:
        """Delete duplicates."""
        return remove_duplicates(parts.hits, memory, parts.sensors.radars.period_s, time_s)

    def _weigh(self, parts: Parts, memory: RadarMemory, batch: PlotColumns, per_m2: Floats) -> tuple[Ints, Floats]:
        """Update the confirmed tracks. Returns: the slot that likely took each plot, -1: none; the probability that none did. (M,), (M,)"""
        table, rules, radar, count = memory.table, parts.hits, int(batch.sensor[0]), len(batch.time)
        period_s, detection = float(parts.sensors.radars.period_s[radar]), rules.detection_probability
        confirmed = table.live[table.status[table.live] == Status.CONFIRMED]
        pairs = candidates_by_largest_noise(parts, table.estimates, confirmed, batch)
        due = batch.time[pairs.plot] - table.radar_s[pairs.track, radar] > 0.5 * period_s  # it took no plot in this look
        hypotheses = parts.joint.predict_to_plots(table, Candidates(*(column[due] for column in pairs)), batch)
        plot, of, tracks = hypotheses.plot, hypotheses.track, hypotheses.slot
        missed = 1.0 - detection * rules.gate_probability
        weight = detection / missed * parts.joint.likelihood(table, hypotheses) / per_m2[plot]
        marginals = kernels.association.marginals
        share = marginals.marginals(plot, of, weight, count, len(tracks), EXACT)
        parts.joint.update_by_shares(table, hypotheses, share, batch, self.least_model_probability)
        by, hit, best = marginals.plots_of_tracks(plot, of, share, count, len(tracks), LIKELY)
        kernels.tracks.track_life.record(table.life, tracks[hit], best[hit], batch)
        table.note_moved(parts.clutter, tracks[hit])
        return np.append(tracks, -1)[by], np.maximum(1.0 - np.bincount(plot, share, count), 0.0)
