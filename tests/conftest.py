"""How hard hypothesis searches: COASTWATCH_HYPOTHESIS=nightly searches longer, from a new seed each time."""

from __future__ import annotations

import os

from hypothesis import HealthCheck, settings

ANY_TIME = {"deadline": None, "suppress_health_check": [HealthCheck.too_slow]}
"""No test fails because the machine is busy or compiles a kernel."""

settings.register_profile("ci", max_examples=25, derandomize=True, **ANY_TIME)
settings.register_profile("nightly", max_examples=200, **ANY_TIME)
settings.load_profile(os.environ.get("COASTWATCH_HYPOTHESIS", "ci"))
