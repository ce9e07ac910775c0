"""The cases of the table of accuracy can be run: their scenarios load, their figures exist, their required values can be missed."""

from __future__ import annotations

import pytest

from coastwatch.scenario import load_scenario
from coastwatch.scores.confusion import Confusion
from scaling.load.accuracy import Case, Figure, Run, cold_start, lines_of, load_cases, run_case, value_of

pytestmark = pytest.mark.contract

CASES = load_cases()


def test_every_setting_of_every_case_exists() -> None:
    for case in CASES:
        scenario = load_scenario(case.scenario, dict(pair.split("=", 1) for pair in case.settings))
        assert scenario.input.method == "simulated", case.name


def test_a_case_inherits_the_settings_of_the_cases_it_extends() -> None:
    by_name = {case.name: case for case in CASES}
    both = by_name["plots, bias"].settings
    assert set(by_name["bias"].settings) | set(by_name["plots"].settings) == set(both)


def test_a_case_that_extends_an_unknown_one_is_refused(tmp_path) -> None:
    path = tmp_path / "cases.toml"
    path.write_text('[[case]]\nname = "one"\nextends = ["two"]\nfigure = [{ path = "a.b" }]\n', "utf-8")
    with pytest.raises(ValueError, match=r"one: got extends = \['two'\], needed names of earlier cases"):
        load_cases(path)


def test_a_run_gives_every_figure_and_every_cycle_of_the_warm_up() -> None:
    small = ("input.count=40", "cycles=2", "warmup_s=12")
    case = Case(name="small", settings=("sonars=[]", *small), figure=CASES[-1].figure, cold_start_s=9.0)
    run = run_case(case, 1)
    assert [time_s for time_s, _ in run.decisions] == [3.0, 6.0, 9.0, 12.0]
    assert 0.0 < value_of(Figure(path="associations.f1", scale=100.0), run.scores) <= 100.0
    assert len(list(lines_of(case, [run]))) == len(case.figure) + 2


def test_a_missed_value_is_reported() -> None:
    runs = [Run({"a": {"x": 2.0, "y": 4.0}}, []), Run({"a": {"x": 3.0, "y": 4.0}}, [])]
    figures = (Figure(path="a.x", required=2.5), Figure(path="a.x", over="a.y", required=0.8, better="lower"))
    high, low = lines_of(Case(name="made up", figure=figures), runs)
    assert high.split()[-4:] == ["2.500", "2.500", "2.000", "NO"]
    assert low.split()[-4:] == ["0.800", "0.625", "0.750", "yes"]


def test_a_cold_start_ends_when_f1_of_all_runs_stays_high() -> None:
    right, wrong = Confusion(tp=1000), Confusion(tp=990, fn=10)
    runs = [
        Run({}, [(3.0, right), (6.0, wrong), (9.0, right), (12.0, right)]),
        Run({}, [(3.0, right), (6.0, right), (9.0, right), (12.0, right)]),
    ]
    reached_s, pooled = cold_start(runs)
    assert reached_s == 9.0
    assert pooled[1] == (6.0, pytest.approx(2 * 1990 / (2 * 1990 + 10)))
    assert cold_start([Run({}, [(3.0, wrong)])])[0] == float("inf")
