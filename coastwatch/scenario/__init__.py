"""One TOML file to one frozen, validated Scenario."""

from coastwatch.scenario.model import Scenario, StoreSettings, WorkerSettings
from coastwatch.scenario.reading import ScenarioError, load_scenario, make_scenario, scenario_names
from coastwatch.scenario.sites import Area, Radar, Sonar, Station, TrackSource, refuse_shared_names

__all__ = [
    "Area",
    "Radar",
    "Scenario",
    "ScenarioError",
    "Sonar",
    "Station",
    "StoreSettings",
    "TrackSource",
    "WorkerSettings",
    "load_scenario",
    "make_scenario",
    "refuse_shared_names",
    "scenario_names",
]
