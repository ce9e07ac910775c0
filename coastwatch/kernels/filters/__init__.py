"""Filters: Kalman and IMM filters of radar, AIS and fused tracks. Modules load at first use: numba takes half a second."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submodules=[
        "ais_imm",
        "ais_tracker",
        "coordinated_turn",
        "fused_filters",
        "gaussian",
        "imm",
        "manoeuvre_imm",
        "manoeuvre_models",
        "model_kinds",
        "symmetric4",
        "track_to_track_imm",
        "velocity_jumps",
    ],
)
