"""Wire formats: each is found through the table, and what one sends is what it reads."""

from __future__ import annotations

import inspect
import math
import pkgutil
from dataclasses import replace
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from pyais import NMEAMessage
from system_track_bytes import system_track

import coastwatch.formats
from coastwatch.batches import (
    AisReports,
    AzimuthReference,
    HeadingReports,
    RadarReports,
    Radars,
    Reports,
    Sensors,
    Sonars,
    Stations,
    TrackSources,
)
from coastwatch.errors import InputError
from coastwatch.formats.asterix.decoder import AsterixDecoder
from coastwatch.formats.asterix.system_tracks import SAC, SIC
from coastwatch.formats.decoding import FeedSettings
from coastwatch.formats.format import Format, OutSettings, Vessels
from coastwatch.formats.registry import DECODED, FORMATS, PICTURES
from coastwatch.formats.target_numbers import TargetNumbers
from coastwatch.scenario.sites import TrackSource, sensors_of

pytestmark = pytest.mark.contract

NOW_S = 1_782_907_200.25
FORMATS_OF_MODULES = [
    one
    for module in pkgutil.walk_packages(coastwatch.formats.__path__, "coastwatch.formats.")
    if module.name != "coastwatch.formats.registry"
    for _, one in inspect.getmembers(import_module(module.name), lambda value: isinstance(value, Format))
]


def sensors() -> Sensors:
    """A coast with one radar on a ship, one track source and nothing else."""
    one = np.full(1, 10.0)
    ship = np.array([AzimuthReference.HEADING])
    radars = Radars(np.array(["ship"]), np.zeros(1, np.int64), np.zeros((1, 2)), one, one, one, one, azimuth_reference=ship)
    sources = TrackSources(np.array(["other"]), np.full((1, 2), np.nan), np.zeros(1), one, one, one)
    return Sensors(radars, Stations.empty(), Sonars.empty(), ("region",), np.zeros((1, 2)), track_sources=sources)


def vessels(**other: object) -> Vessels:
    """Four vessels: north-east, south-west and past the date line, without motion, and without accuracy."""
    columns = {
        "every_id": np.array([3, 5, 2**40 + 7, 2**40 + 9]),
        "vessel_id": np.array([3, 5, 2**40 + 7, 2**40 + 9]),
        "position_deg": np.array([[50.7, -1.1], [-22.9, -43.2], [-17.5, 179.9999], [70.0, 25.0]]),
        "sog_kn": np.array([12.0, 0.5, np.nan, 30.0]),
        "cog_deg": np.array([45.0, 200.0, np.nan, 359.0]),
        "major_m": np.array([40.0, 25.0, 10.0, np.nan]),
        "minor_m": np.array([10.0, 25.0, 5.0, np.nan]),
        "orientation_deg": np.array([30.0, 0.0, 120.0, np.nan]),
        "mmsi": np.array([235_000_001, -1, -1, -1]),
        "name": ["SHIP", None, None, None],
    }
    return Vessels(1, NOW_S, 3.0, **(columns | other))  # type: ignore[arg-type]


def datagrams(given: Vessels) -> list[bytes]:
    pictures = FORMATS["asterix"].pictures
    assert pictures is not None
    return list(pictures(OutSettings()).messages(given))


def test_every_format_that_a_module_declares_is_in_the_table_under_its_name() -> None:
    assert {one.name for one in FORMATS_OF_MODULES} == set(FORMATS)
    assert all(FORMATS[one.name] is one for one in FORMATS_OF_MODULES)


@pytest.mark.parametrize("name", DECODED)
def test_a_format_of_the_table_makes_decoders_that_survive_what_is_not_theirs(name: str) -> None:
    decode = FORMATS[name].decoder
    assert decode is not None
    made = [decode(FeedSettings(f"feed {k}", "x", source="other", number=k), sensors()) for k in range(2)]
    for decoder in made:
        decoder.decode([(NOW_S, b"\x00not of any format", 0)], None)
        assert sum(fault.count for fault in decoder.tally.faults()) == 1
    sources = FORMATS[name].report_sources(made)
    assert sources
    for reports_between in sources:
        assert len(reports_between(-math.inf, math.inf)) == 0
    assert isinstance(made[0].reports_between(-math.inf, math.inf), Reports)


