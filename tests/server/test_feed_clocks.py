"""Wrong clocks and hostile senders: a feed of which the stamps are wrong is said to be wrong, and disturbs no other one."""

from __future__ import annotations

import math
import re
import threading
import time
from dataclasses import replace
from datetime import UTC, datetime
from types import SimpleNamespace

import numpy as np
import pytest
from feed_world import SCENARIO, SEA, SENSORS, deliver, items, put
from nmea_sentences import with_sum
from server_world import Served

from coastwatch.batches import AisReports, Reports
from coastwatch.formats.decoding import CONFIRMED_BY, FAR_JUMP_S, Stamps
from coastwatch.formats.intake.faults import Tally
from coastwatch.formats.nmea import new_vessels
from coastwatch.formats.nmea.new_vessels import AGREES_M, BURST, BURST_OF_FEED, PER_SECOND, NewVessels
from coastwatch.operators.api import metrics
from coastwatch.operators.api.service import Service
from coastwatch.server.clock import CLOCK, ClockSet, SteadyClock
from coastwatch.server.feeds.address import parsed
from coastwatch.server.feeds.live_input import LiveInput
from coastwatch.server.feeds.sending import encoded
from coastwatch.server.live import RunAbout
from coastwatch.server.regions import intake
from coastwatch.server.regions.client import Connection, parsed_region
from coastwatch.server.regions.intake import RegionIntake
from coastwatch.server.regions.link import Position
from coastwatch.server.regions.message import RegionCycle, RegionTracks
from coastwatch.server.troubles import of_feeds
from scaling.page.fleet import Simulated

pytestmark = pytest.mark.whole

HOUR_S, NOW_S = 3_600.0, 1.79e9


class Machine:
    """The clocks of a machine that can be set."""

    def __init__(self) -> None:
        self.wall_s, self.monotonic_s = 1.7e9, 50.0

    def passes(self, seconds: float) -> None:
        self.wall_s, self.monotonic_s = self.wall_s + seconds, self.monotonic_s + seconds

    def clock(self) -> SteadyClock:
        return SteadyClock(lambda: self.wall_s, lambda: self.monotonic_s)


@pytest.mark.parametrize("step_s", [-HOUR_S, HOUR_S, 3 * 365 * 86_400.0])
def test_time_goes_on_evenly_when_the_clock_of_the_machine_is_set(step_s: float) -> None:
    machine = Machine()
    clock = machine.clock()
    begun_s = clock.now_s()
    machine.passes(10.0)
    machine.wall_s += step_s
    assert clock.now_s() == begun_s + 10.0
    assert clock.step_s == step_s
    machine.passes(10.0)
    assert clock.now_s() == begun_s + 20.0
    machine.wall_s -= step_s
    assert (clock.now_s(), clock.step_s) == (begun_s + 20.0, 0.0)
    machine.wall_s += step_s
    clock.adopt()
    assert clock.now_s() == machine.wall_s


def test_a_small_correction_is_taken_over_slowly() -> None:
    machine = Machine()
    clock = machine.clock()
    machine.wall_s -= 1.0
    before_s = clock.now_s()
    for _ in range(120):
        machine.passes(1.0)
        now_s = clock.now_s()
        assert 0.98 < now_s - before_s < 1.02
        before_s = now_s
    assert clock.now_s() == pytest.approx(machine.wall_s, abs=1e-3)


def live(*addresses: str) -> LiveInput:
    return LiveInput([parsed(text) for text in addresses], SENSORS)


def bearing(when_s: float, degrees: float) -> bytes:
    return b'{"type":"bearing","sonar":"%s","time":%f,"bearing_deg":%f}' % (
        str(SENSORS.sonars.name[0]).encode(),
        when_s,
        degrees,
    )


def seconds_of(said: str, way: str) -> float:
    """How far a clock is said to be ahead or behind: the machine may be busy meanwhile."""
    found = re.search(rf"its clock is (\d+) s {way}", said)
    assert found is not None, said
    return float(found[1])


