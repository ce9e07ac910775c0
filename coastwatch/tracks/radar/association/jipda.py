"""Joint integrated probabilistic data association: every track weighs the plots in its gate, and every plot may be a new vessel.

Source: A. G. Hem, E. F. Brekke, Variations of joint integrated data association with radar and target-provided measurements,
Journal of Advances in Information Fusion 17(2), 2022, sections III to V.
"""

from __future__ import annotations

from typing import ClassVar, Literal

import numpy as np

from coastwatch import kernels
from coastwatch.batches import Floats, Ints
from coastwatch.kernels.tracks.columns import Candidates, PlotColumns
from coastwatch.kernels.tracks.existence import EXISTS, LATELY, SURELY
from coastwatch.kernels.tracks.joint_update import Hypotheses
from coastwatch.tracks.radar import plots_alone
from coastwatch.tracks.radar.life.existence import merge_duplicates
from coastwatch.tracks.radar.parts import LIKELY, ExpectedPlots, Parts, begin_look, begin_tracks, gated_by_plots
from coastwatch.tracks.radar.plot_association import PlotAssociation
from coastwatch.tracks.radar.table import RadarMemory


class Jipda(PlotAssociation):
    """Each track weighs all plots in its gate, and each plot may be of a vessel without a track."""

    upkeep: ClassVar[str] = "existence"
    literal: ClassVar[bool] = False  # as printed
    method: Literal["jipda"] = "jipda"

    def track_batch(self, parts: Parts, memory: RadarMemory, batch: PlotColumns) -> tuple[RadarMemory, Ints]:
        """Weigh the plots of a batch of one radar. Returns: memory, the slot of the track that most likely took each plot, or -1."""
        table, radar = memory.table, int(batch.sensor[0])
        expected = begin_look(parts, memory, batch)
        pairs, added = gated_by_plots(parts, table, batch)
        half_turn_s = 0.5 * float(parts.sensors.radars.period_s[radar])
        due = (
            batch.time[pairs.plot] - table.radar_s[pairs.track, radar] > half_turn_s
        )  # it took no plot of this radar in this look
        hypotheses = parts.joint.predict_to_plots(table, Candidates(*(column[due] for column in pairs)), batch, added)
        probability = self._update(parts, memory, hypotheses, expected, batch)
        likely = np.flatnonzero(probability > LIKELY)
        best = np.full(len(batch.time), -1)
        best[hypotheses.plot[likely]] = hypotheses.slot[hypotheses.track[likely]]
        return self._with_free_plots(parts, memory, hypotheses, probability, expected, batch), best

    def _update(
        self, parts: Parts, memory: RadarMemory, hypotheses: Hypotheses, expected: ExpectedPlots, batch: PlotColumns
    ) -> Floats:
        """Weigh the plots and update the tracks, in place. Returns: the probability that each pair is right. (A,)"""
        table, rules, radar, detection = memory.table, parts.existence, int(batch.sensor[0]), expected.detection
        period_s = float(parts.sensors.radars.period_s[radar])
        slot, plot, of = hypotheses.slot, hypotheses.plot, hypotheses.track
        kernels.tracks.existence.predict_existence(
            table.existing, slot, table.updated_s[slot], radar, period_s, expected.radars, rules.chain
        )
        sought = (table.existence[slot] >= EXISTS) & (table.updated_s[slot] - table.radar_s[slot, radar] <= LATELY * period_s)
        r, eta = table.existence[slot], table.visibility[slot]
        missed = 1.0 - r * eta * detection
        density = expected.false_per_m2 if self.literal else expected.untracked_per_m2
        weight = (detection * eta * r / missed)[of] * parts.joint.likelihood(table, hypotheses) / density[plot]
        probability: Floats = kernels.association.marginals.marginals(
            plot, of, weight, len(batch.time), len(slot), rules.exact_up_to
        )
        taken = np.minimum(np.bincount(of, probability, len(slot)), 1.0)
        survived = (1.0 - taken) * r * (1.0 - eta * detection) / missed
        exists = survived + taken
        share = probability / exists[of]
        parts.joint.update_by_shares(table, hypotheses, share, batch, rules.least_model_probability)
        table.existence[slot] = np.minimum(exists, SURELY)
        table.visibility[slot] = (survived * (1.0 - detection) * eta / (1.0 - detection * eta) + taken) / exists
        if rules.rates.learnt:
            memory.rates.detections[radar] += taken[sought].sum()
            memory.rates.looks[radar] += sought.sum()
        table.looked_s[slot, radar] = table.updated_s[slot]
        table.misses[slot] = 0
        likely = np.flatnonzero(probability > LIKELY)
        kernels.tracks.track_life.record(table.life, slot[of[likely]], plot[likely], batch)
        table.note_moved(parts.clutter, slot)
        if memory.plots_alone.models:
            plots_alone.update(memory.plots_alone, table, parts, slot[of], plot, share, likely, batch)
        return probability

    def _with_free_plots(
        self,
        parts: Parts,
        memory: RadarMemory,
        hypotheses: Hypotheses,
        probability: Floats,
        expected: ExpectedPlots,
        batch: PlotColumns,
    ) -> RadarMemory:
        """The memory with what the plots of no track teach of clutter, and the tracks that they begin. Args: probability: (A,)."""
        rules, clutter, radar, count = parts.existence, parts.clutter, int(batch.sensor[0]), len(batch.time)
        plot = hypotheses.plot
        free: Floats = np.maximum(1.0 - np.bincount(plot, probability, count), 0.0)
        if self.literal:
            free = np.where(np.bincount(plot, minlength=count) == 0, 1.0, 0.0)
        if rules.rates.learnt:
            memory = memory.decided(clutter, parts.sensors.radars, batch, free)
            memory.rates.false_plots[radar] += (free * expected.false_per_m2 / expected.untracked_per_m2).sum()
        false = free
        if clutter.learnt is True:
            moving = np.bincount(plot, probability * memory.table.moving(hypotheses.slot)[hypotheses.track], count)
            false = np.clip(1.0 - moving, 0.0, 1.0)
        memory = memory.with_clutter(clutter, batch, false, float(parts.sensors.radars.period_s[radar]))
        existence = free * expected.unborn_per_m2 / expected.untracked_per_m2
        least = rules.least_existence(expected.radars.probability, expected.false_of_radar_per_m2)[0][radar]
        plots = np.flatnonzero(existence >= least)
        if len(plots):
            memory = begin_tracks(parts.bank, memory, plots, batch)
            memory.table.existence[memory.table.live[-len(plots) :]] = existence[plots]
        return memory

    def end_cycle(self, parts: Parts, memory: RadarMemory, time_s: float) -> RadarMemory:
        """Merge tracks of one vessel."""
        return merge_duplicates(parts.existence, memory, parts.sensors.radars.period_s, time_s)


class JipdaLiteral(Jipda):
    """As `jipda`, as printed: a plot of no track is clutter, equation (69), and only a plot in no gate begins a track.

    Of a paper, for comparison.
    """

    literal: ClassVar[bool] = True
    method: Literal["jipda_literal"] = "jipda_literal"  # type: ignore[assignment]
