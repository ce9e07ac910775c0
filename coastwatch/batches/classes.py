"""Classes of vessels that both an AIS ship type and the noise of a propeller can tell apart."""

from __future__ import annotations

from enum import IntEnum

import numpy as np


class VesselClass(IntEnum):
    """Class of a vessel; -1 in a batch is unknown."""

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
