"""Errors whose message is a whole answer for an operator. The command line chooses its exit code by their type."""


class ExplainedError(Exception):
    """The message says what failed, why, and what to do: exit code 1."""


class InputError(ExplainedError, ValueError):
    """A command, option, address, setting or file that the caller can repair, with what it got and what it needed: exit code 2."""


class AddressError(InputError):
    """An address to which nothing can be sent, or from which nothing can come; the message says what is wrong."""


class StoreError(ExplainedError):
    """The database cannot do what was asked; the message says which database, why, and what to do."""


class DatabaseAddressError(StoreError, InputError):
    """A URL that names no database of a known kind: exit code 2."""


class OtherSchemaError(StoreError, InputError):
    """A database of another schema: exit code 2, as no second attempt mends it."""


class RunFailedError(ExplainedError):
    """The run of a server has failed for good: the process ends with exit code 1, and whatever started it may start it again."""
