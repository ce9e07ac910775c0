"""The scenario of a centre: its regions are sources of finished tracks in place of radars."""

from __future__ import annotations

from collections.abc import Sequence

from coastwatch.scenario import Scenario, ScenarioError, TrackSource, refuse_shared_names

PATIENCE_S = 10.0
"""A track that its region has not sent for so long is dropped: a region sends all its tracks in every cycle."""


def of_centre(scenario: Scenario, regions: Sequence[str]) -> Scenario:
    """The scenario with a track source for each region and without radars. A source that it has already keeps its settings.

    Raises: ScenarioError: two regions of one name.
    """
    return with_track_sources(scenario, regions, PATIENCE_S).model_copy(update={"radars": ()})


def with_track_sources(scenario: Scenario, names: Sequence[str], patience_s: float = 30.0) -> Scenario:
    """The scenario with a track source of each of these names. One that it has already keeps its settings.

    Args: patience_s: of the new ones.
    Raises: ScenarioError: a name is there twice; InputError, as of `refuse_shared_names`.
    """
    twice = sorted({name for name in names if list(names).count(name) > 1})
    if twice:
        count = list(names).count(twice[0])
        raise ScenarioError(f"track source: got the name {twice[0]!r} {count} times, needed each once: name=NAME")
    present = {source.name for source in scenario.track_sources}
    added = tuple(TrackSource(name=name, patience_s=patience_s) for name in names if name not in present)
    refuse_shared_names(scenario.radars, added, scenario.sonars)
    return scenario.model_copy(update={"track_sources": (*scenario.track_sources, *added)})
