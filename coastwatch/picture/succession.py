"""Who is who from one cycle to the next: what tracks remember and vote for, and the vessels of this cycle in order of their ids."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from coastwatch import kernels
from coastwatch.batches import Associations, Bools, Floats, Ints, Rows, Sensors, SourceKind, Tracks
from coastwatch.kernels.threads import in_blocks
from coastwatch.picture.known import Known, few

if TYPE_CHECKING:
    from coastwatch.picture.identity import Identity, PictureMemory

AIS_VOTE = 1.2  # of a radar's


@dataclass(frozen=True, eq=False)
class Heirs:
    """Which vessel of the last cycle each vessel of this one is, by number and slot; and what was asked on the way."""

    start: Rows  # (V + 1,) the tracks of vessel v are row[start[v]:start[v + 1]]
    row: Rows  # (N,)
    at: Rows  # (N,) row of each track in the last cycle, -1 where none
    to: Rows  # (L,) row in this cycle of each track of the last, -1 where none
    home: Rows  # (N,) slot of the first vessel that the track was in, -1 for a new track
    voter: Rows  # (K,) number of the only vessel with a vote for the slot, -1 for none, -2 for several
    alive: Bools  # (K,) whether a track that was in it lives
    chosen: Rows  # (V,) slot of each vessel, -1 where none
    taken: Rows  # (K,) the vessel that has this slot, -1 where none

    def give(self, vessels: Rows, slots: Rows) -> None:
        """Gives these slots to these vessels, which had none. Args: (B,), (B,)."""
        self.chosen[vessels], self.taken[slots] = slots, vessels


def inherit(
    memory: PictureMemory, ids: Ints, tracks: Tracks, associations: Associations, vessels: int, time_s: float, sensors: Sensors
) -> Heirs:
    """The vessels that tracks vote for.

    A track votes for the vessel it was in, and with a fraction of a vote for the first it ever was in, so that a pair that was
    joined in error parts into the vessels it was made of. What nobody else votes for is settled in one pass; the rest one-to-one.
    """

    vessel, n = associations.vessel, len(tracks)
    start, row = associations.by_vessel
    at, to = kernels.tables.match_ids.followed(memory.track_id, tracks.track_id)
    previous, home = np.empty(n, np.int32), np.empty(n, np.int32)
    voter, taken, chosen = (
        np.full(count, kernels.identity.identity_votes.NOBODY, np.int32) for count in (len(ids), len(ids), vessels)
    )
    alive = np.zeros(len(ids), np.bool_)
    kernels.identity.identity_votes.recalled(
        at, vessel, memory.track_vessel, memory.track_home, previous, home, voter, alive, chosen
    )
    weights = np.where(sensors.source_kinds == SourceKind.AIS, AIS_VOTE, 1.0)
    ballot = (previous, home, tracks.source), weights
    past = memory.known.past("since_s"), float(time_s)
    in_blocks(kernels.identity.identity_votes.settled, vessels, start, row, *ballot, voter, ids, *past, chosen, taken)
    _one_to_one(start, row, ballot, past, ids, chosen, taken)
    return Heirs(start, row, at, to, home, voter, alive, chosen, taken)


def _one_to_one(
    start: Rows, row: Rows, ballot: tuple[Any, Floats], past: tuple[Any, float], ids: Ints, chosen: Rows, taken: Rows
) -> None:
    """Settles the vessels that vie for a slot, into the last two."""

    rivals = np.flatnonzero(chosen == kernels.identity.identity_votes.OPEN)
    if len(rivals) == 0:
        return
    group, slot, gain = kernels.identity.identity_votes.ballots(rivals, start, row, *ballot, *past)
    best = kernels.association.assignment.assign(group, ids[slot], gain)
    chosen[rivals] = kernels.identity.identity_votes.NOBODY
    chosen[group[best]], taken[slot[best]] = slot[best], group[best]


@dataclass(frozen=True, eq=False)
class LineUp:
    """The vessels of this cycle in order of their ids, and where those of the last cycle went."""

    vessel_id: Ints  # (R,) of the rows of the picture
    come: Rows  # (R,) number of the vessel, or -1 - slot of one without tracks
    moved: Rows  # (K,) slot in the next cycle of each slot, -1 where none
    hidden: Rows  # (H,) slots
    hidden_id: Ints  # (H,)
    gone_id: Ints  # (G,)
    row_of: Rows  # (V,) row of each vessel
    begin: Rows  # (R + 1,) where the members of each row begin


def line_up(settings: Identity, known: Known, ids: Ints, heirs: Heirs, time_s: float, next_id: int) -> LineUp:
    """Who is shown, hidden and gone. New vessels get ids from next_id on; those whose tracks went into others are gone."""

    fate, shown = np.empty(len(ids), np.int8), len(known.shown)
    times = float(time_s), settings.coast_s, settings.hold_s, settings.return_s
    given = heirs.taken, heirs.voter, heirs.alive, known.past("updated_s"), known.past("mmsi"), times
    in_blocks(kernels.identity.lifecycle.fates, len(ids), *given, fate)
    back = shown + few(fate[shown:] <= kernels.identity.lifecycle.COASTING)
    back = back[np.argsort(ids[back])]
    vessel_id, come, moved = kernels.identity.lifecycle.lined_up(
        ids, fate, heirs.taken, shown, back, few(heirs.chosen < 0), next_id
    )
    hidden, gone = few(fate == kernels.identity.lifecycle.HIDDEN), few(fate == kernels.identity.lifecycle.GONE)
    row_of, begin = kernels.identity.lifecycle.placed(come, heirs.start)
    return LineUp(vessel_id, come, moved, hidden, ids[hidden], ids[gone], row_of, begin)


def remember(heirs: Heirs, line: LineUp, vessel: Ints) -> tuple[Rows, Rows]:
    """The slots in the next cycle of the vessels that each track is in, and was first in. (N,), (N,)"""

    was_in, was_home = np.empty(len(vessel), np.int32), np.empty(len(vessel), np.int32)
    in_blocks(kernels.identity.lifecycle.remembered, len(vessel), vessel, line.row_of, heirs.home, line.moved, was_in, was_home)
    return was_in, was_home
