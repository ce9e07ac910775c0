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
from coastwatch.tracks.radar import plots_alone
from coastwatch.tracks.radar.life.existence import merge_duplicates
from coastwatch.tracks.radar.parts import LIKELY, Parts, begin_tracks, false_plots_at, gated_by_plots, learn_turn
from coastwatch.tracks.radar.plot_association import PlotAssociation
from coastwatch.tracks.radar.table import RadarMemory


class Jipda(PlotAssociation):
    """Each track weighs all plots in its gate, and each plot may be of a vessel without a track."""

    upkeep: ClassVar[str] = "existence"
    literal: ClassVar[bool] = False  # as printed
    method: Literal["jipda"] = "jipda"

    def track_batch(self, parts: Parts, memory: RadarMemory, batch: PlotColumns) -> tuple[RadarMemory, Ints]:
        """Weigh the plots of a batch of one radar. Returns: memory, the slot of the track that most likely took each plot, or -1."""
        table, rules, clutter, radar = memory.table, parts.existence, parts.clutter, int(batch.sensor[0])
        period_s = float(parts.sensors.radars.period_s[radar])
        learn_turn(parts, memory, batch)
        columns, every_density = rules.by_number(memory.rates, parts.sensors.radars)
        detection = float(columns.probability[radar])
        false_per_m2 = false_plots_at(parts, memory, batch, float(every_density[radar]))
        unborn_per_m2 = rules.new_per_m2(columns.probability)[radar]
        pairs, added = gated_by_plots(parts, table, batch)
        due = (
            batch.time[pairs.plot] - table.radar_s[pairs.track, radar] > 0.5 * period_s
        )  # it took no plot of this radar in this look
        hypotheses = parts.joint.predict_to_plots(table, Candidates(*(column[due] for column in pairs)), batch, added)
        slot, plot, of = hypotheses.slot, hypotheses.plot, hypotheses.track
        kernels.tracks.existence.predict_existence(
            table.existing, slot, table.updated_s[slot], radar, period_s, columns, rules.chain
        )
        sought = (table.existence[slot] >= EXISTS) & (table.updated_s[slot] - table.radar_s[slot, radar] <= LATELY * period_s)
        r, eta = table.existence[slot], table.visibility[slot]
        missed = 1.0 - r * eta * detection
        weight = (
            (detection * eta * r / missed)[of]
            * parts.joint.likelihood(table, hypotheses)
            / (false_per_m2 if self.literal else false_per_m2 + unborn_per_m2)[plot]
        )
        probability: Floats = kernels.association.marginals.marginals(
            plot, of, weight, len(batch.time), len(slot), rules.exact_up_to
        )
        taken = np.minimum(np.bincount(of, probability, len(slot)), 1.0)
        survived = (1.0 - taken) * r * (1.0 - eta * detection) / missed
        exists = survived + taken
        parts.joint.update_by_shares(table, hypotheses, probability / exists[of], batch, rules.least_model_probability)
        table.existence[slot] = np.minimum(exists, SURELY)
        table.visibility[slot] = (survived * (1.0 - detection) * eta / (1.0 - detection * eta) + taken) / exists
        if rules.rates.learnt:
            memory.rates.detections[radar] += taken[sought].sum()
            memory.rates.looks[radar] += sought.sum()
        table.looked_s[slot, radar] = table.updated_s[slot]
        table.misses[slot] = 0
        likely = np.flatnonzero(probability > LIKELY)
        kernels.tracks.track_life.record(table.life, slot[of[likely]], plot[likely], batch)
        table.note_moved(clutter, slot)
        if memory.plots_alone.models:
            plots_alone.update(memory.plots_alone, table, parts, slot[of], plot, probability / exists[of], likely, batch)
        best = np.full(len(batch.time), -1)
        best[plot[likely]] = slot[of[likely]]
        free: Floats = np.maximum(1.0 - np.bincount(plot, probability, len(batch.time)), 0.0)
        if self.literal:
            free = np.where(np.bincount(plot, minlength=len(batch.time)) == 0, 1.0, 0.0)
        if rules.rates.learnt:
            memory = memory.decided(clutter, parts.sensors.radars, batch, free)
            memory.rates.false_plots[radar] += (free * false_per_m2 / (false_per_m2 + unborn_per_m2)).sum()
        moving = np.bincount(plot, probability * table.moving(slot)[of], len(batch.time))
        false = np.clip(1.0 - moving, 0.0, 1.0) if clutter.learnt is True else free
        memory = memory.with_clutter(clutter, batch, false, period_s)
        existence = free * unborn_per_m2 / (false_per_m2 + unborn_per_m2)
        plots = np.flatnonzero(existence >= rules.least_existence(columns.probability, every_density)[0][radar])
        if len(plots):
            memory = begin_tracks(parts.bank, memory, plots, batch)
            memory.table.existence[memory.table.live[-len(plots) :]] = existence[plots]
        return memory, best

    def end_cycle(self, parts: Parts, memory: RadarMemory, time_s: float) -> RadarMemory:
        """Merge tracks of one vessel."""
        return merge_duplicates(parts.existence, memory, parts.sensors.radars.period_s, time_s)


class JipdaLiteral(Jipda):
    """As `jipda`, as printed: a plot of no track is clutter, equation (69), and only a plot in no gate begins a track.

    Of a paper, for comparison.
    """

    literal: ClassVar[bool] = True
    method: Literal["jipda_literal"] = "jipda_literal"  # type: ignore[assignment]
