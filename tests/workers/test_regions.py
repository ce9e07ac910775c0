"""Regional centres however they are spread: the tracks and the picture of one thread, also when hosts of regions are lost."""

import os
import signal
from collections import Counter

import numpy as np
import pytest
from region_steps import add, refuse
from regions_world import CYCLES, REGIONS, Centre, FailingHosts, run_regions, scenario_of_regions, starts

from coastwatch.kernels.threads import threads
from coastwatch.server.checkpoint import save
from coastwatch.stage import serial_regions
from coastwatch.workers import ThreadedRegions, open_workers, remote_regions
from coastwatch.workers.region_processes import ProcessHosts
from coastwatch.workers.remote_regions import Kept, RemoteRegions

pytestmark = pytest.mark.contract


def moments():
    """When hosts are lost: at each of the calls and answers of some cycles, and at many."""
    yield from ([at] for at in range(1, 61))
    for seed in range(40):
        rng = np.random.default_rng([seed, 3])
        yield sorted(rng.choice(200, rng.integers(2, 40), replace=False).tolist())


@pytest.mark.parametrize("replaced", [True, False])
@pytest.mark.parametrize("gather_every", [1, 4])
def test_hosts_lost_at_any_moment_change_nothing(replaced, gather_every):
    lost = 0
    for fail_at in moments():
        hosts, centre = FailingHosts(3, fail_at, replaced), Centre()
        regions = RemoteRegions(hosts)
        for cycle in range(12):
            centre.step(regions, gather=cycle % gather_every == 0)
        centre.step(regions)
        assert regions.lost == hosts.lost
        lost += hosts.lost
    assert lost > 100


def test_a_host_is_sent_a_memory_once_and_afterwards_only_what_is_given(monkeypatch):
    monkeypatch.setattr(remote_regions, "REPLAY_S", 1e9)
    monkeypatch.setattr(remote_regions, "BALANCE_EVERY", 1000)  # regions move by measured times, which differ
    hosts, centre = FailingHosts(2, []), Centre()
    regions = RemoteRegions(hosts)
    for _ in range(30):
        centre.step(regions, gather=False)
    assert Counter(name for name, _ in hosts.called) == {"step": 30 * REGIONS}
    assert all(isinstance(memory, Kept) for memory in centre.there)
    assert regions.gather(starts()) is not None  # plain memories are what they are


@pytest.mark.parametrize(("seconds", "cycles"), [(1e9, 3), (0.0, 10**6)])
def test_no_more_is_computed_again_than_the_limit_allows(monkeypatch, seconds, cycles):
    monkeypatch.setattr(remote_regions, "REPLAY_CYCLES", cycles)
    monkeypatch.setattr(remote_regions, "REPLAY_S", seconds)
    monkeypatch.setattr(remote_regions, "BALANCE_EVERY", 1000)  # regions move by measured times, which differ
    steps = 0

    def counted(memory, given):
        nonlocal steps
        steps += 1
        return add(memory, given)

    hosts = FailingHosts(REGIONS, [])
    regions, memories = RemoteRegions(hosts), starts()
    for number in range(1, 31):
        before = steps
        if number % 7 == 0:
            hosts.fail_at = {hosts.number + 1}
        memories = [found[0] for found in regions(counted, memories, [np.ones(7)] * REGIONS)]
        assert steps - before <= REGIONS + min(cycles, 3)
    assert hosts.lost == 4
    assert all(total.tolist() == [30.0] * 7 for total, _ in regions.gather(memories))


