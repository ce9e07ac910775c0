"""The details of a vessel without AIS say which ship it was by its last AIS, and until when."""

from dataclasses import replace

import pytest
import store_world as world

from coastwatch import store as kept
from coastwatch.operators import presentation
from coastwatch.spelling import utc_text

pytestmark = pytest.mark.contract

VESSEL, MMSI, NAME = 2, 710_000_001, "SHIP 1"
NONE = dict.fromkeys(("last_ais_mmsi", "last_ais_name", "last_ais_until_utc"))


def last_ais(store, run, vessel):
    details = presentation.vessel(store, presentation.run(store, run), vessel).details
    return {name: details[name] for name in NONE}


@pytest.mark.parametrize("keeps_mmsi", [True, False])
def test_the_last_ais_of_a_vessel_is_known_once_it_has_none(url, keeps_mmsi):
    """From cycle 4 on it has no AIS; it goes on under its MMSI, or that is of another vessel now."""
    with kept.open_store(url) as store:
        run = world.begin(store)
        for number in range(4):
            world.write(store, run, number)
            assert last_ais(store, run, VESSEL) == NONE, "it has AIS"
        for number in range(4, 7):
            picture = world.picture_of(number, 30)
            mmsi = picture.mmsi.copy()
            mmsi[picture.vessel_id == VESSEL] = -1
            cycle = world.cycle_of(number, 30, replace(picture, mmsi=mmsi))
            world.write(store, run, number, cycle=replace(cycle, picture=picture) if keeps_mmsi else cycle)
        until = utc_text(world.instant_s(3))
        assert last_ais(store, run, VESSEL) == dict(zip(NONE, (str(MMSI), NAME, until), strict=True))
        assert presentation.vessel(store, presentation.run(store, run), VESSEL).details["mmsi"] == (
            str(MMSI) if keeps_mmsi else None
        )
        assert last_ais(store, run, 1) == NONE, "it never had AIS"
        assert last_ais(store, run, 4) == NONE, "it has AIS"
