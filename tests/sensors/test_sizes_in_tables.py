"""Names, sizes and headings in tables of AIS: antennas of ships, rows of messages without a position, columns of types."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from coastwatch.sensors.recorded.tables.ais import AisTable

pytestmark = pytest.mark.golden

SATELLITE = (
    "MMSI,Message_ID,Time,Vessel_Name,Ship_Type,Dimension_to_Bow,Dimension_to_stern,Dimension_to_port,"
    "Dimension_to_starboard,SOG,Longitude,Latitude,COG,Heading"
)
"""The header of a provider of AIS received by satellites, shortened."""
AISHUB = "MMSI,TSTAMP,LATITUDE,LONGITUDE,COG,SOG,HEADING,NAVSTAT,NAME,TYPE,A,B,C,D"


def table(path: Path, header: str, *rows: str) -> AisTable:
    file = path / "ais.csv"
    file.write_text("\n".join([header, *rows]) + "\n")
    return AisTable(files=(file,))


def test_names_and_sizes_of_messages_without_a_position_are_read(tmp_path: Path) -> None:
    """They were refused as rows with an empty latitude, so that most ships had no name."""
    given = table(
        tmp_path,
        SATELLITE,
        "356051000,1,20210701_184245,,,,,,,14.8,-132.606438333,33.705075,118.4,118.0",
        "356051000,5,20210701_184251,EVER FAR,70,210,20,16,24,,,,,",
        "356051000,5,20210701_184851,EVER FAR,70,210,20,16,24,,,,,",  # the same again
        "356051000,8,20210701_184853,,,,,,,,,,,",  # nothing that is used
        "356051001,1,20210701_184901,NEAR,70,,,,,14.8,-132.6,,118.4,118.0",  # a report whose latitude is missing
    )
    reports, statics, faults = given.read()
    assert reports.time_s.tolist() == [1_625_164_965.0]
    assert reports.heading_deg.tolist() == [118.0]
    assert statics.name.tolist() == ["EVER FAR"] * 2
    assert statics.received_s.tolist() == [1_625_164_971.0, 1_625_165_331.0]
    assert (statics.length_m[0], statics.beam_m[0]) == (230.0, 40.0)
    antenna = statics.to_bow_m[0], statics.to_stern_m[0], statics.to_port_m[0], statics.to_starboard_m[0]
    assert antenna == (210.0, 20.0, 16.0, 24.0)
    assert [(fault.kind, fault.count) for fault in faults] == [("empty cell", 2)]
    (content,) = given.contents()
    assert (content.records, content.read, content.beside) == (1, 5, (("names and sizes", 2),))


def test_letters_of_sizes_and_numbers_of_types_are_known(tmp_path: Path) -> None:
    given = table(
        tmp_path,
        AISHUB,
        "235070762,2021-07-09 08:06:13 GMT,50.7,-1.1,90,5,511,0,ALPHA,70,100,50,10,12",
        "235070763,2021-07-09 08:06:14 GMT,50.8,-1.1,90,5,91,0,BETA,36,0,0,0,0",
    )
    reports, statics, faults = given.read()
    assert reports.time_s.tolist() == [1_625_817_973.0, 1_625_817_974.0]
    assert np.isnan(reports.heading_deg[0])
    assert reports.heading_deg[1] == 91.0
    assert statics.ship_type.tolist() == [70, 36]
    assert (statics.length_m[0], statics.beam_m[0], statics.to_bow_m[0], statics.to_port_m[0]) == (150.0, 22.0, 100.0, 10.0)
    sizes = statics.length_m[1], statics.beam_m[1], statics.to_bow_m[1], statics.to_starboard_m[1]
    assert np.isnan(sizes).all(), "zeros say that no size was sent"
    assert faults == ()


@pytest.mark.parametrize("sizes", ["100,50,10,999", "-100,150,10,12", "90000,50,10,12", "100,50,x,12", "100,50,,12"])
def test_an_antenna_where_no_message_can_have_it_is_none(tmp_path: Path, sizes: str) -> None:
    """Its ship would be moved by half of that."""
    _, statics, _ = table(tmp_path, AISHUB, f"235070762,2021-07-09 08:06:13,50.7,-1.1,90,5,91,0,ALPHA,70,{sizes}").read()
    assert statics.name.tolist() == ["ALPHA"]
    assert np.isnan([statics.length_m[0], statics.to_bow_m[0], statics.to_stern_m[0], statics.to_starboard_m[0]]).all()


def test_numbers_of_messages_are_no_types_of_ships(tmp_path: Path) -> None:
    rows = [f"1625817973,235070{k},50.7,-1.1,A {k},{kind}" for k, kind in enumerate((1, 3, 18, 27), 100)]
    _, statics, _ = table(tmp_path, "time,mmsi,lat,lon,name,type", *rows).read()
    assert statics.ship_type.tolist() == [-1] * 4