def test_asterix_and_json_of_a_clock_an_hour_ahead_are_of_their_arrival_and_said() -> None:
    now_s = time.time()
    radar = SEA.radar.take(np.arange(20))
    radar = type(radar)(**{**radar.__dict__, "time_s": np.full(20, now_s + HOUR_S), "received_s": np.full(20, now_s + HOUR_S)})
    datagrams = encoded(type(SEA)(**{**SEA.__dict__, "radar": radar}), parsed("asterix+udp://x:1"), SENSORS)
    with live("asterix+udp://127.0.0.1:0", "json+listen://127.0.0.1:0", "json+listen://127.0.0.1:0?name=good") as made:
        put(made.ports[1], [bearing(now_s + 3 * 365 * 86_400.0, degree) for degree in range(20)])
        put(made.ports[2], [bearing(now_s, 200 + degree) for degree in range(20)])
        import socket

        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
            for datagram in datagrams:
                out.sendto(datagram, ("127.0.0.1", made.ports[0]))
        deliver(made, len(datagrams), 0)
        deliver(made, 20, 1)
        deliver(made, 20, 2)
        found = made.between(now_s - 10.0, time.time() + 1.0)
        assert (len(found.radar), len(found.bearing)) == (20, 40)
        assert np.all(np.abs(found.radar.time_s - now_s) < 10.0)
        said = [(trouble.name, trouble.text) for trouble in of_feeds(made.feeds(), now_s)]
        assert len(said) == 2
        assert seconds_of(said[0][1], "ahead") == pytest.approx(HOUR_S, abs=10.0)
        assert all("good" not in name for name, _ in said)


def test_a_stamp_that_no_clock_shows_is_refused_and_one_far_ahead_is_said_after_good_ones_too() -> None:
    with live("json+listen://127.0.0.1:0") as made:
        now_s = time.time()
        feed = made._feeds[0]
        feed.look()
        wild = [bearing(1e3 * now_s, 1.0), bearing(1e300, 2.0), bearing(-1e300, 3.0), bearing(now_s + HOUR_S, 4.0)]
        put(made.ports[0], [*wild, *(bearing(now_s, 10.0 + degree) for degree in range(20))])
        deliver(made, 24)
        found = made.between(now_s - 10.0, time.time() + 1.0)
        assert sorted(found.bearing.bearing_deg)[:2] == [4.0, 10.0]
        feed.look()
        state = made.feeds()[0]
        assert state["refused"] == 3
        assert state["faults"] == {
            "time that no clock shows: not of 1970 to 2223": 3,
            "time ahead of the clock of this machine, that of arrival taken": 1,
        }
        assert [trouble.text for trouble in of_feeds([state], now_s)] == [
            "1 stamps of the last minute were ahead of the clock of this machine: the time of arrival is taken",
            "3 records of the last minute are not used: time that no clock shows: not of 1970 to 2223",
        ]


def zda(when_s: float) -> bytes:
    return with_sum(datetime.fromtimestamp(when_s, UTC).strftime("GPZDA,%H%M%S.00,%d,%m,%Y,00,00"))


def plain(count: int, first: int = 0) -> list[bytes]:
    """AIS sentences without a time."""
    lines = encoded(SEA, parsed("ais+tcp://x:1"), SENSORS)
    bare = [line.rpartition(b"\\")[2] for line in lines]
    return [line for line in bare if line.split(b",")[1] == b"1"][first : first + count]


def test_an_old_clock_sentence_throws_nothing_away_and_is_said() -> None:
    with live("ais+listen://127.0.0.1:0") as made:
        now_s = time.time()
        put(made.ports[0], [zda(now_s - 40 * 86_400.0), *plain(50)])
        deliver(made, 51)
        put(made.ports[0], plain(50, 50))  # a new connection, without a clock
        deliver(made, 101)
        found = made.between(now_s - 5.0, time.time() + 1.0)
        feed = made.feeds()[0]
        assert len(found.ais) > 90
        assert (feed["before_run"], feed["late"]) == (0, 0)
        assert any("clock sentence" in kind for kind in feed["faults"])


def test_the_clock_sentence_of_one_sender_is_not_that_of_another() -> None:
    with LiveInput([parsed("ais+listen://127.0.0.1:0")], SENSORS, clock="feeds") as made:
        import socket

        honest = socket.create_connection(("127.0.0.1", made.ports[0]))
        honest.sendall(zda(1.75e9) + b"\r\n" + b"\r\n".join(plain(20)) + b"\r\n")
        deliver(made, 21)
        assert made.feeds()[0]["newest_s"] is None
        assert len(made.between(1.75e9 - 5.0, 1.75e9 - 1.0)) == 0
        put(made.ports[0], [zda(1.75e9 - 300.0)])
        deliver(made, 22)
        honest.sendall(b"\r\n".join(plain(20, 20)) + b"\r\n")
        deliver(made, 42)
        found = made.between(1.75e9 - 1.0, 1.75e9 + 1.0)
        honest.close()
        assert len(found.ais) > 35
        assert made.feeds()[0]["late"] == 0


