"""Track-to-track association by windowed covariance: floored, capped, accumulated against "no partner", one-to-one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from coastwatch.associations.history import History
from coastwatch.associations.pairing import gated_pairs, one_to_one, rows_of_spots, vessels
from coastwatch.batches import Array, Associations, Ints, Spots, Tracks
from coastwatch.geodesy import earth_centred
from coastwatch.stage import Groups, Method, Shared, Spread, by_group


@dataclass(frozen=True, eq=False)
class WindowMemory:
    history: History


class WindowedCovariance(Method):
    """Pairs by a log-likelihood ratio accumulated over the window, then the best one-to-one assignment.

    The covariance of a difference is what the tracks say, scaled in position and velocity by the sample covariance of the window
    about its mean, so that neither a quiet pair is refused nor a drifting one accepted. A short window of track errors, which
    persist, shows little: it weighs against `prior` entries, and the scale stays between `floor` and `cap`. `registration` adds
    that share of a radar plot's covariance, unscaled: a constant azimuth or range bias is as large as the noise of the
    specification and does not show in the window. With probability `misled_share` the velocities do not count, because a track
    that took foreign plots is where it should be but not under way as it should. The ratio is against an unrelated vessel of
    the local density. What a pair was counts `forgetting` times less a cycle later and one step counts at most `step_limit`, so
    that a track that changes vessel loses its partner within a few cycles. Statistic: the accumulated log-likelihood ratio.

    Source: P. Rangel et al., Enhancing Performance and Reliability in Maritime Target Fusion Through a Context-Driven Approach,
    eq. 5 and 7, with the covariance bounded; Y. Bar-Shalom and H. Chen, Multisensor track-to-track association for tracks with
    dependent errors, 2006, for the likelihood ratio against an extraneous track.
    """

    method: Literal["windowed_covariance"] = "windowed_covariance"
    window: Annotated[int, Field(ge=1, le=200)] = 20  # cycles
    gate_m: Annotated[float, Field(gt=0.0)] = 1000.0
    prior: Annotated[float, Field(ge=0.0)] = 10.0  # entries of the window that the tracks' own covariance counts as
    floor: Annotated[float, Field(gt=0.0, le=1.0)] = 0.5
    cap: Annotated[float, Field(ge=1.0)] = 2.0
    forgetting: Annotated[float, Field(ge=0.0, le=1.0)] = 0.9
    registration: Annotated[float, Field(ge=0.0)] = 0.5
    step_limit: Annotated[float, Field(gt=0.0)] = 20.0
    misled_share: Annotated[float, Field(gt=0.0, lt=1.0)] = 0.01  # of tracks whose velocity foreign plots have spoilt
    threshold: float = 0.0  # that a pair's statistic must exceed
    unrelated_speed_m_s: Annotated[float, Field(gt=0.0)] = 4.0
    unknown_velocity_sigma_m_s: Annotated[float, Field(gt=0.0)] = 0.5  # of a source that gives no covariance

    def init(self) -> WindowMemory:
        return WindowMemory(History.empty(self.window))

    def step(self, memory: WindowMemory, tracks: Tracks, spots: Spots, spread: Spread) -> tuple[WindowMemory, Associations]:
        """Associations of these tracks. Args: tracks: (N); spots: of the same rows. Returns: memory and Associations."""
        covariance = tracks.known_covariance(self.unknown_velocity_sigma_m_s)
        own = np.diagonal(covariance, axis1=1, axis2=2)
        variance = np.column_stack([own[:, 0] + own[:, 1], own[:, 2] + own[:, 3]])
        history = memory.history.extended(tracks, variance)
        arrays = {
            "point_m": earth_centred(tracks.position_deg),
            "source": tracks.source,
            "covariance": covariance,
            "report": _registration(tracks, self.registration),
            "position_deg": history.position_deg,
            "velocity_m_s": history.velocity_m_s,
            "variance": history.variance,
            "length": history.length,
        }
        parts = spread(score_spots, self, arrays, rows_of_spots(spots))
        first, second, score = (_joined(parts, k) for k in range(3))
        order = np.lexsort((second, first))
        first, second, score = first[order], second[order], score[order]
        chosen = one_to_one(tracks, first, second, score - self.threshold)
        first, second, score = first[chosen], second[chosen], score[chosen]
        vessel, kept = vessels(tracks, first, second, score)
        return WindowMemory(history.sorted()), Associations(first[kept], second[kept], score[kept], vessel)


def score_spots(settings: WindowedCovariance, arrays: Shared, spots: Groups) -> tuple[Array, ...]:
    """Pairs that these spots own and that pass: rows of the first and second track, statistic."""
    return by_group(_score_spot, settings, arrays, spots)


def _score_spot(settings: WindowedCovariance, arrays: Shared, rows: Ints) -> tuple[Array, ...]:
    """Pairs that this spot owns whose score is above the threshold: rows of the first and second track, score."""
    from coastwatch.kernels.windows import windowed_scores

    first, second = gated_pairs(arrays, rows, settings.gate_m)
    if len(first) == 0:
        return first, second, np.zeros(0)
    report = arrays["report"]
    phi = arrays["covariance"][first] + arrays["covariance"][second]
    candidates = np.bincount(first, minlength=len(arrays["source"]))[first]
    density = np.maximum(candidates - 1, 1) / (np.pi * settings.gate_m**2)
    score: Array = windowed_scores(
        first,
        second,
        arrays["position_deg"],
        arrays["velocity_m_s"],
        arrays["variance"],
        arrays["length"],
        phi,
        report[first] + report[second],
        density,
        settings.prior,
        settings.floor,
        settings.cap,
        settings.forgetting,
        settings.step_limit,
        settings.misled_share,
        settings.unrelated_speed_m_s,
    )
    keep = score > settings.threshold
    return first[keep], second[keep], score[keep]


def _registration(tracks: Tracks, share: float) -> Array:
    """The share of a report's covariance that a constant bias of its sensor may have; none for tracks that name themselves (AIS)."""
    radar = (tracks.mmsi < 0)[:, None, None]
    return np.where(radar, share * tracks.report_covariance, 0.0)


def _joined(parts: list[tuple[Array, ...]], k: int) -> Array:
    dtype = np.float64 if k == 2 else np.int64
    return np.concatenate([np.zeros(0, dtype), *(part[k] for part in parts)])
