"""The land that radars mask in their video: that of a file, of the scenario, or of Natural Earth."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from coastwatch.errors import InputError
from coastwatch.scenario import load_scenario

pytestmark = pytest.mark.contract


def island(longitude: float) -> dict[str, Any]:
    corners = [[longitude, 54.2], [longitude + 0.1, 54.2], [longitude + 0.1, 54.3], [longitude, 54.2]]
    return {"type": "Polygon", "coordinates": [corners]}


def test_the_sensors_have_the_land_of_a_file_that_is_near_the_radars(tmp_path: Path) -> None:
    path = tmp_path / "coast.geojson"
    path.write_text(json.dumps({"type": "GeometryCollection", "geometries": [island(12.0), island(60.0)]}))
    sensors = load_scenario("heymann-table-1", {"coastline": f'"{path}"'}).sensors()
    assert [len(ring) for ring in sensors.land_deg] == [4]
    assert sensors.land_deg[0][1] == (54.2, 12.1)
    assert load_scenario("heymann-table-1").sensors().land_deg == ()


def test_a_basin_in_the_land_of_a_file_is_water(tmp_path: Path) -> None:
    path, basin = tmp_path / "coast.geojson", [[12.02, 54.21], [12.03, 54.21], [12.03, 54.22], [12.02, 54.21]]
    path.write_text(json.dumps({"type": "Polygon", "coordinates": [*island(12.0)["coordinates"], basin]}))
    rings = load_scenario("heymann-table-1", {"coastline": f'"{path}"'}).sensors().land_deg
    assert [ring[1] for ring in rings] == [(54.2, 12.1), (54.21, 12.03)]


def test_a_scenario_has_a_coastline_of_its_own_and_natural_earth_knows_land() -> None:
    assert len(load_scenario("video-harbour").sensors().land_deg) == 1
    rings = load_scenario("video-harbour", {"coastline": "natural_earth", "radars.0.range_nm": "12.0"}).sensors().land_deg
    corners = np.concatenate([np.array(ring) for ring in rings])
    assert np.abs(corners - [54.15, 12.1]).max() < 0.5


def test_a_coastline_that_is_no_file_is_named() -> None:
    with pytest.raises(InputError, match=r"coastline: got 'nowhere\.geojson', which is no file"):
        load_scenario("heymann-table-1", {"coastline": "nowhere.geojson"}).sensors()
    with pytest.raises(InputError, match=r"coastline: got .*heymann-table-1/coastline.geojson"):
        load_scenario("heymann-table-1", {"coastline": "own"}).sensors()
