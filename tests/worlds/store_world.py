"""A small sea whose every cycle is known by its number alone, to be written to a store and found there again."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from coastwatch.alarms import EventMemory, EvidenceContext, expected_sensors, next_events
from coastwatch.batches import (
    CLASSES,
    COVER_AZIMUTHS,
    COVER_RANGES,
    AisAlarms,
    AisReports,
    AisStatics,
    Associations,
    BearingAssociations,
    BearingReports,
    BearingTracks,
    EventChanges,
    FusedTracks,
    Members,
    Octants,
    Picture,
    RadarCorrections,
    RadarCover,
    RadarReports,
    Radars,
    Reports,
    Sensors,
    Sonars,
    Spots,
    StandingEchoes,
    Stations,
    Tracks,
)
from coastwatch.centre import Cycle
from coastwatch.geodesy import KNOT_M_S, earth_centred
from coastwatch.scenario import StoreSettings
from coastwatch.stage import Plan
from coastwatch.store import CycleRecord, ForCentres, Intake, Store, Written, begin_run, write_cycle

START_S = 1_750_000_000.0
PERIOD_S = 3.0
REGIONS = ("guanabara", "ilha")
AIS, SONAR = 2, 3
KEEP = StoreSettings(history_max_s=0.0)
"""A point of every vessel in every cycle, so that the past is found to the last digit."""


def sensors() -> Sensors:
    """Two radars in two regions, one AIS receiver, one sonar."""
    site = np.array([[-22.9, -43.2], [-22.8, -43.1]])
    two = np.array([10.0, 12.0])
    return Sensors(
        Radars(np.array(["fort", "island"]), np.array([0, 1]), site, two * 1852.0, two, two, two / 1000.0),
        Stations(np.array(["hill"]), site[:1], np.array([60_000.0])),
        Sonars(np.array(["mouth"]), site[:1], *(np.array([x]) for x in (9000.0, 0.01, 3.0, 90.0, 270.0))),
        REGIONS,
        site,
    )


def begin(store: Store, scenario: str = "sea", seed: int = 1, **more: Any) -> int:
    """A run of this sea."""
    fixed = {"title": "A sea", "version": "0.1.0", "settings": {"period_s": PERIOD_S}, "sensors": sensors()}
    return begin_run(
        store, scenario=scenario, seed=seed, plan=Plan(start_s=START_S, period_s=PERIOD_S, cycles=40), **{**fixed, **more}
    )


def instant_s(number: int) -> float:
    """When a cycle ends."""
    return START_S + PERIOD_S * (number + 1)


def present(number: int, vessels: int) -> np.ndarray:
    """Which vessels are in the picture of a cycle: each is away for one cycle in eleven."""
    k = np.arange(vessels)
    return (k + number) % 11 != 10


def picture_of(number: int, vessels: int) -> Picture:
    """Vessel k + 1 moves north at k knots from its place in a grid; odd ones have an MMSI."""
    k = np.flatnonzero(present(number, vessels))
    n = len(k)
    place = np.stack([-22.9 + 0.01 * (k // 100) + 1e-5 * number, -43.2 + 0.01 * (k % 100)], 1)
    covariance = np.zeros((n, 4, 4))
    covariance[:, range(4), range(4)] = np.array([4.0, 9.0, 0.01, 0.02])
    return Picture(
        vessel_id=k + 1,
        time_s=np.full(n, instant_s(number)),
        position_deg=place,
        velocity_m_s=np.stack([np.zeros(n), (k % 20) * KNOT_M_S], 1),
        covariance=covariance,
        since_s=np.full(n, START_S),
        updated_s=np.full(n, instant_s(number) - 1.0),
        mmsi=np.where(k % 2 == 1, 710_000_000 + k, -1),
        flags=np.zeros(n, np.int64),
        origin=np.full(n, -1),
    )


def tracks_of(picture: Picture) -> tuple[Tracks, Associations, Members]:
    """A radar track for every vessel and an AIS track for each that has an MMSI, associated."""
    radar, ais = np.arange(len(picture)), np.flatnonzero(picture.mmsi >= 0)
    row = np.concatenate([radar, ais])
    source = np.concatenate([picture.vessel_id % 2, np.full(len(ais), AIS)])
    track = np.concatenate([picture.vessel_id[radar] + 1000, picture.vessel_id[ais] + 5_000_000_000])
    n = len(row)
    tracks = Tracks(
        track, source, picture.time_s[row], picture.position_deg[row], picture.velocity_m_s[row], picture.covariance[row],
        np.ones((n, 2, 2)), picture.updated_s[row], picture.since_s[row], np.where(source == AIS, picture.mmsi[row], -1), np.full(n, -1),
    )  # fmt: skip
    found = Associations(ais, np.arange(len(radar), n), 0.5 + np.arange(len(ais), dtype=float), row)
    order = np.lexsort((track, source, picture.vessel_id[row]))
    return tracks, found, Members(picture.vessel_id[row][order], track[order], source[order])


def bearings_of(picture: Picture) -> tuple[BearingTracks, BearingAssociations]:
    """One bearing track, due west, on the vessel with the smallest number."""
    n = min(1, len(picture))
    tracks = BearingTracks(
        np.full(n, 77), np.full(n, SONAR), picture.time_s[:n], np.full(n, -np.pi / 2), np.full(n, 1e-3), np.zeros((n, 2, 2)),
        np.full((n, 2), [-22.9, -43.2]), picture.updated_s[:n], picture.since_s[:n], np.zeros((n, 3)), np.zeros((n, 3)),
        np.zeros((n, 3, 2)), np.zeros((n, 3)), np.zeros((n, CLASSES), np.int64), np.full(n, -1),
    )  # fmt: skip
    return tracks, BearingAssociations(np.zeros(n, np.int64), np.zeros(n, np.int64), np.full(n, 3.5), np.zeros(1))


def corrections_of(number: int) -> RadarCorrections:
    """The first radar settles in cycle 20, its azimuth bias grows by a thousandth of a degree a cycle; nothing is known of the second."""
    settled = number >= 20
    sigma = [np.array([s, np.nan]) for s in (1.6, np.radians(0.01 if settled else 0.2), 3.0, 0.1)]
    biases = [np.array([b, 0.0]) for b in (np.radians(5.0 + 0.001 * number), -12.0, 1.5)]
    state = np.array([2 if settled else 1, 0])
    factors = np.array([[1.25, 1.0], [np.nan, np.nan]])
    vessels, residuals, no = np.array([7, 0]), np.array([10.0 * number, 0.0]), np.zeros(2, np.bool_)
    site = {"site_error_m": np.array([[48.5, -2.0], [0.0, 0.0]]), "site_sigma_m": np.array([[0.5, 0.75], [np.nan, np.nan]])}
    site |= {"range_scale": np.array([0.01, 0.0]), "range_scale_sigma": np.array([0.0002, np.nan])}
    return RadarCorrections(*biases, *sigma, vessels, residuals, state, no, **site, noise_factor=factors)


def cover_of(number: int) -> RadarCover:
    """Both radars have turned once a cycle. The first one sees half of the AIS vessels in one cell; the second has clutter in one."""
    none = np.zeros((2, COVER_AZIMUTHS, COVER_RANGES))
    seen, looks, false = none + 0.9, none.copy(), none.copy()
    seen[0, 7, 3], looks[0, 7, 3], false[1, 70, 15] = 0.5, 10.0 + number, 2e-6
    range_m, site_deg = sensors().radars.range_m, np.array([[-22.9, -43.2], [np.nan, np.nan]])
    return RadarCover(range_m, site_deg, np.full(2, float(number)), seen, looks, none + 0.8, none.copy(), false)


def standing_of(number: int) -> StandingEchoes:
    """A quay that the second radar sees, and a pile that the first one sees from cycle 3 on."""
    place = np.array([[-22.8, -43.0], [-22.9, -43.1]])
    both = StandingEchoes(np.array([1, 0]), place, np.array([120.0, 8.0]), np.array([2.5, 0.9]), np.full(2, float(number)))
    return both if number >= 3 else both.take(np.array([0]))


def cycle_of(number: int, vessels: int, picture: Picture | None = None) -> Cycle:
    """What the pipeline yields in a cycle."""
    picture = picture_of(number, vessels) if picture is None else picture
    tracks, found, members = tracks_of(picture)
    bearings, heard = bearings_of(picture)
    n = len(tracks)
    spots = Spots(
        earth_centred(np.array([[-22.9, -43.2], [-22.8, -43.1]])),
        np.arange(n) % 2,
        np.zeros(min(n, 2), np.int64),
        np.arange(min(n, 2)),
    )
    fused = FusedTracks(picture.time_s, picture.position_deg, picture.velocity_m_s, picture.covariance)
    none = np.zeros(0, np.int64)
    return Cycle(
        time_s=instant_s(number), tracks=tracks, alarms=AisAlarms.empty(), bearing_tracks=bearings, spots=spots,
        associations=found, fused=fused,
        picture=picture, members=members, octants=Octants(none, none, none), bearing_associations=heard,
        corrections=corrections_of(number), radar_cover=cover_of(number), standing_echoes=standing_of(number),
    )  # fmt: skip


def reports_of(number: int, vessels: int) -> Reports:
    """No reports but the name of one vessel."""
    k = number % max(vessels, 1)
    one = np.array([instant_s(number)])
    name = AisStatics(
        one,
        np.array([710_000_000 + k]),
        np.array([f"SHIP {k}"]),
        np.array([""]),
        np.array([70]),
        np.array([120.0]),
        np.array([np.nan]),
    )
    return Reports(RadarReports.empty(), AisReports.empty(), name, BearingReports.empty())


SECONDS = {"plots": 0.001, "tracks": 0.004, "spots": 0.0005, "picture": 0.002, "scores": 0.1}


MEMORIES: dict[tuple[str, int], dict[int, EventMemory]] = {}
"""Of each database and run, the memory of events before each cycle, as a checkpoint has it."""


def with_events(store: Store, run_id: int, number: int, cycle: Cycle, gap_s: float) -> Cycle:
    """The cycle with what it changes in the events, as the pipeline yields it."""
    memories = MEMORIES.setdefault((store.where, run_id), {})
    memories[number + 1], events = events_of(memories.get(number, EventMemory.none()), cycle, gap_s)
    return replace(cycle, events=events)


def events_of(
    memory: EventMemory, cycle: Cycle, gap_s: float, heard_s: np.ndarray | None = None, margin: float = 0.95
) -> tuple[EventMemory, EventChanges]:
    """The memory of events after a cycle, and what it changes. Args: heard_s: (V,) newest AIS report of each vessel."""
    never = np.full(len(cycle.picture), -np.inf) if heard_s is None else heard_s
    of_cycle = cycle.tracks, cycle.members, cycle.bearing_tracks, cycle.bearing_associations
    names = (*REGIONS, "ais", "mouth")
    evidence = EvidenceContext(*of_cycle, names, *expected_sensors(sensors(), margin, 60.0, 45.0), never)
    return next_events(memory, cycle.picture, cycle.vessel_alarms, cycle.time_s, gap_s, evidence)


def write(store: Store, run_id: int, number: int, vessels: int = 30, **more: Any) -> Cycle:
    """Write one cycle of this sea and return it."""
    cycle = more.pop("cycle", None) or cycle_of(number, vessels)
    write_and_say(store, run_id, number, vessels, cycle=cycle, **more)
    return cycle


def write_and_say(store: Store, run_id: int, number: int, vessels: int = 30, **more: Any) -> Written:
    """Write one cycle of this sea and return what the store says of it."""
    cycle = more.pop("cycle", None) or cycle_of(number, vessels)
    if not len(cycle.events):
        cycle = with_events(store, run_id, number, cycle, more.get("keep", KEEP).event_gap_s)
    given = {"keep": KEEP, "checkpoint": b"memory %d" % number, "reports": reports_of(number, vessels), "last": False, **more}
    used = ForCentres(intake=[Intake("north", "a run of the region", number, number, 0)])
    record = CycleRecord(number, cycle, given["reports"], SECONDS, given["checkpoint"], given["last"], used)
    if "video" in given:
        record = replace(record, video=given["video"])
    return write_cycle(store, run_id, record, given["keep"])
