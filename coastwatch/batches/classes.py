"""Classes of vessels that both an AIS ship type and the noise of a propeller can tell apart."""

from __future__ import annotations

from enum import IntEnum

import numpy as np

from coastwatch.batches.struct import Ints


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


def _of_types() -> Ints:
    """VesselClass of each ITU-R M.1371-5 ship type 0 to 99 (table 53), -1 where the type is of no class."""
    out = np.full(100, -1, np.int64)
    out[70:80], out[80:90], out[60:70], out[40:50] = (
        VesselClass.CARGO,
        VesselClass.TANKER,
        VesselClass.PASSENGER,
        VesselClass.PASSENGER,  # high speed craft
    )
    out[30], out[[35, 55]], out[[36, 37]] = VesselClass.FISHING, VesselClass.MILITARY, VesselClass.PLEASURE
    out[[31, 32, 33, 34, 50, 51, 52, 53, 54]] = VesselClass.SERVICE
    return out


CLASS_OF_TYPE = _of_types()
