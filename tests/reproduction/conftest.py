"""A command in a process of its own."""

from run_fixtures import start

__all__ = ["start"]
