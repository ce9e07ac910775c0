"""Fixtures of servers, of finished runs and of a browser."""

from browser_world import browser
from run_fixtures import finished_run, start
from server_fixtures import changing, served

__all__ = ["browser", "changing", "finished_run", "served", "start"]
