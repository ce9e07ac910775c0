"""What is wrong with a running server, in one list: for readiness, metrics, log and page."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

from coastwatch.server.link import FeedState

SILENT_S = 60.0
"""A feed that has sent nothing, or to which nothing could be sent, for so long is a trouble."""


class Trouble(NamedTuple):
    """Something that an operator should know."""

    kind: str  # store, log, behind, restart, alarms, feed, video, clock, crowd, tokens, certificate, picture, zone, webhook
    name: str  # of the feed, radar, file, stage, zone, web hook or run; empty: there is one of its kind
    since_s: float | None  # Unix time; None: not known
    text: str
    is_serious: bool  # the picture is not of now, or nothing comes into it


def of_feeds(feeds: Sequence[FeedState], now_s: float) -> list[Trouble]:
    """Feeds that are silent, or that say what is wrong with them. It is serious where all are silent."""
    dead = [feed for feed in feeds if feed["silent_s"] > SILENT_S]
    troubles = []
    if dead and len(dead) == len(feeds):
        heard_s = min(feed["silent_s"] for feed in dead)
        troubles.append(Trouble("feed", "", now_s - heard_s, f"no feed has been heard for {heard_s:.0f} s", True))
    for feed in dead:
        silent_s, error = feed["silent_s"], feed["error"]
        text = f"nothing has come for {silent_s:.0f} s" + (f": {error}" if error else "")
        troubles.append(Trouble("feed", feed["name"], now_s - silent_s, text, False))
    ways = Counter(radar["name"] for feed in feeds for radar in feed.get("radars", ()))
    for feed in feeds:
        for radar in feed.get("radars", ()):
            where = f" (over {feed['name']})" if ways[radar["name"]] > 1 else ""
            troubles += [Trouble("video", radar["name"], None, text + where, False) for text in radar["troubles"]]
        troubles += [Trouble("feed", feed["name"], None, text, False) for text in feed.get("troubles", ())]
    return troubles


def of_outs(feeds: Sequence[FeedState], now_s: float) -> list[Trouble]:
    """Feeds to other systems that are not connected, and to which nothing was sent for as long; and what they say is wrong."""
    said = [Trouble("feed", feed["name"], None, text, False) for feed in feeds for text in feed.get("troubles", ())]
    return said + [
        Trouble(
            "feed",
            feed["name"],
            now_s - feed["silent_s"],
            f"nothing has been sent for {feed['silent_s']:.0f} s" + (f": {feed['error']}" if feed["error"] else ""),
            False,
        )
        for feed in feeds
        if not feed["connected"] and feed["silent_s"] > SILENT_S
    ]
