"""The parser of all commands, and completion for shells."""

from __future__ import annotations

import argparse

from coastwatch.operators.cli import database_commands, reading_commands, running_commands
from coastwatch.operators.cli.arguments import (
    QUESTIONS,
    SCENARIOS,
    Parser,
    Version,
)
from coastwatch.operators.cli.commands import Commands

EPILOG = """\
exit codes: 0 done, 1 failed, 2 bad input, 4 a figure fell or a target was missed, 130 interrupted with Ctrl-C, 141\
 the reader of the output closed it.
COASTWATCH_TRACEBACK=1 in the environment prints the traceback of an error.
All commands, settings and questions: coastwatch/operators/REFERENCE.md"""


GROUPS = {
    "token": ("make tokens", "Tokens of `coastwatch serve --tokens`."),
    "db": ("upgrade, check, copy or prune a database", "Upgrade, check, copy or prune a database."),
}
"""Summary and description of each group of commands."""


COMMANDS = Commands()

OF_MODELS = ("serve", "feed")
"""Commands whose options are read from models and formats, which take a second to import."""


def make_parser(command: str | None = None) -> Parser:
    """The parser of all commands. The parsed arguments have `act`, "module:function" in this package.

    Args: command: the only one that is to be parsed; the options of other ones of OF_MODELS are left out.
    """
    return make_parsers(command)[""]


def make_parsers(command: str | None = None) -> dict[str, Parser]:
    """The parser of each command by its name, and that of all under "". Args: as of `make_parser`."""
    parser = Parser(
        prog="coastwatch",
        description="One picture of a coast from radars, AIS and passive sonars.",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action=Version, nargs=0, help="print the version")
    parsers, places = {"": parser}, {"": parser.add_subparsers(title="commands", metavar="COMMAND", required=True)}
    modules = running_commands, reading_commands, database_commands
    listed = [*(one for module in modules for one in module.COMMANDS), *COMMANDS]
    for name, act, summary, add_options in listed:
        group, _, verb = name.rpartition(" ")
        if group not in places:
            summary_of_group, description = GROUPS[group]
            below = places[""].add_parser(group, help=summary_of_group, description=description)
            places[group] = below.add_subparsers(title="commands", metavar="COMMAND", required=True)
        description = " ".join((add_options.__doc__ or "").split())
        one = parsers[name] = places[group].add_parser(verb, help=summary, description=description)
        one.set_defaults(act=act, command=one.prog)
        if name not in OF_MODELS or command in (None, name):
            add_options(one)
    return parsers


@COMMANDS.command("completion", "parser:print_completion", "print a completion script for a shell")
def completion(parser: Parser) -> None:
    """Print the script with which a shell completes commands, options, scenarios and questions. bash: eval "$(coastwatch
    completion bash)"; zsh: coastwatch completion zsh > FOLDER_OF_FPATH/_coastwatch.
    """
    parser.add_argument("shell", choices=("bash", "zsh", "tcsh"), help="the shell")


def print_completion(options: argparse.Namespace) -> int:
    """Carries out `completion`."""
    import shtab

    from coastwatch.shipped import operator_queries_folder, scenarios_folder

    names = {
        SCENARIOS: sorted(path.parent.name for path in scenarios_folder().glob("*/scenario.toml")),
        QUESTIONS: sorted(path.stem for path in operator_queries_folder().glob("*.sql")),
    }
    words = {function: " ".join(listed) for function, listed in names.items()}
    preamble = {
        "bash": "".join(f'{function}() {{ compgen -W "{listed}" -- "$1"; }}\n' for function, listed in words.items()),
        "zsh": "".join(f"{function}() {{ _values name {listed} }}\n" for function, listed in words.items()),
    }
    print(shtab.complete(make_parser(), options.shell, preamble=preamble.get(options.shell, "")))
    return 0
