"""Tables: sorting, grouping and matching of rows. Modules load at first use: numba takes half a second."""

import pkgutil

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, [module.name for module in pkgutil.iter_modules(__path__)])
