"""A replay of the page: filters that need details of vessels hold in the past, and again when it is live."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import store_world
from browser_world import SIZE, Watch
from server_world import listening, wait_for

from coastwatch.operators.api.application import WEB
from coastwatch.operators.cli.serving import following
from coastwatch.store import open_store

pytestmark = pytest.mark.whole

VESSELS = 60
SHOWN = "[...coastwatch.shown].filter(Boolean).length"


def test_a_filter_by_length_holds_in_a_replay_and_when_it_is_live_again(browser: Any, tmp_path: Path) -> None:
    with open_store(f"sqlite:///{tmp_path / 'sea.db'}") as store:
        run = store_world.begin(store)
        for number in range(4):
            store_world.write(store, run, number, VESSELS)
        with following(store, None, poll_s=0.05) as service, listening(service, web=WEB) as address:
            wait_for(lambda: service.hub.picture)
            watch = Watch(browser.new_page(viewport=SIZE), int(address.rpartition(":")[2]))
            watch.open()
            watch.ask("(coastwatch.state.filter = {...coastwatch.state.filter, minLength: 1}, coastwatch.filterChanged())")
            of_length = watch.until(SHOWN, lambda count: 0 < count <= VESSELS)
            at_s = store_world.instant_s(1)
            watch.ask(f"coastwatch.replay.enter({at_s})")
            watch.until("coastwatch.picture === coastwatch.replay.picture && coastwatch.picture.at", lambda at: at == at_s)
            then = watch.until(SHOWN, lambda count: count > 0)
            watch.page.keyboard.press("l")
            watch.until(f"coastwatch.picture === coastwatch.live && {SHOWN}", lambda count: count == of_length)
            assert then > 0
            assert watch.errors == []
            watch.page.close()
