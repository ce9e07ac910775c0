"""Registration errors of radars, found on line: the methods of the stage."""

from typing import Annotated

from pydantic import Field

from coastwatch.registration.none import NoRegistration
from coastwatch.registration.on_line import OnLineRegistration

Registrar = Annotated[OnLineRegistration | NoRegistration, Field(discriminator="method")]

__all__ = ["NoRegistration", "OnLineRegistration", "Registrar"]
