"""The order of the test files, and how hard hypothesis searches.

COASTWATCH_HYPOTHESIS=nightly searches longer, from a new seed each time.
"""

from __future__ import annotations

import os

import pytest
from hypothesis import HealthCheck, settings

ANY_TIME = {"deadline": None, "suppress_health_check": [HealthCheck.too_slow]}
"""No test fails because the machine is busy or compiles a kernel."""

settings.register_profile("ci", max_examples=15, derandomize=True, **ANY_TIME)
settings.register_profile("nightly", max_examples=200, **ANY_TIME)
settings.load_profile(os.environ.get("COASTWATCH_HYPOTHESIS", "ci"))

LONGEST = (
    "whole/test_every_scenario",
    "tracks/test_ais_in_radar_tracks",
    "whole/test_context_driven",
    "reproduction/test_reproduce",
    "flow/test_silent_sensors",
    "server/test_live",
    "server/test_run",
)
"""Begun first: a file is the work of one process, and a long one begun last would keep the others waiting. `test_ais_in_radar_tracks`
compiles the kernels of all trackers, which several processes would do at once in the files after it."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put the files that take longest first."""
    order = {name: place for place, name in enumerate(LONGEST)}
    items.sort(key=lambda item: order.get(f"{item.path.parent.name}/{item.path.stem}", len(order)))
