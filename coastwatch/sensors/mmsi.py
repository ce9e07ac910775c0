"""Which numbers are a vessel's: the first digits of a maritime mobile service identity.

Source: Recommendation ITU-R M.585-9 (2022), annex 1. MID are the three digits of a country, 201 to 775.
"""

from __future__ import annotations

import numpy as np

from coastwatch.batches import Bools, Ints
from coastwatch.sensors.faults import SET_ASIDE

FIRST_MID, LAST_MID = 201, 775

NOT_AN_MMSI = "not an MMSI"
COAST_STATION = SET_ASIDE + "coast station"
AID_TO_NAVIGATION = SET_ASIDE + "aid to navigation"
AIRCRAFT = SET_ASIDE + "search and rescue aircraft"


def _is_mid(number: Ints) -> Bools:
    return (number >= FIRST_MID) & (number <= LAST_MID)


def vessel(mmsi: Ints) -> Bools:
    """Which are a vessel's number: MID and six digits, 98 MID and four (a craft of a mother ship), or 970, 972, 974 and six
    (distress transmitter, man overboard, emergency beacon: whoever sends them must be in the picture).
    """
    craft = (mmsi // 10_000_000 == 98) & _is_mid(mmsi // 10_000 % 1000)
    distress = np.isin(mmsi // 1_000_000, (970, 972, 974))
    return np.asarray(_is_mid(mmsi // 1_000_000) | craft | distress)


def others(mmsi: Ints) -> dict[str, Bools]:
    """Which are no vessel's, by kind of fault: 00 MID and four, 99 MID and four, 111 MID and three; the rest is not an MMSI."""
    coast = (mmsi < 10_000_000) & _is_mid(mmsi // 10_000)
    aid = (mmsi // 10_000_000 == 99) & _is_mid(mmsi // 10_000 % 1000)
    aircraft = (mmsi // 1_000_000 == 111) & _is_mid(mmsi // 1000 % 1000)
    return {
        COAST_STATION: coast,
        AID_TO_NAVIGATION: aid,
        AIRCRAFT: aircraft,
        NOT_AN_MMSI: ~(vessel(mmsi) | coast | aid | aircraft),
    }
