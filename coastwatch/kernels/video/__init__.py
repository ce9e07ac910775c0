"""Radar video: background, detection, connected echoes and their moments. Modules load at first use: numba takes half a second."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submodules=["background", "components", "spokes"])
