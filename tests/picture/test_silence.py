"""Which sensors are silent: by what they usually send, never by how few vessels there are."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from as_bytes import as_bytes

from coastwatch.batches import (
    AisReports,
    AisStatics,
    BearingReports,
    RadarReports,
    Radars,
    Reports,
    SensorHearing,
    Sensors,
    Sonars,
    Stations,
    TrackReports,
    Tracks,
    TrackSources,
)
from coastwatch.cover import SilenceInput, UsualPauses
from coastwatch.geodesy import offset_deg
from coastwatch.server.checkpoint import load, save

pytestmark = pytest.mark.contract

PERIOD_S = 3.0
SITES = offset_deg(np.tile([-33.9, 18.4], (3, 1)), np.array([[0.0, 0.0], [30e3, 0.0], [60e3, 0.0]]))
RANGE_M = 20e3  # of each station: each two neighbours share 10 km


def sensors(stations: int = 1) -> Sensors:
    radar = np.array(["north", "south"]), np.array([0, 0]), SITES[:2], np.full(2, 20e3), np.array([3.0, 6.0])
    source = np.array(["vts"]), np.full((1, 2), np.nan), np.zeros(1), np.full(1, 20.0), np.full(1, 1.0), np.full(1, 60.0)
    names = np.array(["a", "b", "c"], "U32")[:stations]
    return Sensors(
        Radars(*radar, np.full(2, 10.0), np.full(2, 0.005)),
        Stations(names, SITES[:stations], np.full(stations, RANGE_M)),
        Sonars.empty(),
        ("cape",),
        SITES[:1],
        TrackSources(*source),
    )


class Came(NamedTuple):
    """What comes in a cycle."""

    ais: Sequence[float] = ()  # metres east of the first station, of each report
    plots: Sequence[int] = ()  # radar of each
    tracks: int = 0  # of the track source


def reports_of(came: Came, time_s: float, seed: int | None = None) -> Reports:
    """Reports received at this time. Args: seed: of the order in which they stand, received during the cycle; none: as given."""
    rng = np.random.default_rng(0 if seed is None else [seed, round(time_s)])

    def times(count: int) -> np.ndarray:
        return time_s - (0.0 if seed is None else PERIOD_S) * np.linspace(0.0, 1.0, count, endpoint=False)[::-1]

    def mixed(batch):  # type: ignore[no-untyped-def]
        return batch if seed is None else batch.take(rng.permutation(len(batch)))

    n, m, k = len(came.ais), len(came.plots), came.tracks
    east = np.array(came.ais, float)
    at = offset_deg(np.broadcast_to(SITES[0], (n, 2)), np.stack([east, np.zeros(n)], 1))
    ais = AisReports(times(n), times(n), np.arange(n), at, np.zeros(n), np.zeros(n), np.zeros(n, bool), np.arange(n))
    site, zero = np.broadcast_to(SITES[0], (m, 2)).copy(), np.zeros(m)
    radar = RadarReports(np.array(came.plots, np.int64), times(m), times(m), zero + 1e3, zero, site, np.zeros(m, np.int64))
    place = np.broadcast_to(SITES[0], (k, 2)).copy()
    given = np.zeros(k, np.int64), np.arange(k), times(k), times(k), place, np.zeros((k, 2)), np.zeros((k, 4, 4))
    tracks = TrackReports(*given, np.zeros(k, np.int64))
    return Reports(mixed(radar), mixed(ais), AisStatics.empty(), BearingReports.empty(), mixed(tracks))


def ais_tracks(east_m: Sequence[float]) -> Tracks:
    n, zero = len(east_m), np.zeros(len(east_m))
    at = offset_deg(np.broadcast_to(SITES[0], (n, 2)), np.stack([np.array(east_m, float), zero], 1))
    whole, two, four = np.arange(n), np.zeros((n, 2)), np.zeros((n, 4, 4))
    return Tracks(whole, whole, zero, at, two, four, np.zeros((n, 2, 2)), zero, zero, whole, whole)


def play(
    scene: Callable[[int], Came], cycles: int, where: Sensors, alive: Sequence[float] = (), seed: int | None = None
) -> list[SensorHearing]:
    """Which sensors are heard in each cycle; now and then the memory goes through a checkpoint. Args: alive: AIS vessels, m east."""
    method = UsualPauses()
    memory, out = method.init(), []
    for cycle in range(cycles):
        time_s = 1000.0 + PERIOD_S * cycle
        given = reports_of(scene(cycle), time_s, seed), ais_tracks(alive), time_s, where
        if cycle % 7 == 5:
            memory = load(save(memory))
        memory, hearing = method.step(memory, SilenceInput(*given))
        out.append(hearing)
    return out


def silent(found: list[SensorHearing], kind: str, row: int = 0) -> list[int]:
    """The cycles in which a sensor is silent."""
    return [k for k, hearing in enumerate(found) if getattr(hearing, kind).silent[row]]


FOUR = (0.0, 100.0, 200.0, 300.0)
ALL = Came(FOUR, (0, 0, 0, 1, 1, 1), 4)


def without(part: str, first: int, last: int, usual: Came = ALL) -> Callable[[int], Came]:
    """A scene in which a part does not come from one cycle to another."""
    return lambda cycle: usual._replace(**{part: Came._field_defaults[part]}) if first <= cycle < last else usual


def test_ais_is_silent_after_thirty_seconds_until_it_is_heard_and_nothing_else_is() -> None:
    found = play(without("ais", 20, 60), 80, sensors(), FOUR)
    assert silent(found, "ais") == silent(found, "stations") == list(range(30, 60))
    assert not any(silent(found, *of) for of in (("radars", 0), ("radars", 1), ("track_sources", 0)))


def test_a_radar_is_silent_after_five_of_its_turns_and_a_source_after_thirty_seconds() -> None:
    south = lambda cycle: ALL if cycle < 20 else ALL._replace(plots=(0, 0, 0))  # noqa: E731
    found = play(south, 40, sensors(), FOUR)
    assert (silent(found, "radars", 0), silent(found, "radars", 1)) == ([], list(range(30, 40)))
    north = lambda cycle: ALL if cycle < 20 else ALL._replace(plots=(1, 1, 1))  # noqa: E731
    assert silent(play(north, 40, sensors(), FOUR), "radars", 0) == list(range(25, 40))
    assert silent(play(without("tracks", 20, 60), 60, sensors(), FOUR), "track_sources") == list(range(30, 60))


def test_clocks_stand_from_the_last_report_and_then_from_each_cycle() -> None:
    found = play(without("ais", 20, 60), 61, sensors(), FOUR)
    assert found[30].ais.stands_from_s.tolist() == found[30].stations.stands_from_s.tolist() == [1000.0 + PERIOD_S * 19]
    assert found[31].ais.stands_from_s.tolist() == [1000.0 + PERIOD_S * 30]
    assert found[60].ais.stands_from_s.tolist() == [np.inf]
    assert [found[k].stations.returned_s.tolist() for k in (59, 60)] == [[-np.inf], [1000.0 + PERIOD_S * 60]]


def test_a_sensor_of_few_vessels_is_not_silent_for_they_may_have_left() -> None:
    usual = Came((0.0, 100.0), (0, 1), 2)
    found = play(lambda cycle: usual if cycle < 20 else Came(), 300, sensors(), (0.0, 100.0))
    assert not any(silent(found, *of) for of in (("ais", 0), ("radars", 0), ("track_sources", 0)))
    assert found[-1].radars.heard.all()


def test_what_was_never_heard_covers_nothing_and_is_not_silent() -> None:
    found = play(lambda cycle: Came(FOUR), 100, sensors(), FOUR)
    for kind in ("radars", "track_sources"):
        assert not any(getattr(hearing, kind).heard.any() or silent([hearing], kind) for hearing in found)
    nothing = play(lambda cycle: Came(), 100, sensors())
    assert not any(
        hearing.ais.heard.any() or hearing.stations.heard.any() or silent([hearing], "stations") for hearing in nothing
    )


@pytest.mark.parametrize(("every", "after"), [(20, 600.0), (60, 1800.0)])
def test_what_pauses_by_nature_may_pause_longer(every: int, after: float) -> None:
    """Four moored vessels report together, once a minute or once in three: silent is what does not come for ten times that."""
    last = 8 * every
    found = play(lambda cycle: Came(FOUR if cycle <= last and cycle % every == 0 else ()), last + 13 * every, sensors(), FOUR)
    assert silent(found, "ais")[0] == last + int(after / PERIOD_S) + 1


def test_ais_that_was_never_heard_is_silent_after_three_minutes_until_it_is_heard() -> None:
    found = play(without("ais", 0, 80), 120, sensors(2))
    assert silent(found, "ais") == list(range(61, 80)), "of 3 s each: more than 180 s after the first one"
    assert not any(silent(found, "stations", row) for row in range(2))
    assert {hearing.ais.stands_from_s[0] for hearing in found[61:80]} == {1000.0}, "its alarm counts from the start"
    assert not any(hearing.stations.stands.any() for hearing in found)
    nowhere = play(without("ais", 0, 120), 120, sensors(0))
    assert silent(nowhere, "ais") == [], "nobody expects AIS without a station"


def test_a_failure_is_no_habit() -> None:
    """AIS fails for an hour. After five minutes it fails again, and that is seen as soon as the first time."""
    usual = lambda cycle: Came(FOUR) if cycle < 20 or 1220 <= cycle < 1320 else Came()  # noqa: E731
    found = silent(play(usual, 1400, sensors(), FOUR), "ais")
    assert found == [*range(30, 1220), *range(1330, 1400)]


def test_a_station_is_silent_by_what_only_it_reaches_and_all_are_with_ais() -> None:
    """Vessels are near each station, and between each two neighbours. The second station fails; then all do; then the second returns."""
    near = [[0.0, -1e3, -2e3, -3e3], [30e3, 31e3, 29e3, 30.5e3], [60e3, 61e3, 62e3, 63e3]]
    between = [15e3, 16e3, 44e3, 45e3]

    def scene(cycle: int) -> Came:
        here = [0, 2] if 20 <= cycle < 40 or cycle >= 100 else [] if 40 <= cycle < 80 else [0, 1, 2]
        return Came([east for k in here for east in near[k]] + (between if here else []))

    found = play(scene, 120, sensors(3), [*near[0], *near[1], *near[2], *between])
    assert silent(found, "ais") == list(range(50, 80))
    second = silent(found, "stations", 1)
    assert second[:50] == list(range(30, 80))
    assert second[50:] == list(range(second[50], 120))
    assert 110 <= second[50] <= 115, "the failure before was learnt a little"
    assert silent(found, "stations", 0) == silent(found, "stations", 2) == list(range(50, 80))


@pytest.mark.parametrize("stations", [1, 3])
def test_the_order_of_reports_changes_nothing(stations: int) -> None:
    scene = without("ais", 15, 40, ALL._replace(ais=(0.0, 14e3, 16e3, 31e3, 33e3)))
    one, other = (play(scene, 50, sensors(stations), (0.0, 14e3, 16e3, 31e3, 33e3), seed) for seed in (1, 2))
    for a, b in zip(one, other, strict=True):
        assert as_bytes(a) == as_bytes(b)


def test_a_long_cycle_counts_as_long_as_it_is() -> None:
    """Ten periods without reports are merged in one cycle: radars and AIS are silent in it."""
    method, where = UsualPauses(), sensors()
    memory = method.init()
    for cycle in range(20):
        given = reports_of(ALL, PERIOD_S * cycle), ais_tracks(FOUR), PERIOD_S * cycle, where
        memory, hearing = method.step(memory, SilenceInput(*given))
    memory, hearing = method.step(memory, SilenceInput(Reports(), ais_tracks(FOUR), PERIOD_S * 19 + 33.0, where))
    assert hearing.ais.silent.all()
    assert hearing.radars.silent.all()
    assert hearing.radars.stands_from_s.tolist() == [PERIOD_S * 19] * 2


def test_reports_without_a_time_say_nothing() -> None:
    """In cycle 20 one report of each kind has no time of arrival; then nothing comes."""
    for stations, bad_s in ((1, np.nan), (3, np.nan), (1, np.inf)):
        method, where = UsualPauses(), sensors(stations)
        memory = method.init()
        for cycle in range(60):
            time_s = 1000.0 + PERIOD_S * cycle
            reports = reports_of(ALL if cycle <= 20 else Came(), time_s)
            if cycle == 20:
                none = np.full(1, bad_s)
                parts = {kind: getattr(reports, kind).take(np.zeros(1, np.int64)) for kind in ("radar", "ais", "tracks")}
                reports = replace(reports, **{kind: replace(part, received_s=none) for kind, part in parts.items()})
            memory, hearing = method.step(memory, SilenceInput(reports, ais_tracks(FOUR), time_s, where))
            for of in vars(hearing).values():
                assert not np.isnan(of.heard_s).any()
                assert (of.heard_s[np.isfinite(of.heard_s)] == 1000.0 + PERIOD_S * min(cycle, 19)).all()
        assert hearing.ais.silent.all()
        assert hearing.radars.silent[0]
        assert hearing.track_sources.silent.all()


def test_a_message_of_statics_without_a_time_says_nothing() -> None:
    """After cycle 19 two come alone, in cycle 25: one has no time of arrival."""
    method, where = UsualPauses(), sensors()
    memory = method.init()
    for cycle in range(60):
        time_s = 1000.0 + PERIOD_S * cycle
        reports = reports_of(ALL if cycle < 20 else Came(), time_s)
        if cycle == 25:
            reports = replace(reports, statics=AisStatics.join([statics_of(np.nan), statics_of(time_s)]))
        memory, hearing = method.step(memory, SilenceInput(reports, ais_tracks(FOUR), time_s, where))
    assert hearing.ais.heard_s.tolist() == [1000.0 + PERIOD_S * 25]
    assert hearing.ais.silent.all()


def statics_of(received_s: float) -> AisStatics:
    """One message, of zeros."""
    one = {name: np.zeros((1, *column.shape[1:]), column.dtype) for name, column in vars(AisStatics.empty()).items()}
    return replace(AisStatics(**one), received_s=np.full(1, received_s))


def test_a_station_is_heard_last_when_it_was_though_ais_was_silent_since() -> None:
    """All fail in cycle 20. AIS is heard again from cycle 60 on, but for the second station: it was heard last in cycle 19."""
    near = [[0.0, -1e3, -2e3, -3e3], [30e3, 31e3, 29e3, 30.5e3]]
    scene = lambda cycle: Came([] if 20 <= cycle < 60 else near[0] if cycle >= 60 else [*near[0], *near[1]])  # noqa: E731
    found = play(scene, 100, sensors(2), [*near[0], *near[1]])
    assert silent(found, "ais") == list(range(30, 60))
    second = silent(found, "stations", 1)
    assert second == [*range(30, 60), *range(second[30], 100)]
    assert second[30] == 70, "what it may pause begins when AIS is heard again"
    assert {found[k].stations.heard_s[1] for k in range(19, 100)} == {1000.0 + PERIOD_S * 19}
    assert found[70].stations.stands_from_s[1] >= 1000.0 + PERIOD_S * 59, "time that stood while AIS was silent"
