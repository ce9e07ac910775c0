"""Every method of the associations stage, and the cases in which a windowed covariance is known to fail."""

from dataclasses import replace

import numpy as np
import pytest
from pydantic import TypeAdapter, ValidationError
from unions import methods_in

from coastwatch.associations import (
    AssociationInput,
    Associator,
    SingleScanTest,
    WindowedCovariance,
    WindowedCovarianceLiteral,
)
from coastwatch.batches import Tracks
from coastwatch.geodesy import difference_m, offset_deg
from coastwatch.server.checkpoint import load, save
from coastwatch.spots import KMeansSpots
from coastwatch.stage import serial

pytestmark = pytest.mark.contract

VARIANTS = {
    "literal one-to-one": WindowedCovarianceLiteral(one_to_one=True, threshold="hotelling"),
    "test recursive": SingleScanTest(dependence="recursive"),
    "test geometric mean": SingleScanTest(dependence="geometric_mean"),
}
METHODS = [*methods_in(Associator), *VARIANTS.values()]
IDS = [*(method.method for method in methods_in(Associator)), *VARIANTS]
ORIGIN = np.array([-23.0, 179.99])
RADAR_SIGMA_M, AIS_SIGMA_M = 8.0, 1.5
PERIOD_S = 3.0


class Water:
    """Vessels in straight motion, seen by sources whose errors are AR(1)."""

    def __init__(self, seed, start_m, velocity_m_s, sees, correlation=0.8):
        self.rng = np.random.default_rng([seed, 1])
        self.start, self.velocity = np.asarray(start_m, float), np.asarray(velocity_m_s, float)
        self.vessel = np.concatenate([np.flatnonzero(s) for s in sees])
        self.source = np.concatenate([np.full(int(np.sum(s)), k) for k, s in enumerate(sees)])
        self.ais = len(sees) - 1
        self.correlation = correlation
        self.error = self._fresh()

    def _fresh(self):
        sigma = np.where(self.source == self.ais, AIS_SIGMA_M, RADAR_SIGMA_M)[:, None]
        return self.rng.normal(0.0, 1.0, (len(self.vessel), 4)) * np.concatenate(
            [sigma, sigma, 0.05 * sigma, 0.05 * sigma], axis=1
        )

    def tracks(self, cycle, bias_m=(0.0, 0.0)):
        c = self.correlation
        self.error = c * self.error + np.sqrt(1.0 - c * c) * self._fresh()
        time_s = PERIOD_S * cycle
        metres = (self.start + self.velocity * time_s)[self.vessel] + self.error[:, :2]
        metres = metres + np.where(self.source[:, None] == self.ais, 0.0, np.asarray(bias_m))
        sigma = np.where(self.source == self.ais, AIS_SIGMA_M, RADAR_SIGMA_M)
        variance = np.stack([sigma**2, sigma**2, (0.05 * sigma) ** 2, (0.05 * sigma) ** 2], axis=1)
        n = len(self.vessel)
        ids = self.source * 10**6 + self.vessel
        report = np.where(self.source == self.ais, 3.33**2, 30.0**2)[:, None, None] * np.eye(2)
        return Tracks(
            ids,
            self.source,
            np.full(n, time_s),
            offset_deg(np.broadcast_to(ORIGIN, (n, 2)), metres),
            self.velocity[self.vessel] + self.error[:, 2:],
            variance[:, :, None] * np.eye(4),
            report,
            np.full(n, time_s),
            np.zeros(n),
            np.where(self.source == self.ais, ids, -1),
            self.vessel,
        )


def crowd(seed, n=300, regions=1, width_m=9000.0):
    rng = np.random.default_rng([seed, 0])
    heading, speed = rng.uniform(0.0, 2.0 * np.pi, n), rng.uniform(0.0, 7.7, n)
    sees = [rng.uniform(size=n) < 0.6 for _ in range(regions + 1)]
    velocity = speed[:, None] * np.stack([np.sin(heading), np.cos(heading)], axis=1)
    return Water(seed, rng.uniform(0.0, width_m, (n, 2)), velocity, sees)


def run(method, water, cycles, bias_m=(0.0, 0.0), spots=None, look=None):
    spots = spots or KMeansSpots(count=3)
    memory, spot_memory = method.init(), spots.init()
    out = []
    for cycle in range(cycles):
        tracks = water.tracks(cycle, bias_m)
        if look is not None:
            tracks = look(tracks, cycle)
        spot_memory, s = spots.step(spot_memory, tracks)
        memory, found = method.step(memory, AssociationInput(tracks, s, serial))
        out.append((tracks, found))
    return out


def f1(tracks, found):
    right = (tracks.origin[found.first] == tracks.origin[found.second]).sum()
    first = tracks.origin[tracks.mmsi < 0]
    exist = np.isin(first, tracks.origin[tracks.mmsi >= 0]).sum()
    return 2.0 * right / (len(found.first) + exist)


