"""Are silent vessels flagged dark, and only they?"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from coastwatch.batches import AisReports, Bools, Flag, Floats, Ints, Picture, Sensors, Truth
from coastwatch.geodesy import to_plane

SILENT_FOR_S = 60.0  # without a report: silent now
SETTLED_S = 120.0  # so long silent in cover: the flag is due


@dataclass(frozen=True, eq=False)
class Dark:
    """What was due and what was flagged, over instants and over vessels."""

    since_s: Floats  # (V,) of all true vessels: since when silent in cover, inf: not
    due: Bools  # (V,) the flag was due at some instant
    flagged: Bools  # (V,) and stood at some instant at which it was due
    false_ids: Ints  # ids of vessels of the picture that were flagged and not silent
    due_count: int = 0  # instants at which a flag was due
    flagged_count: int = 0  # of these, with the flag
    clear_count: int = 0  # instants of vessels of the picture that were not silent
    false_count: int = 0  # of these, with the flag

    @staticmethod
    def over(vessels: int) -> Dark:
        """Before the first instant."""
        none = np.zeros(vessels, np.bool_)
        return Dark(np.full(vessels, np.inf), none, none, np.zeros(0, np.int64))

    def as_dict(self) -> dict[str, float | int | None]:
        """Shares and counts; a share of nothing is none."""
        return {
            "dark_recall": self.flagged_count / self.due_count if self.due_count else None,
            "dark_false_rate": self.false_count / self.clear_count if self.clear_count else None,
            "silent_vessels_in_cover": int(self.due.sum()),
            "silent_vessels_flagged": int(self.flagged.sum()),
            "vessels_flagged_wrongly": len(self.false_ids),
        }


def never_heard(vessel: Ints, ais: AisReports) -> Ints:
    """The true vessels of which no report ever comes."""
    return np.setdiff1d(vessel, ais.origin)


def watch(
    dark: Dark, every_vessel: Ints, may_be_silent: Ints, truth: Truth, ais: AisReports, picture: Picture, sensors: Sensors
) -> Dark:
    """The counts after one more instant.

    A vessel is silent when it is one of those that may be and was not heard for 60 s. Its flag is due after 120 s of that inside
    the range of a radar and of an AIS station, whether or not the picture has it.

    Args: every_vessel: (V,) sorted, of the whole run; may_be_silent: their origins; truth: now; ais: all reports of the run.
    """
    if not len(truth):
        return dark
    now_s = float(truth.time_s[0])
    lo, hi = np.searchsorted(ais.received_s, [now_s - SILENT_FOR_S, now_s], side="right")
    silent = np.isin(truth.vessel, may_be_silent) & ~np.isin(truth.vessel, ais.origin[lo:hi])
    cover = covered(truth.position_deg, sensors.radars.site_deg, sensors.radars.range_m)
    cover &= covered(truth.position_deg, sensors.stations.site_deg, sensors.stations.range_m)
    state = np.zeros(len(every_vessel), np.bool_)
    state[np.searchsorted(every_vessel, truth.vessel[silent & cover])] = True
    since = np.where(state, np.minimum(dark.since_s, now_s), np.inf)
    due = now_s - since >= SETTLED_S
    flag = (picture.flags & Flag.DARK) != 0
    flagged = due & np.isin(every_vessel, picture.origin[flag])
    clear = ~np.isin(picture.origin, truth.vessel[silent])
    return replace(
        dark,
        since_s=since,
        due=dark.due | due,
        flagged=dark.flagged | flagged,
        false_ids=np.union1d(dark.false_ids, picture.vessel_id[flag & clear]),
        due_count=dark.due_count + int(due.sum()),
        flagged_count=dark.flagged_count + int(flagged.sum()),
        clear_count=dark.clear_count + int(clear.sum()),
        false_count=dark.false_count + int((flag & clear).sum()),
    )


def covered(position_deg: Floats, site_deg: Floats, range_m: Floats) -> Bools:
    """Whether each place is within range of any site. Args: (V, 2), (R, 2), (R,). Returns: (V,)."""
    out = np.zeros(len(position_deg), np.bool_)
    for site, reach in zip(site_deg, range_m, strict=True):
        out |= np.linalg.norm(to_plane(position_deg, site), axis=1) <= reach
    return out
