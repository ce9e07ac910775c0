"""Each vessel once, with a stable identity, sources and flags: the methods of the stage."""

from coastwatch.picture.identity import Identity

__all__ = ["Identity"]
