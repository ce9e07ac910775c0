"""Whether radar and AIS see the same vessels in a run: if they see none together, the times of one of them are wrong."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from coastwatch.batches import Bools, Floats, Sensors
from coastwatch.geodesy import to_plane

if TYPE_CHECKING:
    from coastwatch.centre import Cycle

LEAST_CYCLES, LEAST_VESSELS = 100, 3
"""Cycles in which a region has vessels of its own with AIS vessels among them, and how many different AIS vessels: then it is sure."""
CHANCE_SHARE = 0.01  # of the AIS vessels among those of a region, that come together with one by chance


class CommonVessels:
    """Counts over the cycles of a run, for each region with radars that do not move."""

    def __init__(self, sensors: Sensors) -> None:
        self._sensors = sensors
        n = len(sensors.region_names)
        self._cycles, self._lone, self._common = np.zeros(n, np.int64), np.zeros(n, np.int64), np.zeros(n, np.int64)
        self._mmsi: list[set[int]] = [set() for _ in range(n)]

    def add(self, cycle: Cycle) -> None:
        """Count the vessels of a cycle."""
        picture, members = cycle.picture, cycle.members
        has_ais = np.isin(picture.vessel_id, members.vessel_id[members.source == self._sensors.ais_source])
        for region in range(len(self._sensors.region_names)):
            of_region = np.isin(picture.vessel_id, members.vessel_id[members.source == region])
            self._common[region] += np.count_nonzero(of_region & has_ais)
            if not (of_region & ~has_ais).any():
                continue
            away_m = self._from_radars(region, picture.position_deg)
            among = has_ais & ~of_region & self._within(away_m, of_region)
            self._cycles[region] += bool(among.any())
            self._lone[region] += np.count_nonzero(among)
            self._mmsi[region].update(picture.mmsi[among].tolist())

    def warnings(self) -> Iterator[str]:
        """A sentence for each region that has no vessel in common with AIS."""
        radars = self._sensors.radars
        for region in range(len(self._sensors.region_names)):
            vessels = len(self._mmsi[region])
            few = self._cycles[region] < LEAST_CYCLES or vessels < LEAST_VESSELS
            if few or self._common[region] > CHANCE_SHARE * self._lone[region]:
                continue
            names = ", ".join(radars.name[radars.region == region].tolist())
            yield (
                f"radar {names} and AIS have no vessel in common, though {vessels} AIS vessels were among those of the radar, in "
                f"{self._cycles[region]:,} cycles: are the times of one of them local, not UTC, or is the place of the radar wrong?"
            )

    def _from_radars(self, region: int, position_deg: Floats) -> Floats:
        """Distance to the nearest radar of a region, NaN where all of them move. (V, 2) -> (V,)"""
        site = self._sensors.radars.site_deg[self._sensors.radars.region == region]
        site = site[np.isfinite(site).all(axis=1)]
        if not len(site):
            return np.full(len(position_deg), np.nan)
        return np.asarray(np.min([np.hypot(*to_plane(position_deg, place).T) for place in site], axis=0))

    @staticmethod
    def _within(away_m: Floats, of_region: Bools) -> Bools:
        """Which vessels are as near as the vessels of a region are. False for NaN."""
        return np.asarray(away_m <= away_m[of_region].max())