def test_a_feed_of_which_most_is_thrown_away_is_said() -> None:
    with live("json+listen://127.0.0.1:0") as made:
        now_s = time.time()
        made.between(now_s - 10.0, now_s - 5.0)
        made._feeds[0].look()
        put(made.ports[0], [bearing(now_s - 60.0, degree) for degree in range(50)])
        deliver(made, 50)
        made.between(now_s - 5.0, now_s)
        made._feeds[0].look()
        said = " ".join(trouble.text for trouble in of_feeds(made.feeds(), now_s))
        assert "50 of 50 reports of the last minute were thrown away" in said


@pytest.mark.parametrize("start_utc", [None, datetime(2025, 6, 1, tzinfo=UTC), datetime(2026, 6, 1, tzinfo=UTC)])
def test_with_the_clock_of_the_feeds_a_run_begins_at_the_first_report_whenever_its_scenario_would(
    start_utc: datetime | None,
) -> None:
    with LiveInput([parsed("ais+listen://127.0.0.1:0")], SENSORS, clock="feeds") as made:
        put(made.ports[0], items("ais+tcp://x:1"))
        _, plan = made.begin(SCENARIO.model_copy(update={"start_utc": start_utc}), SENSORS, 1, threading.Event(), {})
    assert plan.start_s == math.floor(SEA.ais.received_s.min()) - 1.0


@pytest.mark.parametrize(("age_s", "remedy"), [(12.0, False), (1_800.0, True), (86_400.0, True)])
def test_a_recording_that_is_sent_as_if_it_were_of_now_is_told_the_option_it_needs(age_s: float, remedy: bool) -> None:
    """Of reports that are only late, nothing of recordings is said."""
    with live("json+listen://127.0.0.1:0") as made:
        now_s = time.time()
        made.between(now_s - 60.0, now_s - 30.0)
        made.between(now_s - 30.0, now_s - 5.0)
        made._feeds[0].look()
        put(made.ports[0], [bearing(now_s - age_s, degree) for degree in range(50)])
        deliver(made, 50)
        made.between(now_s - 5.0, now_s)
        made._feeds[0].look()
        said = " ".join(trouble.text for trouble in of_feeds(made.feeds(), now_s))
        assert "50 of 50 reports of the last minute were thrown away" in said
        assert ("from before the run began. A recording needs --clock feeds" in said) == remedy
        assert ("they came after their cycle" in said) != remedy
        if remedy:
            assert seconds_of(said, "behind") == pytest.approx(age_s, abs=10.0)


def test_readiness_and_age_do_not_follow_a_clock_that_is_set(served: Served, monkeypatch: pytest.MonkeyPatch) -> None:
    machine = Machine()
    clock, source, service = machine.clock(), Simulated(), Service(served.store)
    monkeypatch.setattr(metrics, "time", SimpleNamespace(monotonic=lambda: machine.monotonic_s))
    monkeypatch.setattr(source, "now_s", clock.now_s)
    monkeypatch.setattr(source, "about", lambda: RunAbout("sea", "A sea", 3.0, None))
    service.source = source
    service.hub.picture = picture = replace(served.service.picture(), time_s=clock.now_s() - 1.0)
    service.metrics.picture(picture, source.now_s())
    for step_s, age_s in ((-HOUR_S, 6.0), (2.0 * HOUR_S, 11.0)):
        machine.wall_s += step_s
        machine.passes(5.0)
        ready, body = service.ready()
        assert (ready, body["age_s"]) == (True, age_s)
        assert f"coastwatch_picture_age_seconds {age_s}" in service.metrics.text().decode()
    machine.wall_s -= HOUR_S
    machine.passes(60.0)
    ready, body = service.ready()
    assert (ready, body["status"]) == (False, "no picture has come for 70 s")
    assert "coastwatch_ready 0.0" in service.metrics.text().decode()


class Ahead(Connection):
    """A region that sends a cycle each period, of a clock that is wrong."""

    now_s, ahead_s = NOW_S, HOUR_S

    def next(self) -> RegionCycle | None:
        seq = self.incoming.position.seq + 1
        time_s = NOW_S + 3.0 * seq
        if time_s > self.now_s:
            return None
        self.incoming.received(Position("1@a", seq))
        one = np.ones(1)
        place = np.array([[50.0 + 1e-4 * seq, -1.0]])
        tracks = RegionTracks(np.array([1]), one * (time_s + self.ahead_s), place, np.zeros((1, 2)), np.eye(4)[None])
        return RegionCycle("1@a", seq, time_s + self.ahead_s, tracks)


