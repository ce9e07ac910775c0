"""Every question of db/operator gives the planted answer, on SQLite and PostgreSQL."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import store_world as world

from coastwatch import store as kept
from coastwatch.batches import AisAlarms, Associations, Flag, Members, NavStatus, Picture
from coastwatch.errors import StoreError
from coastwatch.geodesy import KNOT_M_S, offset_deg
from coastwatch.operators.cli import main
from coastwatch.store import INSTANTS, Store

pytestmark = pytest.mark.contract

CYCLES = 40
LAST_S = world.instant_s(CYCLES - 1)
SPHERE = 0.006
"""The questions measure on a sphere of 60 NM a degree, the planted distances are of the ellipsoid: at most 0.6 % apart."""

HARBOUR = np.array([-22.9, -43.2])
PLACES_M = np.array(
    [
        [0, 0],
        [300, 0],
        [5000, 0],
        [5000, 4000],
        [-6000, 0],
        [-6000, 8000],
        [20_000, 0],
        [20_000, 3000],
        [40_000, 0],
        [60_000, 0],
    ]
)
"""Where vessels 1 to 10 lie, metres east and north of the harbour. 1 and 2 are close; 3 and 4 are on opposite courses."""

VELOCITY_KN = np.array([[0, 0], [0, 4], [0, 11], [0, -10], [30, 0], [0, 5], [0, 6], [0, 7], [0, 8], [0, 9]])
FLAGS = {
    3: Flag.DARK,
    4: Flag.AIS_WITHOUT_RADAR,
    5: Flag.IMPOSSIBLE_SPEED,
    6: Flag.AIS_CONTRADICTED,
    7: Flag.MMSI_TWICE,
    8: Flag.MMSI_TWICE,
    9: Flag.DARK | Flag.COASTING,
    1: Flag.STATIONARY | Flag.ODD_MMSI | Flag.AGROUND,
    10: Flag.EPIRB,
}
SETTINGS = {
    "period_s": world.PERIOD_S,
    "picture": {"dark_after_s": 60.0, "unseen_after_s": 45.0, "cover_margin": 0.95},
}
STATUS = {1: NavStatus.AGROUND, 2: NavStatus.MOORED, 10: NavStatus.AIS_SART_ACTIVE}
MMSI = {1: 710_000_001, 2: 710_000_002, 4: 710_000_004, 5: 710_000_005, 6: 710_000_006, 7: 710_000_007, 8: 710_000_007}


CHANGES = {10: "ana", 30: "bia"}
"""Who changes something through the API at the end of a cycle."""

ENDS = (20, 33, CYCLES - 1)
"""The newest cycles at which every question is asked."""

SILENT_SINCE_S = world.START_S - 20.0  # vessel 9


def planted(number: int) -> Picture:
    """Vessels 1 to 10; vessel 10 comes in cycle 30, vessel 2 leaves after cycle 35 and vessel 8 is away from 32 to 34."""
    there = [
        v for v in range(1, 11) if (v != 10 or number >= 30) and (v != 2 or number <= 35) and (v != 8 or not 32 <= number <= 34)
    ]
    ids = np.array(there)
    n = len(ids)
    covariance = np.zeros((n, 4, 4))
    covariance[:, range(4), range(4)] = (1.0 + ids[:, None] / 10.0) ** 2
    covariance[ids == 6, 0, 0] = 900.0
    time_s = world.instant_s(number)
    return Picture(
        vessel_id=ids,
        time_s=np.full(n, time_s),
        position_deg=offset_deg(HARBOUR, PLACES_M[ids - 1].astype(float)),
        velocity_m_s=VELOCITY_KN[ids - 1] * KNOT_M_S,
        covariance=covariance,
        since_s=np.where(ids == 10, world.instant_s(30), world.START_S),
        updated_s=np.where(ids == 9, SILENT_SINCE_S, time_s - 1.0),
        mmsi=np.array([MMSI.get(v, -1) for v in there]),
        flags=np.array([int(FLAGS.get(v, 0)) for v in there]),
        origin=np.full(n, -1),
        nav_status=np.array([int(STATUS.get(v, -1)) for v in there]),
    )


def without_radar(cycle: Any, number: int) -> Any:
    """The cycle as if vessel 4 had no radar track, and vessel 1 had been handed from one region to the other in cycle 20."""
    members, vessel = cycle.members, cycle.members.vessel_id
    source, track = members.source.copy(), members.track_id.copy()
    handed = (vessel == 1) & (source != world.AIS) & (number >= 20)
    source[handed], track[handed] = 0, 2001
    stays = ~((vessel == 4) & (source != world.AIS))
    order = np.lexsort((track[stays], source[stays], vessel[stays]))
    members = Members(vessel[stays][order], track[stays][order], source[stays][order])
    none = np.zeros(0, np.int64)
    return replace(cycle, members=members, associations=Associations(none, none, np.zeros(0), cycle.associations.vessel))


def write_planted(store: Store, run: int, cycles: range) -> None:
    """Cycles of the planted sea, and two changes through the API."""
    for number in cycles:
        cycle = without_radar(world.cycle_of(number, 0, planted(number)), number)
        world.write(store, run, number, cycle=cycle, reports=world.reports_of(1, 2))
        if number in CHANGES:
            path, body = "/api/v1/alarms/4-dark-1/acknowledge", "{}"
            change = kept.Change(world.instant_s(number), CHANGES[number], "operator", "10.0.0.9", "POST", path, 200, body)
            kept.note_change(store, change)


@pytest.fixture(scope="module")
def store(shared_url: str) -> Iterator[Store]:
    """Forty cycles of the planted sea, after a run of another one."""
    with kept.open_store(shared_url) as store:
        other = world.begin(store, "other")
        world.write(store, other, 0)
        write_planted(store, world.begin(store, settings=SETTINGS), range(CYCLES))
        yield store


@pytest.fixture(scope="module")
def answers(tmp_path_factory: pytest.TempPathFactory) -> dict[int, dict[str, kept.Rows]]:
    """What each question about now was answered when one of ENDS was the newest cycle, by that cycle and question."""
    found: dict[int, dict[str, kept.Rows]] = {}
    with kept.open_store(str(tmp_path_factory.mktemp("growing") / "x.db")) as growing:
        run, first = world.begin(growing, settings=SETTINGS), 0
        for last in ENDS:
            write_planted(growing, run, range(first, last + 1))
            found[last] = {name: kept.operator_query(growing, name, required(name)) for name in kept.operator_queries()}
            first = last + 1
    return found


def required(name: str) -> dict[str, Any]:
    """The parameters of a question that have no default."""
    given = {"latitude_deg": -22.9, "longitude_deg": -43.2, "mmsi": 710_000_001}
    parameters = kept.operator_queries()[name].parameters
    return {key: given[key] for key, parameter in parameters.items() if parameter.default is None}


def ask(store: Store, name: str, /, **parameters: Any) -> list[dict[str, Any]]:
    found = kept.operator_query(store, name, parameters)
    return [dict(zip(found.columns, row, strict=True)) for row in found.rows]


def ids(rows: list[dict[str, Any]]) -> list[int]:
    return [row["vessel_id"] for row in rows]


def test_every_question(store: Store) -> None:
    """One database for all: each answer is what was planted."""
    asked: set[str] = set()

    def rows(name: str, **parameters: Any) -> list[dict[str, Any]]:
        asked.add(name)
        return ask(store, name, **parameters)

    dark = rows("dark_vessels")
    assert ids(dark) == [3, 9]
    assert dark[0]["watched_for_s"] == LAST_S - world.START_S
    assert ids(rows("dark_vessels", min_sog_kn=9.0)) == [3]
    resting = rows("stationary")
    assert [(row["vessel_id"], row["mmsi"], row["start_s"]) for row in resting] == [(1, 710_000_001, world.instant_s(0))]
    assert resting[0]["stationary_for_s"] == LAST_S - world.instant_s(0)
    assert rows("stationary", seconds=1e4) == []
    alone = rows("ais_without_radar")
    assert [(row["vessel_id"], row["mmsi"], row["sources"]) for row in alone] == [(4, 710_000_004, "ais")]
    assert ids(rows("contradicted")) == [6]
    assert [(row["vessel_id"], row["mmsi"]) for row in rows("mmsi_twice")] == [(7, 710_000_007), (8, 710_000_007)]
    assert ids(rows("impossible_speed")) == [5]
    assert [(row["vessel_id"], row["kind"], row["says"]) for row in rows("emergencies")] == [(10, "epirb", "active")]
    assert [(row["vessel_id"], row["mmsi"]) for row in rows("odd_mmsi")] == [(1, 710_000_001)]
    assert [(row["vessel_id"], row["nav_status"]) for row in rows("disabled")] == [(1, 6)]

    alarms = rows("alarms")
    assert [(row["vessel_id"], row["kind"], row["start_s"], row["end_s"], row["gaps"]) for row in alarms] == [
        (10, "epirb", world.instant_s(30), None, 0)
    ] + [
        (vessel, kind, world.instant_s(0), None, gaps)
        for vessel, kind, gaps in (
            *((1, "aground", 0), (1, "odd_mmsi", 0)),
            *((3, "dark", 0), (4, "ais_without_radar", 0), (5, "impossible_speed", 0), (6, "ais_contradicted", 0)),
            *((7, "mmsi_twice", 0), (8, "mmsi_twice", 1), (9, "dark", 0)),
        )
    ]
    assert alarms[0]["evidence"].endswith("; navigational status AIS-SART active")
    alarms = alarms[3:]
    dark, alone = (row["evidence"] for row in alarms[:2])
    reason = "never heard on AIS; in range of AIS station hill; limit 60 s; "
    assert dark == reason + "seen by ilha (11.0 kn, 1 s old)"
    reason = "AIS goes on without a radar track; in range of radars fort, island; limit 45 s; "
    assert alone == reason + "seen by ais (10.0 kn, 1 s old)"
    both = r"seen by ilha \(6\.0 kn, 1 s old\), ais \(6\.0 kn, 1 s old, 0 m from the first\)"
    assert re.fullmatch(both + r"; same MMSI as vessel 8, (2999|3000) m away", alarms[4]["evidence"])
    assert alarms[0]["lasted_s"] == LAST_S - world.instant_s(0)
    assert ids(rows("alarms", kind="dark", count=1)) == [3]
    assert rows("alarms", to_s=world.START_S) == []

    audit = rows("audit")
    assert [(row["who"], row["time_s"]) for row in audit] == [("bia", world.instant_s(30)), ("ana", world.instant_s(10))]
    assert (audit[0]["role"], audit[0]["client"], audit[0]["http_status"]) == ("operator", "10.0.0.9", 200)
    assert [row["who"] for row in rows("audit", from_s=world.instant_s(30))] == ["bia"]
    assert [row["who"] for row in rows("audit", to_s=world.instant_s(29))] == ["ana"]
    assert [row["who"] for row in rows("audit", count=1)] == ["bia"]

    new = rows("new_vessels", minutes=1)
    assert [(row["vessel_id"], row["from_s"]) for row in new] == [(8, world.instant_s(35)), (10, world.instant_s(30))]
    assert ids(rows("new_vessels", minutes=0.4)) == [8]
    lost = rows("lost_vessels")
    assert [(row["vessel_id"], row["last_s"], row["mmsi"]) for row in lost] == [(2, world.instant_s(35), 710_000_002)]
    assert lost[0]["sog_kn"] == pytest.approx(4.0)
    assert rows("lost_vessels", minutes=0.1) == []

    assert ids(rows("fastest", count=4)) == [5, 3, 4, 10]
    uncertain = rows("uncertain", count=2)
    assert [(row["vessel_id"], row["major_m"]) for row in uncertain] == [(6, 30.0), (10, 2.0)]
    assert [(row["vessel_id"], row["age_s"]) for row in rows("silent")] == [(9, world.instant_s(CYCLES - 1) - SILENT_SINCE_S)]
    assert [row["time_s"] for row in rows("history_of_mmsi", mmsi=710_000_002)] == [world.instant_s(k) for k in range(36)]
    assert len(rows("history_of_mmsi", mmsi="710000007", minutes=0.25)) == 6 + 5

    near = rows("near_position", latitude_deg=HARBOUR[0], longitude_deg=HARBOUR[1], radius_nm=3.0)
    assert ids(near) == [1, 3]
    assert near[1]["distance_nm"] == pytest.approx(5000.0 / 1852.0, rel=SPHERE)
    heard = rows("bearings")
    assert [(row["source"], row["vessel_id"], row["bearing_deg"]) for row in heard] == [("mouth", 1, pytest.approx(270.0))]

    changes = rows("source_changes")
    said = [(row["time_s"], row["vessel_id"], row["what"], row["source"], row["track_id"]) for row in changes]
    handed_s = world.instant_s(20)
    assert said == [(handed_s, 1, "joined", "guanabara", 2001), (handed_s, 1, "left", "ilha", 1001)]
    coverage = {row["name"]: (row["tracks"], row["vessels"], row["vessels_of_it_alone"]) for row in rows("sensor_coverage")}
    assert coverage == {"guanabara": (4, 4, 1), "ilha": (4, 4, 2), "ais": (6, 6, 1), "mouth": (1, 1, 0)}
    registered = {row["name"]: row for row in rows("sensor_registration", minutes=1.0)}
    assert [(name, row["state"], row["vessels"]) for name, row in registered.items()] == [
        ("fort", "settled", 7),
        ("island", "unknown", 0),
        ("mouth", None, None),
    ]
    fort = registered["fort"]
    assert fort["azimuth_bias_deg"] == pytest.approx(5.0 + 0.001 * (CYCLES - 1))
    assert fort["azimuth_sigma_deg"] == pytest.approx(0.01)
    assert fort["azimuth_change_deg"] == pytest.approx(0.001 * 60.0 / world.PERIOD_S)
    assert (fort["range_bias_m"], fort["time_lag_s"]) == (-12.0, 1.5)
    assert (fort["estimated_lag_s"], fort["lag_sigma_s"]) == (1.6, 0.1)
    assert (fort["site_east_m"], fort["site_north_m"], fort["site_sigma_m"]) == (48.5, -2.0, 0.75)
    assert registered["island"]["azimuth_sigma_deg"] is None
    assert registered["island"]["site_east_m"] is None
    assert (fort["range_scale"], fort["range_scale_sigma"]) == (0.01, 0.0002)
    assert registered["island"]["range_scale"] is None
    load = {row["stage"]: row for row in rows("load", cycles=10)}
    assert list(load) == list(world.SECONDS)
    assert load["tracks"]["mean_ms"] == pytest.approx(4.0)
    assert load["tracks"]["cycles"] == 10
    assert sum(row["share"] for row in load.values()) == pytest.approx(1.0)

    passing = rows("closest_approach")
    assert [(row["first_id"], row["second_id"]) for row in passing] == [(3, 4)]
    assert passing[0]["passing_m"] == pytest.approx(0.0, abs=1.0)
    assert passing[0]["passing_in_s"] == pytest.approx(4000.0 / (21.0 * KNOT_M_S), rel=SPHERE)
    assert rows("closest_pairs") == []
    pairs = rows("closest_pairs", within_m=4500.0)
    assert [(row["first_id"], row["second_id"]) for row in pairs] == [(7, 8), (3, 4)]
    assert [row["distance_m"] for row in pairs] == pytest.approx([3000.0, 4000.0], rel=SPHERE)
    assert asked == set(kept.operator_queries()), "a question without a planted answer"


def test_another_run_may_be_asked(store: Store) -> None:
    assert ids(ask(store, "fastest", run=1, count=1)) == [20]
    assert ids(ask(store, "fastest", run="1", count="2")) == [20, 19]
    assert ask(store, "dark_vessels", run=1) == []


def test_close_to_the_antimeridian(url: str) -> None:
    """Two vessels 222 m apart on the two sides of it; the cells of the questions wrap as the Earth does."""
    picture = planted(0).take(slice(0, 3))
    place = np.array([[0.0, 179.999], [0.0, -179.999], [0.0, 179.9]])
    with kept.open_store(url) as store:
        world.write(store, world.begin(store), 0, cycle=world.cycle_of(0, 0, replace(picture, position_deg=place)))
        pairs = ask(store, "closest_pairs")
        assert [(row["first_id"], row["second_id"]) for row in pairs] == [(1, 2)]
        assert pairs[0]["distance_m"] == pytest.approx(0.002 * 111_320.0, rel=SPHERE)
        assert sorted(ids(ask(store, "near_position", latitude_deg=0.0, longitude_deg=180.0, radius_nm=1))) == [1, 2]


@pytest.mark.parametrize("within_m", [50.0, 700.0, 2_000.0])
def test_cells_find_every_pair(tmp_path: Path, within_m: float) -> None:
    """The pairs found by cells are those found by comparing all."""
    rng = np.random.default_rng([3, 1])
    n = 300
    picture = world.picture_of(0, n * 11 // 10)
    n = len(picture)
    place = HARBOUR + rng.uniform(-0.05, 0.05, (n, 2))
    picture = replace(picture, position_deg=place, velocity_m_s=np.full((n, 2), 3.0))
    apart = (
        (place[:, None] - place)
        * 111_120.0
        * np.stack([np.ones((n, n)), np.cos(np.radians((place[:, None, 0] + place[:, 0]) / 2))], -1)
    )
    first, second = np.nonzero(np.triu(np.hypot(apart[..., 0], apart[..., 1]) <= within_m, 1))
    with kept.open_store(str(tmp_path / "x.db")) as store:
        world.write(store, world.begin(store), 0, cycle=world.cycle_of(0, 0, picture))
        found = {(row["first_id"], row["second_id"]) for row in ask(store, "closest_pairs", within_m=within_m, count=10**6)}
    wanted = set(zip(picture.vessel_id[first].tolist(), picture.vessel_id[second].tolist(), strict=True))
    assert found == wanted
    assert len(found) > 0


def test_times_are_instants_or_lengths(store: Store) -> None:
    """A column in `_s` is an instant where INSTANTS says so, which the command line shows as UTC; else a length of time."""
    given = {"latitude_deg": -22.9, "longitude_deg": -43.2, "mmsi": 710_000_001, "minutes": 60}
    for name, question in kept.operator_queries().items():
        found = kept.operator_query(store, name, {key: given[key] for key in question.parameters if key in given})
        for column, value in zip(found.columns, found.rows[0] if found.rows else (), strict=False):
            if column.endswith("_s") and value is not None:
                assert (value > world.START_S - 30.0) == (column in INSTANTS), f"{name}.{column}"


@pytest.mark.parametrize("last", ENDS)
def test_every_question_at_an_instant_is_answered_as_it_was_then(
    store: Store, last: int, answers: dict[int, dict[str, kept.Rows]]
) -> None:
    """A question about now was asked when the cycle was the newest; one about then asks the whole database."""
    for name, now in answers[last].items():
        then = kept.operator_query(store, name, required(name), world.instant_s(last) + 1.0)
        if name == "bearings":  # of the past, only those that were given to a vessel, without their rates
            now = replaced(now, rate_deg_s=None)
            then = replaced(then, updated_s=now.column("updated_s")[0])
        assert then.columns == now.columns
        for column in {"updated_s", "age_s"} & set(now.columns):  # of vessels that are heard again soon: at the latest
            off_s = np.subtract(then.column(column), now.column(column)) * (-1.0 if column == "age_s" else 1.0)
            assert ((off_s >= 0.0) & (off_s <= 1.0)).all(), name
            then, now = replaced(then, **{column: None}), replaced(now, **{column: None})
        assert then.rows == now.rows, name
    assert kept.operator_query(store, "fastest").rows  # what was temporary is gone


def test_what_the_past_lacks_of_bearings_is_said(capsys: pytest.CaptureFixture[str]) -> None:
    """Tracks without a vessel, rates and the sites of sonars then are not stored."""
    assert "only the tracks that were given to a vessel are known" in kept.operator_queries()["bearings"].explanation
    with pytest.raises(SystemExit):
        main(["query", "--help"])
    said = " ".join(capsys.readouterr().out.split())
    assert "only those that were given to a vessel" in said
    assert "site of the sonar in the scenario" in said


def test_a_question_before_the_first_cycle_is_refused(store: Store) -> None:
    with pytest.raises(StoreError, match="holds nothing up to"):
        kept.operator_query(store, "fastest", {}, world.START_S)


def replaced(rows: kept.Rows, **values: Any) -> kept.Rows:
    """The rows with another value in some columns."""
    made = [tuple(values.get(name, value) for name, value in zip(rows.columns, row, strict=True)) for row in rows.rows]
    return kept.Rows(rows.columns, made)


def test_a_vessel_is_silent_after_the_intervals_of_its_own_ais(url: str) -> None:
    """All were heard 40 s ago. Radar alone is silent after 15 s; class A under way (10 s) is silent, a vessel at anchor (180 s) not."""
    picture = replace(world.picture_of(0, 4), updated_s=np.full(4, world.instant_s(0) - 40.0))
    made = world.cycle_of(0, 4, picture)
    ais = made.tracks.take(np.flatnonzero(made.tracks.mmsi >= 0))
    no = np.zeros(len(ais), np.bool_)
    alarms = AisAlarms(ais.track_id, ais.mmsi, no, no, interval_s=np.array([10.0, 180.0]))
    with kept.open_store(url) as store:
        run = world.begin(store)
        world.write(store, run, 0, cycle=replace(made, alarms=alarms))
        found = kept.operator_query(store, "silent", {"run": str(run)})
        assert sorted(zip(found.column("vessel_id"), found.column("interval_s"), strict=True)) == [
            (1, 0.0),
            (2, 10.0),
            (3, 0.0),
        ]
        assert 4 in kept.operator_query(store, "silent", {"run": str(run), "intervals": "0.2"}).column("vessel_id")
