"""Scores of a run: sums over cycles, and the figures at its end."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Protocol

import numpy as np

from coastwatch.batches import (
    AisReports,
    Associations,
    BearingAssociations,
    BearingTracks,
    FusedTracks,
    Ints,
    Picture,
    Recording,
    Sensors,
    Tracks,
    Trajectories,
    Truth,
)
from coastwatch.geodesy import difference_m, earth_centred
from coastwatch.kernels.tables.lookup import row_of
from coastwatch.scores.bound import bound
from coastwatch.scores.confusion import Confusion, association, bearing_association
from coastwatch.scores.dark import Dark, watch, without_reports
from coastwatch.scores.nees import nees
from coastwatch.scores.ospa import gospa, ospa
from coastwatch.scores.purity import Identities
from coastwatch.scores.rmse import Errors, FusionErrors, errors, fusion_errors

CUTOFF_M = 20.0  # of GOSPA and OSPA: the value of Helgesen et al. 2022, about three sigma of a harbour radar
ORDER = 2.0


class Yielded(Protocol):
    """The part of a cycle that scores read."""

    @property
    def time_s(self) -> float: ...
    @property
    def tracks(self) -> Tracks: ...
    @property
    def associations(self) -> Associations: ...
    @property
    def fused(self) -> FusedTracks: ...
    @property
    def bearing_tracks(self) -> BearingTracks: ...
    @property
    def picture(self) -> Picture: ...
    @property
    def bearing_associations(self) -> BearingAssociations: ...


@dataclass(frozen=True, eq=False)
class Tally:
    """Sums so far, as plain data."""

    associations: Confusion = Confusion()
    bearing_associations: Confusion = Confusion()
    fused: Errors = Errors()
    radar: Errors = Errors()
    ais: Errors = Errors()
    nees_sum: float = 0.0
    nees_count: int = 0
    gospa_squares_m2: float = 0.0  # of the picture against all true vessels, sum over instants
    ospa_m: float = 0.0
    instants: int = 0
    counted: tuple[tuple[float, Ints], ...] = ()  # time and true vessels of the fused errors, for the bound
    identities: Identities | None = None
    may_be_silent: Ints | None = None
    dark: Dark | None = None


def add(tally: Tally, cycle: Yielded, recording: Recording, sensors: Sensors) -> Tally:
    """The sums after one more cycle; unchanged where the recording has no truth."""
    if recording.truth is None:
        return tally
    truth, kinds, tracks = recording.truth.at(cycle.time_s), sensors.source_kinds, cycle.tracks
    has_truth = bool((tracks.origin >= 0).any())
    bearings_known = bool((cycle.bearing_tracks.origin >= 0).any())
    decided = association(tracks, cycle.associations, kinds) if has_truth else Confusion()
    bearings = (
        bearing_association(cycle.bearing_tracks, cycle.picture, cycle.bearing_associations) if bearings_known else Confusion()
    )
    fused_errors = fusion_errors(truth, tracks, cycle.associations, cycle.fused, kinds)
    nees_sum, nees_count = _fused_nees(truth, cycle, fused_errors)
    distance = gospa(earth_centred(cycle.picture.position_deg), earth_centred(truth.position_deg), CUTOFF_M, ORDER)
    tally = replace(
        tally,
        associations=tally.associations + decided,
        bearing_associations=tally.bearing_associations + bearings,
        fused=tally.fused + fused_errors.fused,
        radar=tally.radar + fused_errors.radar,
        ais=tally.ais + fused_errors.ais,
        nees_sum=tally.nees_sum + nees_sum,
        nees_count=tally.nees_count + nees_count,
        gospa_squares_m2=tally.gospa_squares_m2 + distance.total_m**2,
        ospa_m=tally.ospa_m + ospa(distance, CUTOFF_M, ORDER).total_m,
        instants=tally.instants + 1,
        counted=(*tally.counted, (cycle.time_s, fused_errors.origin)) if recording.noise is not None else (),
    )
    return (
        _watched(tally, recording.truth, cycle, recording.for_scores().ais, recording.silenced, sensors) if has_truth else tally
    )


def result(tally: Tally, recording: Recording, sensors: Sensors) -> dict[str, dict[str, float | int | None]]:
    """All scores, by stage; empty where there is no truth. A figure with nothing to count is None."""
    if recording.truth is None:
        return {}
    ais = recording.for_scores().ais
    best, of_plots = (_bound_errors(tally, recording, some) for some in (ais, ais.take(np.zeros(0, np.int64))))
    return _figures(tally, best, of_plots)


def figure_names() -> list[str]:
    """Every figure that `result` may have, as "associations.f1"."""
    decided = Confusion(1, 1, 1, 1)
    whole = Tally(decided, decided, dark=Dark.empty(), identities=Identities.empty())
    stages = _figures(whole, Errors(), Errors())
    return [f"{stage}.{name}" for stage, figures in stages.items() for name in figures]


def _figures(tally: Tally, best: Errors, of_plots: Errors) -> dict[str, dict[str, float | int | None]]:
    """The scores by stage. Args: best, of_plots: errors of the exact filter with all reports, and with plots alone."""
    parts = {"bound": best, "radar": tally.radar, "radar_bound": of_plots, "ais": tally.ais}
    return {
        "associations": {**_decisions(tally.associations)},
        "bearing_associations": {**_decisions(tally.bearing_associations)},
        "fused_tracks": {
            **tally.fused.as_dict(),
            **{
                f"{part}_{name}": value
                for part, errors_of_part in parts.items()
                for name, value in errors_of_part.as_dict().items()
            },
            "nees": tally.nees_sum / tally.nees_count if tally.nees_count else None,
            "count": tally.fused.count,
            "bound_count": best.count,
        },
        "picture": {
            "gospa_rms_m": float(np.sqrt(tally.gospa_squares_m2 / tally.instants)) if tally.instants else None,
            "ospa_mean_m": tally.ospa_m / tally.instants if tally.instants else None,
            **(tally.dark.as_dict() if tally.dark else {}),
            **(tally.identities.as_dict() if tally.identities else {}),
        },
    }


def _decisions(confusion: Confusion) -> dict[str, float]:
    """Its figures; none if nothing was decided."""
    return confusion.as_dict() if confusion != Confusion() else {}


def _fused_nees(truth: Truth, cycle: Yielded, fused_errors: FusionErrors) -> tuple[float, int]:
    """Sum and count of the NEES of the counted vessels, position and velocity, where the fuser gives a covariance."""
    at = row_of(truth.vessel, fused_errors.origin)
    fused = cycle.fused.take(fused_errors.row)
    error_m = difference_m(fused.position_deg, truth.position_deg[at])
    values = nees(np.column_stack([error_m, fused.velocity_m_s - truth.velocity_m_s[at]]), fused.covariance)
    finite = np.isfinite(values)
    return float(values[finite].sum()), int(finite.sum())


def _watched(
    tally: Tally, truth: Trajectories, cycle: Yielded, ais: AisReports, silenced: tuple[int, ...], sensors: Sensors
) -> Tally:
    """The sums with the ids and the dark flags of one more picture."""
    silent = tally.may_be_silent
    if silent is None:
        silent = np.union1d(without_reports(truth.vessel, ais), np.array(silenced, np.int64))
    dark = watch(tally.dark or Dark.empty(V=len(truth.vessel)), silent, truth, cycle.time_s, ais, cycle.picture, sensors)
    identities = (tally.identities or Identities.empty()).seen(cycle.picture.vessel_id, cycle.picture.origin)
    return replace(tally, may_be_silent=silent, dark=dark, identities=identities)


def _bound_errors(tally: Tally, recording: Recording, ais: AisReports) -> Errors:
    """Errors of the exact filter over the vessels and instants over which the fused errors were taken.

    Args: ais: the AIS reports that it uses besides all plots.
    """
    truth, noise = recording.truth, recording.noise
    if truth is None or noise is None or not tally.counted:
        return Errors()
    rows = np.flatnonzero(np.isin(truth.vessel, np.concatenate([origin for _, origin in tally.counted])))
    few = rows_of_vessels(truth, rows)
    times = np.array([time_s for time_s, _ in tally.counted])
    best = bound(few, recording.for_scores().radar, ais, noise, times)
    total = Errors()
    for t, (time_s, origin) in enumerate(tally.counted):
        now = truth.at(time_s)
        at, row = row_of(now.vessel, origin), row_of(few.vessel, origin)
        has_bound = np.isfinite(best.position_deg[row, t, 0])
        total += errors(
            best.position_deg[row, t][has_bound],
            best.velocity_m_s[row, t][has_bound],
            now.position_deg[at][has_bound],
            now.velocity_m_s[at][has_bound],
        )
    return total


def rows_of_vessels(truth: Trajectories, rows: Ints) -> Trajectories:
    """The trajectories of some vessels."""
    whole = {"time_s"} | ({"kick_keep"} if not len(truth.kick_keep) else set())
    return Trajectories(
        **{f.name: getattr(truth, f.name) if f.name in whole else getattr(truth, f.name)[rows] for f in fields(truth)}
    )