@pytest.mark.parametrize("ahead_s", [HOUR_S, 30 * 86_400.0])
def test_the_cycles_of_a_region_of_a_clock_ahead_are_of_their_arrival_counted_and_said(
    ahead_s: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    region = Ahead(parsed_region("ws://127.0.0.1:1?name=north"))
    region.ahead_s = ahead_s
    monkeypatch.setattr(intake, "now_s", lambda: region.now_s)
    taken, used = RegionIntake(region, 0, True), 0
    for number in range(1, 41):
        region.now_s = now_s = NOW_S + 3.0 * number
        taken.receive(now_s)
        found = taken.reports_between(now_s - 3.0, now_s)
        used += len(found)
        if len(found):
            made = (found.position_deg[0, 0] - 50.0) / 1e-4
            assert number - 1.5 < made < number + 0.5, "what the region saw an hour ago is not shown as of now"
            assert now_s - 3.0 < found.time_s[0] <= now_s
    assert used >= 39
    assert {fault.kind: fault.count for fault in taken.faults()}[intake.AHEAD] >= 39
    (trouble,) = of_feeds([{**taken.counters(), "silent_s": 0.0}], region.now_s)
    assert (trouble.name, f"{ahead_s:.0f} s ahead" in trouble.text) == ("region north", True)


def test_a_region_whose_cycles_come_after_their_time_is_a_trouble_until_they_come_in_time(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    region = Ahead(parsed_region("ws://127.0.0.1:1?name=north"))
    monkeypatch.setattr(intake, "now_s", lambda: region.now_s)
    taken, said = RegionIntake(region, 0, True), list[list[str]]()
    for number in range(1, 41):
        region.now_s, region.ahead_s = NOW_S + 3.0 * number, -10.0 if number <= 20 else 0.0
        taken.receive(region.now_s)
        taken.reports_between(region.now_s - 8.0, region.now_s - 5.0)
        said.append([one.text for one in of_feeds([{**taken.counters(), "silent_s": 0.0}], region.now_s)])
    assert said[1] == said[28] == said[-1] == []
    assert len(said[19]) == len(said[22]) == 1
    assert "the newest of them came 10 s after its end" in said[22][0], "later ones came in time"
    assert said[19][0].startswith(
        "20 of its last 20 cycles were left out: the newest of them came 10 s after its end, later than --lateness"
    )
    assert (taken.late, taken.used) == (20, 18)


def stamps(checked: bool = False) -> Stamps:
    return Stamps("x", checked, Tally())


def test_one_wild_stamp_does_not_run_the_clock_of_the_feeds_away() -> None:
    judged, arrived = stamps(), np.zeros(40)
    time_s = np.linspace(1e9, 1e9 + 40.0, 40)
    time_s[[0, 7, 20]] += 3 * 365 * 86_400.0
    found = judged.times_s(time_s, arrived)
    assert np.isnan(found).nonzero()[0].tolist() == [0, 7, 20]
    assert judged.newest_s == time_s[39]


def test_a_wild_stamp_that_comes_first_is_corrected() -> None:
    judged = stamps()
    judged.times_s(np.array([2e9]), np.zeros(1))
    found = judged.times_s(1e9 + np.arange(2.0 * CONFIRMED_BY), np.zeros(2 * CONFIRMED_BY))
    assert np.isfinite(found).all()
    assert judged.newest_s == 1e9 + 2.0 * CONFIRMED_BY - 1.0


def test_a_jump_that_many_records_confirm_is_believed() -> None:
    judged = stamps()
    judged.times_s(1e9 + np.arange(20.0), np.zeros(20))
    after = 1e9 + 2 * FAR_JUMP_S + np.arange(20.0)
    found = np.array([judged.time_s(float(one), 0.0) for one in after])
    assert np.isnan(found[: CONFIRMED_BY - 1]).all()
    assert np.array_equal(found[CONFIRMED_BY - 1 :], after[CONFIRMED_BY - 1 :])


def test_a_clock_of_the_machine_that_the_feeds_agree_with_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    real = time.time
    with live("json+listen://127.0.0.1:0") as made:
        monkeypatch.setattr("coastwatch.server.clock.time.time", lambda: real() - HOUR_S)
        CLOCK.now_s()
        assert CLOCK.step_s == pytest.approx(-HOUR_S, abs=5.0)
        put(made.ports[0], [bearing(real(), degree) for degree in range(20)])
        deliver(made, 20)
        made.between(real() - 10.0, real())
        made._adopt_clock()  # the feed agrees with the time before
        put(made.ports[0], [bearing(real() - HOUR_S, degree) for degree in range(20)])
        deliver(made, 40)
        made.between(real(), real() + 1.0)
        with pytest.raises(ClockSet, match="-3600 s"):
            made._adopt_clock()
        assert CLOCK.now_s() == pytest.approx(real() - HOUR_S, abs=1.0)
        monkeypatch.undo()
        CLOCK.adopt()


def heard(new: NewVessels, mmsi: np.ndarray, time_s: float, at_deg: np.ndarray, sender: int = 0) -> np.ndarray:
    n = len(mmsi)
    return new.accepted(mmsi, np.full(n, time_s), at_deg, np.zeros(n, np.int64), np.full(n, sender, np.int64))


def test_a_sender_that_invents_vessels_gets_its_budget_and_the_honest_one_beside_it_all() -> None:
    new, g = NewVessels(), np.random.default_rng(3)
    granted = 0
    for second in range(100):
        n = 3_000
        wrong = heard(new, g.integers(10**8, 10**9, n), float(second), g.uniform(-60, 60, (n, 2)), sender=1)
        granted += int(wrong.sum())
        honest = heard(new, 10**9 + np.arange(10) + 10 * second, float(second), np.zeros((10, 2)), sender=2)
        assert honest.all()
    assert granted <= BURST + PER_SECOND * 100 + 500  # and those that were drawn twice near each other


def test_a_vessel_beyond_the_budget_is_used_from_the_second_report_on_that_agrees() -> None:
    new, n = NewVessels(), BURST + 500
    mmsi, at_deg = 10**8 + np.arange(n), np.zeros((n, 2))
    first = heard(new, mmsi, 0.0, at_deg)
    assert int(first.sum()) == BURST
    near = at_deg + np.array([0.5 * AGREES_M / 111_320.0, 0.0])
    far = at_deg + 1.0
    assert heard(new, mmsi, 0.01, np.where(np.arange(n)[:, None] % 2, near, far)).sum() == BURST + 250
    assert heard(new, mmsi, 0.02, far).all()


def test_senders_without_number_share_the_budget_of_the_feed() -> None:
    new = NewVessels()
    granted = sum(
        int(heard(new, 10**8 + 100 * sender + np.arange(100), 0.0, np.zeros((100, 2)), sender).sum()) for sender in range(500)
    )
    assert granted == BURST_OF_FEED


def test_an_mmsi_that_was_not_heard_for_an_hour_is_new_again() -> None:
    new = NewVessels()
    for hour in range(3):
        heard(new, 10**8 + np.arange(1_000) + 1_000 * hour, 5_000.0 * hour, np.zeros((1_000, 2)))
    assert len(new._accepted.mmsi) == 1_000


def test_vessels_that_wait_for_a_second_report_are_said_and_those_without_room_too(monkeypatch: pytest.MonkeyPatch) -> None:
    count, now_s = BURST + 1_500, time.time()
    times_s = np.full(count, now_s)
    position_deg = np.random.default_rng(1).uniform(-50.0, 50.0, (count, 2))
    speed, course = np.zeros(count), np.zeros(count)
    ais = AisReports(times_s, times_s, 300_000_000 + np.arange(count), position_deg, speed, course, np.zeros(count, np.bool_))
    lines = encoded(Reports(ais=ais), parsed("ais+listen://x:1"), SENSORS)
    with live("ais+listen://127.0.0.1:0?name=coast") as made:
        made._feeds[0].look()
        put(made.ports[0], lines)
        deliver(made, count)
        made.between(now_s - 10.0, now_s + 10.0)
        made._feeds[0].look()
        (said,) = of_feeds(made.feeds(), now_s)
        assert said.name == "coast"
        assert said.text.startswith("1500 MMSI are not in the picture: they are beyond the budget of new ones")
        monkeypatch.setattr(new_vessels, "MOST_WAITING", 1_000)
        ahead = replace(ais, mmsi=ais.mmsi + 10_000, time_s=times_s + 11.0, received_s=times_s + 11.0)
        put(made.ports[0], encoded(Reports(ais=ahead), parsed("ais+listen://x:1"), SENSORS))
        deliver(made, 2 * count)
        made.between(now_s + 10.0, now_s + 20.0)
        made._feeds[0].look()
        assert any(
            "were forgotten before their second report: too many wait" in one.text for one in of_feeds(made.feeds(), now_s)
        )
