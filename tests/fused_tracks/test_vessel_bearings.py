"""Bearings as measurements of vessels: which vessel, what they change, how long they hold one without radar, two boats in one echo."""

from functools import cache

import numpy as np
import pytest

from coastwatch.associations.bearing_members import bearing_members, bearing_only_vessels, vessel_bearings
from coastwatch.batches import (
    AisAlarms,
    Associations,
    BearingAssociations,
    BearingTracks,
    Flag,
    Measurements,
    Members,
    Picture,
    Radars,
    Sensors,
    Sonars,
    Stations,
    Tracks,
    VesselBearings,
)
from coastwatch.fused_tracks import CentralImm, FusionInput
from coastwatch.geodesy import difference_m, offset_deg, wrap_rad
from coastwatch.picture import Identity, PictureInput
from coastwatch.server.checkpoint import load, save

pytestmark = pytest.mark.contract

HOME = np.array([-23.0, -43.1])
SONAR = offset_deg(HOME, np.array([0.0, -4000.0]))
VELOCITY = np.array([4.0, 1.0])
PERIOD_S, SIGMA_RAD, PLOT_M = 3.0, np.radians(0.5), 60.0
CERTAIN = 0.999
SEEN = 30  # cycles of plots and bearings
ECHOES = 30.0  # m, spacing of two boats
STATION_ID = 2 * 2**40  # of the first bearing track
KINDS = np.array([0, 1, 2])


def sensors(sigma_rad=SIGMA_RAD):
    none = np.zeros((0, 2))
    sonar = Sonars(np.array(["s"]), SONAR[None], *(np.array([x]) for x in (2e4, sigma_rad, 3.0, 0.0, 360.0)))
    radar = Radars(np.array(["r"]), np.array([0]), HOME[None], *(np.array([x]) for x in (2e4, 3.0, 10.0, 0.01)))
    return Sensors(radar, Stations(np.zeros(0, "U1"), none, np.zeros(0)), sonar, ("a",), HOME[None])


def truth_deg(vessel, time_s):
    """Boats that sail abreast, one behind the other as the sonar sees them when they are at its meridian."""
    return offset_deg(HOME, np.column_stack([4.0 * time_s - 400.0 + ECHOES * vessel, 1.0 * time_s + 0.0 * vessel]))


def radar_tracks(rng, vessel, time_s, generation=0):
    """A track and a plot of each of these vessels."""
    vessel = np.asarray(vessel, np.int64)
    n = len(vessel)
    plot = offset_deg(truth_deg(vessel, time_s), rng.normal(0.0, PLOT_M, (n, 2)))
    covariance = np.tile(np.diag([PLOT_M**2] * 2 + [1.0] * 2), (n, 1, 1))
    stamp, report = np.full(n, time_s), np.tile(np.eye(2) * PLOT_M**2, (n, 1, 1))
    ids, velocity = 100 * generation + vessel, np.tile(VELOCITY, (n, 1))
    source, none = np.zeros(n, np.int64), np.full(n, -1)
    tracks = Tracks(ids, source, stamp, plot, velocity, covariance, report, stamp, np.zeros(n), none, vessel)
    full = np.full((n, 4, 4), np.nan)
    full[:, :2, :2] = report
    return tracks, Measurements(ids, source, stamp, plot, np.full((n, 2), np.nan), full, np.tile(HOME, (n, 1)))


def line_of(vessel, time_s):
    off = difference_m(truth_deg(vessel, time_s), np.tile(SONAR, (len(vessel), 1)))
    return np.arctan2(off[:, 0], off[:, 1])


def bearing_tracks(rng, vessel, time_s, bias_rad=0.0, sigma_rad=SIGMA_RAD):
    vessel = np.asarray(vessel, np.int64)
    n = len(vessel)
    said = wrap_rad(line_of(vessel, time_s) + rng.normal(0.0, sigma_rad, n) + bias_rad)
    stamp, site, window = np.full(n, time_s), np.tile(SONAR, (n, 1)), np.zeros((n, 1))
    return BearingTracks(
        STATION_ID + vessel,
        np.full(n, 2),
        stamp,
        said,
        np.zeros(n),
        np.zeros((n, 2, 2)),
        site,
        stamp,
        np.zeros(n),
        window,
        window,
        np.zeros((n, 1, 2)),
        np.full((n, 1), sigma_rad**2),
        np.zeros((n, 7), np.int64),
        vessel,
        stamp,
        said,
        np.full(n, sigma_rad**2),
        site,
    )


