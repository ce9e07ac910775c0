"""Tables: sorting, grouping and matching of rows. Modules load at first use: numba takes half a second."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submodules=[
        "byte_planes",
        "dealing",
        "grouping",
        "groups",
        "latest_per_id",
        "lookup",
        "match_ids",
        "picture_codec",
        "picture_rows",
        "sorted_rows",
        "sorting",
        "subset",
    ],
)
