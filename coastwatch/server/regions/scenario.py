"""The scenario of a centre: its regions are sources of finished tracks in place of radars."""

from __future__ import annotations

from collections.abc import Sequence

from coastwatch.scenario import Scenario, ScenarioError, TrackSource

PATIENCE_S = 10.0
"""A track that its region has not sent for so long is dropped: a region sends all its tracks in every cycle."""


def of_centre(scenario: Scenario, regions: Sequence[str]) -> Scenario:
    """The scenario with a track source for each region and without radars. A source that it has already keeps its settings.

    Raises: ScenarioError: two regions of one name.
    """
    twice = sorted({name for name in regions if list(regions).count(name) > 1})
    if twice:
        raise ScenarioError(
            f"region: got the name {twice[0]!r} {list(regions).count(twice[0])} times, needed each once: name=NAME"
        )
    known = {source.name for source in scenario.track_sources}
    added = tuple(TrackSource(name=name, patience_s=PATIENCE_S) for name in regions if name not in known)
    return scenario.model_copy(update={"radars": (), "track_sources": (*scenario.track_sources, *added)})
