"""Raw NMEA: the recordings of ../shared/data with the counts that their READMEs give."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from nmea_sentences import ASSUMED, read_all

from coastwatch.batches import AisReports
from coastwatch.batches.ais_codes import is_vessel
from coastwatch.sensors.recorded.nmea.feed import Nmea

pytestmark = pytest.mark.golden

DATA = Path(__file__).parents[2].parent / "shared" / "data"


def dataset(name: str) -> Path:
    path = DATA / name
    if not path.exists():
        pytest.skip(f"{path} is not on this machine")
    return path


def accounted(reports: AisReports, statics: int, faults: dict[str, int]) -> int:
    notes = ("set aside: time missing", "set aside: late", "file cut")
    return len(reports) + statics + sum(n for k, n in faults.items() if not k.startswith(notes))


def test_pyais_sample_is_accounted_for() -> None:
    reports, statics, faults = read_all(Nmea(files=(dataset("pyais_nmea/nmea_data_sample.txt"),), assume_start_utc=ASSUMED))
    counts = {f.kind: f.count for f in faults}
    assert counts["empty payload"] == 100  # the README: 100 do not decode, 88 and more of them empty
    assert counts["lone part of a message"] == 20
    assert accounted(reports, len(statics), counts) == 898
    assert reports.position_deg[:, 0].min() > 35.6 - 0.1
    assert reports.position_deg[:, 0].max() < 38.6 + 0.1


def test_danish_stream_is_accounted_for() -> None:
    reports, statics, faults = read_all(Nmea(files=(dataset("aislib_stream/stream_example.txt.gz"),)))
    counts = {f.kind: f.count for f in faults}
    assert accounted(reports, len(statics), counts) == 4051
    odd = ~is_vessel(reports.mmsi)
    assert len(np.unique(reports.mmsi[~odd])) == 1382
    assert {123456789, 24466031} <= set(reports.mmsi[odd].tolist())  # vessels whose number is wrong stay, as sent
    assert len(np.unique(reports.mmsi[odd])) == 6
    assert not [
        k for k in counts if k in ("checksum", "undecodable", "half a line", "lone part of a message", "time going backwards")
    ]
    assert 0.0 < (reports.received_s - reports.time_s).max() < 30.0
    assert (np.diff(reports.received_s) >= 0.0).all()
    assert 25.0 < reports.received_s[-1] - reports.received_s[0] <= 28.9


def test_norwegian_tag_blocks_are_read() -> None:
    file = dataset("kystverket_tagblock/norwegian.raw")
    assert sum(line.startswith("\\") for line in file.read_text().splitlines()) == 197
    reports, _, faults = read_all(Nmea(files=(file,)))
    counts = {f.kind: f.count for f in faults}
    assert reports.received_s.min() == 1733782034.0
    assert reports.received_s.max() <= 1733782039.0
    assert len(np.unique(reports.mmsi[is_vessel(reports.mmsi)])) == 142
    assert len(np.unique(reports.mmsi)) == 146
    assert not [k for k in counts if "tag block" in k or "part" in k]
    assert 56.9 - 0.1 < reports.position_deg[:, 0].min() < reports.position_deg[:, 0].max() < 71.3 + 0.1


@pytest.mark.parametrize(("name", "vdo", "least"), [("gofree-merrimac.log.gz", 0, 1290), ("nais300-merrimac.log", 130, 375)])
def test_logs_of_a_ship_are_dated_by_its_clock(name: str, vdo: int, least: int) -> None:
    reports, _, faults = read_all(Nmea(files=(dataset(f"signalk_logs/{name}"),)))
    counts = {f.kind: f.count for f in faults}
    assert counts.get("position not available", 0) == vdo
    assert len(reports) >= least
    assert "time missing" not in counts
    assert reports.received_s[-1] - reports.received_s[0] < 145.0


@pytest.mark.parametrize("folder", ["ais_vectors_gpsd", "ais_vectors_libais"])
def test_decoder_vectors_stop_nothing(folder: str) -> None:
    files = [p for p in sorted(dataset(folder).iterdir()) if p.name not in ("README.md", "COPYING", "LICENSE")]
    for file in files:
        reports, statics, faults = read_all(Nmea(files=(file,), assume_start_utc=ASSUMED))
        assert len(reports) + len(statics) + len(faults) > 0
        assert np.isfinite(reports.position_deg).all()
