"""Where reports come from: the union of feeds. A scenario's `input.method` chooses one."""

from typing import Annotated

from pydantic import Field

from coastwatch.sensors.ais_table import AisTable
from coastwatch.sensors.autoferry import Autoferry
from coastwatch.sensors.nmea import Nmea
from coastwatch.sensors.simulated import Simulated
from coastwatch.sensors.solent import Solent
from coastwatch.sensors.tables import Tables

Feed = Annotated[Simulated | Nmea | AisTable | Tables | Autoferry | Solent, Field(discriminator="method")]

__all__ = ["AisTable", "Autoferry", "Feed", "Nmea", "Simulated", "Solent", "Tables"]
