"""AIS reports into the tracks of vessels: one vessel after the other, its reports in order of time, compiled by numba.

The tracks of one vessel (one MMSI) stand in consecutive rows, its slots, filled from the first; an empty slot has hits 0.
Everything here depends on the rows it is given and on nothing else, so that reports played again from an earlier state
give the same bits.
"""

import math

import numpy as np

from coastwatch.kernels.filters.ais_imm import anchor_near, mean_of, measure, restart, step_filter
from coastwatch.kernels.geometry.ellipsoid import SEMI_MAJOR, to_enu
from coastwatch.kernels.jit import jit

TAKEN, REPEAT, IMPOSSIBLE, CROWDED = 0, 1, 2, 3


@jit
def absorb(tracks, first, slots, reports, begin, end, rules, stuck, verdict):  # type: ignore[no-untyped-def]
    """Each vessel's reports into its tracks, in place; what became of each report into `verdict`.

    Args: tracks: TRACK rows; first: (V,) first slot of each vessel; slots: of each vessel; reports: REPORT rows, each vessel's
        in order of time; begin, end: (V,) its rows; stuck: (V,) set where the slots did not suffice (its rows are then
        spoilt: start again from the former ones, with more); verdict: (M,) TAKEN, REPEAT, IMPOSSIBLE or CROWDED.
    """
    z, noise, moving = np.zeros((1, 4)), np.zeros((1, 4, 4)), np.zeros(1, np.bool_)
    spare, span, fit = np.zeros(1, tracks.dtype)[0], np.zeros(1), np.zeros(1)
    for v in range(len(first)):
        stuck[v] = False
        for m in range(begin[v], end[v]):
            _expire(tracks, first[v], slots, reports[m].time, rules)
            verdict[m] = _hear(tracks, first[v], slots, reports[m], rules, z, noise, moving, spare, span, fit)
            if verdict[m] == CROWDED and slots == 1:
                stuck[v] = True
                break
            for t in range(first[v], first[v] + slots):
                if tracks[t].hits > 0:
                    tracks[t].heard = reports[m].time


@jit
def _expire(tracks, first, slots, time, rules):  # type: ignore[no-untyped-def]
    """Slots emptied of tracks too old to come back and of second tracks never confirmed; the others move up."""
    kept = first
    for t in range(first, first + slots):
        age = time - tracks[t].updated
        if tracks[t].hits == 0 or age > rules.forget or (tracks[t].confirmed == 0 and age > tracks[t].patience):
            continue
        if kept != t:
            tracks[kept] = tracks[t]
        kept += 1
    for t in range(kept, first + slots):
        tracks[t].hits = 0


@jit
def _hear(tracks, first, slots, report, rules, z, noise, moving, spare, span, fit):  # type: ignore[no-untyped-def]
    """The verdict on a report, which goes to the track it fits, or opens one."""
    best = _choose(tracks, first, slots, report, rules, z)
    if best >= 0:
        return _continue(tracks[best], report, rules, z, noise, moving, spare, span, fit)
    place, known = -1, False
    for t in range(first, first + slots):
        if tracks[t].hits == 0:
            place = t
            break
        if tracks[t].confirmed == 1:
            known = True
            tracks[t].alarm = report.time + rules.alarm
    if place < 0:
        return CROWDED
    tracks[place].number = -1
    tracks[place].started = report.time
    tracks[place].hits = 0
    tracks[place].interval = 0.0
    tracks[place].alarm = -np.inf
    tracks[place].confirmed = 0 if known else 1
    restart(tracks[place], report, rules, z, noise, moving)
    _book(tracks[place], report, rules)
    return IMPOSSIBLE if known else TAKEN


@jit
def _choose(tracks, first, slots, report, rules, z):  # type: ignore[no-untyped-def]
    """The row of the track that a ship could have come from, the live before the lost, then the nearest; -1 for none.

    Into z (1, 4) goes the place of the report in that track's plane.
    """
    best, best_live, best_miss = -1, False, np.inf
    for t in range(first, first + slots):
        if tracks[t].hits == 0:
            break
        dt = report.time - tracks[t].updated
        east, north, up = to_enu(report.lat, report.lon, tracks[t].anchor_lat, tracks[t].anchor_lon)
        de, dn = east - mean_of(tracks[t], 0), north - mean_of(tracks[t], 1)
        way = rules.max_speed * dt + rules.tolerance
        # The plane folds the far half of the Earth onto the near one.
        if up < -SEMI_MAJOR or de * de + dn * dn > way * way:
            continue
        live = dt <= tracks[t].patience
        if live:
            de, dn = de - dt * mean_of(tracks[t], 2), dn - dt * mean_of(tracks[t], 3)
        miss = de * de + dn * dn
        if best < 0 or (live and not best_live) or (live == best_live and miss < best_miss):
            best, best_live, best_miss = t, live, miss
            z[0, 0], z[0, 1] = east, north
    return best


@jit
def _continue(track, report, rules, z, noise, moving, spare, span, fit):  # type: ignore[no-untyped-def]
    """The report into its own track: the verdict on it."""
    dt = report.time - track.updated
    if 0.0 < dt <= rules.repeat and report.lat == track.lat and report.lon == track.lon:
        return REPEAT
    if dt > track.patience:
        restart(track, report, rules, z, noise, moving)
    else:
        anchor_near(track, report, rules, z)
        measure(track, report, rules, z, noise, moving)
        step_filter(track, dt, z, noise, moving, rules, spare, span, fit)
        if dt > 0.0:
            track.interval = dt if dt > track.interval else track.interval + 0.1 * (dt - track.interval)
    track.confirmed = 1
    _book(track, report, rules)
    return TAKEN


@jit
def _book(track, report, rules):  # type: ignore[no-untyped-def]
    """What the track knows besides its filter, and how long it will wait for the next report."""
    track.mmsi, track.class_b, track.origin = report.mmsi, report.class_b, report.origin
    track.updated, track.lat, track.lon = report.time, report.lat, report.lon
    track.sog, track.cog = report.sog, report.cog
    track.hits += 1
    fast = math.sqrt(mean_of(track, 2) ** 2 + mean_of(track, 3) ** 2) > rules.slow_speed
    nominal = (rules.moving_b if report.class_b == 1 else rules.moving_a) if fast else rules.slow
    track.expected = max(nominal, track.interval)
    track.patience = rules.patience_least + rules.patience_factor * track.expected


@jit
def carry_numbers(former, former_begin, former_end, tracks, begin, end):  # type: ignore[no-untyped-def]
    """The numbers that a vessel's tracks had before its reports were played again, given to the tracks that came out.

    A track that kept its number through the play keeps it; then one that ends in the same report as a former one takes that
    number; the rest take what is left, in order.
    Args: former, tracks: TRACK rows; begin, end: (V,) the rows of each vessel in them. Writes tracks.number.
    """
    for v in range(len(begin)):
        for exact in (True, False):
            for t in range(begin[v], end[v]):
                if tracks[t].number >= 0 or tracks[t].confirmed == 0:
                    continue
                for f in range(former_begin[v], former_end[v]):
                    same = former[f].updated == tracks[t].updated and former[f].lat == tracks[t].lat
                    same = same and former[f].lon == tracks[t].lon
                    if (exact and not same) or former[f].number < 0:
                        continue
                    taken = False
                    for u in range(begin[v], end[v]):
                        taken = taken or tracks[u].number == former[f].number
                    if not taken:
                        tracks[t].number = former[f].number
                        break
