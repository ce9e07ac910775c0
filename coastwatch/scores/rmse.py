"""Root mean square errors of position, course and speed, as sums that add up over cycles."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from coastwatch.batches import Associations, Bools, Floats, FusedTracks, Ints, SourceKind, Tracks, Truth
from coastwatch.geodesy import KNOT_M_S, difference_m, wrap_rad
from coastwatch.kernels.tables.lookup import row_of

COURSE_FROM_KN = 2.0  # slower vessels do not count in the error of the course


@dataclass(frozen=True)
class Errors:
    """Sums of squared errors and their counts."""

    position_m2: float = 0.0  # two-dimensional
    course_deg2: float = 0.0
    speed_kn2: float = 0.0
    count: int = 0
    course_count: int = 0

    def __add__(self, other: Errors) -> Errors:
        return Errors(*(getattr(self, f.name) + getattr(other, f.name) for f in fields(self)))

    def as_dict(self) -> dict[str, float | None]:
        """The roots of the means; None where nothing was counted."""
        return {
            "position_rmse_m": _root(self.position_m2, self.count),
            "course_rmse_deg": _root(self.course_deg2, self.course_count),
            "speed_rmse_kn": _root(self.speed_kn2, self.count),
        }


def _root(total: float, count: int) -> float | None:
    """Root of the mean; None if the count is 0."""
    return float(np.sqrt(total / count)) if count else None


def errors(position_deg: Floats, velocity_m_s: Floats, true_position_deg: Floats, true_velocity_m_s: Floats) -> Errors:
    """The errors of estimates; the course counts only where the true speed is 2 kn or more.

    Args: each (N, 2): latitude and longitude, velocity east and north, and the same of the truth.
    """
    error_m = difference_m(position_deg, true_position_deg)
    speed, true_speed = (np.hypot(v[:, 0], v[:, 1]) / KNOT_M_S for v in (velocity_m_s, true_velocity_m_s))
    course, true_course = (np.arctan2(v[:, 0], v[:, 1]) for v in (velocity_m_s, true_velocity_m_s))
    turned = np.degrees(wrap_rad(course - true_course))[true_speed >= COURSE_FROM_KN]
    return Errors(
        float((error_m**2).sum()), float((turned**2).sum()), float(((speed - true_speed) ** 2).sum()), len(error_m), len(turned)
    )


def whole_vessels(tracks: Tracks, associations: Associations, kinds: Ints) -> tuple[Bools, Ints]:
    """Which fused vessels consist of radar and AIS tracks of one true vessel alone, and of which one.

    Returns: (V,) whether, and (V,) origin.
    """
    vessels = int(associations.vessel.max(initial=-1)) + 1
    kind = kinds[tracks.source]
    has_radar, has_ais = (
        np.bincount(associations.vessel[kind == k], minlength=vessels) > 0 for k in (SourceKind.RADAR, SourceKind.AIS)
    )
    least, most = np.full(vessels, np.iinfo(np.int64).max), np.full(vessels, -1)
    np.minimum.at(least, associations.vessel, tracks.origin)
    np.maximum.at(most, associations.vessel, tracks.origin)
    return has_radar & has_ais & (least == most) & (least >= 0), most


@dataclass(frozen=True, eq=False)
class FusionErrors:
    """Errors of the fused vessels that are associated correctly, and of their tracks."""

    fused: Errors
    radar: Errors
    ais: Errors
    origin: Ints  # (C,) the true vessels that were counted
    row: Ints  # (C,) of FusedTracks


def fusion_errors(truth: Truth, tracks: Tracks, associations: Associations, fused: FusedTracks, kinds: Ints) -> FusionErrors:
    """The errors over vessels that have at least one radar and one AIS track and only tracks of one true vessel.

    Args: truth: at the time of the tracks; tracks: (N); associations: of the same rows; fused: one row a vessel.
    """
    whole, origin = whole_vessels(tracks, associations, kinds)
    at = row_of(truth.vessel, origin)
    counted = np.flatnonzero(whole & (at >= 0))
    kind, label = kinds[tracks.source], associations.vessel
    inside = np.isin(label, counted)
    radar, ais = (np.flatnonzero(inside & (kind == k)) for k in (SourceKind.RADAR, SourceKind.AIS))
    return FusionErrors(
        errors(fused.position_deg[counted], fused.velocity_m_s[counted], *_at(truth, at[counted])),
        errors(tracks.position_deg[radar], tracks.velocity_m_s[radar], *_at(truth, at[label[radar]])),
        errors(tracks.position_deg[ais], tracks.velocity_m_s[ais], *_at(truth, at[label[ais]])),
        origin[counted],
        counted,
    )


def _at(truth: Truth, rows: Ints) -> tuple[Floats, Floats]:
    """True positions and velocities of these rows."""
    return truth.position_deg[rows], truth.velocity_m_s[rows]
