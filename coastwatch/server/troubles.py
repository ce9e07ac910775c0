"""What is wrong with a running server, in one list: for readiness, metrics, log and page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

SILENT_S = 60.0
"""A feed that has sent nothing for so long is a trouble, unless it says itself when it is."""


class Trouble(NamedTuple):
    """Something that an operator should know."""

    kind: str  # store, log, behind, restart, alarms, feed, clock, crowd, tokens, picture, zone
    name: str  # of the feed, file, stage, zone or run; empty: there is one of its kind
    since_s: float | None  # Unix time; None: not known
    text: str
    is_serious: bool  # the picture is not of now, or nothing comes into it


def of_feeds(feeds: Sequence[Mapping[str, Any]], now_s: float) -> list[Trouble]:
    """Feeds that are silent, or that say what is wrong with them. It is serious where all are silent. Args: feeds: with their counters."""
    dead = [feed for feed in feeds if _is_dead(feed)]
    out = []
    if dead and len(dead) == len(feeds):
        heard_s = min(float(feed["silent_s"]) for feed in dead)
        out.append(Trouble("feed", "", now_s - heard_s, f"no feed has been heard for {heard_s:.0f} s", True))
    for feed in dead:
        silent_s, error = float(feed["silent_s"]), feed.get("error")
        said = f"nothing has come for {silent_s:.0f} s" + (f": {error}" if error else "")
        out.append(Trouble("feed", str(feed["name"]), now_s - silent_s, said, False))
    for feed in feeds:
        out += [Trouble("feed", str(feed["name"]), None, str(said), False) for said in feed.get("troubles", ())]
    return out


def _is_dead(feed: Mapping[str, Any]) -> bool:
    silent_s = feed.get("silent_s")
    return silent_s is not None and float(silent_s) > float(feed.get("silent_after_s") or SILENT_S)
