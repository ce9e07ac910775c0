"""Puts the page of the map into a wheel, and refuses a wheel without it. An editable installation needs no page."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

PAGE = "coastwatch/operators/web"


class PageOfTheMap(BuildHookInterface):
    """The page is ignored by git, so hatchling leaves it out unless it is named."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Add the page. Args: version: "standard" or "editable". Raises: FileNotFoundError where it was not built."""
        if version == "editable":
            return
        if not (Path(self.root) / PAGE / "index.html").is_file():
            raise FileNotFoundError(f"{PAGE}/index.html: not found, a wheel needs it; build it with `make web`")
        build_data["force_include"][str(Path(self.root) / PAGE)] = PAGE
