"""Codes of AIS: what an MMSI is of, navigational status, accuracy, and the classes of vessels that a ship type implies."""

from __future__ import annotations

from enum import IntEnum

import numpy as np

from coastwatch.kernels.arrays import Bools, Ints

FIRST_MID, LAST_MID = 201, 775
LARGEST_MMSI = 2**30 - 1
"""The field of a message has 30 bits. Numbers of ten digits can be sent, though no station has one."""

AIS_SART, MAN_OVERBOARD, EPIRB = 970, 972, 974
"""The first three digits of a distress transmitter, a man overboard device and an emergency beacon."""


class NavStatus(IntEnum):
    """Navigational status, as an officer of the watch sets it; -1 in a batch: not sent. Source: ITU-R M.1371-5, table 48."""

    UNDER_WAY_USING_ENGINE = 0
    AT_ANCHOR = 1
    NOT_UNDER_COMMAND = 2
    RESTRICTED_MANOEUVRABILITY = 3
    CONSTRAINED_BY_DRAUGHT = 4
    MOORED = 5
    AGROUND = 6
    ENGAGED_IN_FISHING = 7
    UNDER_WAY_SAILING = 8
    RESERVED_9 = 9  # high-speed craft with dangerous goods
    RESERVED_10 = 10  # wing-in-ground craft with dangerous goods
    TOWING_ASTERN = 11
    PUSHING_OR_TOWING_ALONGSIDE = 12
    RESERVED_13 = 13
    AIS_SART_ACTIVE = 14  # or a man overboard device or emergency beacon
    UNDEFINED = 15  # also a distress transmitter under test


def nav_status_text(status: int) -> str:
    """A navigational status in words, "at anchor"; a number that no message can hold as it is."""
    if not 0 <= status <= 15:
        return str(status)
    return NavStatus(status).name.lower().replace("_", " ").replace("ais sart", "AIS-SART")


class PositionAccuracy(IntEnum):
    """What a message states of its position; -1 in a batch: nothing. Source: ITU-R M.1371-5, tables 48 and 50."""

    UNAIDED = 0  # flag "low", and no integrity monitoring (RAIM) that would know the error
    HIGH = 1  # 10 m or better
    LOW = 2  # flag "low", and RAIM expects an error above 10 m


def is_mid(number: Ints) -> Bools:
    """Whether three digits are of a country."""
    return (number >= FIRST_MID) & (number <= LAST_MID)


def is_vessel(mmsi: Ints) -> Bools:
    """Whether an MMSI has the form of a vessel's: MID and six digits, 98 MID and four (a craft of a mother ship), or of a distress
    device: 970, 972, 974 and six.

    Source: Recommendation ITU-R M.585-9 (2022), annex 1. MID are the three digits of a country, 201 to 775.
    """
    craft = (mmsi // 10_000_000 == 98) & is_mid(mmsi // 10_000 % 1000)
    return np.asarray(is_mid(mmsi // 1_000_000) | craft | is_distress_device(mmsi))


def is_distress_device(mmsi: Ints) -> Bools:
    """Whether an MMSI is of a distress transmitter, a man overboard device or an emergency beacon."""
    number = mmsi // 1_000_000
    return np.asarray((number == AIS_SART) | (number == MAN_OVERBOARD) | (number == EPIRB))


def is_coast_station(mmsi: Ints) -> Bools:
    """Whether an MMSI is of a coast or base station: 00 MID and four digits."""
    return (mmsi < 10_000_000) & is_mid(mmsi // 10_000)


def is_aid_to_navigation(mmsi: Ints) -> Bools:
    """Whether an MMSI is of an aid to navigation: 99 MID and four digits."""
    return np.asarray((mmsi // 10_000_000 == 99) & is_mid(mmsi // 10_000 % 1000))


def is_rescue_aircraft(mmsi: Ints) -> Bools:
    """Whether an MMSI is of a search and rescue aircraft: 111 MID and three digits."""
    return np.asarray((mmsi // 1_000_000 == 111) & is_mid(mmsi // 1000 % 1000))


class VesselClass(IntEnum):
    """Class of a vessel that both an AIS ship type and the noise of a propeller can tell; -1 in a batch is unknown."""

    CARGO = 0
    TANKER = 1
    PASSENGER = 2
    FISHING = 3
    SERVICE = 4  # tugs, pilots, dredgers and the like
    PLEASURE = 5  # sailing and motor yachts
    MILITARY = 6  # and law enforcement


CLASSES = len(VesselClass)

CLASS_OF_TYPE = np.full(100, -1, np.int64)
"""VesselClass of each ITU-R M.1371-5 ship type 0 to 99 (table 53), -1 where the type is of no class."""

CLASS_OF_TYPE[70:80], CLASS_OF_TYPE[80:90] = VesselClass.CARGO, VesselClass.TANKER
CLASS_OF_TYPE[40:50] = CLASS_OF_TYPE[60:70] = VesselClass.PASSENGER  # from 40: high speed craft
CLASS_OF_TYPE[30], CLASS_OF_TYPE[[35, 55]], CLASS_OF_TYPE[[36, 37]] = (
    VesselClass.FISHING,
    VesselClass.MILITARY,
    VesselClass.PLEASURE,
)
CLASS_OF_TYPE[[31, 32, 33, 34, 50, 51, 52, 53, 54]] = VesselClass.SERVICE
