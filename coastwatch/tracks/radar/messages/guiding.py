"""AIS messages that guide the association of plots, and are not in the track that is reported."""

from __future__ import annotations

from typing import ClassVar, Literal

import numpy as np

from coastwatch.batches import Floats, Ints, Messages
from coastwatch.stage import NotNegative, Positive
from coastwatch.tracks.radar import plots_alone
from coastwatch.tracks.radar.life.existence import KNOWN
from coastwatch.tracks.radar.messages.sequential import Sequential
from coastwatch.tracks.radar.messages.weighing import begin_unnamed
from coastwatch.tracks.radar.parts import Parts
from coastwatch.tracks.radar.table import RadarMemory


class Guiding(Sequential):
    """Each AIS message at its own time, as by `sequential`, for the association of plots alone.

    A second filter has the plots only, with the probabilities of this association. It is what a track reports, so that its errors stay
    independent of AIS, and an AIS that states a wrong position cannot draw it away. A track whose two filters contradict each other goes
    on by plots alone, and for a while no track takes messages of that MMSI. A vessel that no radar has seen for `coast_s` is not reported.
    """

    guides: ClassVar[bool] = True
    method: Literal["guiding"] = "guiding"  # type: ignore[assignment]
    registration: NotNegative = 0.0
    """Share of a plot's covariance by which a radar may see a vessel beside its AIS. 0: radars have no bias; 1: one whose bias is not known
    yet makes fewer second tracks of vessels, and leaves an AIS that states a wrong position later."""
    doubt: Positive = 25.0  # normalised squared distance of the two filters at which a track leaves its messages
    elsewhere_s: Positive = 10.0  # a track also leaves them where another track has had newer ones of that MMSI for so long
    distrust_s: Positive = 120.0  # so long no track takes messages of an MMSI that a track has left

    def trusted(self, memory: RadarMemory, messages: Messages, time_s: float) -> Messages:
        """The messages without those of an MMSI that a track has left lately."""
        table, alone = memory.table, memory.plots_alone
        left = table.live[time_s - alone.left_s[table.live] < self.distrust_s]
        return messages.take(~np.isin(messages.mmsi, alone.left_mmsi[left])) if len(left) else messages

    def leave(self, parts: Parts, memory: RadarMemory, since_s: float, time_s: float) -> None:
        """Tracks whose messages contradict their plots, or go to another track, go on by plots alone, in place.

        All tracks of that MMSI do. Args: since_s: time of the oldest message of this cycle: a track without one is not tested again.
        """
        table, alone = memory.table, memory.plots_alone
        every = table.probable_ids(table.live, KNOWN)
        slots, mmsi = table.live[every >= 0], every[every >= 0]
        ids, of = np.unique(mmsi, return_inverse=True)
        newest_s = np.full(len(ids), -np.inf)
        np.maximum.at(newest_s, of, table.message_s[slots])
        gone = table.message_s[slots] < newest_s[of] - self.elsewhere_s
        fresh = np.flatnonzero(table.message_s[slots] >= since_s)
        bias = self.registration * _plot_covariance(parts, memory, slots[fresh])
        gone[fresh[plots_alone.contradicted(alone, table, parts.bank, slots[fresh], bias, time_s, self.doubt)]] = True
        gone = np.isin(mmsi, mmsi[gone])
        left = slots[gone]
        if not len(left):
            return
        alone.left_mmsi[left], alone.left_s[left] = mmsi[gone], time_s
        with_plots = left[alone.has_filter(left)]
        plots_alone.begin_at(table.filters, table.estimates, with_plots, parts.bank, alone.estimates, with_plots)
        table.updated_s[with_plots] = alone.updated_s[with_plots]
        alone.updated_s[left] = table.message_s[left] = -np.inf
        table.ids[left], table.id_probability[left] = -1, 0.0
        begin_unnamed(self, table, left)


def _plot_covariance(parts: Parts, memory: RadarMemory, slots: Ints) -> Floats:
    """The covariance of a plot at these tracks, of the radar with the newest one. (N, 2, 2)"""
    table, radars = memory.table, parts.sensors.radars
    if not len(radars):
        return np.zeros((len(slots), 2, 2))
    radar = table.radar_s[slots].argmax(axis=1)
    off_m = np.nan_to_num(table.combined_mean[slots, :2] - memory.site_m[radar])
    range_m = np.hypot(off_m[:, 0], off_m[:, 1])
    along = off_m / np.maximum(range_m, 1.0)[:, None]
    outer = along[:, :, None] * along[:, None, :]
    across2 = (range_m * radars.azimuth_sigma_rad[radar]) ** 2
    out: Floats = across2[:, None, None] * (np.eye(2) - outer) + radars.range_sigma_m[radar][:, None, None] ** 2 * outer
    return out
