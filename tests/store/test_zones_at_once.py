"""Zones in a database: what several operators add at once has numbers and names of its own."""

from __future__ import annotations

import time
from concurrent.futures import ThreadPoolExecutor
from importlib import import_module
from threading import Barrier
from typing import Any

import pytest

from coastwatch import store
from coastwatch.store import open_store

pytestmark = pytest.mark.contract

module = import_module("coastwatch.store.zones")  # the package has a function of this name
AT_ONCE = 6


def test_zones_that_are_added_at_once_have_numbers_and_names_of_their_own(url: str, monkeypatch: pytest.MonkeyPatch) -> None:
    write, start = module._write, Barrier(AT_ONCE)

    def slowly(*given: Any) -> None:
        time.sleep(0.05)  # the others have read the newest number by now, if they may
        write(*given)

    monkeypatch.setattr(module, "_write", slowly)
    with open_store(url) as opened, ThreadPoolExecutor(AT_ONCE) as threads:

        def add(k: int) -> Any:
            start.wait(10.0)
            return store.add_zone(opened, "sea", {"name": f"zone {k // 2}", "kind": "line"}, at_s=1.0, who="ana")

        made = [zone for zone in threads.map(add, range(AT_ONCE)) if zone is not None]
        assert sorted(zone.number for zone in made) == [module.FIRST_NUMBER + k for k in range(AT_ONCE // 2)]
        assert sorted(zone.definition["name"] for zone in made) == [f"zone {k}" for k in range(AT_ONCE // 2)]

        def change(k: int) -> Any:
            start.wait(10.0)
            given = {"name": "same", "kind": "line"}
            return store.change_zone(opened, "sea", module.FIRST_NUMBER + k // 2, given, at_s=2.0, who="bia")

        changed = list(threads.map(change, range(AT_ONCE)))
        assert sum(isinstance(zone, module.StoredZone) for zone in changed) == 2, "both changes of the zone that was first"
        assert [zone for zone in changed if isinstance(zone, str)] == ["same"] * (AT_ONCE - 2)
