"""Registration errors of radars, found online: the methods of the stage."""

from typing import Annotated

from pydantic import Field

from coastwatch.registration.inputs import RegistrationInput as RegistrationInput
from coastwatch.registration.none import NoRegistration as NoRegistration
from coastwatch.registration.online import OnlineMemory, OnlineRegistration as OnlineRegistration
from coastwatch.stage import NoMemory

Registrar = Annotated[OnlineRegistration | NoRegistration, Field(discriminator="method")]
RegistrationMemory = OnlineMemory | NoMemory
