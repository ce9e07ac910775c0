"""Close pairs of vessels are those found by comparing all, anywhere on Earth."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import store_world as world
from test_plans import said

from coastwatch import store as kept
from coastwatch.geodesy import KNOT_M_S, offset_deg
from coastwatch.store.read import close_pairs

pytestmark = pytest.mark.contract

VESSELS = 500
PLACES = {
    "equator": (0.0, 179.99),
    "coast": (-22.9, -43.2),
    "arctic": (84.0, 10.0),
    "seam": (59.0, 180.0),
    "pole": (89.99, 0.0),
}


def crowd(seed: int, place: tuple[float, float]) -> Any:
    """Vessels within some 10 km, a third of them at rest, some with no speed known."""
    rng = np.random.default_rng([seed, 93])
    picture = world.picture_of(0, VESSELS)
    n = len(picture)
    position = offset_deg(np.broadcast_to(place, (n, 2)), rng.normal(0.0, 6000.0, (n, 2)))
    position[:, 0] = np.clip(position[:, 0], -90.0, 90.0)
    velocity = rng.normal(0.0, 8.0 * KNOT_M_S, (n, 2)) * (rng.random((n, 1)) < 0.7)
    return world.cycle_of(0, 0, replace(picture, position_deg=position, velocity_m_s=velocity))


def all_pairs(found: close_pairs.Vessels, radius_m: float) -> tuple[close_pairs.Vessels, close_pairs.Vessels]:
    """Every pair of vessels, however far apart, the smaller number first."""
    first, second = np.triu_indices(len(found.vessel_id), 1)
    return found.take(first), found.take(second)


@pytest.mark.parametrize("place", PLACES)
def test_the_tree_gives_what_all_pairs_give(place: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: dict[str, list[dict[str, Any]]] = {
        "closest_pairs": [{"within_m": 300.0}, {"within_m": 4000.0, "min_sog_kn": 6.0}, {"within_m": 0.0}],
        "closest_approach": [{}, {"search_nm": 0.5, "minutes": 3.0}, {"search_nm": 20.0}, {"minutes": 0.0}, {"search_nm": 0.0}],
    }
    with kept.open_store(str(tmp_path / "x.db")) as store:
        world.write(store, world.begin(store), 0, cycle=crowd(7, PLACES[place]))
        for name, questions in asked.items():
            for parameters in questions:
                found = kept.operator_query(store, name, {**parameters, "count": 10**6})
                with monkeypatch.context() as patched:
                    patched.setattr(close_pairs, "_pairs_within", all_pairs)
                    assert found == kept.operator_query(store, name, {**parameters, "count": 10**6}), (name, parameters)
            assert place == "pole" or len(kept.operator_query(store, name).rows) > 0


@pytest.mark.parametrize("name", ["closest_pairs", "closest_approach"])
def test_vessels_are_read_once(name: str, tmp_path: Path) -> None:
    """No join of the picture with itself: one statement names the table, and names it once."""
    with kept.open_store(str(tmp_path / "x.db")) as store:
        world.write(store, world.begin(store), 0, cycle=crowd(3, PLACES["coast"]))
        with said(store.engine) as statements:
            kept.operator_query(store, name)
    of_vessels = [statement for statement, _ in statements if "FROM vessel" in statement]
    assert len(of_vessels) == 1
    assert "JOIN" not in of_vessels[0]
