"""The alert rules of Prometheus, run by promtool: each is quiet while all is well, and fires after what it is for."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import pytest
import yaml

RULES = Path(__file__).parents[2] / "ops" / "compose" / "alerts.yml"
JOB = '{job="coastwatch",instance="server"}'
STEP_S = 10  # from one value to the next, as Prometheus reads the server
LONG_STEP_S = 60  # between two looks of all rules at a trial of hours
WELL_S = 600  # all is well until then


class Trial(NamedTuple):
    """What makes one alert fire: its series go on as `well`, then as `ill`; values of promtool, 'FIRST+STEPxCOUNT'."""

    alert: str
    series: tuple[tuple[str, str, str], ...]  # name and labels; well, 61 values; ill
    fires_after_s: int  # of ill values, at the latest
    also_quiet_after_s: int = 0  # of ill values: too short to be an alert
    every_s: int = STEP_S  # the rules are looked at


def _rises(name: str, by: float, labels: str = JOB) -> tuple[str, str, str]:
    """A counter that stands, then rises by so much in each step."""
    return name + labels, "5x60", f"5+{by}x400"


def _of_records(count: str, ill: int) -> tuple[tuple[str, str, str], ...]:
    """A feed of 100 records in each step, of which one, then so many, are counted as this."""
    total = "coastwatch_feed_total"
    return (
        (f'{total}{{feed="ais",count="{count}"}}', "0+1x60", f"61+{ill}x60"),
        (f'{total}{{feed="ais",count="records"}}', "0+100x60", "6100+100x60"),
    )


TRIALS = (
    Trial("CoastwatchDown", (("up" + JOB, "1x60", "0x60"),), 90, 40),
    Trial("CoastwatchNotReady", (("coastwatch_ready" + JOB, "1x60", "0x60"),), 150, 100),
    Trial(
        "CoastwatchPictureOld",
        (("coastwatch_picture_age_seconds" + JOB, "3x60", "45x60"), ("coastwatch_ready" + JOB, "1x60", "1x60")),
        60,
        20,
    ),
    Trial("CoastwatchCyclesLate", (_rises("coastwatch_cycles_late_total", 1),), 180, 30),
    Trial("CoastwatchCyclesMerged", (_rises("coastwatch_cycles_merged_total", 1),), 120, 30),
    Trial("CoastwatchRestarted", (_rises("coastwatch_restarts_total", 1),), 30),
    Trial("CoastwatchStoreBehind", (("coastwatch_store_waiting" + JOB, "2x60", "3x60"),), 60, 20),
    Trial("CoastwatchStoreBehind", (_rises("coastwatch_store_failures_total", 1),), 70, 20),
    Trial(
        "CoastwatchNotStored",
        (
            _rises("coastwatch_store_skipped_total", 1),
            _rises("coastwatch_store_forgotten_total", 0),
            _rises("coastwatch_alarms_forgotten_total", 0),
        ),
        30,
    ),
    Trial("CoastwatchLogHeld", (("coastwatch_log_bytes" + JOB, "1000000000x60", "3000000000x60"),), 90, 40),
    Trial("CoastwatchDiskFills", (("coastwatch_disk_free_bytes" + JOB, "3000000000x60", "1900000000x60"),), 330, 280),
    Trial("CoastwatchCertificateEnds", (("coastwatch_tls_expires_seconds" + JOB, "1300000x60", "1200000x60"),), 330, 280),
    Trial(
        "CoastwatchTrouble",
        (('coastwatch_trouble{job="coastwatch",serious="true",what="feed"}', "0x60", "1x60"),),
        60,
        20,
    ),
    Trial("CoastwatchFeedLost", (('coastwatch_feed_connected{feed="ais"}', "1x60", "0x60"),), 90, 40),
    Trial("CoastwatchFeedSilent", (('coastwatch_feed_silent_seconds{feed="ais"}', "3x60", "130x60"),), 90, 40),
    Trial("CoastwatchFeedRefused", _of_records("refused", 50), 600, 200),
    Trial("CoastwatchReportsLate", _of_records("late", 30), 600, 200),
    Trial("CoastwatchFeedDropped", (_rises("coastwatch_feed_total", 1, '{feed="ais",count="dropped"}'),), 120, 30),
    Trial(
        "CoastwatchVideoStopped",
        (  # of two feeds of one radar, one goes on
            ('coastwatch_radar_silent_seconds{job="coastwatch",feed="a",radar="north"}', "900x60", "900x60"),
            ('coastwatch_radar_silent_seconds{job="coastwatch",feed="b",radar="north"}', "1x60", "20x60"),
        ),
        20,
    ),
    Trial(
        "CoastwatchSpokesLost",
        (
            ('coastwatch_radar_total{feed="a",radar="north",count="spokes_lost"}', "0+1x60", "61+300x60"),
            ('coastwatch_radar_total{feed="a",radar="north",count="spokes"}', "0+8192x60", "499712+8192x60"),
        ),
        400,
        60,
    ),
    Trial("CoastwatchRefusals", (_rises("coastwatch_requests_total", 20, '{status="401"}'),), 600, 200),
    Trial("CoastwatchServerErrors", (_rises("coastwatch_requests_total", 1, '{status="500"}'),), 30),
    Trial("CoastwatchViewersSlow", (_rises("coastwatch_viewers_slow_closed_total", 1),), 90, 10),
    Trial(
        "CoastwatchMemoryGrows",
        (("process_resident_memory_bytes" + JOB, "500000000x60", "500000000x2200 1200000000x400"),),
        22000 + 1900,
        22000 + 1500,
        LONG_STEP_S,
    ),
    Trial("CoastwatchWebhookFails", (_rises("coastwatch_webhook_total", 1, '{count="failed"}'),), 30),
)


def _tests(trial: Trial) -> list[dict[str, object]]:
    """The instants at which the alert must be quiet, then the one at which it must fire, for promtool."""
    quiet_s = sorted({WELL_S, WELL_S + trial.also_quiet_after_s})
    firing = f'count(ALERTS{{alertname="{trial.alert}",alertstate="firing"}})'
    asked: list[dict[str, object]] = [{"expr": firing, "eval_time": f"{at_s}s", "exp_samples": []} for at_s in quiet_s]
    fires_s = WELL_S + trial.fires_after_s
    return [*asked, {"expr": firing, "eval_time": f"{fires_s}s", "exp_samples": [{"labels": "{}", "value": 1}]}]


def _by_promtool(trials: Sequence[Trial], folder: Path) -> subprocess.CompletedProcess[str]:
    """What promtool says of trials of these rules: a file for each interval of looking at them."""
    program = shutil.which("promtool")
    if program is None:
        pytest.skip("promtool is not installed: it comes with Prometheus")
    cases = []
    for every_s in sorted({trial.every_s for trial in trials}):
        tests = [_with_values(trial) for trial in trials if trial.every_s == every_s]
        cases.append(folder / f"alerts-{every_s}.test.yml")
        of_file = {"rule_files": [str(RULES)], "evaluation_interval": f"{every_s}s", "tests": tests}
        cases[-1].write_text(yaml.safe_dump(of_file), "utf-8")
    return subprocess.run([program, "test", "rules", *map(str, cases)], capture_output=True, text=True, check=False)


def _with_values(trial: Trial) -> dict[str, object]:
    """One group of tests for promtool."""
    series = [{"series": name, "values": f"{well} {ill}"} for name, well, ill in trial.series]
    return {"name": trial.alert, "interval": f"{STEP_S}s", "input_series": series, "promql_expr_test": _tests(trial)}


def test_each_alert_is_quiet_while_all_is_well_and_fires_after_what_it_is_for(tmp_path: Path) -> None:
    alerts = {rule["alert"] for group in yaml.safe_load(RULES.read_text("utf-8"))["groups"] for rule in group["rules"]}
    assert {trial.alert for trial in TRIALS} == alerts
    done = _by_promtool(TRIALS, tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr


def test_a_rule_that_stays_quiet_would_be_found(tmp_path: Path) -> None:
    well = TRIALS[0]._replace(series=(("up" + JOB, "1x60", "1x60"),))
    done = _by_promtool([well], tmp_path)
    assert done.returncode == 1
    assert "FAILED" in done.stderr
