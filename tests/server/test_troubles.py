"""What a server says is wrong: feeds that are silent, one or all of them, and cycles that were merged a while ago."""

from __future__ import annotations

import pytest

from coastwatch.scenario import load_scenario
from coastwatch.server import clock
from coastwatch.server.input import Paced
from coastwatch.server.link import FeedState, Link
from coastwatch.server.live import SHOWN_S, LiveRun
from coastwatch.server.troubles import SILENT_S, Trouble, of_feeds, of_outs

pytestmark = pytest.mark.contract

NOW_S = 1_750_000_000.0


def feed(name: str, silent_s: float, error: str | None = None) -> FeedState:
    """The state of a feed that is silent."""
    return {**Link(error=error).as_feed(name), "silent_s": silent_s}


def test_one_silent_feed_of_two_is_said_and_is_not_serious() -> None:
    (said,) = of_feeds([feed("north", 150.0, error="refused"), feed("south", 3.0)], NOW_S)
    assert said == Trouble("feed", "north", NOW_S - 150.0, "nothing has come for 150 s: refused", False)
    assert of_feeds([feed("north", SILENT_S - 1.0)], NOW_S) == []


@pytest.mark.parametrize("names", [("north",), ("north", "south")])
def test_when_every_feed_is_silent_it_is_said_for_how_long_none_was_heard(names: tuple[str, ...]) -> None:
    first, *others = of_feeds([feed(name, 150.0 + 30.0 * k) for k, name in enumerate(names)], NOW_S)
    assert first == Trouble("feed", "", NOW_S - 150.0, "no feed has been heard for 150 s", True)
    assert [(one.name, one.is_serious) for one in others] == [(name, False) for name in names]
    assert others[-1].text == f"nothing has come for {150 + 30 * (len(names) - 1)} s"


def test_a_feed_to_others_is_said_where_it_has_no_connection_and_not_where_there_was_nothing_to_send() -> None:
    (said,) = of_outs([feed("out north", 150.0, error="refused"), feed("out south", 3.0)], NOW_S)
    assert said == Trouble("feed", "out north", NOW_S - 150.0, "nothing has been sent for 150 s: refused", False)
    assert of_outs([{**feed("out north", 150.0), "connected": True}], NOW_S) == []


def test_merged_cycles_are_said_for_a_while(monkeypatch: pytest.MonkeyPatch) -> None:
    run = LiveRun(load_scenario("guanabara"), Paced(), lambda _: None, database="")
    at_s = NOW_S
    monkeypatch.setattr(clock, "now_s", lambda: at_s)
    assert run.troubles() == []
    run.note_merged(3)
    at_s += 60.0
    run.note_merged(2)
    (said,) = run.troubles()
    assert (said.kind, said.since_s, said.is_serious) == ("behind", NOW_S, False)
    assert said.text == "5 cycles of the last 10 minutes were merged with the next ones, as the run was behind"
    at_s += SHOWN_S + 1.0
    assert run.troubles() == []
