"""Errors whose class says what they mean for the caller, wherever they are raised."""


class InputError(Exception):
    """A wrong command, option or input file: exit code 2. The message says what it got and what it needed."""
