"""Tables: sorting, grouping and matching of rows. Modules load at first use: numba takes half a second."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submodules=["counting_sort", "lookup", "match_ids", "row_numbers"])
