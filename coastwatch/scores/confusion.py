"""Decisions of association against truth: one decision for each radar or bearing track in each scored cycle."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coastwatch.batches import (
    Associations,
    Batch,
    BearingAssociations,
    BearingTracks,
    Bools,
    Ints,
    Picture,
    SourceKind,
    Tracks,
    column,
)


@dataclass(frozen=True)
class Confusion:
    """Counts of decisions. A swap (a wrong partner although the right one exists) counts as fn and as fp."""

    tp: int = 0  # right partner chosen
    fn: int = 0  # partner exists, not chosen
    fp: int = 0  # wrong partner chosen
    tn: int = 0  # none exists, none chosen

    def __add__(self, other: Confusion) -> Confusion:
        return Confusion(self.tp + other.tp, self.fn + other.fn, self.fp + other.fp, self.tn + other.tn)

    def as_dict(self) -> dict[str, float]:
        """The counts and the rates that follow from them, 0 to 1 (mcc: -1 to 1); 0/0 is 0."""
        tp, fn, fp, tn = self.tp, self.fn, self.fp, self.tn
        product = float(tp + fp) * float(tp + fn) * float(tn + fp) * float(tn + fn)
        return {
            "tp": tp,
            "fn": fn,
            "fp": fp,
            "tn": tn,
            "accuracy": _over(tp + tn, tp + fn + fp + tn),
            "precision": _over(tp, tp + fp),
            "recall": _over(tp, tp + fn),
            "f1": _over(2 * tp, 2 * tp + fp + fn),
            "specificity": _over(tn, tn + fp),
            "mcc": _over(tp * tn - fp * fn, float(np.sqrt(product))),
        }


def _over(part: float, whole: float) -> float:
    """The ratio, 0 if the whole is 0."""
    return float(part / whole) if whole > 0 else 0.0


@dataclass(frozen=True, eq=False)
class Decisions(Batch):
    """One row for each decision. In a swap a partner exists, the right one is not chosen, and a wrong one is."""

    row: Ints = column(np.int64, "D")  # of the track that was decided on
    exists: Bools = column(np.bool_, "D")  # a true partner exists
    right: Bools = column(np.bool_, "D")  # and is chosen
    wrong: Bools = column(np.bool_, "D")  # a wrong one is chosen

    def counted(self) -> Confusion:
        """The counts over all of them."""
        return count_decisions(self.exists, self.right, self.wrong)


def count_decisions(partner_exists: Bools, right_chosen: Bools, wrong_chosen: Bools) -> Confusion:
    """The counts over decisions. Args: (N,) each: a true partner exists; it is chosen; a wrong one is chosen."""
    return Confusion(
        tp=int(np.sum(right_chosen)),
        fn=int(np.sum(partner_exists & ~right_chosen)),
        fp=int(np.sum(wrong_chosen)),
        tn=int(np.sum(~partner_exists & ~wrong_chosen & ~right_chosen)),
    )


def association(tracks: Tracks, associations: Associations, kinds: Ints) -> Confusion:
    """The counts over `decisions`, with the same arguments."""
    return decisions(tracks, associations, kinds).counted()


def decisions(tracks: Tracks, associations: Associations, kinds: Ints) -> Decisions:
    """One decision for each radar track: which AIS track is the same vessel? The AIS tracks in its vessel were chosen.

    A track of clutter (origin -1) has no partner. Of two radar tracks of one true vessel, each is a decision.

    Args: tracks: (N); associations: of the same rows; kinds: SourceKind of each source.
    """
    kind = kinds[tracks.source]
    radar, ais = np.flatnonzero(kind == SourceKind.RADAR), np.flatnonzero(kind == SourceKind.AIS)
    exists = (tracks.origin[radar] >= 0) & np.isin(tracks.origin[radar], tracks.origin[ais])
    label, origin = associations.vessel, tracks.origin
    chosen = _matches(label[radar], label[ais])
    right = np.where(exists, _matches(_keys(label, origin, radar), _keys(label, origin, ais)), 0)
    return Decisions(radar, exists, right > 0, chosen > right)


def bearing_association(
    bearing_tracks: BearingTracks, picture: Picture, bearing_associations: BearingAssociations
) -> Confusion:
    """One decision for each bearing track: which vessel of the picture is it? A partner exists if the picture has its true vessel."""
    origin = bearing_tracks.origin
    exists = (origin >= 0) & np.isin(origin, picture.origin)
    bearing, vessel = bearing_associations.bearing_row, bearing_associations.vessel_row
    same = exists[bearing] & (picture.origin[vessel] == origin[bearing])
    right, wrong = (np.bincount(bearing[which], minlength=len(origin)) > 0 for which in (same, ~same))
    return count_decisions(exists, right, wrong)


def _keys(label: Ints, origin: Ints, rows: Ints) -> Ints:
    """One number for each pair of label and origin."""
    least = int(origin.min(initial=0))
    return np.asarray(label[rows] * (int(origin.max(initial=0)) - least + 1) + origin[rows] - least)


def _matches(wanted: Ints, among: Ints) -> Ints:
    """How often each value occurs among others."""
    ordered = np.sort(among)
    return np.searchsorted(ordered, wanted, side="right") - np.searchsorted(ordered, wanted, side="left")
