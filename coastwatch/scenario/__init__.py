"""One TOML file to one frozen, validated Scenario."""

from coastwatch.scenario.model import Scenario as Scenario, StoreSettings as StoreSettings, WorkerSettings as WorkerSettings
from coastwatch.scenario.reading import (
    ScenarioError as ScenarioError,
    load_scenario as load_scenario,
    make_scenario as make_scenario,
    scenario_names as scenario_names,
)
from coastwatch.scenario.sites import (
    Area as Area,
    Radar as Radar,
    Sonar as Sonar,
    Station as Station,
    TrackSource as TrackSource,
    refuse_shared_names as refuse_shared_names,
)
