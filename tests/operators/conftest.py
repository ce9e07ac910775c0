"""Fixtures of servers and of finished runs."""

from run_fixtures import finished_run, start
from server_fixtures import changing, served

__all__ = ["changing", "finished_run", "served", "start"]
