"""Joint integrated probabilistic data association: every track weighs the plots in its gate, and every plot may be a new vessel."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from coastwatch import kernels
from coastwatch.batches import Floats, Ints, Sensors
from coastwatch.kernels.filters.gaussian import gate
from coastwatch.kernels.tracks.columns import Candidates, Estimates, PlotColumns, RadarColumns
from coastwatch.kernels.tracks.existence import SURELY
from coastwatch.kernels.tracks.joint_update import Hypotheses
from coastwatch.tracks.clutter import ClutterSettings
from coastwatch.tracks.filter_bank import CompiledBank
from coastwatch.tracks.joint.existence import (
    ExistenceManagement,
    confirm_and_find_lost,
    existence_at,
    merge_duplicates,
    shown,
)
from coastwatch.tracks.table import RadarMemory, Status, Table, begin_tracks

LIKELY = 0.5  # a plot is reported as taken by the track that it belongs to with more than this probability


@dataclass(frozen=True)
class JointAssociation:
    """Filters and settings of the tracker of a region. The steps of `coastwatch.tracks.region.RegionTracker`."""

    bank: CompiledBank
    management: ExistenceManagement
    clutter: ClutterSettings
    sensors: Sensors

    def track_batch(self, memory: RadarMemory, batch: PlotColumns) -> tuple[RadarMemory, Ints]:
        """Weigh the plots of a batch of one radar. Returns: memory, the slot of the track that most likely took each plot, or -1."""
        table, rules, radar = memory.table, self.management, int(batch.sensor[0])
        every_detection, every_density = rules.by_number(self.sensors.radars)
        detection = float(every_detection[radar])
        false_per_m2 = memory.false_plots_per_m2(self.clutter, batch, float(every_density[radar]))
        unborn_per_m2 = rules.new_vessels_per_m2 * rules.new_visibility * detection
        period_s = float(self.sensors.radars.period_s[radar])
        hypotheses = self._predict_to(table, self._candidates(table, batch, period_s), batch)
        slot, plot = hypotheses.slot, hypotheses.plot
        of = np.repeat(np.arange(len(slot)), np.diff(hypotheses.start))  # track of each pair
        kernels.tracks.existence.predict_existence(
            table.existing, slot, table.updated_s[slot], radar, period_s, detection, rules.chain
        )
        r, eta = table.existence[slot], table.visibility[slot]
        missed = 1.0 - r * eta * detection
        weight = (
            (detection * eta * r / missed)[of]
            * self._likelihood(table, hypotheses)
            / self._nobodys(false_per_m2, unborn_per_m2)[plot]
        )
        find = kernels.association.marginals.marginals
        probability = find(plot, of, weight, len(batch.time), len(slot), rules.exact_up_to)
        taken = np.minimum(np.bincount(of, probability, len(slot)), 1.0)
        survived = (1.0 - taken) * r * (1.0 - eta * detection) / missed
        exists = survived + taken
        self._update(table, hypotheses, probability / exists[of], batch)
        table.existence[slot] = np.minimum(exists, SURELY)
        table.visibility[slot] = (survived * (1.0 - detection) * eta / (1.0 - detection * eta) + taken) / exists
        table.looked_s[slot, radar] = table.updated_s[slot]
        table.misses[slot] = 0
        likely = np.flatnonzero(probability > LIKELY)
        kernels.tracks.track_life.record(table.life, slot[of[likely]], plot[likely], batch)
        table.note_moved(self.clutter, slot)
        moving = table.moved[slot] & (table.status[slot] == Status.CONFIRMED)
        false = np.clip(1.0 - np.bincount(plot, probability * moving[of], len(batch.time)), 0.0, 1.0)
        memory = memory.with_clutter(self.clutter, batch, false, period_s)
        best = np.full(len(batch.time), -1)
        best[plot[likely]] = slot[of[likely]]
        free = self._free(plot, probability, len(batch.time))
        return self._begin(memory, batch, free * unborn_per_m2 / (false_per_m2 + unborn_per_m2)), best

    def end_slice(self, memory: RadarMemory, radars: RadarColumns, ours: Ints, time_s: float) -> RadarMemory:
        """Count the looks that gave no plot, confirm and delete tracks. Args: as of `RegionTracker`."""
        table, rules = memory.table, self.management
        detection, _ = rules.by_number(self.sensors.radars)
        looked = radars, ours, detection[ours], rules.look_slack, rules.chain
        kernels.tracks.existence.count_missed_looks(table.existing, table.estimates, table.live, *looked)
        return replace(memory, table=table.without(confirm_and_find_lost(rules, table, time_s)))

    def end_cycle(self, memory: RadarMemory, time_s: float) -> RadarMemory:
        """Merge tracks of one vessel."""
        table = merge_duplicates(self.management, memory.table, self.sensors.radars.period_s, time_s)
        return replace(memory, table=table)

    def shown(self, table: Table, time_s: float) -> Ints:
        """Slots of the tracks to report."""
        return shown(self.management, table, time_s)

    def existence(self, table: Table, slots: Ints, time_s: float) -> Floats:
        """The probability that there is a vessel behind each of these tracks. (N,)"""
        return existence_at(self.management, table, slots, time_s)

    def _nobodys(self, false_per_m2: Floats, unborn_per_m2: float) -> Floats:
        """The density of plots that are of no track. (M,)"""
        return false_per_m2 + unborn_per_m2

    def _free(self, plot: Ints, probability: Floats, count: int) -> Floats:
        """The probability that each plot is of no track. (M,) Args: plot, probability: (A,) of each pair; count: M."""
        free: Floats = np.maximum(1.0 - np.bincount(plot, probability, count), 0.0)
        return free

    def _predict_to(self, table: Table, pairs: Candidates, batch: PlotColumns) -> Hypotheses:
        """Predict each track to the newest of its plots, in place. Returns: the pairs by track, with their likelihoods by model."""
        hypotheses, models = by_track(pairs, len(self.bank.models)), self.bank.models
        given = hypotheses, batch, self.bank.prior.renewal_s, models
        kernels.tracks.joint_update.predict_to_plots(tuple(table.filters), table.estimates, *given)
        return hypotheses

    def _likelihood(self, table: Table, pairs: Hypotheses) -> Floats:
        """The likelihood of each plot, given its track. (A,)"""
        mode = table.mode_probability[np.repeat(pairs.slot, np.diff(pairs.start))]
        total: Floats = (mode * pairs.likelihood).sum(axis=1)
        return total

    def _update(self, table: Table, pairs: Hypotheses, share: Floats, batch: PlotColumns) -> None:
        """Update each track by all of its plots, in place. Args: share: (A,) probability of each, given that the track exists."""
        given = pairs, share, self.management.least_model_probability, self.bank.models
        kernels.tracks.joint_update.update_by_shares(tuple(table.filters), table.estimates, *given)

    def _candidates(self, table: Table, batch: PlotColumns, period_s: float) -> Candidates:
        """The plots in the gates of the tracks that took none of this radar in this look."""
        pairs = self._gated(table.estimates, table.live, batch)
        due = batch.time[pairs.plot] - table.radar_s[pairs.track, batch.sensor[0]] > 0.5 * period_s
        return pairs if due.all() else Candidates(*(column[due] for column in pairs))

    def _gated(self, estimates: Estimates, slots: Ints, batch: PlotColumns, widened: float = 1.0) -> Candidates:
        """The plots or messages in the gates of these tracks.

        A gate is as wide as by the liveliest model: the average of the models would lose vessels that manoeuvre while they are missed.
        """
        limit = widened * gate(self.management.gate_probability, 2)
        lively = estimates._replace(noise=np.full(len(estimates.noise), self.bank.models["noise"].max()))
        pairs: Candidates = kernels.tracks.gate.candidates(lively, slots, batch, limit, self.management.late_s)
        return pairs

    def _begin(self, memory: RadarMemory, batch: PlotColumns, existence: Floats) -> RadarMemory:
        """Begin a track at each plot that is probable enough to be a new vessel. Args: existence: (M,)."""
        plots = np.flatnonzero(existence >= self.management.begin_existence)
        if not len(plots):
            return memory
        memory = begin_tracks(self.bank, memory, plots, batch)
        memory.table.existence[memory.table.live[-len(plots) :]] = existence[plots]
        return memory


def by_track(pairs: Candidates, models: int) -> Hypotheses:
    """These pairs sorted by track, then plot, with room for what the kernel fills in."""
    order = np.argsort(pairs.track, kind="stable")
    track, count = pairs.track[order], len(order)
    first = np.flatnonzero(np.diff(track, prepend=-1))
    start = np.append(first, count)
    return Hypotheses(
        track[first], start, pairs.plot[order], np.empty((count, 2)), np.empty((count, 2, 2)), np.empty((count, models))
    )


class LiteralAssociation(JointAssociation):
    """As `JointAssociation`, as printed: a plot of no track is clutter, equation (69), and only a plot in no gate begins a track."""

    def _nobodys(self, false_per_m2: Floats, unborn_per_m2: float) -> Floats:
        return false_per_m2

    def _free(self, plot: Ints, probability: Floats, count: int) -> Floats:
        free: Floats = np.where(np.bincount(plot, minlength=count) == 0, 1.0, 0.0)
        return free
