"""AIS messages in multi-hypothesis tracks: a message is a look of its own, at its own time, and its MMSI a resource as a plot is.

A message came, so its vessel was not missed, and its absence says nothing. A leaf that takes a message may have its MMSI from then on.
Source: E. Liland, AIS aided multi hypothesis tracker, NTNU 2017, sections 4.4 and 4.5; weights by existence as in `weighing`.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from coastwatch import kernels
from coastwatch.batches import Floats, Ints, Messages
from coastwatch.batches.ais_codes import is_vessel
from coastwatch.kernels.filters.gaussian import Estimates
from coastwatch.kernels.tables.lookup import row_of
from coastwatch.kernels.tracks.columns import ExistenceColumns
from coastwatch.kernels.tracks.existence import SURELY
from coastwatch.kernels.tracks.joint_update import Hypotheses
from coastwatch.tracks.radar import plots_alone
from coastwatch.tracks.radar.leaves import FilterSteps, Forest, Leaves
from coastwatch.tracks.radar.messages.settings import MessageSettings
from coastwatch.tracks.radar.messages.weighing import (
    COARSE,
    begin_named,
    begin_unnamed,
    columns_of,
    log_density_of_velocity,
    measurements_of,
    update_new,
)
from coastwatch.tracks.radar.motion import Filters
from coastwatch.tracks.radar.multi_hypothesis.choice import Pruning, choose_and_prune
from coastwatch.tracks.radar.multi_hypothesis.trees import (
    OWNED,
    decide,
    forest_of,
    shares,
    with_linked,
    with_roots,
    write_chosen,
)
from coastwatch.tracks.radar.parts import Parts, candidates_by_largest_noise
from coastwatch.tracks.radar.table import RadarMemory, Table

SENDS = math.log(2.0)  # cost of an MMSI that a leaf takes: half of the vessels send none
WAITS, LONGEST_WAIT_S = (
    1.5,
    60.0,
)  # expected intervals of its messages in which a track lives without plots, and how long at most
MMSI_DIGITS = 2**31  # above any MMSI


class Heard(NamedTuple):
    """Messages in the gates of leaves: A pairs, sorted by leaf."""

    leaf: Ints  # (A,)
    message: Ints  # (A,)
    filters: Filters  # (A,) of the leaf, updated by the message
    predicted: Filters  # (A,) before it, at its time
    log_ratio: Floats  # (A,) likelihood over that of a message of a vessel without a track


class Taken(NamedTuple):
    """Ways in which leaves take messages: W of the pairs of `Heard`, in their order."""

    pair: Ints  # (W,)
    cost: Floats  # (W,) of the leaf with the message
    mmsi: Ints  # (W,) of the leaf with the message


def take_round(pruning: Pruning, parts: Parts, rules: MessageSettings, memory: RadarMemory, messages: Messages) -> RadarMemory:
    """The memory after these messages, whose gates have no track in common."""
    forest, table, batch = forest_of(memory, pruning.window), memory.table, columns_of(messages)
    leaves, first = forest.leaves, forest.next_plot
    heard = _heard(parts, rules, leaves, messages)
    _give_up_names(rules, table, leaves, heard, messages)
    looked_s = np.full(len(table.track_id), -np.inf)
    np.maximum.at(looked_s, leaves.slot[heard.leaf], batch.time[heard.message])
    looked = np.isfinite(looked_s)
    trees = forest.trees()
    rows = kernels.tracks.tree_rows.rows_of(trees, np.flatnonzero(looked))
    life = ExistenceColumns(
        leaves.existence, leaves.visibility, leaves.existence_s, leaves.radar_s, leaves.misses, leaves.radar_s
    )
    kernels.tracks.existence.fade(life, rows, looked_s[leaves.slot[rows]], parts.existence.chain)
    for window in (leaves.plot, leaves.step):
        window[rows, :-1] = window[rows, 1:]
        window[rows, -1] = -1
    ways = _taken_by_leaves(rules, table, leaves, heard, messages)
    children, steps = _children(parts, forest, trees.steps, heard, ways, messages)
    of_tree = leaves.slot[heard.leaf] * MMSI_DIGITS + messages.mmsi[heard.message]
    refuses = (leaves.mmsi[rows] >= 0) & np.isin(leaves.slot[rows] * MMSI_DIGITS + leaves.mmsi[rows], of_tree)
    leaves.cost[rows[refuses]] += _cost_of_a_wrong_id(rules)
    grown = Leaves.join([leaves.take(rows), children])
    grown = with_linked(forest, trees, grown.take(np.argsort(grown.slot, kind="stable")), looked, messages.mmsi[heard.message])
    if memory.plots_alone.models:
        plots_alone.begin_at_tracks(memory.plots_alone, table, parts, np.flatnonzero(looked))
    pruned = choose_and_prune(pruning, forest, grown, looked, table.status)
    forest, unproven = forest.replaced(trees, pruned.slot, pruned.leaves, steps), forest.unproven + pruned.unproven
    forest = replace(forest, next_plot=first + len(messages), unproven=unproven)
    taken = write_chosen(parts, table, pruned, looked, first, batch)
    got = np.flatnonzero(taken >= 0)
    np.maximum.at(table.message_s, taken[got], batch.time[got])
    until_s = _awaited_until_s(messages.take(got))
    has_id = table.ids[taken[got], 0] == messages.mmsi[got]
    forest.until_s[taken[got]] = np.where(has_id, until_s, -np.inf)
    forest = decide(forest, table, pruned, looked)
    of_any, owned, _ = shares(table, pruned, len(messages), first)
    new = np.where(owned > OWNED, 0.0, np.clip(1.0 - of_any, 0.0, 1.0))
    return _begin(parts, rules, replace(memory, forest=forest), messages, new)


def _heard(parts: Parts, rules: MessageSettings, leaves: Leaves, messages: Messages) -> Heard:
    """The messages in the gate of any model of each leaf."""
    batch = columns_of(messages)
    pairs = candidates_by_largest_noise(parts, leaves.estimates, np.flatnonzero(leaves.slot >= 0), batch, COARSE)
    by_leaf = np.argsort(pairs.track, kind="stable")
    leaf, message = pairs.track[by_leaf], pairs.plot[by_leaf]
    since = batch.time[message] - leaves.updated_s[leaf]
    renewal_s, models = parts.bank.prior.renewal_s, parts.bank.models
    before = (column[leaf] for column in leaves.filters)
    predicted = kernels.filters.imm.predict_filters(*before, np.maximum(since, 0.0), renewal_s, models)
    z, noise = measurements_of(messages.take(message))
    late = np.maximum(-since, 0.0)[:, None]
    z[:, :2] += late * leaves.combined_mean[leaf, 2:]
    noise[:, :2, :2] += (late * late)[:, :, None] * leaves.combined_covariance[leaf, 2:, 2:]
    numbers, none = np.arange(len(leaf) + 1), np.empty((len(leaf), 0))
    position, spread = np.ascontiguousarray(z[:, :2]), np.ascontiguousarray(noise[:, :2, :2])
    gated = Hypotheses(numbers[:-1], numbers, message, position, spread, none)
    fits = kernels.tracks.message_clusters.in_any_gate(predicted, gated, rules.limit)
    leaf, message, predicted = leaf[fits], message[fits], Filters(*(column[fits] for column in predicted))
    z, noise = z[fits], noise[fits]
    *updated, log_likelihood = kernels.filters.imm.update_filters(*predicted, z, noise, np.isfinite(z[:, 2]))
    density = parts.existence.new_vessels_per_m2 * (1.0 - rules.silent_share)
    ratio = log_likelihood - log_density_of_velocity(parts, messages)[message] - math.log(density)
    return Heard(leaf, message, Filters(*updated), predicted, ratio)


def _give_up_names(rules: MessageSettings, table: Table, leaves: Leaves, heard: Heard, messages: Messages) -> None:
    """Take an MMSI from trees that have not heard it lately, when its message is in a gate of another tree with plots. In place.

    They had the plots of another vessel since its last message. As an MMSI is a resource, the other tree could not have it.
    """
    slot, mmsi = leaves.slot[heard.leaf], messages.mmsi[heard.message]
    with_plots = np.flatnonzero(np.isfinite(table.radar_s[slot]).any(axis=1))
    names, last = np.unique(mmsi[with_plots][::-1], return_index=True)
    time_s = messages.time_s[heard.message[with_plots]][::-1][last]
    at = row_of(names, leaves.mmsi)
    late = np.flatnonzero((at >= 0) & (leaves.mmsi >= 0))
    late = late[table.message_s[leaves.slot[late]] < time_s[at[late]] - rules.elsewhere_s]
    late = late[~np.isin(leaves.slot[late] * MMSI_DIGITS + leaves.mmsi[late], slot * MMSI_DIGITS + mmsi)]
    given_up = np.unique(leaves.slot[late] * MMSI_DIGITS + leaves.mmsi[late])
    slots = np.unique(leaves.slot[late])
    slots = slots[np.isin(slots * MMSI_DIGITS + table.ids[slots, 0], given_up)]
    leaves.mmsi[late] = -1
    table.ids[slots] = -1
    table.id_probability[slots] = 0.0
    begin_unnamed(rules, table, slots)


def _taken_by_leaves(rules: MessageSettings, table: Table, leaves: Leaves, heard: Heard, messages: Messages) -> Taken:
    """The ways in which leaves take messages. The windows of leaves have moved on already.

    A leaf without an MMSI takes that of the message; if another track has it, it may also take the message alone. So may a leaf with
    another MMSI, or change its own. Of children with one history and one MMSI the cheapest stays.
    """
    leaf, message = heard.leaf, heard.message
    wrong = _cost_of_a_wrong_id(rules)
    own, sent = leaves.mmsi[leaf], messages.mmsi[message]
    usable = is_vessel(sent)
    owner = np.append(table.live, -1)[row_of(table.ids[table.live, 0], sent)]
    alone = ~usable | ((own != sent) & ((own >= 0) | ((owner >= 0) & (owner != leaves.slot[leaf]))))
    names = np.flatnonzero(usable)
    stays = np.flatnonzero(alone)
    pair = np.concatenate([names, stays])
    taking = np.where(own == sent, 0.0, np.where(own < 0, SENDS, 2.0 * wrong))
    extra = np.concatenate([taking[names], np.where(usable[stays], wrong, 0.0)])
    mmsi = np.concatenate([sent[names], own[stays]])
    existence = np.log(np.maximum(leaves.existence[leaf], 1.0 - SURELY))
    cost = leaves.cost[leaf[pair]] - existence[pair] - heard.log_ratio[pair] + extra
    window = leaves.plot[leaf[pair], :-1]
    keys = (leaves.slot[leaf[pair]], mmsi, message[pair], *window.T)
    order = np.lexsort((cost, *keys[::-1]))
    changed = np.zeros(len(order), np.bool_)
    changed[:1] = True
    for key in keys:
        changed[1:] |= key[order][1:] != key[order][:-1]
    kept = np.sort(order[changed])
    return Taken(pair[kept], cost[kept], mmsi[kept])


def _children(
    parts: Parts, forest: Forest, first_step: int, heard: Heard, taken: Taken, messages: Messages
) -> tuple[Leaves, FilterSteps]:
    """The leaves that take a message, and the steps of their filters. Args: first_step: row of the first of these steps."""
    pair, message = taken.pair, heard.message[taken.pair]
    children, time_s = forest.leaves.take(heard.leaf[pair]), messages.time_s[message]
    after = Filters(*(np.ascontiguousarray(column[pair]) for column in heard.filters))
    updated_s = np.maximum(children.updated_s, time_s)
    before = children.estimates
    estimates = Estimates(updated_s, before.mean.copy(), before.covariance.copy(), before.noise.copy())
    kernels.filters.imm.combine_filters(tuple(after), estimates, np.arange(len(pair)), parts.bank.models)
    mean, covariance = kernels.filters.imm.estimate_filters(*(column[pair] for column in heard.predicted))
    mean, covariance = np.ascontiguousarray(mean[:, :4]), np.ascontiguousarray(covariance[:, :4, :4])
    children.plot[:, -1] = forest.next_plot + message
    children.step[:, -1] = first_step + np.arange(len(pair))
    new = FilterSteps(updated_s, estimates.mean, estimates.covariance, mean, covariance, np.full(len(pair), -1))
    children = replace(
        children,
        cost=taken.cost,
        mmsi=taken.mmsi,
        existence=np.full(len(pair), SURELY),
        misses=np.zeros(len(pair)),
        state=after.state,
        covariance=after.covariance,
        mode_probability=after.mode_probability,
        updated_s=updated_s,
        combined_mean=estimates.mean,
        combined_covariance=estimates.covariance,
        noise_m2_s3=estimates.noise,
    )
    return children, new


def _cost_of_a_wrong_id(rules: MessageSettings) -> float:
    """The cost of a leaf whose vessel sends another MMSI than its own: a negative log-likelihood."""
    return -math.log(max(1.0 - rules.correct_id, 1e-12))


def _awaited_until_s(messages: Messages) -> Floats:
    """The time up to which the vessel of each message (M) lives without plots; -inf where no interval is known.

    A berthed vessel sends each three minutes: a track that waited so long without plots would take those of its neighbours.
    """
    until_s = messages.time_s + np.minimum(WAITS * messages.interval_s, LONGEST_WAIT_S)
    return np.where(np.isfinite(until_s), until_s, -np.inf)


def _begin(parts: Parts, rules: MessageSettings, memory: RadarMemory, messages: Messages, existence: Floats) -> RadarMemory:
    """A track for each message that is probably of a vessel without one. Args: existence: (M,)."""
    begun = np.flatnonzero(existence >= rules.begin_existence)
    if not len(begun):
        return memory
    before, batch, first = len(memory.table), columns_of(messages), memory.forest.next_plot - len(messages)
    memory = begin_named(parts, rules, memory, batch, messages.mmsi, existence)
    table, forest = memory.table, memory.forest
    slots = table.live[before:]
    update_new(parts, table.filters, slots, messages.take(begun))
    kernels.filters.imm.combine_filters(tuple(table.filters), table.estimates, slots, parts.bank.models)
    unnamed = slots[~is_vessel(messages.mmsi[begun])]
    table.ids[unnamed, 0], table.id_probability[unnamed, 1] = -1, 0.0
    forest = with_roots(forest, table, slots, first + begun)
    forest.until_s[slots] = _awaited_until_s(messages.take(begun))
    return replace(memory, forest=forest)
