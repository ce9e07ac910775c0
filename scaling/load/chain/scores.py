"""Scores of a run of the whole chain: regional tracks, associations, fused tracks and the picture against the truth.

All vessels count. The physical bound is computed for a sample of them, so that a run of 100,000 vessels needs no long history.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np

from coastwatch.batches import (
    ID_STRIDE,
    AisReports,
    Bools,
    Floats,
    Ints,
    Noise,
    RadarReports,
    Reports,
    SourceKind,
    Tracks,
    Truth,
)
from coastwatch.centre import Cycle
from coastwatch.geodesy import KNOT_M_S, NAUTICAL_MILE_M, difference_m, earth_centred, to_plane
from coastwatch.kernels.tables.lookup import row_of
from coastwatch.scores.bound import bound
from coastwatch.scores.confusion import Confusion, association, bearing_association
from coastwatch.scores.ospa import gospa
from coastwatch.scores.purity import Identities
from coastwatch.scores.rmse import Errors, fusion_errors
from coastwatch.sensors.simulated.ais import POSITION_STEP_DEG, SOG_STEP_KN
from coastwatch.sensors.simulated.simulation import ROUNDING, truths_of
from scaling.load.chain.world import World

SAMPLE = 1000  # vessels of which the bound is computed
OWN_FROM_M = 1000.0  # a track farther from the vessel of its plots than this is false
EDGE_M = 300.0  # vessels so near the end of a radar's range need no track
CUTOFF_M, ORDER = 200.0, 2.0  # of GOSPA of the regional tracks: they are of ranges up to 24 NM


@dataclass(frozen=True)
class TrackQuality:
    """Sums over regions and cycles: regional tracks against the vessels in cover of each region."""

    in_cover: int = 0
    with_track: int = 0  # of these, with a track of the region within `OWN_FROM_M`
    tracks: int = 0
    false: int = 0  # tracks of no vessel, and second tracks of a vessel in one region
    position_m2: float = 0.0  # of the first track of each vessel
    velocity_m2_s2: float = 0.0
    own: int = 0  # number of these tracks
    gospa_m2: float = 0.0

    def __add__(self, other: TrackQuality) -> TrackQuality:
        return TrackQuality(*(getattr(self, f.name) + getattr(other, f.name) for f in fields(self)))

    def as_dict(self, cycles: int) -> dict[str, float]:
        """Rates; false tracks are a mean per cycle; GOSPA is the root of its square per vessel in cover. Args: cycles: added."""
        own = max(self.own, 1)
        return {
            "completeness": self.with_track / max(self.in_cover, 1),
            "false_tracks": self.false / max(cycles, 1),
            "position_rmse_m": float(np.sqrt(self.position_m2 / own)),
            "velocity_rmse_m_s": float(np.sqrt(self.velocity_m2_s2 / own)),
            "gospa_m": float(np.sqrt(self.gospa_m2 / max(self.in_cover, 1))),
            "tracks": self.tracks / max(cycles, 1),
        }


@dataclass(frozen=True, eq=False)
class Tally:
    """Sums so far, and what the bound needs of the sample."""

    cycles: int = 0
    tracks: TrackQuality = TrackQuality()
    associations: Confusion = Confusion()
    bearings: Confusion = Confusion()
    fused: Errors = Errors()
    radar: Errors = Errors()
    ais: Errors = Errors()
    picture_ids: Identities = field(default_factory=Identities.empty)
    track_ids: Identities = field(default_factory=Identities.empty)
    fused_sample: tuple[tuple[float, Ints, Floats], ...] = ()  # time, vessels, squared position errors of each cycle
    radar_sample: tuple[tuple[float, Ints, Floats], ...] = ()
    radar_reports: tuple[RadarReports, ...] = ()  # of the sample, of every cycle
    ais_reports: tuple[AisReports, ...] = ()


def sample_of(world: World) -> Ints:
    """The vessels of which the bound is computed."""
    return np.unique(np.linspace(0, world.count - 1, min(SAMPLE, world.count)).astype(np.int64))


def received(tally: Tally, reports: Reports, sample: Ints) -> Tally:
    """The tally with the reports of the sample, also of cycles that are not scored."""
    radar = reports.radar.take(np.isin(reports.radar.origin, sample))
    ais = reports.ais.take(np.isin(reports.ais.origin, sample))
    return replace(tally, radar_reports=(*tally.radar_reports, radar), ais_reports=(*tally.ais_reports, ais))


def add(tally: Tally, world: World, cycle: Cycle, sample: Ints) -> Tally:
    """The sums after one more cycle."""
    truth, kinds, tracks = truth_at(world, cycle.time_s), world.sensors.source_kinds, cycle.tracks
    made = fusion_errors(truth, tracks, cycle.associations, cycle.fused, kinds)
    radar = tracks.take(kinds[tracks.source] == SourceKind.RADAR)
    fused_deg = cycle.fused.position_deg[made.row]
    return replace(
        tally,
        cycles=tally.cycles + 1,
        tracks=tally.tracks + track_quality(world, truth, radar),
        associations=tally.associations + association(tracks, cycle.associations, kinds),
        bearings=tally.bearings + bearing_association(cycle.bearing_tracks, cycle.picture, cycle.bearing_associations),
        fused=tally.fused + made.fused,
        radar=tally.radar + made.radar,
        ais=tally.ais + made.ais,
        picture_ids=tally.picture_ids.seen(cycle.picture.vessel_id, cycle.picture.origin),
        track_ids=tally.track_ids.seen(_small(radar, world), radar.origin),
        fused_sample=(*tally.fused_sample, _of_sample(cycle.time_s, made.origin, fused_deg, truth, sample)),
        radar_sample=(*tally.radar_sample, _of_sample(cycle.time_s, radar.origin, radar.position_deg, truth, sample)),
    )


def truth_at(world: World, time_s: float) -> Truth:
    """The vessels that are present at an instant."""
    row = np.arange(world.count)
    position, velocity = world.vessels.state(row, np.full(world.count, time_s))
    here = np.isfinite(position[:, 0])
    return Truth(row[here], np.full(int(here.sum()), time_s), position[here], velocity[here])


def track_quality(world: World, truth: Truth, radar: Tracks) -> TrackQuality:
    """The regional tracks of one cycle against the vessels in cover of each region."""
    total, radars = TrackQuality(), world.sensors.radars
    for region in range(len(world.sensors.region_names)):
        mine = radar.take(radar.source == region)
        covered = np.zeros(len(truth), np.bool_)
        for r in np.flatnonzero(radars.region == region):
            rows = row_of(truth.vessel, world.seen[r])
            rows = rows[rows >= 0]
            at_m = to_plane(truth.position_deg[rows], radars.site_deg[r])
            covered[rows[np.hypot(at_m[:, 0], at_m[:, 1]) < radars.range_m[r] - EDGE_M]] = True
        total += _quality(truth, covered, mine)
    return total


def _quality(truth: Truth, covered: Bools, tracks: Tracks) -> TrackQuality:
    """The tracks of one region in one cycle. Args: covered: (V,) of the truth."""
    at = row_of(truth.vessel, tracks.origin)
    at = np.where(tracks.origin >= 0, at, -1)
    error_m = np.linalg.norm(difference_m(tracks.position_deg, truth.position_deg[at]), axis=1)
    near = np.flatnonzero((at >= 0) & (error_m < OWN_FROM_M))
    who, first = np.unique(at[near], return_index=True)
    first = near[first]
    off_m_s = tracks.velocity_m_s[first] - truth.velocity_m_s[who]
    distance = gospa(earth_centred(tracks.position_deg), earth_centred(truth.position_deg[covered]), CUTOFF_M, ORDER)
    return TrackQuality(
        in_cover=int(covered.sum()),
        with_track=int(covered[who].sum()),
        tracks=len(tracks),
        false=len(tracks) - len(who),
        position_m2=float((error_m[first] ** 2).sum()),
        velocity_m2_s2=float((off_m_s**2).sum()),
        own=len(who),
        gospa_m2=distance.total_m**2,
    )


def _small(radar: Tracks, world: World) -> Ints:
    """Track ids below 2**31, as `Identities` needs them: ids of a region begin at its number times a large stride."""
    regions = len(world.sensors.region_names)
    return np.asarray((radar.track_id % ID_STRIDE) * regions + radar.source)


def _of_sample(time_s: float, origin: Ints, position_deg: Floats, truth: Truth, sample: Ints) -> tuple[float, Ints, Floats]:
    """Squared position errors of the estimates of the sample; those of false tracks are left out."""
    at = np.where(np.isin(origin, sample), row_of(truth.vessel, origin), -1)
    rows = np.flatnonzero(at >= 0)
    squares = (difference_m(position_deg[rows], truth.position_deg[at[rows]]) ** 2).sum(axis=1)
    near = squares < OWN_FROM_M**2
    return time_s, origin[rows[near]], squares[near]


def result(tally: Tally, world: World, sample: Ints) -> dict[str, Any]:
    """All scores, ready for JSON. A figure with nothing to count is None."""
    picture, track_ids = tally.picture_ids.as_dict(), tally.track_ids.as_dict()
    radar = RadarReports.join(list(tally.radar_reports))
    ais = AisReports.join(list(tally.ais_reports))
    return {
        "tracks": tally.tracks.as_dict(tally.cycles)
        | {"id_switches": track_ids["id_switches"], "purity": track_ids["purity"]}
        | _against_bound(tally.radar_sample, world, sample, radar, AisReports.empty()),
        "associations": tally.associations.as_dict(),
        "bearing_associations": tally.bearings.as_dict(),
        "fused_tracks": {
            **tally.fused.as_dict(),
            **{f"radar_{name}": value for name, value in tally.radar.as_dict().items()},
            **{f"ais_{name}": value for name, value in tally.ais.as_dict().items()},
            **_against_bound(tally.fused_sample, world, sample, radar, ais),
        },
        "picture": {"id_switches": picture["id_switches"], "purity": picture["purity"]},
    }


def _against_bound(
    counted: tuple[tuple[float, Ints, Floats], ...], world: World, sample: Ints, radar: RadarReports, ais: AisReports
) -> dict[str, float | None]:
    """Position RMSE of the sample, the RMSE of the exact filter at the same instants, and the ratio of the two."""
    every = {f.name: getattr(world.vessels, f.name) for f in fields(world.vessels)}
    arrays: dict[str, Any] = {name: value[sample] for name, value in every.items() if isinstance(value, np.ndarray)}
    few = replace(world.vessels, **arrays)
    start_s, times = world.plan.start_s, np.array([time_s for time_s, *_ in counted])
    instants = np.array([start_s, *(world.plan.instant_s(c) for c in range(world.plan.cycles))])
    none: dict[str, float | None] = {"sample_rmse_m": None, "bound_rmse_m": None, "over_bound": None}
    if not sum(len(origin) for _, origin, _ in counted):
        return none
    truth = replace(few.sampled(instants), vessel=sample)
    best = bound(truth, radar, ais, noise_of(world), times)
    ours = bounds = count = 0.0
    for t, (time_s, origin, squares) in enumerate(counted):
        row = row_of(sample, origin)
        known = np.isfinite(best.position_deg[row, t, 0])
        row, here = row[known], few.position(row[known], np.full(int(known.sum()), time_s))
        ours += float(squares[known].sum())
        bounds += float((difference_m(best.position_deg[row, t], here) ** 2).sum())
        count += len(row)
    if not bounds:
        return none
    return {
        "sample_rmse_m": float(np.sqrt(ours / count)),
        "bound_rmse_m": float(np.sqrt(bounds / count)),
        "over_bound": float(np.sqrt(ours / bounds)),
    }


def noise_of(world: World) -> Noise:
    """The true errors of the sensors, which the bound knows."""
    radars, ais = world.sensors.radars, world.input.ais
    truths = truths_of("radars", radars.name, world.input.radar, world.input.radars)
    factor, wire = np.array([t.noise_factor for t in truths]), float(ais.wire_steps)
    step_m = POSITION_STEP_DEG * 60.0 * NAUTICAL_MILE_M
    return Noise(
        range_sigma_m=factor * radars.range_sigma_m,
        azimuth_sigma_rad=factor * radars.azimuth_sigma_rad,
        range_bias_m=np.array([t.range_bias_m for t in truths]),
        azimuth_bias_rad=np.radians([t.azimuth_bias_deg for t in truths]),
        time_bias_s=np.array([t.time_bias_s for t in truths]),
        site_error_m=np.zeros((len(truths), 2)),
        ais_position_sigma_m=float(np.hypot(ais.position_sigma_m, wire * step_m / ROUNDING)),
        ais_velocity_sigma_m_s=float(np.hypot(ais.velocity_sigma_kn, wire * SOG_STEP_KN / ROUNDING)) * KNOT_M_S,
    )
