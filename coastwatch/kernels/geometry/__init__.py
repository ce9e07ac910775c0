"""Geometry: WGS 84, planes, neighbours, coverage. Modules load at first use: numba takes half a second."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__, submodules=["centroids", "ellipsoid", "grid", "radar_plane", "sensor_coverage"]
)
