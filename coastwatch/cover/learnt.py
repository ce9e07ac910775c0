"""Cover of each radar, learnt on line: how probably it detects a vessel, and how dense false plots are, in each polar cell."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Literal, NamedTuple

import numpy as np

from coastwatch import kernels
from coastwatch.batches import (
    COVER_AZIMUTHS,
    COVER_RANGES,
    AisDetection,
    Batch,
    Bools,
    Floats,
    Ints,
    Measurements,
    Plots,
    RadarCover,
    Sensors,
    Tracks,
    column,
    cover_cell,
)
from coastwatch.cover.inputs import CoverInput, CoverOutput
from coastwatch.geodesy import difference_m, from_plane
from coastwatch.kernels.tables.lookup import find, row_of
from coastwatch.stage import Count, Method, NotNegative, Positive, Probability

CELLS = COVER_AZIMUTHS * COVER_RANGES
STILL_M_S = 0.5  # slower vessels stay in the cell of their visit
PAUSE_TURNS = 3.0  # a radar that was silent for longer has not turned


@dataclass(frozen=True, eq=False)
class Visits(Batch):
    """AIS vessels that are in one cell of a radar without interruption, sorted by radar, then vessel."""

    radar: Ints = column(np.int64, "N")
    track_id: Ints = column(np.int64, "N")
    cell: Ints = column(np.int64, "N")
    looks: Floats = column(np.float64, "N")  # turns of the radar since the vessel came into the cell
    plots: Floats = column(np.float64, "N")  # of the vessel in these turns


@dataclass(frozen=True, eq=False)
class CellCounts(Batch):
    """Sums over turns for each of R radars and its C cells. Older turns count less."""

    site_deg: Floats = column(np.float64, "R", 2, new=np.nan)  # of the antenna; NaN before the first plot
    newest_s: Floats = column(np.float64, "R", new=np.nan)  # newest plot; NaN before the first
    turns: Floats = column(np.float64, "R")
    false_turns: Floats = column(np.float64, "R")  # in which false plots were counted
    ais_looks: Floats = column(np.float64, "R", CELLS)  # at AIS vessels that have left the cell
    ais_plots: Floats = column(np.float64, "R", CELLS)  # of them
    track_looks: Floats = column(np.float64, "R", CELLS)  # at confirmed tracks of plots
    track_plots: Floats = column(np.float64, "R", CELLS)
    false_plots: Floats = column(np.float64, "R", CELLS)  # of no confirmed track

    def forgotten(self, keep: Floats) -> CellCounts:
        """The same with all sums times a factor. Args: keep: (R,)"""
        sums = {f.name: getattr(self, f.name) for f in fields(self) if f.name not in ("site_deg", "newest_s")}
        return replace(self, **{name: (array.T * keep).T for name, array in sums.items()})


@dataclass(frozen=True, eq=False)
class CoverMemory:
    """What is known of the cover of all radars between two cycles; no row before the first."""

    visits: Visits
    counts: CellCounts
    cycle: int  # so far

    def check_rows(self) -> None:
        """Check the numbers of radars and cells, as after reading a checkpoint. Raises: ValueError that names the field."""
        kernels.tables.row_numbers.require_rows("Visits.radar", self.visits.radar, len(self.counts))
        kernels.tables.row_numbers.require_rows("Visits.cell", self.visits.cell, CELLS)


class Turned(NamedTuple):
    """How each radar has turned since the last cycle."""

    site_deg: Floats  # (R, 2)
    newest_s: Floats  # (R,)
    turns: Floats  # (R,) 0 for one that sent no plot
    shift_m: Floats  # (R,) by which its antenna has moved


class Seen(NamedTuple):
    """Pairs of a track and a radar in whose range it is, sorted by radar, then row."""

    radar: Ints  # (P,)
    row: Ints  # (P,) of the tracks
    cell: Ints  # (P,)


class LearntCover(Method):
    """The share of vessels that a radar detects in a turn, in cells of 5 deg by a sixteenth of its range.

    - A vessel with AIS is a reference vessel of the cell where it is: the radar detects it in a turn if a track of the same vessel takes a
      plot of that radar. One visit of a vessel to a cell counts at most `visit_looks` turns, so a moored vessel counts no more than others.
    - The share in a cell begins at the share of the whole radar, worth `prior_visits`. That of the radar begins at
      `prior_probability`, worth as much.
    - The probability for a vessel rests on the other vessels alone. Else a false AIS position would prove that nobody is seen there.

    Confirmed tracks of plots, and plots of no confirmed track, are counted in the same cells. Counts are forgotten with `memory_s`, as
    far as the antenna moves, and where the registration of a radar jumps.
    Source: A. Gelman and others, Bayesian Data Analysis, 3rd edition 2013, section 2.4 (binomial share with a conjugate prior).
    """

    method: Literal["learnt"] = "learnt"
    memory_s: Positive = 7200.0  # time constant with which counts are forgotten while the radar turns
    visit_looks: Positive = 12.0  # turns that one visit of a vessel to a cell counts, at most
    prior_visits: Positive = 2.0  # that the share of the radar is worth in a cell
    prior_probability: Probability = 0.9  # of detection, before anything is known of a radar
    settle_s: NotNegative = 60.0  # AIS tracks heard for less are not counted: association takes time
    most_tracks: Count = 512  # of AIS, and of plots, that are counted in a cycle: a fixed draw
    most_plots: Count = 4096  # of a cycle; with more, false plots are counted in one of 2, 4, ... cycles

    def init(self) -> CoverMemory:
        return CoverMemory(Visits.empty(), CellCounts.empty(), 0)

    def step(self, memory: CoverMemory, given: CoverInput) -> tuple[CoverMemory, CoverOutput]:
        """The cover of each radar after this cycle. Nothing is learnt of a silent radar, and it detects nobody."""
        plots, tracks, associations, sensors, jumped = (
            given.plots,
            given.tracks,
            given.associations,
            given.sensors,
            given.jumped,
        )
        if not len(sensors.radars):
            return memory, CoverOutput(RadarCover.empty(), AisDetection.empty())
        counts = memory.counts if len(memory.counts) else CellCounts.empty(R=len(sensors.radars))
        turned = _turned(counts, plots, sensors)
        before = memory.visits.take(~jumped[memory.visits.radar])
        ring_m = sensors.radars.range_m / COVER_RANGES
        keep = np.exp(-turned.turns * sensors.radars.period_s / self.memory_s - turned.shift_m / ring_m) * ~jumped
        counts = replace(counts.forgotten(keep), site_deg=turned.site_deg, newest_s=turned.newest_s)
        counts.turns[:] += turned.turns

        is_ais = tracks.source == sensors.ais_source
        has_plots = np.zeros(int(associations.vessel.max(initial=-1)) + 1, np.bool_)
        has_plots[associations.vessel[tracks.source < sensors.ais_source]] = True
        heard_for_s = np.where(is_ais, tracks.updated_s - tracks.started_s, 0.0)
        is_reference = is_ais & ~given.alarmed & (heard_for_s >= self.settle_s)
        drawn = self._drawn(tracks, is_reference) | self._drawn(tracks, tracks.source < len(sensors.region_names))
        alone = is_ais & ~has_plots[associations.vessel]
        seen = _staying(_in_range(tracks, np.flatnonzero(drawn | alone), turned, sensors), before, tracks)
        counted = drawn[seen.row] & (turned.turns[seen.radar] > 0.0)
        hits = _plots_of(seen, counted, given, is_ais)

        of_plots = counted & ~is_ais[seen.row]
        _add(counts.track_looks, seen.radar[of_plots], seen.cell[of_plots], turned.turns[seen.radar[of_plots]])
        _add(counts.track_plots, seen.radar[of_plots], seen.cell[of_plots], hits[of_plots])
        due = (memory.cycle + np.arange(len(counts))) % _step(len(plots), self.most_plots) == 0
        counts.false_turns[:] += np.where(due, turned.turns, 0.0)
        _count_false(counts.false_plots, plots, given.measurements, due & (turned.turns > 0.0), sensors)
        visits = self._visited(before, counts, tracks, seen, drawn[seen.row] & is_ais[seen.row], hits, turned)
        looks, ais_plots = counts.ais_looks.copy(), counts.ais_plots.copy()
        weight = self._weight(visits)
        _add(looks, visits.radar, visits.cell, weight * visits.looks)
        _add(ais_plots, visits.radar, visits.cell, weight * visits.plots)
        of_ais = is_ais[seen.row]
        asked = Seen(seen.radar[of_ais], seen.row[of_ais], seen.cell[of_ais])
        detection = self._detection(asked, visits, looks, ais_plots, tracks, given.silent)
        cover = self._cover(counts, looks, ais_plots, sensors)
        return CoverMemory(visits, counts, memory.cycle + 1), CoverOutput(cover, detection)

    def _drawn(self, tracks: Tracks, candidates: Bools) -> Bools:
        """A draw of at most about `most_tracks` of the candidates, by their ids: the same ones while their number is about the same."""
        step = _step(int(candidates.sum()), self.most_tracks)
        return candidates if step == 1 else candidates & (tracks.track_id % step == 0)

    def _weight(self, visits: Visits) -> Floats:
        """What a turn of each visit counts, so that the visit counts at most `visit_looks`. (N,)"""
        return self.visit_looks / np.maximum(visits.looks, self.visit_looks)

    def _visited(
        self, before: Visits, counts: CellCounts, tracks: Tracks, seen: Seen, counted: Bools, hits: Floats, turned: Turned
    ) -> Visits:
        """The visits of this cycle. Those that have ended are added to the counts. Args: counted: (P,) pairs of a reference vessel."""
        radar, row, cell = seen.radar[counted], seen.row[counted], seen.cell[counted]
        turns = turned.turns[radar]
        rows = np.unique(row)
        row_now = np.append(rows, -1)[kernels.tables.match_ids.index_of(tracks.track_id[rows], before.track_id)]
        key = np.where(row_now >= 0, before.radar * len(tracks) + row_now, -1)
        at = row_of(key, radar * len(tracks) + row)
        at[at >= 0] = np.where(before.cell[at[at >= 0]] == cell[at >= 0], at[at >= 0], -1)
        goes_on, ended = at >= 0, np.ones(len(before), np.bool_)
        ended[at[goes_on]] = False
        gone = before.take(ended)
        weight = self._weight(gone)
        _add(counts.ais_looks, gone.radar, gone.cell, weight * gone.looks)
        _add(counts.ais_plots, gone.radar, gone.cell, weight * gone.plots)
        looks, plots = turns.copy(), hits[counted]
        looks[goes_on] += before.looks[at[goes_on]]
        plots[goes_on] += before.plots[at[goes_on]]
        return Visits(radar, tracks.track_id[row], cell, looks, np.minimum(plots, looks))

    def _detection_share(self, plots: Floats, looks: Floats, of_radar: Floats) -> Floats:
        """The share of turns with a plot, with a prior."""
        weight = self.prior_visits * self.visit_looks
        share: Floats = (plots + weight * of_radar) / (looks + weight)
        return share

    def _detection(
        self, asked: Seen, visits: Visits, looks: Floats, plots: Floats, tracks: Tracks, silent: Bools | None
    ) -> AisDetection:
        """The probability that some radar detects an AIS vessel in a turn, by what the other vessels show."""
        own, rows = np.zeros((2, len(asked.row))), np.unique(asked.row)
        row = rows[
            kernels.tables.match_ids.index_of(tracks.track_id[rows], visits.track_id)
        ]  # a visit is of a reference vessel, which is asked
        at = find(visits.radar * len(tracks) + row, asked.radar * len(tracks) + asked.row)
        has_visit = np.flatnonzero(at >= 0)
        weight = self._weight(visits)[at[has_visit]]
        own[:, has_visit] = weight * visits.plots[at[has_visit]], weight * visits.looks[at[has_visit]]
        r, cell = asked.radar, asked.cell
        prior = np.full(len(r), self.prior_probability)
        of_radar = self._detection_share(plots.sum(axis=1)[r] - own[0], looks.sum(axis=1)[r] - own[1], prior)
        probability = self._detection_share(plots[r, cell] - own[0], looks[r, cell] - own[1], of_radar)
        if silent is not None:
            probability[silent[r]] = 0.0
        best = np.zeros(len(rows))
        np.maximum.at(best, np.searchsorted(rows, asked.row), probability)
        return AisDetection(tracks.track_id[rows], best)

    def _cover(self, counts: CellCounts, looks: Floats, plots: Floats, sensors: Sensors) -> RadarCover:
        """The grids of all radars."""
        prior = np.full(len(counts), self.prior_probability)
        of_ais = self._detection_share(plots.sum(axis=1), looks.sum(axis=1), prior)
        of_tracks = self._detection_share(counts.track_plots.sum(axis=1), counts.track_looks.sum(axis=1), prior)
        edges = np.linspace(0.0, 1.0, COVER_RANGES + 1) * sensors.radars.range_m[:, None]
        area = np.pi / COVER_AZIMUTHS * np.diff(edges**2, axis=1)
        shape = len(counts), COVER_AZIMUTHS, COVER_RANGES
        false = counts.false_plots.reshape(shape) / np.maximum(counts.false_turns, 1.0)[:, None, None] / area[:, None, :]
        return RadarCover(
            range_m=sensors.radars.range_m,
            site_deg=counts.site_deg,
            turns=counts.turns.copy(),
            ais_detection=self._detection_share(plots, looks, of_ais[:, None]).reshape(shape),
            ais_looks=looks.reshape(shape),
            track_detection=self._detection_share(counts.track_plots, counts.track_looks, of_tracks[:, None]).reshape(shape),
            track_looks=counts.track_looks.reshape(shape).copy(),
            false_plots_per_m2=false,
        )


def _turned(counts: CellCounts, plots: Plots, sensors: Sensors) -> Turned:
    """How each radar has turned since the last cycle. The first cycle with plots, and one after a pause, counts no turn."""
    radars = sensors.radars
    _, newest, _ = kernels.association.polar_pairs.sweeps(plots.sensor, plots.time_s, plots.site_m, len(radars))
    sent = np.flatnonzero(newest >= 0)
    site_deg, newest_s = counts.site_deg.copy(), counts.newest_s.copy()
    turns, shift_m = np.zeros(len(radars)), np.zeros(len(radars))
    site_deg[sent] = from_plane(plots.site_m[newest[sent]], sensors.region_origin_deg[radars.region[sent]])
    newest_s[sent] = np.fmax(plots.time_s[newest[sent]], counts.newest_s[sent])
    heard_before = sent[np.isfinite(counts.newest_s[sent])]
    passed = (newest_s[heard_before] - counts.newest_s[heard_before]) / radars.period_s[heard_before]
    turns[heard_before] = np.where(passed <= PAUSE_TURNS, passed, 0.0)
    moved_m = difference_m(site_deg[heard_before], counts.site_deg[heard_before])
    shift_m[heard_before] = np.hypot(moved_m[:, 0], moved_m[:, 1])
    return Turned(site_deg, newest_s, turns, shift_m)


def _in_range(tracks: Tracks, rows: Ints, turned: Turned, sensors: Sensors) -> Seen:
    """The pairs of these rows and the radars in whose range they are. A radar that has sent nothing has none."""
    placed = np.flatnonzero(np.isfinite(turned.site_deg[:, 0]))
    pairs = kernels.geometry.sensor_coverage.pairs_in_range(
        turned.site_deg[placed], sensors.radars.range_m[placed], tracks.position_deg[rows], np.zeros(len(rows))
    )
    row, radar, offset = rows[pairs[0]], placed[pairs[1]], pairs[2]
    order = np.lexsort((row, radar))
    source = tracks.source[row[order]]  # a track of plots may hold plots of its own region alone
    order = order[(source == sensors.ais_source) | (source == sensors.radars.region[radar[order]])]
    row, radar, offset = row[order], radar[order], offset[order]
    azimuth, distance = np.arctan2(offset[:, 0], offset[:, 1]), np.hypot(offset[:, 0], offset[:, 1])
    return Seen(radar, row, _cell(azimuth, distance, sensors.radars.range_m[radar]))


def _staying(seen: Seen, before: Visits, tracks: Tracks) -> Seen:
    """The same pairs, where a vessel at rest stays in the cell of its visit.

    One on the edge of two cells would else make a new visit with each error of its position.
    """
    row = kernels.tables.match_ids.index_of(tracks.track_id, before.track_id)
    at = find(seen.radar * len(tracks) + seen.row, before.radar * len(tracks) + row)
    stays = np.flatnonzero((row >= 0) & (at >= 0))
    stays = stays[np.hypot(*tracks.velocity_m_s[row[stays]].T) < STILL_M_S]
    cell = seen.cell.copy()
    cell[at[stays]] = before.cell[stays]
    return seen._replace(cell=cell)


def _cell(azimuth_rad: Floats, distance_m: Floats, range_m: Floats) -> Ints:
    """The cell of each place; what is beyond the range is in the outermost cell."""
    sector, ring = cover_cell(azimuth_rad, distance_m, range_m)
    return np.asarray(sector * COVER_RANGES + ring)


def _add(sums: Floats, radar: Ints, cell: Ints, values: Floats) -> None:
    """Add values to the sums of cells, in place."""
    sums += np.bincount(radar * CELLS + cell, values, sums.size).reshape(sums.shape)


def _plots_of(seen: Seen, counted: Bools, given: CoverInput, is_ais: Bools) -> Floats:
    """How many plots of the radar each pair has in this cycle: of the track, or for AIS of the vessel. 0 if it is not counted. (P,)"""
    tracks, associations, measurements, radars = given.tracks, given.associations, given.measurements, len(given.sensors.radars)
    asked = np.zeros(int(associations.vessel.max(initial=-1)) + 1, np.bool_)
    asked[associations.vessel[seen.row[counted]]] = True
    plots = np.flatnonzero(measurements.sensor >= 0)
    row = kernels.tables.match_ids.index_of(tracks.track_id, measurements.track_id[plots]).astype(np.int64)
    plots, row = plots[row >= 0], row[row >= 0]
    needed = asked[associations.vessel[row]]
    sensor, row = measurements.sensor[plots[needed]], row[needed]
    plots_of_pair = np.zeros(len(seen.row))
    for of_vessel in (False, True):
        pairs = np.flatnonzero(counted & (is_ais[seen.row] == of_vessel))
        number = associations.vessel if of_vessel else np.arange(len(tracks))
        keys, count = np.unique(number[row] * radars + sensor, return_counts=True)
        at = find(keys, number[seen.row[pairs]] * radars + seen.radar[pairs])
        plots_of_pair[pairs[at >= 0]] = count[at[at >= 0]]
    return plots_of_pair


def _count_false(sums: Floats, plots: Plots, measurements: Measurements, due: Bools, sensors: Sensors) -> None:
    """Add the plots of no confirmed track to the sums, in place: all plots of a cell less those in tracks. Args: due: (R,)"""
    range_m = sensors.radars.range_m
    rows = np.flatnonzero(due[plots.sensor])
    sensor = plots.sensor[rows]
    _add(sums, sensor, _cell(plots.azimuth_rad[rows], plots.range_m[rows], range_m[sensor]), np.ones(len(rows)))
    rows = np.flatnonzero((measurements.sensor >= 0) & due[measurements.sensor])
    sensor = measurements.sensor[rows]
    at = difference_m(measurements.position_deg[rows], measurements.site_deg[rows])
    azimuth, distance = np.arctan2(at[:, 0], at[:, 1]), np.hypot(at[:, 0], at[:, 1])
    _add(sums, sensor, _cell(azimuth, distance, range_m[sensor]), -np.ones(len(rows)))
    np.maximum(sums, 0.0, out=sums)


def _step(count: int, most: int) -> int:
    """The power of two of which one in so many leaves at most about as many as wanted."""
    return 1 << max(-(-count // most) - 1, 0).bit_length()
