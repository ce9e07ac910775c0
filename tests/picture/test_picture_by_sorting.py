"""The linear passes of the picture against sorting and seeking: whatever splits, joins, ends, begins and changes its name."""

import numpy as np
import picture_by_sorting
import pytest
from checkpoint_world import is_checked
from hypothesis import given, strategies as st

from coastwatch.batches import AisAlarms, Associations, Flag, FusedTracks, Radars, Sensors, Sonars, Stations, Tracks
from coastwatch.geodesy import offset_deg
from coastwatch.kernels.threads import threads
from coastwatch.picture import Identity, PictureInput
from coastwatch.server.checkpoint import load, save

pytestmark = pytest.mark.oracle

EXACT = ("vessel_id", "time_s", "since_s", "updated_s", "mmsi", "flags", "origin", "nav_status")
CLOSE = ("position_deg", "velocity_m_s", "covariance")
SHORT = Identity(
    coast_s=4.0,
    hold_s=9.0,
    return_s=14.0,
    dark_after_s=3.0,
    dark_coast_s=7.0,
    unseen_after_s=3.0,
    paired_s=2.0,
    contradicted_after_s=1.0,
    contradicted_from_m=10.0,
    taken_from_m=2000.0,
)
PATIENT = SHORT.model_copy(
    update={
        "coast_s": 12.0,
        "hold_s": 6.0,
        "contradicted_for_s": 5.0,
        "contradicted_from_m": 20.0,
        "stationary_m": 12.0,
        "stationary_after_s": 3.0,
        "under_way_kn": 40.0,
        "anchorage_m": 6000.0,
        "anchorage_ships": 2,
    }
)


def sensors(seed):
    """Two regions of radars and a few stations that do not cover all."""
    rng = np.random.default_rng([seed, 41])
    site = np.column_stack([rng.uniform(49.9, 50.3, 5), rng.uniform(-1.3, -0.7, 5)])
    radars = Radars(
        np.array(list("abc"), "U32"),
        np.array([0, 0, 1]),
        site[:3],
        np.array([9e3, 22e3, 15e3]),
        *(np.full(3, x) for x in (3.0,) * 3),
    )
    stations = Stations(np.array(["x", "y"], "U32"), site[3:], np.array([12e3, 30e3]))
    return Sensors(radars, stations, Sonars.empty(), ("west", "east"), site[:2])


class Sea:
    """Vessels that drift about, their tracks, and how they are taken together; much of it goes wrong."""

    def __init__(self, vessels, seed, trouble):
        self.rng, self.trouble, self.vessels = np.random.default_rng([seed, 42]), trouble, vessels
        self.at = offset_deg(np.array([50.1, -1.0]), self.rng.normal(0.0, 9000.0, (vessels, 2)))
        self.velocity = self.rng.normal(0.0, 4.0, (vessels, 2))
        first = np.array([201_000_000, 970_000_000, 972_000_000, 974_000_000, 200_000_000, 982_010_000])
        self.numbers = first[np.arange(vessels) % len(first)] + np.arange(vessels)
        self.mmsi = self.numbers.copy()
        self.ids = np.arange(3 * vessels).reshape(vessels, 3) + 1  # of the west, the east and AIS
        self.next_id = 3 * vessels + 1
        self.here = self.rng.random((vessels, 3)) < 0.6
        self.started = np.zeros((vessels, 3))

    def live(self, now):
        """Tracks end and begin, under new numbers; names change."""
        turned = self.rng.random(self.here.shape) < self.trouble
        self.here ^= turned
        fresh = turned & self.here & (self.rng.random(self.here.shape) < 0.8)
        self.ids[fresh] = self.next_id + np.arange(fresh.sum())
        self.started[fresh], self.next_id = now, self.next_id + int(fresh.sum())
        renamed = self.rng.random(self.vessels) < 0.3 * self.trouble
        self.mmsi[renamed] = self.rng.choice(self.numbers, int(renamed.sum())) if self.vessels else []

    def cycle(self, now):
        self.live(now)
        who, source = np.nonzero(self.here)
        order = self.rng.permutation(len(who)) if self.rng.random() < 0.3 else np.lexsort((who, source))
        who, source = who[order], source[order]
        n, ais = len(who), source == 2
        where = offset_deg(self.at[who], self.velocity[who] * now + self.rng.normal(0.0, 8.0, (n, 2)))
        apart = self.rng.random(n) < self.trouble
        other = np.where(self.rng.random(n) < self.trouble, self.rng.integers(0, self.vessels, n), who)
        vessel = np.unique(np.where(apart, self.vessels + np.arange(n), other), return_inverse=True)[1]
        root = self.rng.normal(0.0, 1.0, (n, 4, 4)) * np.array([9.0, 9.0, 1.0, 1.0])[:, None]
        covariance = root @ root.transpose(0, 2, 1) + np.eye(4)
        ids, updated, mmsi = self.ids[who, source], now - self.rng.integers(0, 4, n) * 0.5, np.where(ais, self.mmsi[who], -1)
        report, started = np.tile(np.eye(2), (n, 1, 1)), self.started[who, source]
        tracks = Tracks(
            ids, source, np.full(n, now), where, self.velocity[who], covariance, report, updated, started, mmsi, who
        )
        none = np.zeros(0, np.int64)
        lead = np.unique(vessel, return_index=True)[1]
        fused = FusedTracks(np.full(len(lead), now), where[lead], self.velocity[who[lead]], covariance[lead])
        odd = AisAlarms(
            ids[ais],
            mmsi[ais],
            self.rng.random(ais.sum()) < 0.1,
            self.rng.random(ais.sum()) < 0.1,
            self.rng.choice([-1, 0, 1, 2, 6, 14, 15], ais.sum()),
        )
        if self.rng.random() < 0.3:
            odd = odd.take(self.rng.permutation(len(odd)))
        return tracks, Associations(none, none, np.zeros(0), vessel), fused, odd


