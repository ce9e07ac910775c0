"""A scenario file says what is wrong with it, and `--set` reaches every setting."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from coastwatch.errors import InputError
from coastwatch.scenario import Scenario, ScenarioError, load_scenario, scenario_names

pytestmark = pytest.mark.contract

HOUSE = Path(__file__).parents[2]
BASE = (HOUSE / "scenarios" / "context-driven-1000" / "scenario.toml").read_text("utf-8")
SHIPPED = sorted(p.parent.name for p in (HOUSE / "scenarios").glob("*/scenario.toml"))


def written(folder: Path, text: str | bytes) -> str:
    path = folder / "mine.toml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return str(path)


def refusal(path: str, overrides: dict[str, str] | None = None) -> str:
    with pytest.raises(ScenarioError) as caught:
        load_scenario(path, overrides)
    return str(caught.value)


def test_every_shipped_scenario_loads_and_comes_back_from_what_it_dumps() -> None:
    assert len(SHIPPED) > 10
    for name in SHIPPED:
        scenario, folder = load_scenario(name), HOUSE / "scenarios" / name
        assert scenario.name == name
        assert scenario == load_scenario(str(folder)) == load_scenario(str(folder / "scenario.toml"))
        assert len(scenario.sensors().radars) == len(scenario.radars) > 0, name
        assert Scenario.model_validate(scenario.model_dump()) == scenario, name
        assert Scenario.model_validate(scenario.model_dump(mode="json")) == scenario, name
        assert Scenario.model_validate_json(scenario.model_dump_json()) == scenario, name


def test_the_listing_has_every_shipped_scenario() -> None:
    assert [name for name, _ in scenario_names()] == SHIPPED
    assert all(title for _, title in scenario_names())


def replaced(old: str, new: str) -> Callable[[], str]:
    def change() -> str:
        assert old in BASE, f"the scenario changed: {old!r} is gone"
        return BASE.replace(old, new, 1)

    return change


def added(text: str) -> Callable[[], str]:
    return lambda: BASE + text


WRONG = {
    "key": (replaced("\ncycles = 40", "\ncylces = 40"), "cylces", "got 40 for an unknown setting"),
    "key of a table": (replaced("[area]", "[aria]"), "area", "got nothing, needed a table [area] with latitude_deg, longitude_deg"),
    "key of the input": (replaced("count = 1000", "coumt = 100"), "coumt", "got 100"),
    "key two tables down": (added("\n[tracks.motion]\nrenewal = 1.0\n"), "motion.renewal", "got 1.0"),
    "unit": (replaced("range_nm = 6.0", "range_km = 6.0"), "radars.0.range_km", "got 6.0"),
    "unit of the second": (replaced("rpm = 20.0", "hz = 0.3"), "radars.1.hz", "got 0.3"),
    "text for a number": (replaced("rpm = 15.0", 'rpm = "fast"'), "radars.0.rpm", "got 'fast'"),
    "metres for nautical miles": (replaced("range_nm = 6.0", "range_nm = 22000"), "radars.0.range_nm", "got 22000"),
    "turns that no antenna makes": (replaced("rpm = 15.0", "rpm = 1e9"), "radars.0.rpm", "got 1000000000.0"),
    "more hours than a date has": (added("\n[store]\nhistory_hours = 1e9\n"), "store.history_hours", "got 1000000000.0"),
    "fraction for a count": (replaced("cycles = 40", "cycles = 40.5"), "cycles", "got 40.5"),
    "number for a table": (replaced("[[stations]]", "[stations]"), "stations", "needed tables [[stations]] with name,"),
    "time without a zone": (replaced("12:00:00Z", "12:00:00"), "start_utc", "got 2025-06-01T12:00:00, needed an instant with a time zone"),
    "negative range": (replaced("range_nm = 6.0", "range_nm = -6.0"), "radars.0.range_nm", "got -6.0, needed more than 0"),
    "no range": (replaced("range_nm = 3.99\n", ""), "sonars.0.range_nm", "got nothing"),
    "not a number": (replaced("period_s = 3.0", "period_s = nan"), "period_s", "got nan, needed a finite number"),
    "infinite": (replaced("warmup_s = 120.0", "warmup_s = inf"), "warmup_s", "got inf, needed a finite number"),
    "no time passes": (replaced("period_s = 3.0", "period_s = 0.0"), "period_s", "got 0.0, needed 0.01 or more"),
    "latitude 91": (replaced("latitude_deg = -23.008333", "latitude_deg = 91.0"), "radars.0.latitude_deg", "got 91.0"),
    "longitude 181": (replaced("longitude_deg = -43.20\n", "longitude_deg = 181.0\n"), "stations.0.longitude_deg", "got 181.0"),
    "latitude 91 of the input": (replaced("area_latitude_deg = -23.05", "area_latitude_deg = 91.0"), "area_latitude_deg", "got 91.0"),
    "a test without covariances": (
        added('\n[associations]\nmethod = "counted_test"\n\n[ais_tracks]\nmethod = "dead_reckoning"\n'),
        "associations.method",
        "got 'counted_test', which needs covariances",
    ),
    "method": (replaced('method = "guided_vimmjipda"', 'method = "magic"'), "tracks.method", "got 'magic', needed one of sided_imm, imm"),
    "method of the input": (replaced('method = "simulated"', 'method = "psychic"'), "input.method", "'psychic', needed one of"),
    "no input": (replaced('method = "simulated"\n', ""), "input", "method"),
    "two of a name": (replaced('"radar-2"', '"radar-1"'), "radars", "got the name 'radar-1' 2 times, needed each once"),
    "a guard as wide as its window": (
        added('\n[extraction]\nmethod = "cfar"\nguard_deg = 6.0\n'),
        "extraction",
        "guard_deg: got 6.0, needed less than window_deg (5.7)",
    ),
    "radars with a wrong sign": (
        replaced("longitude_deg = -43.205450", "longitude_deg = 43.205450"),
        "radars",
        "nm apart, needed 500 at most; is the sign of a position wrong?",
    ),
    "a region named as AIS": (added('\n[[radars]]\nname = "r"\nregion = "ais"\nrange_nm = 6\nrpm = 20\n'), "region", "also that of AIS"),
    "a sonar named as a radar": (replaced('name = "sonar-1"', 'name = "radar-1"'), "sonars", "'radar-1', which is also that of a radar"),
    "a track source named as AIS": (added('\n[[track_sources]]\nname = "ais"\n'), "track_sources", "'ais', which is also that of AIS"),
    "halo": (added("\n[spots]\nhalo_m = 100.0\n"), "spots.halo_m", "got 100.0, needed at least associations.gate_m = 1000.0"),
}  # fmt: skip


@pytest.mark.parametrize("wrong", WRONG)
def test_what_is_wrong_is_named_with_file_and_key(wrong: str, tmp_path: Path) -> None:
    change, key, reason = WRONG[wrong]
    path = written(tmp_path, change())
    said = refusal(path)
    assert said.startswith(f"{path}: ")
    assert key in said
    assert reason in said


def test_every_wrong_key_is_named_at_once(tmp_path: Path) -> None:
    text = (
        BASE.replace("rpm = 15.0", "rpm = -1.0").replace("count = 1000", "count = -5").replace("cycles = 40", "cycles = 1e99")
    )
    said = refusal(written(tmp_path, text)).splitlines()
    assert [("radars.0.rpm" in line, "count" in line, "cycles" in line) for line in said].count((False, False, False)) == 0
    assert len(said) == 3


def test_a_simulation_has_no_span_of_its_own() -> None:
    with pytest.raises(InputError, match="start_utc, cycles: got none or 0"):
        load_scenario("guanabara", {"cycles": "0"}).plan()


def test_a_file_that_cannot_be_read(tmp_path: Path) -> None:
    assert "mine.toml: got text that is not TOML" in refusal(written(tmp_path, "radars are round"))
    assert "mine.toml: got text that is not TOML" in refusal(written(tmp_path, BASE.rstrip()[:-3]))
    assert "mine.toml: line 1: got the byte 0xff, needed text in UTF-8" in refusal(written(tmp_path, b"\xff\xfe\x00scenario"))
    assert "none.toml: there is no such file" in refusal(str(tmp_path / "none.toml"))
    assert "got a folder without scenario.toml" in refusal(str(tmp_path))
    assert "got a file without settings" in refusal(written(tmp_path, ""))


def test_an_unknown_scenario_is_answered_with_those_there_are() -> None:
    said = refusal("atlantis")
    assert "'atlantis'" in said
    assert all(name in said for name in SHIPPED)


REACHED: dict[str, tuple[str, Callable[[Any], Any], Any]] = {
    "cycles": ("7", lambda s: s.cycles, 7),
    "start_utc": ("2026-01-02T03:04:05Z", lambda s: s.start_utc.isoformat(), "2026-01-02T03:04:05+00:00"),
    "title": ("two words", lambda s: s.title, "two words"),
    "name": ('"quoted"', lambda s: s.name, "quoted"),
    "area.width_nm": ("12", lambda s: s.area.width_nm, 12.0),
    "radars.0.rpm": ("24.0", lambda s: [r.rpm for r in s.radars], [24.0, 20.0]),
    "radars.1.name": ("north", lambda s: [r.name for r in s.radars], ["radar-1", "north"]),
    "stations": ("[]", lambda s: s.stations, ()),
    "input.radar.clutter_per_m2": ("5e-7", lambda s: s.input.radar.clutter_per_m2, 5e-7),
    "input.motion.process_noise": ("rw1", lambda s: s.input.motion.process_noise, "rw1"),
    "tracks.upkeep.delete_misses": ("9", lambda s: s.tracks.upkeep.delete_misses, 9),
    "tracks.motion.renewal_s": ("600", lambda s: s.tracks.motion.renewal_s, 600.0),
    "tracks.motion.models": (
        '[{kind = "straight", noise_m2_s3 = 0.1, share = 1.0}]',
        lambda s: [m.noise_m2_s3 for m in s.tracks.motion.models],
        [0.1],
    ),
    "ais_tracks.lateness_s": ("4", lambda s: s.ais_tracks.lateness_s, 4.0),
    "ais_tracks.models": (
        '[{kind = "straight", noise_m2_s3 = 0.1, sojourn_s = 9.0, share = 1.0}]',
        lambda s: [m.noise_m2_s3 for m in s.ais_tracks.models],
        [0.1],
    ),
    "spots.count": ("5", lambda s: s.spots.count, 5),
    "associations.gate_m": ("300", lambda s: (s.associations.method, s.associations.gate_m), ("windowed_covariance", 300.0)),
    "associations.method": ("windowed_covariance_literal", lambda s: s.associations.window, 10),
    "bearing_associations.method": (
        "bearing_windowed_covariance",
        lambda s: s.bearing_associations.method,
        "bearing_windowed_covariance",
    ),
    "fused_tracks.method": ("convex", lambda s: s.fused_tracks.method, "convex"),
    "picture.coast_s": ("1.5", lambda s: s.picture.coast_s, 1.5),
    "store.history_error_m": ("25", lambda s: s.store.history_error_m, 25.0),
    "workers.method": ("processes", lambda s: s.workers.method, "processes"),
    "workers.count": ("2", lambda s: s.workers.count, 2),
}


@pytest.mark.parametrize("key", REACHED)
def test_an_override_reaches_its_setting_and_no_other(key: str) -> None:
    text, found, wanted = REACHED[key]
    plain, changed = load_scenario("context-driven-100"), load_scenario("context-driven-100", {key: text})
    assert found(changed) == wanted
    assert found(plain) != wanted or key.endswith("method")
    stage = key.split(".")[0]
    assert plain.model_dump(exclude={stage}) == changed.model_dump(exclude={stage})


def test_every_stage_takes_a_setting_of_its_default_method_without_the_method() -> None:
    tried = []
    for stage, field in Scenario.model_fields.items():
        default = field.default
        settings = default.model_dump() if "method" in getattr(type(default), "model_fields", {}) else {}
        setting = next((k for k, v in settings.items() if k != "method" and isinstance(v, float | int)), None)
        if setting is None:
            continue
        tried.append(stage)
        made = getattr(load_scenario("solent", {f"{stage}.{setting}": str(getattr(default, setting))}), stage)
        assert made.method == default.method, stage
    assert load_scenario("guanabara", {"tracks.upkeep.delete_misses": "9"}).tracks.method == "guided_vimmjipda"
    assert {"spots", "octants", "associations", "bearing_associations", "fused_tracks", "picture"} <= set(tried)


@pytest.mark.parametrize(
    ("key", "value", "wanted"),
    [
        ("radars.2.rpm", "3", "radars.2: got '2', needed a number from 0 to 1"),
        ("radars.first.rpm", "3", "radars.first: got 'first', needed a number from 0 to 1"),
        ("radars.-1.rpm", "3", "needed a number from 0 to 1"),
        ("radars.rpm", "3", "radars.rpm: got 'rpm'"),
        ("period_s.x", "3", "period_s: got 3.0 there, needed a table"),
        ("radars.0.rpm", "-3", "--set radars.0.rpm: got -3, needed more than 0"),
        ("radars.0.range_km", "3", "--set radars.0.range_km: got 3 for an unknown setting"),
        ("associations.gate_m", "5000", "spots.halo_m"),
        ("spots", "many", "--set spots: got 'many', needed a table"),
        ("tracks.method", "magic", "'magic'"),
        ("", "3", "got 3 for an unknown setting"),
        ("bearing_associations.heard", "0.9", "; its name is now detection_probability"),
        ("registration.method", "on_line", "; its name is now online"),
    ],
)
def test_a_wrong_override_is_named(key: str, value: str, wanted: str) -> None:
    assert wanted in refusal("context-driven-100", {key: value})


def test_another_method_keeps_the_settings_that_it_has_and_leaves_out_the_others() -> None:
    """The file of context-driven-100 sets plot_origin, which a tracker by existence does not have."""
    joint = load_scenario("context-driven-100", {"tracks.method": "vimmjipda"}).tracks
    assert joint.method == "vimmjipda"
    assert load_scenario("context-driven-100", {"tracks.method": "imm"}).tracks.association.method == "known_origin"
    with pytest.raises(ScenarioError, match="plot_origin"):
        load_scenario("context-driven-100", {"tracks.method": "vimmjipda", "tracks.plot_origin": "known"})


PARTS_OF_TRACKERS = {
    "a part of a table": (
        {"tracks.method": "table", "tracks.association.method": "jipda", "tracks.messages.method": "sequential"},
        ("jipda", "manoeuvres", "sequential", "compiled", "existence"),
    ),
    "a part in place of that of the name": (
        {"tracks.method": "vimmjipda", "tracks.motion.kind": "manoeuvres"},
        ("jipda", "manoeuvres", "none", "compiled", "existence"),
    ),
    "the short settings of a name": (
        {"tracks.method": "vimmjipda_noisy_batch", "tracks.message_velocities": "false", "tracks.messages.sigma_m": "9"},
        ("jipda", "imm", "noisy_batch", "compiled", "existence"),
    ),
}


@pytest.mark.parametrize(("settings", "parts"), PARTS_OF_TRACKERS.values(), ids=PARTS_OF_TRACKERS)
def test_a_tracker_has_the_parts_of_its_name_and_those_that_are_given(settings: dict[str, str], parts: tuple[str, ...]) -> None:
    t = load_scenario("context-driven-100", settings).tracks
    assert (t.association.method, t.motion.kind, t.messages.method, t.bank.method, t.upkeep.method) == parts
    assert Scenario.model_validate(load_scenario("context-driven-100", settings).model_dump(mode="json")).tracks == t


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"tracks.method": "imn"}, "tracks.method: got 'imn', needed one of sided_imm, imm, "),
        ({"tracks.method": "imn"}, "multi_hypothesis_literal; did you mean 'imm'?"),
        ({"tracks.motion.kind": "imn"}, "tracks.motion.kind: got 'imn', needed one of manoeuvres, imm"),
        ({"tracks.association.method": "jpdaf"}, "tracks.association.method: got 'jpdaf', needed one of "),
        ({"tracks.plot_origin": "sure"}, "plot_origin: got 'sure', needed 'estimated' or 'known'"),
        (
            {"tracks.messages.method": "sequential"},
            "messages.method: got 'sequential', needed 'none' with association.method = ",
        ),
        ({"tracks.bank.method": "particles"}, "bank.method: got 'particles', needed 'compiled' with association.method = "),
        ({"tracks.upkeep.method": "existence"}, "upkeep.method: got 'existence', needed 'hits' with association.method = "),
    ],
)
def test_a_wrong_part_of_a_tracker_is_named(settings: dict[str, str], said: str) -> None:
    with pytest.raises(ScenarioError) as refused:
        load_scenario("context-driven-1000", settings)
    assert said in str(refused.value)
