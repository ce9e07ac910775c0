"""Kernels: arithmetic on bare arrays in SI units and radians. Sub-packages load at first use."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submodules=["association", "bearings", "filters", "fusion", "geometry", "identity", "tables", "threads", "tracks", "video"],
)