def test_regions_move_when_one_host_has_most_of_the_work(monkeypatch):
    clock = 0.0

    def timed(memory, given):
        nonlocal clock
        clock += given
        return (memory[0] + given, 0), None

    monkeypatch.setattr(remote_regions.time, "process_time", lambda: clock)
    hosts = FailingHosts(2, [])
    regions, memories = RemoteRegions(hosts), [(0.0, 0)] * 4
    cost = [0.1, 0.01, 0.09, 0.01]  # dealt blindly, the first and the third share a host
    for _ in range(2 * remote_regions.BALANCE_EVERY + 1):
        memories = [found[0] for found in regions(timed, memories, cost)]
    moved = [k for name, k in hosts.called if name == "release"]
    assert 1 <= len(moved) <= 3
    assert sorted(k for host in hosts.hosts for k in host._memory) == [0, 1, 2, 3]
    assert not any({0, 2} <= set(host._memory) for host in hosts.hosts)
    np.testing.assert_allclose(
        [total for total, _ in regions.gather(memories)], (2 * remote_regions.BALANCE_EVERY + 1) * np.array(cost)
    )


def test_a_memory_is_consumed_and_an_error_of_a_step_is_raised():
    regions, given = RemoteRegions(FailingHosts(2, [])), [np.ones(7)] * REGIONS
    old = [found[0] for found in regions(add, starts(), given)]
    regions(add, old, given)
    with pytest.raises(ValueError, match=r"memory of a region: got Kept\(region=0, cycle=0\), needed .*cycle=1"):
        regions(add, old, given)
    with pytest.raises(KeyError, match="nothing"):
        regions(refuse, starts(), given)
    with pytest.raises(TypeError, match="needed an array, a number, a text or a declared dataclass"):
        save(old)  # what stands for a memory is not saved in its place


def test_threads_take_regions_and_raise_their_errors():
    with threads(3):
        regions, centre = ThreadedRegions(), Centre()
        for _ in range(5):
            centre.step(regions)
        with pytest.raises(KeyError, match="nothing"):
            regions(refuse, centre.there, [1] * REGIONS)
        assert regions(add, [], []) == []


def test_a_killed_process_costs_a_cycle_and_changes_nothing():
    with ProcessHosts(2) as hosts:
        regions, centre = RemoteRegions(hosts), Centre()
        both = centre.step(regions)
        assert len(both) == 2
        assert centre.step(regions, gather=False) == both
        killed = min(both)
        os.kill(killed, signal.SIGKILL)
        assert killed not in centre.step(regions, gather=False)
        while len(now := centre.step(regions)) < 2:
            assert centre.cycle < 10
        assert now & both == both - {killed}
        for process in now:
            os.kill(process, signal.SIGKILL)
        assert centre.step(regions) & now == set()
        with pytest.raises(KeyError, match="nothing"):
            regions(refuse, centre.there, [1] * REGIONS)
        alone = Centre(1)
        assert alone.step(RemoteRegions(hosts)) == set()


@pytest.fixture(scope="module")
def alone():
    """Real regions in one thread."""
    return run_regions(scenario_of_regions(), serial_regions)


@pytest.mark.parametrize(("method", "count"), [("threads", 1), ("threads", 2), ("threads", 3), ("processes", 1)])
def test_the_picture_from_plots_is_the_same_over_threads(alone, method, count):
    with open_workers(method, count) as workers:
        assert run_regions(scenario_of_regions(), workers.regions, workers.spots) == alone


@pytest.mark.slow
def test_the_picture_from_plots_is_the_same_over_processes_of_which_one_is_killed(alone):
    with open_workers("processes", 2) as workers, ProcessHosts(2) as hosts:

        def kill(cycle):
            if cycle == 3:
                pids = [pid for each in hosts.ready() for pid in each._processes]
                assert len(pids) == 2
                os.kill(pids[0], signal.SIGKILL)

        regions = RemoteRegions(hosts)
        assert run_regions(scenario_of_regions(), regions, workers.spots, kill) == alone
        assert (regions.lost, workers.lost()) == (1, 0)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["imm", "sided_imm", "filterpy_imm", "vimmjipda", "sided_vimmjipda", "multi_hypothesis"])
@pytest.mark.parametrize("count", [2, 3])
def test_every_tracker_gives_the_same_over_processes(method, count):
    scenario = scenario_of_regions(2 * CYCLES, method)
    with open_workers("processes", count) as workers:
        assert run_regions(scenario, workers.regions, workers.spots) == run_regions(scenario, serial_regions)
