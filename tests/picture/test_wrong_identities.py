"""No vessel carries the MMSI of another ship in dense traffic, by the truth of the simulation."""

import pytest

from coastwatch.scenario import load_scenario
from scaling.decisions.wrong_identities import counts_of

pytestmark = pytest.mark.whole

DENSE = {"input.count": "150", "input.area_width_nm": "1.2", "input.area_height_nm": "1.2", "cycles": "30"}


@pytest.mark.parametrize("seed", [pytest.param(1, marks=pytest.mark.slow), 2])
def test_no_vessel_has_the_mmsi_of_another_ship(seed):
    """In both seeds an AIS track moves from one radar track to another, whose vessel kept the MMSI: 1 wrong, 1 doubled."""
    end = counts_of(load_scenario("guanabara", DENSE), seed, last=10)[-1]
    assert (end.wrong, end.doubled) == (0, 0)
    assert end.former > 0, "some go on under a former MMSI"
