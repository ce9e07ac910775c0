"""Each vessel once, with a stable identity, sources and flags: the method of the stage."""

from coastwatch.picture.identity import Identity

__all__ = ["Identity"]
