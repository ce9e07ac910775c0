"""Regional centres over machines: the same tracks as here, also when a machine is lost."""

import os
import sys
import time
import warnings
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest

from coastwatch import pipeline
from coastwatch.scenario import load_scenario
from coastwatch.server.checkpoint import save
from coastwatch.stage import serial, serial_regions

EACH = {"num_cpus": 1, "object_store_memory": 80 * 2**20}  # node of the cluster
PATIENCE_S = 60.0  # until a lost actor has been noticed and replaced
REGIONS = 5


def add(memory, given):
    """A step for the test that writes into its memory."""
    total, cycles = memory
    total += given
    return (total, cycles + 1), total.sum(), os.getpid()


def refuse(memory, given):
    raise KeyError("nothing")


class Centre:
    """Regions with a memory here, and the same over actors."""

    def __init__(self):
        self.rng, self.cycle = np.random.default_rng([1, 0]), 0
        self.here, self.there = ([(np.zeros(7), 0) for _ in range(REGIONS)] for _ in range(2))

    def step(self, actors):
        given = [(self.rng.normal(0.0, 1.0, 7),) for _ in range(REGIONS)]
        self.cycle += 1
        if self.cycle % 4 == 0:  # as where the registration of a radar jumps
            self.here[2], self.there[2] = ((total * 0.5, cycles) for total, cycles in (self.here[2], self.there[2]))
        self.here, sums, _ = zip(*serial_regions(add, self.here, given), strict=True)
        self.there, found, who = zip(*actors(add, self.there, given), strict=True)
        self.here, self.there = list(self.here), list(self.there)
        assert found == sums
        assert save(self.here) == save(self.there)
        return {process for process in who if process != os.getpid()}


@pytest.fixture(scope="module")
def two_machines():
    """A Ray cluster of two nodes with a processor each; the coordinator is at the first."""
    pytest.importorskip("ray", reason="Ray is not installed")
    import ray
    from ray.cluster_utils import Cluster

    with pytest.MonkeyPatch.context() as patch, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        patch.setenv("PYTHONPATH", os.pathsep.join([str(Path(__file__).parent), *sys.path]))  # where actors find the work
        cluster = Cluster(initialize_head=True, head_node_args={"include_dashboard": False, **EACH})
        other = cluster.add_node(**EACH)
        ray.init(address=cluster.address, log_to_driver=False, logging_level="ERROR")
        try:
            yield cluster, other
        finally:
            ray.shutdown()
            cluster.shutdown()


@pytest.mark.slow
def test_a_machine_that_is_killed_costs_a_cycle_and_changes_nothing(two_machines):
    import ray

    from coastwatch.workers.ray import Actors

    cluster, other = two_machines
    centre = Centre()
    with Actors(2) as actors:
        places = [node for node, _ in ray.get([held.actor.joined.remote() for held in actors.at_hand()])]
        assert len(set(places)) == 2
        assert [len(centre.step(actors)) for _ in range(30)] == 30 * [2]
        cluster.remove_node(other, allow_graceful=False)
        deadline, seen = time.monotonic() + PATIENCE_S, []
        while seen[-3:] != 3 * [1]:
            seen.append(len(centre.step(actors)))
            assert time.monotonic() < deadline
        ray.kill(actors.at_hand()[0].actor)
        while seen[-1] != 1 or 0 not in seen:
            seen.append(len(centre.step(actors)))
            assert time.monotonic() < deadline
        with pytest.raises(KeyError, match="nothing"):
            actors(refuse, centre.there, [(1,)] * REGIONS)


@pytest.mark.slow
def test_tracks_of_regions_are_the_same_over_actors(two_machines):
    from coastwatch.workers.ray import Actors

    scenario = load_scenario("context-driven-1000", {"radars.1.region": '"west"', "warmup_s": "0", "cycles": "6"})
    sensors, plan = scenario.sensors(), scenario.plan()
    assert len(sensors.region_names) > 1
    recording = scenario.input.load(sensors, 1, plan)
    with Actors(2) as actors:
        seen = []
        for regions in (serial_regions, actors):
            memory, made = pipeline.start(scenario, sensors), []
            for cycle in range(6):
                now = plan.instant_s(cycle)
                reports = recording.reports.between(plan.instant_s(cycle - 1), now)
                memory, out = pipeline.step(scenario, sensors, memory, reports, now, serial, lambda _: nullcontext(), regions)
                made.append(save((out.tracks, out.picture, out.associations)))
            seen.append((made, save(memory.tracks)))
        assert len(out.tracks) > 20
    assert seen[0] == seen[1]
