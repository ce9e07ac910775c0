"""Settings of the ways in which radar tracks take AIS messages, and the messages of a region."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from coastwatch import kernels
from coastwatch.batches import Floats, Measurements, Messages, Sensors, Tracks
from coastwatch.geodesy import to_plane, turn, within_any
from coastwatch.stage import Positive, Probability, Settings
from coastwatch.tracks.radar.parts import Parts
from coastwatch.tracks.radar.table import RadarMemory


class MessageSettings(Settings):
    """AIS messages as measurements of radar tracks."""

    guides: ClassVar[bool] = False  # messages are for the association alone, and tracks are reported by their plots
    correct_id: Probability = 0.99  # probability that a message carries the id of its vessel
    silent_share: Probability = 0.5  # of the vessels without a track, that send no messages
    gate_sigmas: Annotated[float, Field(gt=0.0)] = 6.0  # a message farther from a track, by all of its models, is not of it
    begin_existence: Probability = 0.05  # a message begins a track that exists with this probability or more
    velocities: bool = True  # speed and course of messages are used; false: positions alone, as in the paper
    trust: Literal["tested", "always"] = "tested"
    """tested: tracks leave messages that contradict their plots, and one that radars do not see is not reported: its AIS track is.
    always: as in the papers."""
    doubt: Positive = 25.0  # normalised squared distance of the two filters at which a track leaves its messages
    elsewhere_s: Positive = 10.0  # a track also leaves them where another track has had newer ones of that MMSI for so long
    distrust_s: Positive = 120.0  # so long no track takes messages of an MMSI that a track has left

    @property
    def limit(self) -> float:
        """Squared Mahalanobis distance of the gate of messages.

        It is wider than that of plots: no message is clutter, and one outside the gate would begin a second track of its vessel.
        """
        return self.gate_sigmas**2


def messages_of(reports: Measurements, ais: Tracks, sensors: Sensors, region: int, interval_s: Floats) -> Messages:
    """The AIS reports of a cycle inside the range of a radar of a region, in its plane: what a tracker with `takes_messages` is given.

    Args: reports: that went into these AIS tracks; interval_s: (N,) of each AIS track, expected between its reports.
    """
    ours = sensors.radars.take(sensors.radars.region == region)
    reports = reports.take(within_any(reports.position_deg, ours.site_deg, ours.range_m))
    at = kernels.tables.match_ids.index_of(ais.track_id, reports.track_id)
    origin_deg = sensors.region_origin_deg[region]
    axes = turn(reports.position_deg, origin_deg)
    back = np.swapaxes(axes, 1, 2)
    return Messages(
        time_s=reports.time_s,
        position_m=to_plane(reports.position_deg, origin_deg),
        covariance=axes @ reports.covariance[:, :2, :2] @ back,
        mmsi=ais.mmsi[at],
        origin=ais.origin[at],
        velocity_m_s=(axes @ reports.velocity_m_s[:, :, None])[:, :, 0],
        velocity_covariance=axes @ reports.covariance[:, 2:, 2:] @ back,
        interval_s=interval_s[at],
    )


def in_order(rules: MessageSettings, parts: Parts, messages: Messages, memory: RadarMemory) -> Messages:
    """The messages sorted by time, without those so much older than a track that no gate would hold them. Particles take no velocities."""
    newest_s = float(memory.table.updated_s[memory.table.live].max(initial=-np.inf))
    order = np.lexsort((messages.position_m[:, 1], messages.position_m[:, 0], messages.mmsi, messages.time_s))
    messages = messages.take(order[messages.time_s[order] >= newest_s - parts.upkeep.late_s])
    if rules.velocities and not parts.bank.particles:
        return messages
    unknown = np.full((len(messages), 2), np.nan)
    return replace(messages, velocity_m_s=unknown, velocity_covariance=np.tile(unknown[:, :, None], (1, 1, 2)))
