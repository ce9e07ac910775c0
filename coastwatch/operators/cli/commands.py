"""What a command is. `act` names the function that `main` imports and calls, so that the parser imports no command."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from coastwatch.operators.cli.arguments import Parser

AddOptions = Callable[[Parser], None]


class Command(NamedTuple):
    """A command: its name, the function that carries it out, its line in `coastwatch --help`, and what adds its options."""

    name: str  # "run", or "db upgrade" of a group
    act: str
    summary: str
    add_options: AddOptions


class Commands(list[Command]):
    """Commands in the order of `coastwatch --help`."""

    def command(self, name: str, act: str, summary: str) -> Callable[[AddOptions], AddOptions]:
        """Makes a command of the function that adds its options. The docstring of the function is the text above them."""

        def register(add_options: AddOptions) -> AddOptions:
            self.append(Command(name, act, summary, add_options))
            return add_options

        return register
