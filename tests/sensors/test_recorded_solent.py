"""The Solent feed: truth and AIS kept apart, gaps never bridged, who is silenced, what the smoothed truth is worth."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from spans import span_of

from coastwatch.batches import Radars, Sensors, Sonars, Stations
from coastwatch.geodesy import KNOT_M_S, difference_m, to_plane
from coastwatch.sensors.recorded.datasets.solent import Solent
from coastwatch.sensors.recorded.tables.ais import AisTable
from coastwatch.sensors.simulated.radar import interpolated
from coastwatch.stage import Plan

DATA = Path(__file__).parents[2].parent / "shared" / "data" / "solent_ais"
START_S = 1452603731.0
PLAN = Plan(start_s=START_S + 600.0, period_s=3.0, cycles=200)
SITE = np.array([[50.795, -1.105], [50.75, -1.10]])
RANGE_M = 9000.0

pytestmark = [pytest.mark.golden, pytest.mark.skipif(not DATA.is_dir(), reason=f"{DATA} is not on this machine")]


def sensors() -> Sensors:
    one = np.ones(2)
    names = np.array(["fort", "pier"], "U32")
    radars = Radars(names, np.zeros(2, np.int64), SITE, RANGE_M * one, 3.0 * one, 10.0 * one, 0.005 * one)
    return Sensors(radars, Stations.empty(), Sonars.empty(), ("solent",), SITE[:1])


def load(seed: int = 1, plan: Plan = PLAN, **settings: Any) -> Any:
    return Solent(**settings).load(sensors(), seed, plan)


def test_the_jump_is_refused_and_the_recording_shared_out() -> None:
    recording = load()
    assert {f.kind: f.count for f in recording.faults if not f.kind.startswith("set aside")} == {"position jump": 1}
    assert any("245188000" in f.example and "13:41:20.973" in f.where for f in recording.faults)
    ais = recording.reports.ais
    original, _, _ = AisTable(files=(DATA / "SolentAIS_20160112_130211.csv.gz",)).read()
    said = set(zip(original.time_s.tolist(), original.mmsi.tolist(), original.position_deg[:, 0].tolist(), strict=True))
    assert set(zip(ais.time_s.tolist(), ais.mmsi.tolist(), ais.position_deg[:, 0].tolist(), strict=True)) <= said
    assert 0.45 < len(ais) / len(original) < 0.6
    assert len(np.unique(ais.mmsi)) == 91
    assert len(set(zip(ais.mmsi.tolist(), ais.origin.tolist(), strict=True))) == 91


def test_truth_never_bridges_a_gap() -> None:
    plan = Plan(start_s=START_S, period_s=3.0, cycles=1690)
    truth = load(plan=plan).truth
    original, _, _ = AisTable(files=(DATA / "SolentAIS_20160112_130211.csv.gz",)).read()
    mmsi = np.unique(original.mmsi)
    for row, vessel in enumerate(truth.vessel):
        times = np.sort(original.time_s[original.mmsi == mmsi[vessel]])
        for a, b in pairwise(times):
            if b - a > 60.0:
                inside = (truth.time_s > a) & (truth.time_s < b)
                assert not truth.present[row, inside].any()
    assert np.isfinite(truth.position_deg).all()
    assert np.isfinite(truth.velocity_m_s).all()


def test_truth_of_odd_fixes_meets_the_even_ones_as_well_as_the_readme_says() -> None:
    plan = Plan(start_s=START_S, period_s=3.0, cycles=1690)
    recording = load(plan=plan)
    ais, truth = recording.reports.ais, recording.truth
    where = interpolated(truth)
    row = np.searchsorted(truth.vessel, ais.origin)
    known = (row < len(truth.vessel)) & (truth.vessel[np.minimum(row, len(truth.vessel) - 1)] == ais.origin)
    ais, row = ais.take(known), row[known]
    error = difference_m(ais.position_deg, where(row, ais.time_s))
    ok = np.isfinite(error).all(axis=1) & np.isfinite(ais.cog_deg)
    error, speed, course = error[ok], ais.sog_kn[ok] * KNOT_M_S, np.radians(ais.cog_deg[ok])
    across = error[:, 0] * np.cos(course) - error[:, 1] * np.sin(course)
    for low, high, p95 in ((0.5, 2.0, 11.0), (2.0, 5.0, 12.5), (5.0, 12.0, 13.5)):
        these = (speed >= low) & (speed < high)
        assert these.sum() > 500
        assert np.median(np.abs(across[these])) < 0.9  # the README: sd 0.5 to 0.9 m
        assert np.percentile(np.hypot(*error[these].T), 95) < p95  # the README: 9 to 12 m, with all the other fixes


def test_silenced_vessels_send_nothing_from_then_on() -> None:
    ais = load().reports.ais
    by_number = dict(zip(ais.mmsi.tolist(), ais.origin.tolist(), strict=True))
    recording = load(silence_mmsi=(235013375, 235069877), silence_from_s=120.0)
    assert recording.silenced == tuple(sorted(by_number[m] for m in (235013375, 235069877)))
    ais = recording.reports.ais
    last = ais.received_s[np.isin(ais.origin, recording.silenced)].max()
    assert PLAN.start_s + 90.0 < last <= PLAN.start_s + 120.0
    with pytest.raises(ValueError, match="123456789"):
        load(silence_mmsi=(123456789,))


def test_the_silenced_share_is_drawn_by_seed_from_moving_vessels_in_cover() -> None:
    a, b, c = load(seed=1, silence_share=0.3), load(seed=1, silence_share=0.3), load(seed=2, silence_share=0.3)
    assert a.silenced == b.silenced != c.silenced
    assert len(a.silenced) >= 3
    truth = a.truth
    for origin in a.silenced:
        row = int(np.flatnonzero(truth.vessel == origin)[0])
        here = truth.present[row]
        assert np.median(np.hypot(*truth.velocity_m_s[row, here].T)) > 0.5 * KNOT_M_S
        away = np.min([np.hypot(*to_plane(truth.position_deg[row, here], s).T) for s in SITE], axis=0)
        assert (away <= RANGE_M).mean() >= 0.5


def test_radars_see_the_truth_with_their_noise_and_clutter() -> None:
    recording = load(radar={"detection_probability": 0.9, "clutter_per_m2": 2e-8})
    radar, truth = recording.reports.radar, recording.truth
    real = radar.take(radar.origin >= 0)
    turns = 600.0 / 3.0 * 2
    assert abs((len(radar) - len(real)) / (turns * 2e-8 * np.pi * RANGE_M**2) - 1.0) < 0.1  # Poisson, 2 000 plots
    at = interpolated(truth)(np.searchsorted(truth.vessel, real.origin), real.time_s)
    error = real.range_m - np.hypot(*np.stack([to_plane(p, s) for p, s in zip(at, real.site_deg, strict=True)]).T)
    assert abs(error.std() / 10.0 - 1.0) < 0.05
    assert (np.diff(radar.received_s) >= 0.0).all()


def test_berthed_vessels_have_a_truth_only_where_asked() -> None:
    assert len(load(berthed_gap_s=400.0).truth.vessel) > len(load().truth.vessel) + 20


def test_the_span_is_that_of_the_recording() -> None:
    assert span_of(Solent()) == (START_S, 1452608802.0)


def test_a_missing_folder_is_named(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="nowhere"):
        span_of(Solent(root=tmp_path / "nowhere"))
