"""Where files are: those shipped beside the code, `db/` and `scenarios/`, in a checkout or a wheel, and the database of a command."""

from __future__ import annotations

from pathlib import Path

DEFAULT_DB = "sqlite:///coastwatch.db"
"""The database where a command names none, in the working directory."""

PACKAGE = Path(__file__).resolve().parent


def folder(name: str) -> Path:
    """The folder of this name: inside the package where a wheel put it, beside the package in a checkout.

    Raises: FileNotFoundError that names both places.
    """
    places = (PACKAGE / "_data" / name, PACKAGE.parent / name)
    for place in places:
        if place.is_dir():
            return place
    raise FileNotFoundError(f"{name}/ is neither at {places[0]} nor at {places[1]}: the installation is incomplete")


def migrations_folder() -> Path:
    """The folder of the Alembic migrations."""
    return folder("db") / "migrations"


def schema_folder() -> Path:
    """The folder of the generated schemas."""
    return folder("db") / "schema"


def operator_queries_folder() -> Path:
    """The folder of the questions that an operator asks, one .sql file each."""
    return folder("db") / "operator"


def scenarios_folder() -> Path:
    """The folder of the scenarios, one sub-folder each."""
    return folder("scenarios")
