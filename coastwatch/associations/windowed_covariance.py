"""Track-to-track association by windowed covariance: floored, capped, accumulated against "no partner", one-to-one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import Field

from coastwatch import kernels
from coastwatch.associations.history import History
from coastwatch.associations.pairing import in_order, one_to_one, rows_of_spots, vessels
from coastwatch.batches import Array, Associations, Spots, Tracks
from coastwatch.kernels.threads import in_blocks
from coastwatch.stage import Groups, Method, Shared, Spread, room_of

if TYPE_CHECKING:
    from coastwatch.kernels.association.prune_pairs import Rule


LEAST_TRACKS = 1024  # for a thread


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
        history, arrays = self._laid_out(memory.history, tracks, room_of(spread))
        parts = spread(score_spots, self, arrays, rows_of_spots(spots))
        first, second, score, tested = (_joined(parts, k) for k in range(4))
        first, second, score = in_order(first, second, score, len(tracks))
        chosen = one_to_one(tracks, first, second, score - self.threshold)
        first, second, score = first[chosen], second[chosen], score[chosen]
        vessel, kept = vessels(tracks, first, second, score)
        return WindowMemory(history), Associations(first[kept], second[kept], score[kept], vessel, int(tested.sum()))

    def rule(self) -> kernels.association.prune_pairs.Rule:
        """The settings as the kernels read them."""

        bounds = self.prior, self.floor, self.cap, self.forgetting, self.step_limit
        return kernels.association.prune_pairs.Rule(
            self.gate_m, *bounds, self.misled_share, self.unrelated_speed_m_s, self.threshold
        )

    def _laid_out(self, before: History, tracks: Tracks, room: Callable[..., Any]) -> tuple[History, dict[str, Any]]:
        """The windows after this cycle, and what `score_spots` reads: tracks ranked so that neighbours stand together.

        Args: room: who makes arrays, as np.empty.
        """

        count = len(tracks)
        key, row, rank = kernels.geometry.bands.in_order(tracks.position_deg, self.gate_m, room)
        columns = (
            kernels.association.history.COLUMNS,
            4,
            kernels.association.pair_features.COLUMNS,
            kernels.association.prune_pairs.COLUMNS,
        )
        entry, point, record, outline = (kernels.association.history.wide_rows(count, c, room) for c in columns)
        given = (
            tracks.position_deg,
            tracks.velocity_m_s,
            tracks.covariance,
            tracks.report_covariance,
            tracks.mmsi,
            tracks.source,
        )
        own = self.unknown_velocity_sigma_m_s**2, self.registration, self.gate_m
        in_blocks(
            kernels.association.pair_features.facts,
            count,
            rank,
            *map(np.ascontiguousarray, given),
            *own,
            point,
            entry,
            kernels.association.history.singles(entry),
            record,
        )
        history = before.extended(tracks.track_id, rank, entry, room)
        in_blocks(
            kernels.association.prune_pairs.outlines,
            count,
            kernels.association.history.addresses(history.ring),
            history.chain,
            history.length,
            record,
            self.rule(),
            outline,
        )
        arrays = {"key": key, "row": row, "rank": rank, "point": point, "record": record, "outline": outline}
        return history, {**arrays, "chain": history.chain, "length": history.length, "ring": history.ring}


def score_spots(settings: WindowedCovariance, arrays: Shared, spots: Groups) -> tuple[Array, ...]:
    """Pairs that these spots own and that pass: rows of the first and second track, score; and how many pairs were tested."""

    seen = {name: _read_only(arrays[name]) for name in ("key", "point", "row", "rank", "chain", "length", "record", "outline")}
    members, low, home, halo_home, halo_row = kernels.tables.groups.parted(
        _read_only(spots.row), _read_only(spots.start), seen["rank"]
    )
    if members < len(seen["row"]):
        most = min(members + len(halo_row), len(home))
        key, point, home, track, top = kernels.tables.groups.gathered(low, home, most, seen["key"], seen["point"])
        near = _read_only(key), _read_only(point), home
    else:
        near, track = (seen["key"], seen["point"], home), np.arange(len(home), dtype=np.int32)
        top = kernels.tables.groups.greatest(seen["point"], 3)
    halo = np.full(1 << (2 * len(halo_row)).bit_length(), -1, np.int64)
    kernels.association.candidate_pairs.fill_halo(halo_home, halo_row, halo)
    places = near, track, seen["row"], halo, top
    windows = (
        kernels.association.history.addresses(arrays["ring"]),
        seen["chain"],
        seen["length"],
        seen["record"],
        seen["outline"],
    )
    found = in_blocks(_score_block, len(track), settings.rule(), *places, windows, least=LEAST_TRACKS)
    return tuple(np.concatenate(column) for column in zip(*found, strict=True))


def _read_only(array: Array) -> Array:
    """The same, as other processes see it: code is then compiled for that alone."""
    out = array.view()
    out.flags.writeable = False
    return out


def _score_block(
    low: int,
    high: int,
    rule: Rule,
    near: tuple[Array, ...],
    track: Array,
    row: Array,
    halo: Array,
    top: float,
    windows: tuple[Array, ...],
) -> tuple[Array, ...]:
    """What `score_spots` gives for those of its tracks, low to high, that are the first of a pair."""

    table, chain, length, record, outline = windows
    window = chain.shape[1] + 1
    places = *near, track, row, halo, kernels.geometry.bands.height_deg(rule.gate), top
    first, second, density, tested = kernels.association.candidate_pairs.candidates(
        low, high, *places, length, record, outline, rule, kernels.association.prune_pairs.cuts(rule, window)
    )
    score = kernels.association.pair_score.windowed_scores(first, second, density, table, chain, length, record, rule)
    keep = score > rule.threshold
    return row[first[keep]].astype(np.int64), row[second[keep]].astype(np.int64), score[keep], np.array([tested])


def _joined(parts: list[tuple[Array, ...]], k: int) -> Array:
    dtype = np.float64 if k == 2 else np.int64
    return np.concatenate([np.zeros(0, dtype), *(part[k] for part in parts)])
