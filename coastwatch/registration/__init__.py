"""Registration errors of radars, found online: the methods of the stage."""

from typing import Annotated

from pydantic import Field

from coastwatch.registration.none import NoRegistration
from coastwatch.registration.online import OnlineRegistration

Registrar = Annotated[OnlineRegistration | NoRegistration, Field(discriminator="method")]

__all__ = ["NoRegistration", "OnlineRegistration", "Registrar"]