class Centre:
    """Fused tracks and picture with the true association of bearings, certain or not."""

    def __init__(self, method=None, seed=1, probability=CERTAIN, bias_rad=0.0, sigma_rad=SIGMA_RAD):
        self.method, self.identity = method or CentralImm(), Identity(coast_s=0.0)
        self.memory, self.picture_memory, self.before = self.method.init(), self.identity.init(), None
        self.rng, self.sensors, self.probability = np.random.default_rng(seed), sensors(sigma_rad), probability
        self.bias_rad, self.sigma_rad = bias_rad, sigma_rad

    def step(self, time_s, seen, heard, generation=0):
        """One cycle: vessels with plots, and with bearings. Returns: picture, fused tracks."""
        tracks, measured = radar_tracks(self.rng, seen, time_s, generation)
        bearings = bearing_tracks(self.rng, heard, time_s, self.bias_rad, self.sigma_rad)
        none = np.zeros(0, np.int64)
        groups = Associations(none, none, np.zeros(0), np.arange(len(tracks)))
        given = VesselBearings.empty()
        if self.before is not None:
            given = vessel_bearings(self.before, bearings, tracks, groups)
        self.memory = load(save(self.memory))
        self.memory, every = self.method.step(self.memory, FusionInput(tracks, measured, groups, time_s, KINDS, given))
        fused, held = bearing_only_vessels(given, every, len(tracks))
        self.picture_memory, (picture, members) = self.identity.step(
            self.picture_memory, PictureInput(tracks, groups, fused, AisAlarms.empty(), time_s, self.sensors, held)
        )
        pair = [(b, v) for b, who in enumerate(bearings.origin) for v in np.flatnonzero(picture.origin == who)[:1]]
        b, v = (np.array(part, np.int64) for part in (zip(*pair, strict=True) if pair else ((), ())))
        bias = np.array([self.bias_rad]), np.full(len(b), self.probability), np.array([1e-4])
        found = BearingAssociations(b, v, np.ones(len(b)), *bias)
        self.before = bearing_members(found, bearings, picture, members, self.sensors)
        return picture, fused


def across_error_m(picture, vessel, time_s):
    """Error across the line of sight from the sonar."""
    row = np.flatnonzero(picture.origin == vessel)
    off = difference_m(picture.position_deg[row], truth_deg(np.array([vessel]), time_s))[0]
    line = line_of(np.array([vessel]), time_s)[0]
    return abs(off @ np.array([np.cos(line), -np.sin(line)]))


@cache
def error_m(setting: tuple[str, float], probability: float, bias_rad: float, sigma_rad: float, seed: int) -> float:
    """Error across the line of sight after SEEN cycles. Args: setting: a name of CentralImm and its value."""
    centre = Centre(CentralImm(**dict([setting])), seed, probability, bias_rad, sigma_rad)
    for cycle in range(SEEN):
        picture, _ = centre.step(PERIOD_S * cycle, [0], [0])
    return across_error_m(picture, 0, PERIOD_S * (SEEN - 1))


AS_SHIPPED, UNHEARD = ("bearing_floor_m", CentralImm().bearing_floor_m), ("bearing_probability", 1.0)


def errors(setting=AS_SHIPPED, probability=CERTAIN, bias_rad=0.0, sigma_rad=SIGMA_RAD, seeds=2):
    return np.array([error_m(setting, probability, bias_rad, sigma_rad, seed) for seed in range(seeds)])


def test_a_bearing_moves_the_vessel_across_the_line_of_sight():
    """0.5 degrees at 4 km are 35 m, beside plots of 60 m."""
    assert np.mean(errors(seeds=6) ** 2) < 0.8 * np.mean(errors(UNHEARD, seeds=6) ** 2)


def test_a_bearing_coarser_than_the_filter_does_not_move_a_vessel_with_plots():
    """3 degrees at 4 km are 210 m, beside a filter on plots of 60 m."""
    coarse = {"sigma_rad": np.radians(3.0)}
    nothing_said = errors(("bearing_floor_m", 1e6), **coarse)
    np.testing.assert_allclose(errors(**coarse), nothing_said, atol=0.01)
    assert np.abs(errors(("bearing_pause_s", 0.0), **coarse) - nothing_said).max() > 1.0


def test_the_known_bias_of_a_sensor_moves_nothing():
    np.testing.assert_allclose(errors(bias_rad=0.05), errors(), atol=1e-3)


@pytest.mark.parametrize("probability", [0.98, np.nan])
def test_a_bearing_that_may_be_of_another_vessel_changes_no_bit(probability):
    assert not np.array_equal(errors(), errors(UNHEARD)), "a certain one does"
    np.testing.assert_array_equal(errors(probability=probability), errors(UNHEARD))


