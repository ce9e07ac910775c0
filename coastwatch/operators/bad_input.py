"""The error for what an operator typed and can mend: exit code 2."""


class BadInput(Exception):
    """What was asked cannot be done as asked; the message says what was got and what was needed."""