@pytest.mark.parametrize("name", PICTURES)
def test_a_format_of_the_table_sends_each_vessel_once_and_none_of_none(name: str) -> None:
    pictures = FORMATS[name].pictures
    assert pictures is not None
    encoder, given = pictures(OutSettings((50.0, -1.0))), vessels()
    messages = list(encoder.messages(given))
    assert len(messages) == len(set(messages)) == 4
    assert list(encoder.messages(given)) == messages
    assert not list(encoder.messages(vessels(**{name: value[:0] for name, value in vars(given).items() if name in ROWS})))


ROWS = [name for name, value in vars(vessels()).items() if hasattr(value, "__len__") and name != "every_id"]


def test_system_tracks_are_read_back_by_the_decoder_of_the_house() -> None:
    given = vessels()
    decoder = AsterixDecoder(FeedSettings("x", "x", {f"{SAC}/{SIC}": str(sensors().track_sources.name[0])}), sensors())
    decoder.decode([(NOW_S, datagram, 0) for datagram in datagrams(given)], None)
    tracks = decoder.reports_between(-math.inf, math.inf).tracks
    assert decoder.tally.faults() == ()
    assert sorted(tracks.number.tolist()) == sorted((given.vessel_id % 65536).tolist())
    order = np.argsort(tracks.number)
    assert np.allclose(tracks.time_s, NOW_S, atol=1 / 128)
    assert np.allclose(tracks.position_deg[order], given.position_deg, atol=180.0 / 2**25)
    speed, course = given.sog_kn * 1852.0 / 3600.0, np.radians(given.cog_deg)
    velocity = np.stack([speed * np.sin(course), speed * np.cos(course)], 1)
    assert np.allclose(tracks.velocity_m_s[order], velocity, atol=0.25, equal_nan=True)
    axis, across = np.radians(given.orientation_deg), np.radians(given.orientation_deg + 90.0)
    for row in range(3):
        u, v = (np.array([math.sin(a[row]), math.cos(a[row])]) for a in (axis, across))
        true = given.major_m[row] ** 2 * np.outer(u, u) + given.minor_m[row] ** 2 * np.outer(v, v)
        found = tracks.covariance[order][row, :2, :2]
        assert np.allclose(found, true, atol=0.5 * 2.0 * given.major_m[row])  # of steps of half a metre
    assert np.isnan(tracks.covariance[order][3]).all()


@pytest.mark.parametrize(
    ("sources", "said"),
    [
        (2, "25/1; its address needs ?25/1=NAME with the name of a track source"),
        (0, """25/1; no track source: --set 'track_sources=[{name="a"}]' makes one"""),
    ],
)
def test_system_tracks_of_no_known_source_are_refused_with_what_the_address_needs(sources: int, said: str) -> None:
    names = tuple(TrackSource(name=f"source {k}") for k in range(sources))
    decoder = AsterixDecoder(FeedSettings("x", "x"), sensors_of((), (), (), names))
    decoder.decode([(NOW_S, datagram, 0) for datagram in datagrams(vessels())], None)
    (fault,) = decoder.tally.faults()
    assert (fault.count, fault.example) == (4, said)


def test_system_tracks_are_what_the_tables_of_the_specification_say() -> None:
    given = vessels()
    found = [system_track(datagram) for datagram in datagrams(given)]
    assert [(one.sac, one.sic, one.number) for one in found] == [(25, 1, k) for k in (vessels().vessel_id % 65536).tolist()]
    assert all(abs(one.of_day_s - NOW_S % 86_400.0) <= 1 / 128 for one in found)
    where = np.array([[one.latitude_deg, one.longitude_deg] for one in found])
    assert np.allclose(where, given.position_deg, atol=180.0 / 2**25)
    assert found[0].velocity_m_s == pytest.approx((4.365, 4.365), abs=0.25)
    assert found[2].velocity_m_s is None
    assert found[0].sigma_m == pytest.approx((21.794, 35.0), abs=0.5)  # of 40 m along 30 deg and 10 m across
    assert found[0].root_covariance_m == pytest.approx(25.487, abs=0.5)
    assert found[2].root_covariance_m is not None
    assert found[2].root_covariance_m < 0.0
    assert found[3].sigma_m is None