@pytest.mark.parametrize("method", METHODS, ids=IDS)
def test_it_says_whether_its_statistic_is_a_distance_and_how_far_apart_pairs_may_be(method):
    found = run(method, crowd(1, n=60), 1)[0][1]
    assert found.statistic_is_distance == (method.method != "windowed_covariance")  # a likelihood ratio: greater is likelier
    assert method.gate_m > 0.0


@pytest.mark.parametrize("method", METHODS, ids=IDS)
def test_resumable_and_indifferent_to_order(method):
    water, spots = crowd(1, n=60), KMeansSpots(count=2)
    memory, spot_memory = method.init(), spots.init()
    rng = np.random.default_rng([2, 0])
    for cycle in range(12):
        tracks = water.tracks(cycle)
        frozen = save(memory)
        spot_memory, s = spots.step(spot_memory, tracks)
        resumed, found = method.step(load(frozen), AssociationInput(tracks, s, serial))
        memory, found_1 = method.step(memory, AssociationInput(tracks, s, serial))
        assert save(resumed) == save(memory)
        order = rng.permutation(len(tracks))
        shuffled = replace(s, spot=s.spot[order], **halo_of(s, order))
        _, other = method.step(load(frozen), AssociationInput(tracks.take(order), shuffled, serial))
        pairs = {(a, b) for a, b in zip(tracks.track_id[found.first], tracks.track_id[found.second], strict=True)}
        mixed = tracks.take(order)
        assert pairs == {(a, b) for a, b in zip(mixed.track_id[other.first], mixed.track_id[other.second], strict=True)}
        np.testing.assert_array_equal(found.statistic, found_1.statistic)


def halo_of(spots, order):
    place = np.argsort(order)
    row = place[spots.halo_row]
    by = np.lexsort((row, spots.halo_spot))
    return {"halo_spot": spots.halo_spot[by], "halo_row": row[by]}


@pytest.mark.parametrize("method", METHODS, ids=IDS)
def test_the_number_of_spots_changes_nothing(method):
    answers = []
    for count in (1, 5, 20):
        out = run(method, crowd(3), 14, spots=KMeansSpots(count=count))
        answers.append([(f.first.tolist(), f.second.tolist(), f.statistic.tolist(), f.vessel.tolist()) for _, f in out])
    assert answers[0] == answers[1] == answers[2]


@pytest.mark.parametrize("method", METHODS, ids=IDS)
@pytest.mark.parametrize("rows", [0, 1])
def test_no_track_and_one_track(method, rows):
    spots = KMeansSpots()
    tracks = crowd(1, n=60).tracks(0).take(np.arange(rows))
    _, s = spots.step(spots.init(), tracks)
    _, found = method.step(method.init(), AssociationInput(tracks, s, serial))
    assert len(found.first) == 0
    assert found.vessel.tolist() == list(range(rows))


def test_an_empty_spot_is_harmless():
    tracks = crowd(1, n=60).tracks(0)
    spots = KMeansSpots(count=2)
    _, s = spots.step(spots.init(), tracks)
    wider = replace(s, centre_m=np.vstack([s.centre_m, s.centre_m[:1] + 1e5]))
    method = WindowedCovariance()
    _, a = method.step(method.init(), AssociationInput(tracks, s, serial))
    _, b = method.step(method.init(), AssociationInput(tracks, wider, serial))
    np.testing.assert_array_equal(a.vessel, b.vessel)


def test_round_trip_through_settings():
    for method in METHODS:
        assert TypeAdapter(Associator).validate_python(method.model_dump()) == method


def test_true_pairs_with_autocorrelated_errors_are_found():
    out = run(WindowedCovariance(), crowd(4), 20)
    assert np.mean([f1(t, f) for t, f in out[3:]]) >= 0.995
    literal = run(WindowedCovarianceLiteral(), crowd(4), 20)
    assert f1(*literal[-1]) < 0.95, "the literal test is known to refuse autocorrelated pairs"


def test_two_regions_and_ais_are_one_vessel():
    tracks, found = run(WindowedCovariance(), crowd(5, regions=2), 15)[-1]
    seen_by = np.bincount(tracks.origin)
    three = np.flatnonzero(seen_by == 3)
    whole = [len(np.unique(found.vessel[tracks.origin == v])) == 1 for v in three]
    assert len(three) > 30
    assert np.mean(whole) >= 0.98
    key = found.vessel * 10 + tracks.source
    assert len(np.unique(key)) == len(key), "no vessel has two tracks of one source"


def test_a_constant_registration_bias_is_no_reason_to_part():
    out = run(WindowedCovariance(), crowd(6), 20, bias_m=(30.0, -20.0))
    assert f1(*out[-1]) >= 0.99


