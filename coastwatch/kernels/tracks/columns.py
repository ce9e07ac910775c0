"""The columns that kernels of radar trackers share. S slots of a table of tracks, M plots, R radars.

A kernel that updates tracks writes into these arrays.
"""

from __future__ import annotations

from typing import NamedTuple

from coastwatch.kernels.arrays import Floats, Ints

SINGLE, TENTATIVE, CONFIRMED = 0, 1, 2  # status of a track; SINGLE: it has one plot
NAMES = 4  # ids of which a track keeps the probability


class TrackLife(NamedTuple):
    """The status of each track and the plots behind it."""

    status: Ints  # (S,) SINGLE, TENTATIVE or CONFIRMED
    hits: Ints  # (S,) plots and messages so far
    started: Floats  # (S,) time of the first plot
    radar_time: Floats  # (S, R) newest plot of each radar, -inf where there is none
    origins: Ints  # (S, K) true vessels of the newest plots, newest first


class ExistenceColumns(NamedTuple):
    """How probable it is that there is a vessel behind each track, and that radars can see it."""

    existence: Floats  # (S,)
    visibility: Floats  # (S,) of a vessel that exists
    time: Floats  # (S,) of both
    looked: Floats  # (S, R) time up to which the looks of each radar are in both
    misses: Floats  # (S,) looks without a plot in the gate since the newest one, each as much as `DetectionColumns.miss` of its radar
    radar_time: Floats  # (S, R) newest plot of each radar, -inf where there is none


class DetectionColumns(NamedTuple):
    """What looks of each radar detect."""

    probability: Floats  # (R,) of a plot of a visible vessel
    miss: Floats  # (R,) what a look without a plot counts
    looks: Floats  # (R,) at vessels whose tracks surely exist


class VesselIds(NamedTuple):
    """Which id the AIS messages of the vessel behind each track carry."""

    name: Ints  # (S, NAMES) MMSI, -1 where there is none
    probability: Floats  # (S, NAMES + 2) that it sends no messages, of each name, of any other id


class PlotColumns(NamedTuple):
    """Plots of a batch, or AIS messages as measurements."""

    time: Floats  # (M,)
    position: Floats  # (M, 2)
    covariance: Floats  # (M, 2, 2)
    sensor: Ints  # (M,) radar; -1: AIS
    origin: Ints  # (M,) true vessel, -1 where there is none


class RadarColumns(NamedTuple):
    """Radars of a region."""

    site: Floats  # (R, 2)
    range: Floats  # (R,)
    period: Floats  # (R,) of one turn
    newest: Floats  # (R,) time of the newest plot, -inf where it has sent nothing


class Candidates(NamedTuple):
    """Pairs of a plot and a track whose gate it is in, sorted by plot, then by track, the older first."""

    plot: Ints  # (A,)
    track: Ints  # (A,) slot
    distance2: Floats  # (A,) squared Mahalanobis distance of the innovation
    log_likelihood: Floats  # (A,) of the innovation
