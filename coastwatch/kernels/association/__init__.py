"""Association: histories of tracks, candidate pairs, their scores, assignment. Modules load at first use: numba takes half a second."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submodules=[
        "assignment",
        "candidate_pairs",
        "connected_components",
        "crowds",
        "global_hypothesis",
        "history",
        "marginals",
        "pair_distance",
        "pair_features",
        "pair_score",
        "places",
        "polar_pairs",
        "prune_pairs",
    ],
)
