"""The newest picture of a run in memory, as the API answers from it: of a cycle that was just computed, or of a database."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, reduce
from operator import or_
from typing import Any

import lazy_loader
import numpy as np

from coastwatch import store
from coastwatch.batches import AisStatics, Array, Floats, Ints, Sensors, SourceKind
from coastwatch.centre import Cycle
from coastwatch.kernels.tables.lookup import find
from coastwatch.store import Store, Table
from coastwatch.store.bbox import Box
from coastwatch.store.read.picture_queries import COLUMNS, STATIC
from coastwatch.store.rows import NullableId, motion, source_texts
from coastwatch.store.write.to_rows import membership, static_rows

polars = lazy_loader.load("polars")  # only a search needs it
SEARCHED = ("vessel_id", "mmsi", "name", "call_sign")

KIND_OF_SOURCE = {SourceKind.AIS: 1, SourceKind.RADAR: 2, SourceKind.BEARING: 4}
"""The bit that a source of this kind sets in the kind of a vessel."""

OWN = tuple(name for name in COLUMNS if name not in (*STATIC, "sources"))
"""Columns of the picture that are kept as arrays, one value a vessel."""

ABSENT = {"name": None, "call_sign": None, "ship_type": -1, "length_m": np.nan, "beam_m": np.nan}
Statics = dict[int, tuple[Any, ...]]
"""MMSI -> values of STATIC, absent ones as in ABSENT."""


@dataclass(frozen=True, eq=False)
class LivePicture:
    """One picture. V vessels, sorted by vessel_id."""

    run_id: int  # in the database
    cycle: int
    time_s: float
    own: Table  # columns OWN
    kind: Array  # (V,) uint8, sum of KIND_OF_SOURCE
    source_codes: Ints  # (V,) into source_texts
    source_texts: Sequence[str]
    statics: Statics

    def __len__(self) -> int:
        return len(self.own)

    def array(self, name: str) -> Array:
        """A column of OWN."""
        return self.own.array(name)

    def positions_deg(self) -> Floats:
        """Latitude and longitude of each vessel. (V, 2)"""
        return np.stack([self.array("latitude_deg"), self.array("longitude_deg")], 1)

    def at(self, vessel_id: Ints) -> Ints:
        """The rows of vessels by their ids; those that are not there are left out."""
        rows = find(self.array("vessel_id"), vessel_id)
        return rows[rows >= 0]

    def take(self, rows: Ints) -> LivePicture:
        """Some of the vessels. Args: rows: (K,) ascending."""
        return replace(self, own=self.own.take(rows), kind=self.kind[rows], source_codes=self.source_codes[rows])

    def rows(self, at: Ints) -> Table:
        """These vessels with all columns of the stored picture. Args: at: (K,) row numbers."""
        columns = {name: self.own.array(name)[at] for name in OWN}
        statics = [self.statics.get(mmsi) for mmsi in columns["mmsi"].tolist()]
        columns |= {name: _static_column(name, statics) for name in STATIC}
        columns["sources"] = self.column("sources", at)
        return Table(COLUMNS, tuple(columns[name] for name in COLUMNS))

    def column(self, name: str, at: Ints) -> Array:
        """One column of `rows`. Args: at: (K,) row numbers."""
        if name in OWN:
            return self.own.array(name)[at]
        if name == "sources":
            return np.array([text or None for text in self.source_texts], object)[self.source_codes[at]]
        return _static_column(name, [self.statics.get(mmsi) for mmsi in self.own.array("mmsi")[at].tolist()])

    def search(self, text: str) -> Ints:
        """Rows whose name, call sign, MMSI or vessel id has this text: those that equal it first, then those that begin with it."""
        wanted, ranks = text.strip().upper(), []
        for name in SEARCHED:
            column = polars.col(name)
            begins = polars.when(column.str.starts_with(wanted)).then(1)
            has = begins.when(column.str.contains(wanted, literal=True)).then(2).otherwise(3)
            ranks.append(polars.when(column == wanted).then(0).otherwise(has))
        rank = self._searched.select(polars.min_horizontal(ranks)).to_series().to_numpy()
        rows = np.flatnonzero(rank < 3)
        return rows[np.argsort(rank[rows], kind="stable")]

    @cached_property
    def _searched(self) -> Any:
        """Columns SEARCHED of all vessels as a data frame of texts in upper case, made at the first search in this picture."""
        statics = dict(self.statics)  # it grows in another thread
        names = polars.DataFrame(
            {
                "number": polars.Series(list(statics), dtype=polars.Int64),
                "name": polars.Series([static[0] for static in statics.values()], dtype=polars.String),
                "call_sign": polars.Series([static[1] for static in statics.values()], dtype=polars.String),
            }
        )
        own = polars.DataFrame({"vessel_id": self.array("vessel_id"), "number": self.array("mmsi")})
        number = polars.col("number")
        texts = own.join(names, "number", "left", maintain_order="left").with_columns(
            polars.col("vessel_id").cast(polars.String),
            polars.when(number >= 0).then(number.cast(polars.String).str.zfill(9)).alias("mmsi"),
        )
        return texts.select(polars.col(name).fill_null("").str.to_uppercase() for name in SEARCHED)


def _static_column(name: str, statics: list[tuple[Any, ...] | None]) -> Array:
    """One column of STATIC. Args: statics: values of STATIC of each vessel; None: nothing is known of it."""
    k, absent = STATIC.index(name), ABSENT[name]
    kind = {"NoneType": object, "int": np.int64, "float": np.float64}[type(absent).__name__]
    return np.array([absent if static is None else static[k] for static in statics], kind)


def of_cycle(run_id: int, number: int, cycle: Cycle, sensors: Sensors, statics: Statics) -> LivePicture:
    """The picture of a cycle. Args: statics: see `merge_statics`."""
    picture, members = cycle.picture, membership(cycle)
    moved = motion(picture.velocity_m_s, picture.covariance).T
    columns = dict(zip(("sog_kn", "cog_deg", "major_m", "minor_m", "orientation_deg"), moved, strict=True))
    columns |= {"latitude_deg": picture.position_deg[:, 0], "longitude_deg": picture.position_deg[:, 1]}
    own = Table(OWN, tuple(columns[name] if name in columns else getattr(picture, name) for name in OWN))
    texts = source_texts(picture.vessel_id, members, sensors.source_names)
    bits = np.array([KIND_OF_SOURCE[SourceKind(kind)] for kind in sensors.source_kinds.tolist()], np.uint8)
    kind, row = np.zeros(len(picture), np.uint8), find(picture.vessel_id, members[:, 0])
    np.bitwise_or.at(kind, row[row >= 0], bits[members[row >= 0, 1]])
    return LivePicture(run_id, number, cycle.time_s, own, kind, texts.codes, list(texts.texts), statics)


def of_store(
    opened: Store, run_id: int, cycle: int, time_s: float, at_s: float | None = None, bbox: Box | None = None
) -> LivePicture:
    """The picture of a run in a database: now, or at an instant; of all vessels, or of those in a box. Raises: StoreError."""
    vessels = store.picture(opened, run_id, at_s, bbox)
    of_source = {name: KIND_OF_SOURCE[SourceKind[kind.upper()]] for _, name, kind in store.sources(opened, run_id).rows}
    number: dict[str, int] = {}  # of each different text
    codes = np.array([number.setdefault(text or "", len(number)) for text in vessels.array("sources").tolist()], np.int64)
    bits = [reduce(or_, (of_source.get(name, 0) for name in text.split(","))) for text in number]
    statics = zip(*(vessels.array(name).tolist() for name in STATIC), strict=True)
    of_mmsi = dict(zip(vessels.array("mmsi").tolist(), statics, strict=True))
    of_mmsi.pop(-1, None)
    own = Table(OWN, tuple(vessels.array(name) for name in OWN))
    kind = np.array(bits, np.uint8)[codes] if len(codes) else np.zeros(0, np.uint8)
    return LivePicture(run_id, cycle, time_s, own, kind, codes, list(number), of_mmsi)


def stored_statics(opened: Store, run_id: int, most: int) -> Statics:
    """The names that a run has stored, of so many vessels at most: those heard last. Raises: StoreError."""
    names = store.newest_statics(opened, run_id, most)
    values = zip(*(names.array(name).tolist() for name in STATIC), strict=True)
    return dict(zip(names.array("mmsi").tolist(), values, strict=True))


def merge_statics(statics: Statics, reports: AisStatics) -> None:
    """Add names, types and sizes to those that are known. A field that was not sent keeps its value."""
    if not len(reports):
        return
    mmsi, columns = static_rows(reports)
    newest = [column.values if isinstance(column, NullableId) else column for column in map(columns.__getitem__, STATIC)]
    for number, *values in zip(mmsi.tolist(), *(np.asarray(column).tolist() for column in newest), strict=True):
        before = statics.get(number, tuple(ABSENT.values()))
        pairs = zip(values, before, strict=True)
        statics[number] = tuple(old if new is None or new in ("", -1) or new != new else new for new, old in pairs)


def without_absent(statics: Statics, mmsi: Ints) -> Statics:
    """The names of those vessels that are in a picture. Args: mmsi: (V,) of its vessels."""
    here = set(mmsi.tolist())
    return {number: values for number, values in statics.items() if number in here}
