"""The feeds: sources of reports. A scenario's `input.method` chooses one of the union `Feed`."""

from typing import Annotated

from pydantic import Field

from coastwatch.sensors.recorded.ais_table import AisTable
from coastwatch.sensors.recorded.autoferry import Autoferry
from coastwatch.sensors.recorded.nmea import Nmea
from coastwatch.sensors.recorded.solent import Solent
from coastwatch.sensors.recorded.tables import Tables
from coastwatch.sensors.simulated.crossing import Crossing
from coastwatch.sensors.simulated.simulation import Simulated

Feed = Annotated[Simulated | Nmea | AisTable | Tables | Autoferry | Solent | Crossing, Field(discriminator="method")]

__all__ = ["AisTable", "Autoferry", "Crossing", "Feed", "Nmea", "Simulated", "Solent", "Tables"]
