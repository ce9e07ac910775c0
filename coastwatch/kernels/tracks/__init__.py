"""Kernels of radar trackers: gate, assignment, track life, report. Modules load at first use: numba takes half a second."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submodules=[
        "clutter",
        "columns",
        "duplicates",
        "existence",
        "gate",
        "hypothesis_trees",
        "initiation",
        "joint_update",
        "message_clusters",
        "plot_assignment",
        "polar_update",
        "prediction",
        "report",
        "thesis_growth",
        "track_life",
        "tree_rows",
        "vessel_ids",
    ],
)
