"""Ship types that AIS tells, against the class that a sensor of bearings gives a vessel by its sound."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coastwatch.batches import CLASS_OF_TYPE, CLASSES, AisStatics, Floats, Ints
from coastwatch.kernels.bearings.signatures import log_likelihood
from coastwatch.kernels.tables.lookup import find


@dataclass(frozen=True, eq=False)
class ShipTypes:
    """The class of each vessel that ever sent a ship type that tells one; the last one heard stands."""

    mmsi: Ints  # (S,) sorted
    vessel_class: Ints  # (S,) VesselClass

    @staticmethod
    def empty() -> ShipTypes:
        return ShipTypes(np.zeros(0, np.int64), np.zeros(0, np.int64))

    def heard(self, statics: AisStatics) -> ShipTypes:
        """What is known after these static reports."""
        code = np.clip(statics.ship_type, -1, len(CLASS_OF_TYPE))
        told = np.flatnonzero((code >= 0) & (code < len(CLASS_OF_TYPE)))
        told = told[CLASS_OF_TYPE[code[told]] >= 0]
        if len(told) == 0:
            return self
        told = told[np.lexsort((code[told], statics.received_s[told]))]
        mmsi = np.concatenate([statics.mmsi[told][::-1], self.mmsi])  # newest first
        every, first = np.unique(mmsi, return_index=True)
        vessel_class = np.concatenate([CLASS_OF_TYPE[code[told]][::-1], self.vessel_class])[first]
        return ShipTypes(every, vessel_class)

    def of(self, mmsi: Ints) -> Ints:
        """The class of each of these, -1 where it is not known. Args: (V,), -1 allowed."""
        row = find(self.mmsi, mmsi)
        return np.where(row >= 0, self.vessel_class[row], -1) if len(self.mmsi) else np.full(len(mmsi), -1, np.int64)


def signature_gain(signatures: Ints, known: Ints, confusion: Floats, habit: float, doubt: float) -> Floats:
    """What the log odds of a pair gain, for each bearing track and each class of vessel; last column: a vessel of unknown class.

    A vessel of unknown class, and one that nobody has seen, is of each class as often as the vessels whose class is known.
    Args: signatures: (N, C) looks that said each class; known: (V,) the classes of the vessels of the picture, -1 unknown; confusion:
    (C, C) true, said; habit: as in coastwatch/kernels/signatures.py; doubt: that a ship is not what its AIS says.
    Returns: (N, C + 1), 0 where there was no look.
    """
    often = np.bincount(known[known >= 0], minlength=CLASSES) + 1.0
    likelihood = log_likelihood(signatures, confusion, habit)
    most = likelihood.max(axis=1, keepdims=True)
    each = np.exp(likelihood - most)
    anyone = (each * (often / often.sum())).sum(axis=1, keepdims=True)
    out = np.zeros((len(signatures), CLASSES + 1))
    out[:, :CLASSES] = np.log((1.0 - doubt) * each + doubt * anyone) - np.log(anyone)
    out[signatures.sum(axis=1) == 0] = 0.0
    return out
