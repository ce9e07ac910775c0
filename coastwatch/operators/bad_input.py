"""The error for input that an operator can correct: exit code 2."""


class BadInput(Exception):
    """A wrong command, option or input file; the message says what it got and what it needed."""
