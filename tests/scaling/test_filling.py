"""A database that is filled for measurements is one that the writer of cycles could have left."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from coastwatch import store as kept
from coastwatch.store.schema.migrate import check
from scaling.load.filling import fill
from scaling.load.queries import MEASURED, newest_run

pytestmark = pytest.mark.contract

POINTS, VESSELS = 20_000, 300


@pytest.fixture(scope="module")
def filled(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path: Path = tmp_path_factory.mktemp("filling") / "x.db"
    fill(f"sqlite:///{path}", POINTS, VESSELS, 1, lambda said: None)
    return path


def test_it_is_whole(filled: Path) -> None:
    assert check(str(filled)) == []


def test_the_past_of_its_last_cycle_is_its_picture(filled: Path) -> None:
    """Within the bound, and with the same names and identities."""
    with kept.open_store(str(filled), create=False) as store:
        of = newest_run(store)
        now, then = kept.picture(store, of.run_id), kept.picture(store, of.run_id, of.to_s)
        assert len(now) == len(of.vessel_id) > VESSELS / 2
        for name in ("vessel_id", "mmsi", "name", "flags"):
            assert now.column(name) == then.column(name)
        assert np.abs(now.array("latitude_deg") - then.array("latitude_deg")).max() < 1e-4
        points = kept.history(store, of.run_id)
        assert len(points) > 0.9 * POINTS
        mmsi = next(value for value in now.column("mmsi") if value)
        asked = kept.operator_query(store, "history_of_mmsi", {"mmsi": mmsi, "minutes": 1e6})
        assert len(asked.rows) == points.column("mmsi").count(mmsi) > 0
        assert set(MEASURED) < set(then.columns)
