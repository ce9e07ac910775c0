"""A national picture of any size with ground truth, as input of the high-level centre: seeded, streamed, one cycle at a time.

`build_world` draws the constant part, `initial_state` is the state before the first cycle, and `next_cycle` gives the input of
a cycle. The input depends on seed, cycle number and state alone. README.md states the properties.
"""

from scaling.load.national.world import (
    INPUT,
    NON_DEFAULT_SETTINGS,
    START_S,
    State,
    World,
    build_world,
    conditions,
    initial_state,
    next_cycle,
    scenario_of,
    truth,
)

__all__ = [
    "INPUT",
    "NON_DEFAULT_SETTINGS",
    "START_S",
    "State",
    "World",
    "build_world",
    "conditions",
    "initial_state",
    "next_cycle",
    "scenario_of",
    "truth",
]
