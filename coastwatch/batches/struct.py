"""Frozen structs of arrays whose shapes are checked when they are made."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields, is_dataclass, replace
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import DTypeLike

from coastwatch.kernels.arrays import Array
from coastwatch.kernels.tables.row_numbers import require_rows


def column(dtype: DTypeLike, *shape: str | int, rows_of: str | None = None, least: int = 0, new: float = 0) -> Any:
    """A field that holds an array of this dtype and shape; a letter in the shape is one size throughout the struct.

    Args: rows_of: the letter of what it numbers, from `least` on: `check_rows` compares them; new: the value in a new row.
    """
    return field(metadata={"dtype": np.dtype(dtype), "shape": shape, "rows_of": rows_of, "least": least, "new": new})


def optional_column(*shape: str | int, dtype: DTypeLike = np.float64, new: float | None = None) -> Any:
    """As `column`, for a value that a batch need not give: then every row is new. Args: new: none: NaN, or -1 for a whole number."""
    if new is None:
        new = np.nan if np.dtype(dtype).kind == "f" else -1
    return field(
        default_factory=lambda: np.zeros((0, *(0 if isinstance(s, str) else s for s in shape[1:])), dtype),
        metadata={"dtype": np.dtype(dtype), "shape": shape, "optional": True, "new": new},
    )


def part(struct: type[Struct]) -> Any:
    """A field that holds another struct, which `Struct.empty` makes with the same sizes."""
    return field(metadata={"part": struct})


def column_or_none(letter: str) -> Any:
    """A column of numbers that is empty, as of no row, where it is not given."""
    return field(default_factory=lambda: np.zeros(0), metadata={"dtype": np.dtype(np.float64), "shape": (letter,)})


def new_rows(shape: list[int], dtype: DTypeLike, value: float) -> Array:
    """An array of this value; of no text where that is 0."""
    return np.full(shape, value, dtype) if value else np.zeros(shape, dtype)


@dataclass(frozen=True, eq=False)
class Struct:
    """Arrays that belong together, checked when made.

    Raises: TypeError or ValueError that names the field, what it got and what it needed.
    """

    def __post_init__(self) -> None:
        layout = _layout(type(self))
        if layout.rows and self._are_rows(layout.rows):
            return
        sizes: dict[str, int] = {}
        for name, dtype, shape in layout.columns:
            got = getattr(self, name)
            if not isinstance(got, np.ndarray):
                raise TypeError(f"{type(self).__name__}.{name}: got {type(got).__name__}, needed an array")
            if got.dtype is not dtype and (got.dtype.kind != dtype.kind or (dtype.kind != "U" and got.dtype != dtype)):
                raise TypeError(f"{type(self).__name__}.{name}: got dtype {got.dtype}, needed {dtype}")
            if got.ndim != len(shape):
                raise ValueError(f"{type(self).__name__}.{name}: got shape {got.shape}, needed {shape} with {sizes}")
            for need, size in zip(shape, got.shape, strict=True):
                if (sizes.setdefault(need, size) if isinstance(need, str) else need) != size:
                    raise ValueError(f"{type(self).__name__}.{name}: got shape {got.shape}, needed {shape} with {sizes}")

    def _are_rows(self, columns: _Rows) -> bool:
        """Whether each array is as needed, in a quick look that errs only to the side of no. Args: columns: `_Layout.rows`."""
        values, size = vars(self), -1
        for name, dtype, axes, width in columns:
            got = values[name]
            if type(got) is not np.ndarray or got.dtype is not dtype:
                return False
            shape = got.shape
            if len(shape) != axes or (axes > 1 and shape[1:] != width):
                return False
            if shape[0] != size:
                if size >= 0:
                    return False
                size = shape[0]
        return True

    @classmethod
    def empty(cls, **sizes: int) -> Self:
        """New rows in every column, of these sizes by letter, 0 where not given. What is neither column nor part has its default."""
        layout = _layout(cls)
        columns = {
            name: new_rows([s if isinstance(s, int) else sizes.get(s, 0) for s in shape], dtype, layout.new[name])
            for name, dtype, shape in layout.columns
        }
        return cls(**columns, **{name: struct.empty(**sizes) for name, struct in layout.parts})

    def with_room(self, letter: str, size: int) -> Self:
        """The same with at least so many rows in the columns whose first axis has this letter: new ones behind the others."""
        layout, longer = _layout(type(self)), {}
        for name, dtype, shape in layout.columns:
            before = getattr(self, name)
            if shape[0] == letter and len(before) < size:
                longer[name] = new_rows([size, *before.shape[1:]], dtype, layout.new[name])
                longer[name][: len(before)] = before
        return replace(self, **longer) if longer else self

    def check_rows(self) -> None:
        """Check the columns of row numbers, as after reading a checkpoint: kernels do not.

        Raises: ValueError that names the field, what it got and what it needed.
        """
        every = fields(self)
        sizes = {
            letter: size
            for f in every
            if "shape" in f.metadata
            for letter, size in zip(f.metadata["shape"], getattr(self, f.name).shape, strict=True)
        }
        for f in every:
            if f.metadata.get("rows_of"):
                name = f"{type(self).__name__}.{f.name}"
                require_rows(name, getattr(self, f.name), sizes[f.metadata["rows_of"]], f.metadata["least"])


_Rows = tuple[tuple[str, np.dtype[Any], int, tuple[str | int, ...]], ...]
"""Columns of rows: name, dtype, number of axes, and shape of a row."""


class _Layout(NamedTuple):
    """The fields of a struct: the names of its arrays and of plain values, the arrays a batch may leave out, what each array is."""

    names: tuple[str, ...]
    plain: tuple[str, ...]
    optional: tuple[str, ...]
    columns: tuple[tuple[str, np.dtype[Any], tuple[str | int, ...]], ...]
    new: dict[str, float]  # the value of each array in a new row
    parts: tuple[tuple[str, type[Struct]], ...]  # other structs
    rows: _Rows  # the columns, where one letter is their first axis and no other axis has one; else none


_LAYOUTS: dict[type, _Layout] = {}


def _layout(struct: type[Struct]) -> _Layout:
    """The fields of a class; kept, because a cycle checks, counts and takes rows of hundreds of structs."""
    if struct not in _LAYOUTS:
        every = fields(struct)
        columns = tuple((f.name, f.metadata["dtype"], f.metadata["shape"]) for f in every if "shape" in f.metadata)
        optional = tuple(f.name for f in every if f.metadata.get("optional"))
        new = {f.name: f.metadata.get("new", 0) for f in every}
        parts = tuple((f.name, f.metadata["part"]) for f in every if "part" in f.metadata)
        names, plain = ([f.name for f in every if ("shape" in f.metadata) is is_array] for is_array in (True, False))
        one_letter = len({shape[0] for _, _, shape in columns}) == 1
        fixed = one_letter and not any(isinstance(size, str) for _, _, shape in columns for size in shape[1:])
        of_rows = tuple((name, dtype, len(shape), shape[1:]) for name, dtype, shape in columns) if fixed else ()
        _LAYOUTS[struct] = _Layout(tuple(names), tuple(plain), optional, columns, new, parts, of_rows)
    return _LAYOUTS[struct]


@dataclass(frozen=True, eq=False)
class Batch(Struct):
    """A Struct whose every array has the same first axis: rows can be counted, taken and joined. Plain values are of all rows."""

    def __post_init__(self) -> None:
        layout = _layout(type(self))
        for name in layout.optional:
            given = getattr(self, name)
            if len(given) == 0 and len(self):
                object.__setattr__(self, name, new_rows([len(self), *given.shape[1:]], given.dtype, layout.new[name]))
        super().__post_init__()

    def __len__(self) -> int:
        return len(getattr(self, _layout(type(self)).names[0]))

    def take(self, rows: Array | slice) -> Self:
        """The rows at these indices, under this mask or in this slice, in that order; a slice copies nothing.

        Raises: IndexError where an index is beyond the rows, or the mask has another length.
        """
        columns, plain = self._columns, self._plain
        if isinstance(rows, slice):
            return type(self)(**plain, **{name: values[rows] for name, values in columns.items()})
        at = np.asarray(rows)
        if at.dtype == np.bool_:
            if len(at) != len(self):
                raise IndexError(f"{type(self).__name__}: got a mask of {len(at)} rows, needed {len(self)}")
            at = np.flatnonzero(at)
        elif not len(at):  # of an empty list
            at = at.astype(np.int64)
        return type(self)(**plain, **{name: values.take(at, axis=0) for name, values in columns.items()})

    @property
    def _columns(self) -> dict[str, Array]:
        return {name: getattr(self, name) for name in _layout(type(self)).names}

    @property
    def _plain(self) -> dict[str, Any]:
        return {name: getattr(self, name) for name in _layout(type(self)).plain}

    def without_values(self, *kept: str) -> Self:
        """As many rows, with the values of the columns that are named. The others are NaN or 0 throughout and take no memory."""
        every = self._columns
        for name in every.keys() - set(kept):
            dtype, shape = every[name].dtype, every[name].shape
            every[name] = np.broadcast_to(np.array(np.nan if dtype.kind == "f" else 0, dtype), shape)
        return type(self)(**self._plain, **every)

    def put(self, first: int, rows: Self) -> None:
        """Write these rows over those from a first one on, in place."""
        for name in _layout(type(self)).names:
            getattr(self, name)[first : first + len(rows)] = getattr(rows, name)

    @classmethod
    def join(cls, parts: Sequence[Self]) -> Self:
        """The rows of all parts, one after the other, with the plain values of the first; no part gives an empty batch."""
        if not parts:
            return cls.empty()
        columns = {name: np.concatenate([getattr(p, name) for p in parts]) for name in _layout(cls).names}
        return cls(**parts[0]._plain, **columns)


def size_bytes(value: object) -> int:
    """The bytes of the arrays in a dataclass of batches, those of one constant left out."""
    if isinstance(value, np.ndarray):
        return 0 if 0 in value.strides else int(value.nbytes)
    if is_dataclass(value):
        return sum(size_bytes(getattr(value, f.name)) for f in fields(value))
    return 0
