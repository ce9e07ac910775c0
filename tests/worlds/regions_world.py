"""Regional centres for tests of how they are spread: small ones, hosts that fail at set moments, three real regions."""

from __future__ import annotations

import os
from contextlib import nullcontext

import numpy as np
from as_bytes import as_bytes
from region_steps import add

from coastwatch.cycle import gathered, run_cycle, start_run
from coastwatch.scenario import load_scenario
from coastwatch.server.checkpoint import save
from coastwatch.stage import serial
from coastwatch.workers.remote_regions import Lost, RegionHost

REGIONS = 5
CYCLES = 6


def starts(regions=REGIONS):
    """The memories before the first cycle."""
    return [(np.zeros(7), 0) for _ in range(regions)]


class Centre:
    """Regions with their memory here, and the same over another RegionMap."""

    def __init__(self, regions=REGIONS):
        self.rng, self.cycle = np.random.default_rng([1, 0]), 0
        self.here, self.there = starts(regions), starts(regions)

    def step(self, regions, gather=True):
        """One cycle of both, and the other processes that took part. Args: gather: bring the memories here and compare them."""
        given = [self.rng.normal(0.0, 1.0, 7) for _ in self.here]
        self.cycle += 1
        self.here, here = map(list, zip(*(add(m, g) for m, g in zip(self.here, given, strict=True)), strict=True))
        self.there, there = map(list, zip(*regions(add, self.there, given), strict=True))
        assert [total for total, _ in there] == [total for total, _ in here]
        if gather:
            assert save(regions.gather(self.there)) == save(self.here)
        return {process for _, process in there if process != os.getpid()}


class FailingHosts:
    """Hosts in this process, which are lost at the calls and answers of the given numbers."""

    least_regions = 1

    def __init__(self, count, fail_at, replaced=True):
        self.hosts, self.fail_at, self.replaced = [RegionHost() for _ in range(count)], set(fail_at), replaced
        self.number = self.lost = 0
        self.called = []

    def _may_fail(self, host):
        self.number += 1
        if self.number in self.fail_at:
            self.lost += 1
            raise Lost
        assert host in self.hosts

    def ready(self):
        return list(self.hosts)

    def call(self, host, name, region, *given):
        self._may_fail(host)
        self.called.append((name, region))
        return name, given

    def answer(self, host, region, begun):
        self._may_fail(host)
        name, given = begun
        found = getattr(host, name)(region, *_copied(given))
        return _copied(found)

    def replace(self, host):
        self.hosts.remove(host)
        if self.replaced:
            self.hosts.append(RegionHost())


def _copied(value):
    """As another process would get it."""
    if isinstance(value, np.ndarray):
        return value.copy()
    return type(value)(_copied(each) for each in value) if type(value) in (tuple, list) else value


def scenario_of_regions(cycles=CYCLES, method="sided_imm"):
    """Three radars, each a region of its own."""
    radar = '{{name = "{0}", region = "{0}", latitude_deg = {1}, longitude_deg = {2}, range_nm = 4.0, rpm = 20.0}}'
    sites = (("north", -23.0, -43.1), ("south", -23.1, -43.1), ("west", -23.05, -43.15))
    origin = ', plot_origin = "estimated"' if method.endswith("imm") else ""
    settings = {
        "radars": f"[{', '.join(radar.format(*site) for site in sites)}]",
        "tracks": f'{{method = "{method}"{origin}}}',
        "warmup_s": "0",
        "cycles": str(cycles),
        "input.count": "120",
    }
    return load_scenario("context-driven-1000", settings)


def run_regions(scenario, regions, spots=serial, at_cycle=lambda cycle: None):
    """What each cycle yields, and the memory of the regions at the end, as bytes."""
    sensors, plan = scenario.sensors(), scenario.plan()
    recording = scenario.input.load(sensors, 1, plan)
    memory, made = start_run(scenario, sensors), []
    for cycle in range(plan.cycles):
        at_cycle(cycle)
        now = plan.instant_s(cycle)
        reports = recording.reports.between(plan.instant_s(cycle - 1), now)
        memory, out = run_cycle(scenario, sensors, memory, reports, now, spots, lambda _: nullcontext(), regions)
        made.append(as_bytes((out.tracks, out.picture, out.associations, out.corrections)))
    assert len(sensors.region_names) == 3
    assert all((out.tracks.source == k).sum() > 5 for k in range(4))
    return made, save(gathered(memory, regions).regions)