def test_a_bearing_far_from_its_vessel_is_not_used():
    centre, time_s = Centre(), PERIOD_S * SEEN
    for cycle in range(SEEN):
        centre.step(PERIOD_S * cycle, [0], [0])
    tracks, measured = radar_tracks(centre.rng, [], time_s)
    none = np.zeros(0, np.int64)
    groups = Associations(none, none, np.zeros(0), none)
    for bias_deg, used in ((0.0, True), (40.0, False)):
        heard = bearing_tracks(centre.rng, [0], time_s, np.radians(bias_deg))
        given = vessel_bearings(centre.before, heard, tracks, groups)
        after, _ = centre.method.step(load(save(centre.memory)), FusionInput(tracks, measured, groups, time_s, KINDS, given))
        assert after.updated_s.tolist() == [time_s if used else time_s - PERIOD_S]


def test_a_vessel_that_the_radar_loses_goes_on_by_its_bearings_and_keeps_its_id():
    centre, name, sizes, flags, misses = Centre(), None, [], [], []
    for cycle in range(SEEN + 40):
        time_s = PERIOD_S * cycle
        picture, _ = centre.step(time_s, [0] if cycle < SEEN else [], [0])
        assert len(picture) == 1
        name = picture.vessel_id[0] if name is None else name
        assert picture.vessel_id[0] == name
        if cycle >= SEEN:
            sizes.append(np.sqrt(np.linalg.eigvalsh(picture.covariance[0, :2, :2])))
            flags.append(picture.flags[0])
            misses.append(across_error_m(picture, 0, time_s))
            assert picture.updated_s[0] == time_s
    assert set(flags) == {int(Flag.COASTING)}
    assert max(misses) < 120.0
    assert sizes[-1][1] > 2.0 * sizes[0][1]  # along the line of sight it is known less and less
    assert sizes[-1][0] < 60.0
    picture, _ = centre.step(PERIOD_S * (SEEN + 40), [0], [0], generation=1)
    assert picture.vessel_id.tolist() == [name]
    assert picture.flags.tolist() == [0]


def test_bearings_hold_a_vessel_no_longer_than_the_setting_says():
    centre, shown = Centre(CentralImm(bearing_hold_s=30.0)), []
    for cycle in range(SEEN + 20):
        picture, _ = centre.step(PERIOD_S * cycle, [0] if cycle < SEEN else [], [0])
        shown.append(len(picture))
    assert sum(shown[SEEN:]) == 10


def test_a_vessel_without_radar_and_bearing_ends_as_before():
    centre = Centre()
    for cycle in range(SEEN):
        centre.step(PERIOD_S * cycle, [0], [0])
    assert len(centre.step(PERIOD_S * SEEN, [], [])[0]) == 0


def test_two_boats_that_become_one_echo_stay_two_while_their_bearings_go_on():
    centre, names = Centre(), set()
    for cycle in range(SEEN + 20):
        time_s = PERIOD_S * cycle
        picture, _ = centre.step(time_s, [0, 1] if cycle < SEEN else [0], [0, 1])
        assert len(picture) == 2
        names |= set(picture.vessel_id.tolist())
    assert len(names) == 2
    assert picture.flags[picture.origin == 1] == int(Flag.COASTING)


def test_an_order_of_tracks_changes_nothing():
    rng = np.random.default_rng(3)
    tracks, _ = radar_tracks(rng, [0, 1, 2], 3.0)
    none = np.zeros(0, np.int64)
    picture_ids = np.array([7, 8, 9])
    members = Members(picture_ids, tracks.track_id, tracks.source)
    heard = bearing_tracks(rng, [2, 0, 5], 3.0)
    n = np.zeros(3)
    picture = Picture(
        picture_ids, n, tracks.position_deg, tracks.velocity_m_s, tracks.covariance, n, n, *np.full((3, 3), -1, np.int64)
    )
    found = BearingAssociations(np.array([0, 1]), np.array([2, 0]), np.ones(2), np.zeros(1), np.ones(2), np.zeros(1))
    before = bearing_members(found, heard, picture, members, sensors())
    for order in ([0, 1, 2], [2, 0, 1]):
        shuffled = tracks.take(np.array(order))
        given = vessel_bearings(
            before, heard, shuffled, Associations(none, none, n[:0], np.arange(3)[np.argsort(np.argsort(order))])
        )
        assert given.vessel_id.tolist() == [7, 9]
        assert shuffled.track_id[[order.index(0), order.index(2)]].tolist() == given.track_id.tolist()
    alone = Associations(none, none, n[:0], np.zeros(1, np.int64))
    gone = vessel_bearings(before, heard, tracks.take(np.array([1])), alone)
    assert gone.vessel.tolist() == [1, 2]
