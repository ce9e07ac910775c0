"""How tables are declared: what all have in common, and the two kinds of key column."""

from __future__ import annotations

from typing import Any

from sqlalchemy import JSON, BigInteger, Boolean, Float, ForeignKey, Integer, LargeBinary, Text
from sqlalchemy.orm import DeclarativeBase, Mapped, mapped_column

Key = BigInteger().with_variant(Integer, "sqlite")
"""An id of eight bytes. SQLite wants the word INTEGER where the column is to be the row's own address."""

IN_KEY_ORDER = {"sqlite_with_rowid": False}
"""The row stands in the B-tree of its primary key: one tree to write, and neighbours in key are neighbours on disk."""


class Base(DeclarativeBase):
    """What every table shares: how Python types become columns."""

    type_annotation_map = {int: Key, float: Float(53), str: Text, bytes: LargeBinary, bool: Boolean, dict[str, Any]: JSON}  # noqa: RUF012


def of_run() -> Mapped[int]:
    """The column that names the run a row belongs to, first in the primary key."""
    return mapped_column(ForeignKey("run.id"), primary_key=True)


def key() -> Mapped[int]:
    """A further column of the primary key."""
    return mapped_column(primary_key=True, autoincrement=False)
