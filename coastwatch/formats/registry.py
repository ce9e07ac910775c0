"""The wire formats by name. A new one is a module and a name in this table."""

from coastwatch.formats.asterix.decoder import ASTERIX
from coastwatch.formats.cot import COT
from coastwatch.formats.format import Format
from coastwatch.formats.json_lines import JSON
from coastwatch.formats.nmea.ais import AIS
from coastwatch.formats.nmea.targets import TLL, TTM

FORMATS: dict[str, Format] = {one.name: one for one in (AIS, ASTERIX, TTM, JSON, COT, TLL)}
DECODED = tuple(name for name, one in FORMATS.items() if one.decoder is not None)
PICTURES = tuple(name for name, one in FORMATS.items() if one.pictures is not None)
