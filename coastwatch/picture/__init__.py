"""Each vessel once, with a stable identity, sources and flags: the methods of the stage."""

from coastwatch.picture.identity import Identity, PictureMemory
from coastwatch.picture.inputs import PictureInput, PictureOutput

__all__ = ["Identity", "PictureInput", "PictureMemory", "PictureOutput"]
