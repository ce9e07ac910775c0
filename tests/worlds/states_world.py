"""A database with one vessel for every state that a vessel of the picture can be in, for tests of what reads it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from coastwatch import store
from coastwatch.batches import (
    CLASSES,
    AisAlarms,
    AisReports,
    AisStatics,
    Associations,
    BearingAssociations,
    BearingReports,
    BearingTracks,
    Flag,
    FusedTracks,
    Members,
    Octants,
    Picture,
    RadarCorrections,
    RadarReports,
    Reports,
    Spots,
    Tracks,
)
from coastwatch.centre import Cycle
from coastwatch.geodesy import earth_centred
from coastwatch.scenario import load_scenario
from coastwatch.server.run import version

SCENARIO, CYCLES = "guanabara", 12
RADAR, AIS, SONAR = 0, 1, 2  # sources of this scenario


@dataclass(frozen=True)
class State:
    """A vessel: the sources of its tracks, its flags, and what is not known of it."""

    name: str
    sources: tuple[int, ...]
    flags: int = 0
    mmsi: bool = False
    covariance: bool = True
    velocity: bool = True
    static: bool = False  # its name, call sign, type and size were received
    last_cycle: int = CYCLES  # the last cycle in which it is in the picture


EVERY_FLAG = sum(int(flag) for flag in Flag)
STATES = (
    State("lone radar", (RADAR,)),
    State("lone AIS", (AIS,), mmsi=True, covariance=False, static=True),
    State("sonar only", (SONAR,), int(Flag.COASTING)),
    State("radar and sonar", (RADAR, SONAR)),
    State("radar and AIS", (RADAR, AIS), mmsi=True, static=True),
    State("all sources", (RADAR, AIS, SONAR), mmsi=True),
    State("two radar tracks", (RADAR, RADAR)),
    State("coasting", (), int(Flag.COASTING)),
    State("coasting with MMSI", (), int(Flag.COASTING), mmsi=True),
    State("no source and no flag", ()),
    State("dark", (RADAR,), int(Flag.DARK)),
    State("AIS without radar", (AIS,), int(Flag.AIS_WITHOUT_RADAR), mmsi=True),
    State("AIS contradicted", (RADAR, AIS), int(Flag.AIS_CONTRADICTED), mmsi=True),
    State("MMSI twice", (AIS,), int(Flag.MMSI_TWICE), mmsi=True),
    State("impossible speed", (AIS,), int(Flag.IMPOSSIBLE_SPEED), mmsi=True),
    State("every flag", (RADAR, AIS), EVERY_FLAG, mmsi=True),
    State("velocity unknown", (AIS,), mmsi=True, velocity=False, covariance=False),
    State("lost", (RADAR,), last_cycle=6),
    State("lost with MMSI", (RADAR, AIS), mmsi=True, last_cycle=8),
)
ID_OF = {state.name: number for number, state in enumerate(STATES, start=1)}


def mmsi_of(name: str) -> int:
    return 710_000_000 + ID_OF[name]


def write(path: Path) -> str:
    """Writes the database, with a recording; returns its URL."""
    url = f"sqlite:///{path}"
    scenario = load_scenario(SCENARIO, {"cycles": str(CYCLES), "store.recording": "true"})
    plan = scenario.plan()
    with store.open_store(url) as opened:
        run_id = store.begin_run(
            opened,
            scenario=scenario.name,
            title=scenario.title,
            seed=scenario.seed,
            version=version(),
            settings=scenario.model_dump(mode="json"),
            sensors=scenario.sensors(),
            plan=plan,
        )
        for number in range(CYCLES):
            cycle, reports = cycle_of(number, plan.instant_s(number))
            last = number == CYCLES - 1
            record = store.CycleRecord(number, cycle, reports, {"tracks": 0.01}, b"memory", last)
            store.write_cycle(opened, run_id, record, scenario.store)
        store.finish_run(opened, run_id, "finished", {}, ())
    return url


def cycle_of(number: int, time_s: float) -> tuple[Cycle, Reports]:
    """What the pipeline would yield in a cycle, and the reports of it."""
    present = [state for state in STATES if number < state.last_cycle]
    picture = picture_of(present, number, time_s)
    members = [(k, source, at) for k, state in enumerate(present) for at, source in enumerate(state.sources)]
    rows = np.array(sorted((k, s, 1000 * s + 10 * int(picture.vessel_id[k]) + at) for k, s, at in members), np.int64)
    vessel, source, track = rows.T
    kept = np.flatnonzero(source != SONAR)  # the store adds bearing tracks to members by their associations
    made = Members(picture.vessel_id[vessel[kept]], track[kept], source[kept])
    n, none = len(kept), np.zeros(0, np.int64)
    tracks = Tracks(
        track[kept], source[kept], np.full(n, time_s), picture.position_deg[vessel[kept]], picture.velocity_m_s[vessel[kept]],
        picture.covariance[vessel[kept]], np.ones((n, 2, 2)), np.full(n, time_s), np.full(n, time_s - 100.0),
        np.where(source[kept] == AIS, picture.mmsi[vessel[kept]], -1), np.full(n, -1),
    )  # fmt: skip
    pair = np.flatnonzero((vessel[kept][1:] == vessel[kept][:-1]) & (source[kept][1:] != source[kept][:-1]))
    associations = Associations(pair, pair + 1, np.full(len(pair), 0.5), vessel[kept])
    bearings, bearing_associations = bearings_of(vessel[source == SONAR], track[source == SONAR], time_s)
    centre = picture.position_deg[:1]
    cycle = Cycle(
        time_s=time_s, tracks=tracks, alarms=AisAlarms.empty(), bearing_tracks=bearings,
        spots=Spots(earth_centred(centre), np.zeros(n, np.int64), none, none), associations=associations,
        fused=FusedTracks(picture.time_s, picture.position_deg, picture.velocity_m_s, picture.covariance), picture=picture,
        members=made, octants=Octants(none, none, none), bearing_associations=bearing_associations,
        corrections=RadarCorrections.empty(R=2),
    )  # fmt: skip
    return cycle, Reports(RadarReports.empty(), AisReports.empty(), statics_of(time_s), BearingReports.empty())


def picture_of(present: list[State], number: int, time_s: float) -> Picture:
    """Vessels in a row, 500 m apart, on their way north; every third one is at rest."""
    n = len(present)
    vessel = np.array([ID_OF[state.name] for state in present])
    speed = np.where(vessel % 3 == 0, 0.0, 4.0)
    covariance = np.tile(np.diag([25.0, 100.0, 0.04, 0.04]), (n, 1, 1))
    covariance[[not state.covariance for state in present]] = np.nan
    velocity = np.stack([np.zeros(n), speed], 1)
    velocity[[not state.velocity for state in present]] = np.nan
    supported = np.array([bool(state.sources) for state in present])
    return Picture(
        vessel_id=vessel,
        time_s=np.full(n, time_s),
        position_deg=np.stack([-22.98 + 3e-5 * speed * number, -43.25 + 0.005 * vessel], 1),
        velocity_m_s=velocity,
        covariance=covariance,
        since_s=np.full(n, time_s - 100.0 - 3.0 * number),
        updated_s=np.where(supported, time_s - 1.0, time_s - 45.0),
        mmsi=np.array([mmsi_of(state.name) if state.mmsi else -1 for state in present]),
        flags=np.array([state.flags for state in present]),
        origin=np.full(n, -1),
    )


def bearings_of(vessel_row: np.ndarray, track: np.ndarray, time_s: float) -> tuple[BearingTracks, BearingAssociations]:
    """A bearing track for each of these vessels, and one that belongs to none."""
    n = len(vessel_row) + 1
    when = np.full(n, time_s)
    tracks = BearingTracks(
        np.append(track, 2999), np.full(n, SONAR), when, np.linspace(-3.0, 3.0, n), np.full(n, 1e-3), np.zeros((n, 2, 2)),
        np.full((n, 2), [-22.989, -43.186]), when, when - 100.0, np.zeros((n, 3)), np.zeros((n, 3)), np.zeros((n, 3, 2)),
        np.zeros((n, 3)), np.zeros((n, CLASSES), np.int64), np.full(n, -1),
    )  # fmt: skip
    return tracks, BearingAssociations(np.arange(n - 1), vessel_row, np.full(n - 1, 3.5), np.zeros(1))


def statics_of(time_s: float) -> AisStatics:
    """Static data of the vessels that send it; the length of the second is not known."""
    known = [state.name for state in STATES if state.static]
    n = len(known)
    mmsi, name = np.array([mmsi_of(one) for one in known]), np.array([one.upper() for one in known])
    length = np.where(np.arange(n) == 1, np.nan, 120.0)
    return AisStatics(np.full(n, time_s), mmsi, name, np.full(n, ""), np.full(n, 70), length, np.full(n, np.nan))