def test_midnight_and_north_are_0_in_every_format() -> None:
    midnight, north = 86_400.0 * 20_000, 359.96  # day 20,000
    given = vessels(cog_deg=np.full(4, north), sog_kn=np.full(4, 10.0))
    last = replace(given, time_s=midnight - 0.001)
    assert {system_track(data).of_day_s for data in datagrams(last)} == {0.0}
    for name, course in (("cot", b'course="0.0"'), ("ttm", b",10.0,0.0,T,")):
        pictures = FORMATS[name].pictures
        assert pictures is not None
        assert all(course in message for message in pictures(OutSettings((50.0, -1.0))).messages(given)), name
    one, zero, place = np.array([north]), np.zeros(1, np.int64), np.array([[50.0, -1.0]])
    when = np.array([midnight - 0.001])
    ais = AisReports(when, when, np.array([235_000_001]), place, np.array([10.0]), one, np.array([False]))
    line = encoded("ais", Reports(ais=ais))
    assert NMEAMessage(line.rpartition(b"\\")[2]).decode().course == 0.0
    headings = HeadingReports(zero, when, when, one + 0.036)
    assert b"HDT,0.00,T" in encoded("heading", Reports(headings=headings))


@pytest.mark.parametrize(("range_nm", "of_day_s"), [(1.0, 86_399.999), (255.996, 1.0), (256.0, 1.0)])
def test_a_plot_is_sent_where_and_when_it_is_or_refused(range_nm: float, of_day_s: float) -> None:
    when, metres = np.array([86_400.0 * 20_000 + of_day_s]), np.array([range_nm * 1852.0])
    zero, site = np.zeros(1, np.int64), np.zeros((1, 2))
    plots = Reports(radar=RadarReports(zero, when, when, metres, np.array([359.999]), site, zero))
    if range_nm >= 256.0:
        with pytest.raises(InputError, match=r"radar 1: got a range of 256\.0 NM, needed at most 255\.996"):
            encoded("asterix", plots)
        return
    data = encoded("asterix", plots)  # 3 octets of the block, 1 of what is there, 2 of the source, 3 of the time
    assert int.from_bytes(data[6:9], "big") == round(of_day_s * 128) % (86_400 * 128)
    assert int.from_bytes(data[10:12], "big") == round(range_nm * 256)
    assert int.from_bytes(data[12:14], "big") == 0  # of 360 degrees
    decoder = AsterixDecoder(FeedSettings("x", "x"), sensors())
    decoder.decode([(float(when[0]), data, 0)], None)
    assert decoder.reports_between(-math.inf, math.inf).radar.time_s == pytest.approx(when, abs=1 / 128)


def encoded(name: str, reports: Reports) -> bytes:
    encode = FORMATS[name].encode
    assert encode is not None
    return encode(reports, sensors())[0]


def test_a_vessel_keeps_its_track_number_while_others_come_and_go() -> None:
    pictures = FORMATS["asterix"].pictures
    assert pictures is not None
    encoder, given = pictures(OutSettings()), vessels()
    first = {system_track(d).number for d in encoder.messages(given)}
    less = vessels(every_id=given.every_id[1:], vessel_id=given.vessel_id[1:2])
    assert [system_track(d).number for d in encoder.messages(less)] == (less.vessel_id % 65536).tolist()
    assert first == set((given.vessel_id % 65536).tolist())


def test_numbers_of_targets_outlive_a_restart_and_are_not_given_again_at_once() -> None:
    """The lowest free number was given: after a restart the numbers of most were those of other vessels."""
    before, after = TargetNumbers(range(1000)), TargetNumbers(range(1000))
    for vessels_here in ([1, 2, 3, 70_004, 5], [2, 3, 70_004, 5, 6], [2, 70_004, 6]):
        before.keep(vessels_here)
    after.keep([2, 70_004, 6])
    assert [before.get(v) for v in (2, 70_004, 6)] == [after.get(v) for v in (2, 70_004, 6)] == [2, 4, 6]
    before.keep([2, 70_004, 6, 7])
    assert before.get(7) == 7, "not 0, 1 or 3, which others have just had"
    few = TargetNumbers(range(3))
    few.keep([1, 4, 7, 10])
    assert [few.get(v) for v in (1, 4, 7, 10)] == [1, 2, 0, None]


def test_the_formats_open_no_socket_and_no_file_but_that_of_land() -> None:
    texts = {path.name: path.read_text("utf-8") for path in Path(coastwatch.formats.__path__[0]).rglob("*.py")}
    del texts["coastline.py"]
    assert len(texts) > 10
    wrong = [name for name, text in texts.items() if "import socket" in text or "pathlib" in text or "open(" in text]
    assert wrong == []