def pair_of(start_m, velocity_m_s, seed=0):
    """Vessel 0 is seen by the radar alone, vessel 1 by AIS alone."""
    return Water(seed, start_m, velocity_m_s, [np.array([True, False]), np.array([False, True])])


def without_velocity(tracks, cycle):
    covariance = tracks.covariance.copy()
    covariance[:, 2:, 2:] = 25.0 * np.eye(2)
    return replace(tracks, velocity_m_s=np.zeros_like(tracks.velocity_m_s), covariance=covariance)


def test_a_drifting_pair_is_refused_where_the_swelling_covariance_accepts_it():
    """Different ships that pass at 171 m, velocity not observed: the bare sample covariance swells with the drift."""
    water = [[0.0, 0.0], [171.0, -60.0]], [[0.0, 2.0], [0.0, 6.0]]
    out = run(WindowedCovariance(), pair_of(*water), 15, look=without_velocity)
    assert sum(len(f.first) for _, f in out[3:]) == 0


@pytest.mark.parametrize("apart_m", [20.0, 50.0, 100.0])
def test_parallel_ships_with_their_own_partners_are_not_swapped(apart_m):
    both = np.array([True, True])
    water = Water(7, [[0.0, 0.0], [apart_m, 0.0]], [[0.0, 5.0], [0.0, 5.0]], [both, both])
    out = run(WindowedCovariance(), water, 25)
    right = [f1(t, f) for t, f in out[5:]]
    assert np.mean(right) >= (0.9 if apart_m == 20.0 else 1.0)


def test_a_parallel_stranger_far_off_is_refused():
    out = run(WindowedCovariance(), pair_of([[0.0, 0.0], [250.0, 0.0]], [[0.0, 5.0], [0.0, 5.0]]), 20)
    assert sum(len(f.first) for _, f in out) == 0


def quiet(tracks, cycle):
    """Radar and AIS a metre apart within a centimetre, for ever."""
    rng = np.random.default_rng([cycle, 3])
    shift = np.where(tracks.mmsi[:, None] < 0, 0.0, 3.0) + rng.normal(0.0, 0.01, (len(tracks), 2))
    exact = offset_deg(np.broadcast_to(ORIGIN, (len(tracks), 2)), shift)
    return replace(tracks, position_deg=exact, velocity_m_s=rng.normal(0.0, 0.001, (len(tracks), 2)))


def test_a_quiet_pair_is_accepted_where_a_bare_sample_covariance_refuses_it():
    one = np.array([True])
    water = [[0.0, 0.0]], [[0.0, 0.0]], [one, one]
    out = run(WindowedCovariance(), Water(8, *water), 15, look=quiet)
    assert all(len(f.first) == 1 for _, f in out)
    literal = run(WindowedCovarianceLiteral(), Water(8, *water), 40, look=quiet)
    assert np.mean([len(f.first) == 1 for _, f in literal[10:]]) < 1.0


def test_a_track_that_changes_vessel_loses_its_partner_within_four_cycles():
    """A radar track of vessel 0 jumps to vessel 1, 300 m off, as after a wrong plot assignment."""
    one, two = np.array([True, False]), np.array([True, True])
    water = Water(9, [[0.0, 0.0], [300.0, 0.0]], [[0.0, 4.0], [0.0, -4.0]], [one, two])

    def jump(tracks, cycle):
        if cycle < 20:
            return tracks
        position, velocity = tracks.position_deg.copy(), tracks.velocity_m_s.copy()
        position[0], velocity[0] = position[2], velocity[2]
        return replace(tracks, position_deg=position, velocity_m_s=velocity)

    out = run(WindowedCovariance(), water, 26, look=jump)
    partner = [f.second.tolist() for _, f in out]
    assert partner[19] == [1]
    assert partner[24] == [2]


@pytest.mark.parametrize("p", [2, 4])
def test_a_window_that_makes_the_covariance_singular_is_refused(p):
    with pytest.raises(ValidationError, match="greater than or equal to 5"):
        WindowedCovarianceLiteral(window=p)


def test_black_box_tracks_are_paired_by_their_specification():
    def black_box(tracks, cycle):
        return replace(tracks, covariance=np.full_like(tracks.covariance, np.nan))

    out = run(WindowedCovariance(), crowd(10), 20, look=black_box)
    assert f1(*out[-1]) >= 0.99


def test_positions_are_compared_in_metres_across_the_antimeridian():
    out = run(WindowedCovariance(), crowd(11, n=100, width_m=4000.0), 12)
    tracks, found = out[-1]
    east = tracks.position_deg[:, 1] > 0.0
    assert east.any()
    assert (~east).any()
    assert np.abs(difference_m(tracks.position_deg[found.first], tracks.position_deg[found.second])).max() < 100.0
