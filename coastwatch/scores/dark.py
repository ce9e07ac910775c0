"""Whether vessels that switched off AIS are flagged as dark, and no others are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coastwatch.batches import AisReports, Bools, Flag, Ints, Picture, Sensors, Struct, Trajectories, Truth, column
from coastwatch.geodesy import within_any
from coastwatch.kernels.tables.lookup import row_of

SILENT_FOR_S = 60.0  # without a report: the vessel is silent
SETTLED_S = 120.0  # silent in cover for so long: the flag is due
LOOKS = 5  # instants at which this is checked


@dataclass(frozen=True, eq=False)
class Dark(Struct):
    """Flags that were due and flags that were set, over instants and over vessels."""

    due: Bools = column(np.bool_, "V")  # of all true vessels: the flag was due at some instant
    flagged: Bools = column(np.bool_, "V")  # and was set at some instant at which it was due
    false_ids: Ints = column(np.int64, "F")  # ids of vessels of the picture that were flagged and not silent
    due_count: int = 0  # instants at which a flag was due
    seen_count: int = 0  # of these, with the vessel in the picture
    flagged_count: int = 0  # of these, with the flag
    clear_count: int = 0  # instants of vessels of the picture that were not silent
    false_count: int = 0  # of these, with the flag

    def as_dict(self) -> dict[str, float | int | None]:
        """Rates and counts; None where there is nothing to count."""
        return {
            "dark_recall": self.flagged_count / self.due_count if self.due_count else None,
            "dark_recall_where_seen": self.flagged_count / self.seen_count if self.seen_count else None,
            "dark_false_rate": self.false_count / self.clear_count if self.clear_count else None,
            "silent_vessels_in_cover": int(self.due.sum()),
            "silent_vessels_flagged": int(self.flagged.sum()),
            "vessels_flagged_wrongly": len(self.false_ids),
        }


def without_reports(vessel: Ints, ais: AisReports) -> Ints:
    """The true vessels without any AIS report in the run."""
    return np.setdiff1d(vessel, ais.origin)


def watch(
    dark: Dark, may_be_silent: Ints, truth: Trajectories, now_s: float, ais: AisReports, picture: Picture, sensors: Sensors
) -> Dark:
    """The counts after one more instant.

    A vessel is silent if it is one of those that may be and sent no report for 60 s. Its flag is due after 120 s of silence
    inside the range of a radar and of an AIS station. The picture need not have it.

    Args: may_be_silent: true vessels; truth, ais: of the whole run; picture: of now.
    """
    settled = [_silent(may_be_silent, truth, now_s - ago, ais) for ago in np.linspace(0.0, SETTLED_S, LOOKS)]
    due = np.full(len(truth.vessel), now_s - SETTLED_S >= truth.time_s[0])
    for silent, row in settled:
        in_cover = within_any(silent.position_deg, sensors.radars.site_deg, sensors.radars.range_m)
        in_cover &= within_any(silent.position_deg, sensors.stations.site_deg, sensors.stations.range_m)
        there = np.zeros(len(due), np.bool_)
        there[row[in_cover]] = True
        due &= there
    flag = (picture.flags & Flag.DARK) != 0
    flagged = due & np.isin(truth.vessel, picture.origin[flag])
    clear = ~np.isin(picture.origin, settled[0][0].vessel)
    return Dark(
        due=dark.due | due,
        flagged=dark.flagged | flagged,
        false_ids=np.union1d(dark.false_ids, picture.vessel_id[flag & clear]),
        due_count=dark.due_count + int(due.sum()),
        seen_count=dark.seen_count + int((due & np.isin(truth.vessel, picture.origin)).sum()),
        flagged_count=dark.flagged_count + int(flagged.sum()),
        clear_count=dark.clear_count + int(clear.sum()),
        false_count=dark.false_count + int((flag & clear).sum()),
    )


def _silent(may_be_silent: Ints, truth: Trajectories, time_s: float, ais: AisReports) -> tuple[Truth, Ints]:
    """The vessels that are silent at a time, and their rows in the trajectories."""
    there = truth.at(time_s)
    lo, hi = np.searchsorted(ais.received_s, [time_s - SILENT_FOR_S, time_s], side="right")
    silent = there.take(np.isin(there.vessel, may_be_silent) & ~np.isin(there.vessel, ais.origin[lo:hi]))
    return silent, row_of(truth.vessel, silent.vessel)
