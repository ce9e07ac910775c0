"""The common input of trackers: plots of one region of the coast of `scaling.load.chain`, with misses and clutter."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from coastwatch.batches import Floats, RadarCorrections, Sensors
from coastwatch.geodesy import from_plane, to_plane
from coastwatch.plots import PolarConversion
from scaling.load.chain.reports import initial_state, next_cycle
from scaling.load.chain.world import Size, World, build_world
from scaling.peers.exchange import PlotHistory
from scaling.peers.input import ORIGIN_DEG

EDGE_M = 300.0  # the end of a radar's range, where tracks come and go


def make_plots(vessels: int, cycles: int, measured: int, seed: int) -> PlotHistory:
    """The plots of a region over T cycles. Args: measured: number of cycles at the end that are timed."""
    world = _world({"vessels": vessels, "cycles": cycles, "seed": seed})
    sensors, converter = world.sensors, PolarConversion()
    memory, none = converter.init(), RadarCorrections.empty(R=len(sensors.radars))
    origin_deg, state, parts = sensors.region_origin_deg[0], initial_state(world), []
    for cycle in range(cycles):
        state, reports = next_cycle(world, state)
        memory, plots = converter.step(memory, reports.radar, sensors, none)
        parts.append((np.full(len(plots), cycle), plots))
    plots = type(parts[0][1]).join([part for _, part in parts])
    time_s = np.array([world.plan.instant_s(cycle) for cycle in range(cycles)])
    truth = [_true(world, float(now_s), origin_deg) for now_s in time_s]
    return PlotHistory(
        time_s=time_s,
        measured=measured,
        cycle=np.concatenate([cycle for cycle, _ in parts]),
        radar=plots.sensor,
        plot_time_s=plots.time_s,
        range_m=plots.range_m,
        azimuth_rad=plots.azimuth_rad,
        position_m=plots.position_m,
        covariance=plots.covariance,
        site_m=to_plane(sensors.radars.site_deg, origin_deg),
        reach_m=sensors.radars.range_m,
        true_position_m=np.array([position for position, _ in truth]),
        true_velocity_m_s=np.array([velocity for _, velocity in truth]),
        settings={"vessels": vessels, "cycles": cycles, "seed": seed},
    )


def plot_radars(settings: Mapping[str, Any]) -> Sensors:
    """The radars of an input, by its settings, moved so that the plane of their region is tangent at `ORIGIN_DEG`."""
    sensors = _world(settings).sensors
    site_m = to_plane(sensors.radars.site_deg, sensors.region_origin_deg[0])
    radars = replace(sensors.radars, site_deg=from_plane(site_m, ORIGIN_DEG))
    return replace(sensors, radars=radars, region_origin_deg=ORIGIN_DEG[None])


def in_cover(history: PlotHistory, position_m: Floats) -> Any:
    """Which positions (N, 2) are in range of a radar, away from the end of its range."""
    gap = position_m[:, None] - history.site_m
    return (np.hypot(gap[..., 0], gap[..., 1]) < history.reach_m - EDGE_M).any(axis=1)


def _world(settings: Mapping[str, Any]) -> World:
    vessels = settings["vessels"]
    return build_world(Size(vessels, settings["cycles"], vessels), {}, settings["seed"])


def _true(world: World, now_s: float, origin_deg: Floats) -> tuple[Floats, Floats]:
    rows = np.arange(world.count)
    position, velocity = world.vessels.state(rows, np.full(len(rows), now_s))
    return to_plane(position, origin_deg), velocity
