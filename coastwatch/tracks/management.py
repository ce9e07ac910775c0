"""Radar plots of one region into tracks, slice of time by slice of time, whatever bank of filters does the sums."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from coastwatch.batches import Floats, Measurements, Plots, Sensors, Tracks
from coastwatch.tracks.lifecycle import quick_enough, survivors, usable, without_twins
from coastwatch.tracks.matching import apply, begins, candidates, choose
from coastwatch.tracks.motion import Prior
from coastwatch.tracks.report import report, taken_plots
from coastwatch.tracks.table import Bank, RadarMemory, Stage, Table, Taken, coverage_of, started
from coastwatch.tracks.upkeep import PlotOrigin, Upkeep


def track_region(
    motion: Prior,
    upkeep: Upkeep,
    plot_origin: PlotOrigin,
    bank: Bank,
    memory: RadarMemory,
    plots: Plots,
    time_s: float,
    *,
    sensors: Sensors,
    region: int,
) -> tuple[RadarMemory, Tracks, Measurements]:
    """Memory after a cycle, the confirmed tracks at its end, and the plots that they took in it.

    Args: plots: of this region, in any order; time_s: end of the cycle; region: its number.
    """
    memory = memory.for_radars(len(sensors.radars))
    good = usable(upkeep, plots, time_s)
    memory = replace(memory, dropped=memory.dropped + int((~good).sum()))
    plots = plots.take(good)
    plots = plots.take(np.argsort(plots.time_s, kind="stable"))
    slice_s = quick_enough(upkeep.slice_s, sensors.radars.period_s[sensors.radars.region == region])
    number = np.floor(plots.time_s / slice_s).astype(np.int64)
    cuts = np.flatnonzero(np.diff(number)) + 1
    taken = []
    for rows in np.split(np.arange(len(plots)), cuts) if len(plots) else []:
        part = plots.take(rows)
        memory = memory.hear(part)
        if plot_origin == "known":
            memory, used = _by_origin(motion, bank, memory, part)
        else:
            memory, used = _by_place(motion, upkeep, bank, memory, part, sensors.radars.period_s)
        taken.append(used)
        memory = _survive(upkeep, memory, float(part.time_s[-1]), sensors, region)
    memory = _survive(upkeep, memory, time_s, sensors, region)
    tracks = report(bank, memory, time_s, sensors, region)
    return memory, tracks, taken_plots(tracks, taken, sensors, region)


def _survive(upkeep: Upkeep, memory: RadarMemory, time_s: float, sensors: Sensors, region: int) -> RadarMemory:
    kept = survivors(upkeep, memory.table, coverage_of(memory, sensors, region), memory.heard_s, time_s)
    return replace(memory, table=kept)


def _by_place(
    motion: Prior, upkeep: Upkeep, bank: Bank, memory: RadarMemory, plots: Plots, period_s: Floats
) -> tuple[RadarMemory, Taken]:
    """One slice: tracks of more than one plot take theirs, single plots find a second, what is left begins new tracks."""
    memory = _merge(upkeep, bank, memory, float(plots.time_s[0]), period_s)
    table = memory.table
    rows = np.flatnonzero(table.stage != Stage.SINGLE)
    pairs = candidates(upkeep, bank, table, rows, plots, period_s)
    chosen = choose(table, pairs, plots, len(period_s))
    free = begins(pairs, chosen, plots)
    used = pairs.take(chosen)
    taken = [Taken(table.track_id[used.track], plots.take(used.plot))]
    table = apply(bank, table, used.track, used.plot, plots, used.after)
    memory = replace(memory, table=table)
    for radar in np.unique(plots.sensor[free]).tolist():
        memory, begun = _begin(motion, upkeep, bank, memory, plots.take(free & (plots.sensor == radar)), period_s)
        taken.append(begun)
    return memory, Taken.join(taken)


def _begin(
    motion: Prior, upkeep: Upkeep, bank: Bank, memory: RadarMemory, plots: Plots, period_s: Floats
) -> tuple[RadarMemory, Taken]:
    """The plots of one radar that no track took: to single plots of before, of any radar, or else new single plots."""
    table = memory.table
    rows = np.flatnonzero(table.stage == Stage.SINGLE)
    pairs = candidates(upkeep, bank, table, rows, plots, period_s)
    used = pairs.take(choose(table, pairs, plots, len(period_s)))
    table = apply(bank, table, used.track, used.plot, plots, used.after)
    left = np.ones(len(plots), np.bool_)
    left[used.plot] = False
    return _append(motion, replace(memory, table=table), plots.take(left)), Taken(
        table.track_id[used.track], plots.take(used.plot)
    )


def _append(motion: Prior, memory: RadarMemory, plots: Plots) -> RadarMemory:
    fresh = started(motion, plots, memory.next_id, len(memory.heard_s))
    return replace(memory, table=Table.join([memory.table, fresh]), next_id=memory.next_id + len(plots))


def _merge(upkeep: Upkeep, bank: Bank, memory: RadarMemory, time_s: float, period_s: Floats) -> RadarMemory:
    table = memory.table
    mean, spread = bank.foresee(table.filters, np.maximum(time_s - table.updated_s, 0.0))
    table, twins = without_twins(upkeep, table, memory.twins, mean, spread, period_s, time_s)
    return replace(memory, table=table, twins=twins)


def _by_origin(motion: Prior, bank: Bank, memory: RadarMemory, plots: Plots) -> tuple[RadarMemory, Taken]:
    """One slice with the known vessel behind each plot: plots of nothing are dropped, two plots are a confirmed track."""
    plots = plots.take(plots.origin >= 0)
    vessels, first = np.unique(plots.origin, return_index=True)
    new = np.sort(first[~np.isin(vessels, memory.table.origins[:, 0])])
    memory = _append(motion, memory, plots.take(new))
    rest = np.delete(np.arange(len(plots)), new)
    table = memory.table
    order = np.argsort(table.origins[:, 0], kind="stable")
    row = order[np.searchsorted(table.origins[order, 0], plots.origin[rest])]
    table = apply(bank, table, row.astype(np.int64), rest, plots, None)
    stage = np.where(table.hits >= 2, np.int64(Stage.CONFIRMED), table.stage)
    taken = Taken(table.track_id[row], plots.take(rest))
    return replace(memory, table=replace(table, stage=stage)), taken
