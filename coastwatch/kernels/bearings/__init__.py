"""Bearings: candidates and likelihoods of bearing tracks against vessels. Modules load at first use: numba takes half a second."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__, submodules=["candidates", "directions", "likelihood", "looks", "null_hypothesis", "signatures", "windows"]
)
