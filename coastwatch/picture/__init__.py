"""Each vessel once, with a stable identity, sources and flags: the methods of the stage."""

from coastwatch.picture.identity import Identity as Identity, PictureMemory as PictureMemory
from coastwatch.picture.inputs import PictureInput as PictureInput, PictureOutput as PictureOutput
