"""Filters: Kalman and IMM filters of radar, AIS and fused tracks. Modules load at first use: numba takes half a second."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submodules=[
        "ais_plausibility",
        "ais_records",
        "ais_tracker",
        "fused_filters",
        "gaussian",
        "imm",
        "kalman",
        "motion_models",
        "smoothing",
        "symmetric4",
        "unscented",
    ],
)