def same(got, wanted, said):
    for column in EXACT:
        np.testing.assert_array_equal(getattr(got, column), getattr(wanted, column), err_msg=f"{said} {column}")
    for column in CLOSE:
        np.testing.assert_allclose(
            getattr(got, column), getattr(wanted, column), rtol=1e-9, atol=1e-12, err_msg=f"{said} {column}"
        )


@given(st.integers(0, 30), st.integers(0, 10**6), st.sampled_from([0.02, 0.1, 0.3]), st.sampled_from([SHORT, PATIENT]))
def test_it_is_what_sorting_says(vessels, seed, trouble, method):
    sea, where = Sea(vessels, seed, trouble), sensors(seed)
    memory, oracle = method.init(), picture_by_sorting.start()
    for cycle in range(14):
        given_to = sea.cycle(1.0 * cycle)
        before = save(memory) if is_checked(cycle) else b""
        after, (picture, members) = method.step(memory, PictureInput(*given_to, 1.0 * cycle, where))
        assert not before or save(memory) == before
        memory = load(save(after)) if before else after
        oracle, wanted, of = picture_by_sorting.step(method, oracle, *given_to, 1.0 * cycle, where)
        same(picture, wanted, cycle)
        for column in ("vessel_id", "track_id", "source"):
            np.testing.assert_array_equal(getattr(members, column), getattr(of, column))
        assert memory.next_id == oracle.next_id


def test_the_troubles_of_the_test_are_met():
    """So that the comparison above says something: every flag is up, ids come back, vessels are hidden and gone."""
    sea, where, memory = Sea(40, 3, 0.1), sensors(3), SHORT.init()
    flags, came_back, hidden, gone, seen, shown = 0, 0, 0, 0, set(), set()
    for cycle in range(40):
        memory, (picture, _) = SHORT.step(memory, PictureInput(*sea.cycle(1.0 * cycle), 1.0 * cycle, where))
        flags |= int(np.bitwise_or.reduce(picture.flags))
        now = set(picture.vessel_id.tolist())
        came_back += len((now - shown) & seen)
        seen, shown = seen | now, now
        hidden, gone = max(hidden, len(memory.known.hidden)), max(gone, len(memory.known.merged_id))
    assert flags == sum(Flag) - Flag.STATIONARY  # SHORT has no vessel that stays so long
    assert came_back > 5
    assert hidden > 0
    assert gone > 0


@pytest.mark.parametrize("count", [20_000])
def test_threads_change_no_bit(count):
    cycles = [Sea(count, 8, 0.02), Sea(count, 8, 0.02)]
    said = []
    for sea, number in zip(cycles, (1, 3), strict=True):
        memory, where = SHORT.init(), sensors(8)
        with threads(number):
            for cycle in range(4):
                memory, (picture, members) = SHORT.step(memory, PictureInput(*sea.cycle(1.0 * cycle), 1.0 * cycle, where))
        said.append(save((memory, picture, members)))
    assert said[0] == said[1]
