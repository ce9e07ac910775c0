"""A server on a database of a small sea."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from server_world import Served, served_sea


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """A server that tests only ask."""
    with served_sea(tmp_path_factory.mktemp("served")) as made:
        yield made


@pytest.fixture
def changing(tmp_path: Path) -> Iterator[Served]:
    """A server to whose database a test writes."""
    with served_sea(tmp_path) as made:
        yield made
