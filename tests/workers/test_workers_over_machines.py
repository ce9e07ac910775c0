"""Regional centres over machines: the same tracks as here, also when a machine is lost."""

import os
import sys
import time
import warnings

import pytest
from region_steps import refuse
from regions_world import REGIONS, Centre, run_regions, scenario_of_regions

from coastwatch.stage import serial_regions
from coastwatch.workers.remote_regions import RemoteRegions

pytestmark = pytest.mark.contract

EACH = {"num_cpus": 1, "object_store_memory": 80 * 2**20}  # node of the cluster
PATIENCE_S = 60.0  # until a lost actor has been noticed and replaced


@pytest.fixture
def two_machines():
    """A Ray cluster of two nodes with a processor each; the coordinator is at the first."""
    pytest.importorskip("ray", reason="Ray is not installed")
    import ray
    from ray.cluster_utils import Cluster

    with pytest.MonkeyPatch.context() as patch, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        patch.setenv("PYTHONPATH", os.pathsep.join([*sys.path]))  # where actors find the work
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
        regions = RemoteRegions(actors)
        places = [node for node, _ in ray.get([actor.handle.joined.remote() for actor in actors.ready()])]
        assert len(set(places)) == 2
        assert [len(centre.step(regions, gather=cycle % 4 == 0)) for cycle in range(30)] == 30 * [2]
        cluster.remove_node(other, allow_graceful=False)
        deadline, seen = time.monotonic() + PATIENCE_S, []
        while seen[-3:] != 3 * [1]:
            seen.append(len(centre.step(regions, gather=False)))
            assert time.monotonic() < deadline
        ray.kill(actors.ready()[0].handle)
        while seen[-1] != 1 or 0 not in seen:
            seen.append(len(centre.step(regions)))
            assert time.monotonic() < deadline
        with pytest.raises(KeyError, match="nothing"):
            regions(refuse, centre.there, [1] * REGIONS)


@pytest.mark.slow
def test_the_picture_from_plots_is_the_same_over_two_machines_of_which_one_is_killed(two_machines):
    from coastwatch.workers.ray import Actors

    cluster, other = two_machines
    scenario = scenario_of_regions()
    alone = run_regions(scenario, serial_regions)
    with Actors(2) as actors:
        assert run_regions(scenario, RemoteRegions(actors)) == alone
        lost = []

        def kill(cycle):
            if cycle == 3:
                cluster.remove_node(other, allow_graceful=False)
                lost.append(cycle)

        assert run_regions(scenario, RemoteRegions(actors), at_cycle=kill) == alone
        assert lost
        assert len(actors.ready()) == 1
