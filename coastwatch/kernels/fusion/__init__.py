"""Fusion: one estimate from several tracks, and their alignment in time. Modules load at first use: numba takes half a second."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submodules=[
        "alignment",
        "convex_combination",
        "covariance_intersection",
        "cross_covariance",
        "track_states",
        "weighted_mean",
    ],
)
