"""The files of `ops/`: units and environments fit together, and three nodes of this machine run as three machines would."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import httpx2 as httpx
import pytest
import yaml
from feed_world import put_datagrams
from run_world import SEED, Start, column, rows, stored, url
from server_world import wait_for
from video_world import arrivals, messages

from coastwatch.operators.api.metrics import OF_RUN, Metrics
from coastwatch.operators.cli import make_parser
from coastwatch.scenario import load_scenario
from coastwatch.server.feeds.address import parsed
from coastwatch.server.feeds.live_input import LiveInput
from coastwatch.server.troubles import Trouble

pytestmark = pytest.mark.whole

OPS = Path(__file__).parents[2] / "ops"
RAY = OPS / "ray"
UNITS = sorted([*OPS.glob("*/*.service"), *OPS.glob("*/*.timer")])
COMPOSE = OPS / "compose"
ALERTS, DASHBOARD = COMPOSE / "alerts.yml", OPS / "dashboards" / "coastwatch.json"
PROGRAM = "/opt/coastwatch"
PATIENCE_S = 240.0  # until a node of a busy machine has come up
HEAD_PORT, FIRST_PORT, FIRST_WORKER_PORT = 36390, 36400, 37000


def directives(unit: Path) -> list[tuple[str, str]]:
    """Each key with its value."""
    lines = [line for line in unit.read_text("utf-8").splitlines() if line and not line.startswith(("#", "["))]
    return [(key, value) for key, _, value in (line.partition("=") for line in lines)]


def environment(file: Path) -> dict[str, str]:
    """The variables that systemd reads from a file."""
    lines = [line for line in file.read_text("utf-8").splitlines() if line and not line.startswith("#")]
    assert all(re.fullmatch(r"[A-Z_]+=\S+", line) for line in lines), "a value needs no blanks or quotes"
    return dict(line.split("=", 1) for line in lines)


def used(text: str) -> set[str]:
    """The variables that a text needs: those with a default are not among them."""
    return {braced or bare for braced, bare in re.findall(r"\$(?:\{([A-Z_]+)\}|([A-Z_]+))", text)}


def metrics() -> tuple[str, set[str]]:
    """What `/metrics` of a server with a feed answers, and the names of all its series."""
    found = Metrics()
    addresses = [parsed(f"{name}+udp://127.0.0.1:0") for name in ("ais", "video")]
    with LiveInput(addresses, load_scenario("guanabara").sensors()) as live:
        counts = dict.fromkeys(OF_RUN, 1.0)
        put_datagrams(live.ports[1], [data for _, data, _ in arrivals(messages(turns=0.1), time.time())])
        wait_for(lambda: live.feeds()[1]["received"] > 0)
        live.between(0.0, 1.0)
        found.ask(lambda: (True, counts, live.feeds(), [Trouble("store", "", None, "away", False)]))
        found.webhooks.labels("a hook", "failed")
        found.certificate(lambda: 1.0)
        found.disk(lambda: 1.0)
        text = found.text().decode()
    kinds = {"counter": ("_total",), "histogram": ("_bucket", "_count", "_sum"), "gauge": ("",)}
    typed = re.findall(r"^# TYPE (\w+) (\w+)$", text, re.MULTILINE)
    return text, {name.removesuffix("_total") + end for name, kind in typed for end in kinds[kind]} | {"up"}


def test_every_metric_that_a_rule_or_panel_names_is_one_of_the_server() -> None:
    rules = [rule["expr"] for group in yaml.safe_load(ALERTS.read_text("utf-8"))["groups"] for rule in group["rules"]]
    panels = [target["expr"] for panel in json.loads(DASHBOARD.read_text("utf-8"))["panels"] for target in panel["targets"]]
    assert (len(rules), len(panels)) > (10, 15)
    text, known = metrics()
    asked = {name for expr in rules + panels for name in re.findall(r"\b(?:coastwatch|process)_\w+|\bup\b", expr)}
    assert asked - known == set()
    ours = {name for name in known if name.startswith("coastwatch_") and not name.endswith(("_sum", "_count"))}
    assert ours - asked <= {"coastwatch_picture_time_seconds", "coastwatch_cycles_total"}
    counts = {word for expr in rules + panels for said in re.findall(r'count=~?"([^"]+)"', expr) for word in said.split("|")}
    assert counts == {"records", "refused", "late", "dropped", "failed", "spokes", "spokes_lost", "parts_lost"}
    assert all(f'count="{word}"' in text for word in counts)


def test_stopped_video_sounds_once_for_each_radar_and_names_it() -> None:
    text, _ = metrics()
    (series,) = re.findall(r"^coastwatch_radar_silent_seconds\{(.*)\} ", text, re.MULTILINE)
    labels = {word.partition("=")[0] for word in re.findall(r'\w+="[^"]*"', series)}
    rules = {rule["alert"]: rule for group in yaml.safe_load(ALERTS.read_text("utf-8"))["groups"] for rule in group["rules"]}
    rule = rules["CoastwatchVideoStopped"]
    (kept,) = re.findall(r"^min by \(([^)]*)\) \(coastwatch_radar_silent_seconds\) > \d+$", rule["expr"])
    assert labels - set(kept.split(", ")) == {"feed"}
    assert "{{ $labels.radar }}" in rule["annotations"]["summary"]


def test_every_alert_has_a_page_and_every_page_is_in_the_list() -> None:
    pages = OPS / "runbook"
    rules = [rule for group in yaml.safe_load(ALERTS.read_text("utf-8"))["groups"] for rule in group["rules"]]
    for rule in rules:
        page = pages / f"{rule['alert']}.md"
        assert rule["annotations"]["runbook"] == str(page.relative_to(OPS.parent))
        said = page.read_text("utf-8")
        assert all(f"**{part}**" in said for part in ("Sign", "Meaning", "Remedy"))
        assert rule["alert"] in said
    named = {page.stem for page in pages.glob("Coastwatch*.md")}
    assert named == {rule["alert"] for rule in rules}
    listed = (pages / "README.md").read_text("utf-8")
    assert [page.name for page in pages.glob("*.md") if page.name != "README.md" and f"]({page.name})" not in listed] == []


def test_the_stack_of_containers_starts_commands_that_there_are_and_mounts_files_that_there_are() -> None:
    stack = yaml.safe_load((COMPOSE / "compose.yaml").read_text("utf-8"))
    services, made_by_hand = stack["services"], {"tokens.toml", "metrics.token"}
    for name in ("server", "upgrade"):
        words = [word.replace("${SCENARIO:-guanabara}", "guanabara") for word in services[name]["command"]]
        make_parser().parse_args(words)
        assert (COMPOSE / services[name]["build"]["context"] / services[name]["build"]["dockerfile"]).is_file()
    mounts = [mount.split(":") for service in services.values() for mount in service.get("volumes", ())]
    for source, target, *_ in mounts:
        if source.startswith("."):
            assert Path(source).name in made_by_hand or (COMPOSE / source).exists(), source
        else:
            assert source in stack["volumes"], source
        assert target.startswith("/")
    assert "http://server:8100".removeprefix("http://") in (COMPOSE / "prometheus.yml").read_text("utf-8")
    page = (COMPOSE / "README.md").read_text("utf-8")
    assert [found.name for found in COMPOSE.iterdir() if found.suffix in (".yml", ".yaml") and found.name not in page] == []


CENTRE, REGION = environment(RAY / "centre.env"), environment(RAY / "region.env")


@pytest.mark.parametrize("unit", UNITS, ids=lambda unit: unit.name)
def test_a_unit_is_valid_and_starts_what_is_installed(unit: Path, tmp_path: Path) -> None:
    text = unit.read_text("utf-8")
    for program in re.findall(rf"^ExecStart=({PROGRAM}\S+)", text, re.MULTILINE):
        name = Path(program).relative_to(PROGRAM)
        assert (name.parts[0] == "ops" and os.access(OPS.parent / name, os.X_OK)) or str(name) == ".venv/bin/coastwatch"
    (page,) = set(re.findall(rf"^Documentation=file://{PROGRAM}/(\S+)", text, re.MULTILINE)) or {"ops/README.md"}
    assert (OPS.parent / page).is_file()
    if shutil.which("systemd-analyze") is None:
        pytest.skip("systemd is not installed")
    for each in UNITS:
        there = re.sub(rf"{PROGRAM}/\S+(?= )", "/bin/true", each.read_text("utf-8"))
        (tmp_path / each.name).write_text(there, "utf-8")
    checked = subprocess.run(
        ["systemd-analyze", "verify", str(tmp_path / unit.name.replace("@.", "@head."))],
        capture_output=True,
        text=True,
        env={**os.environ, "SYSTEMD_UNIT_PATH": f"{tmp_path}:"},
    )
    assert [line for line in checked.stderr.splitlines() if "coastwatch" in line] == []


def test_a_unit_deletes_nothing_that_settings_keep_and_a_hangup_leaves_no_watch_down() -> None:
    serve = directives(OPS / "systemd" / "coastwatch-serve.service")
    assert {("Restart", "always"), ("RestartPreventExitStatus", "2"), ("ExecReload", "/bin/kill -HUP $MAINPID")} <= set(serve)
    assert [unit.name for unit in UNITS if "prune" in unit.read_text("utf-8")] == []
    backup = OPS / "systemd" / "coastwatch-backup.service"
    assert ("OnFailure", "coastwatch-failed@%n.service") in directives(backup)
    assert (backup.parent / "coastwatch-failed@.service").is_file()


def test_every_variable_of_units_and_script_is_in_the_environment_of_its_machine() -> None:
    node = used((RAY / "node").read_text("utf-8")) - {"RAY"}
    assert node == {"NODE_ADDRESS", "NODE_CPUS", "STORE_BYTES", "HEAD_ADDRESS"}
    assert node <= set(REGION)
    assert node <= set(CENTRE)
    centre = dict(directives(RAY / "coastwatch-centre@.service"))
    run = used(centre["ExecStart"])
    assert run == {"COASTWATCH_DB", "ACTORS"}
    assert set(CENTRE) == node | run | {"RAY_ADDRESS"}
    for unit in RAY.glob("*.service"):
        given = directives(unit)
        assert ("EnvironmentFile", "/etc/coastwatch/ray.env") in given
        assert ("Environment", "RAY_AUTH_MODE=token RAY_AUTH_TOKEN_PATH=/etc/coastwatch/ray.token") in given


def test_addresses_ports_and_processors_fit_together() -> None:
    assert CENTRE["HEAD_ADDRESS"] == REGION["HEAD_ADDRESS"] == CENTRE["NODE_ADDRESS"] != REGION["NODE_ADDRESS"]
    port = re.search(r"HEAD_PORT:-(\d+)", (RAY / "node").read_text("utf-8"))
    assert port
    assert CENTRE["RAY_ADDRESS"] == f"{CENTRE['HEAD_ADDRESS']}:{port[1]}"
    assert CENTRE["NODE_CPUS"] == "0"
    assert int(CENTRE["ACTORS"]) == 2 * int(REGION["NODE_CPUS"])


def test_the_page_names_every_file_and_port() -> None:
    page = (RAY / "README.md").read_text("utf-8")
    assert [
        file.name for file in RAY.iterdir() if file.name not in page.replace("`README.md`", "") and file.suffix != ".md"
    ] == []
    first, worker = (
        int(found[1])
        for found in (
            re.search(rf"{name}:-(\d+)", (RAY / "node").read_text("utf-8")) for name in ("FIRST_PORT", "FIRST_WORKER_PORT")
        )
        if found
    )
    for ports in (f"| {first}, {first + 1} |", f"| {first + 2} to {first + 5} |", f"| {worker} to {worker + 997} |"):
        assert ports in page


@pytest.fixture
def three_nodes(tmp_path: Path) -> Iterator[tuple[dict[str, str], dict[str, subprocess.Popen[bytes]]]]:
    """A centre and two regional machines on this one, by `node` and the environment files with other addresses and ports."""
    pytest.importorskip("ray", reason="Ray is not installed")
    token = tmp_path / "ray.token"
    token.write_text("0123456789abcdef" * 4)
    begun: dict[str, subprocess.Popen[bytes]] = {}
    here = {
        **os.environ,
        "RAY": str(Path(sys.executable).with_name("ray")),
        "RAY_AUTH_MODE": "token",
        "RAY_AUTH_TOKEN_PATH": str(token),
        "HEAD_PORT": str(HEAD_PORT),
        "HEAD_ADDRESS": "127.0.0.1",
        "NODE_ADDRESS": "127.0.0.1",
        "STORE_BYTES": str(80 * 2**20),
    }
    machines = {
        "centre": (CENTRE, "head", {}),
        "region-1": (REGION, "worker", {"NODE_CPUS": "1"}),
        "region-2": (REGION, "worker", {"NODE_CPUS": "1"}),
    }
    try:
        for number, (machine, (given, kind, other)) in enumerate(machines.items()):
            ports = {"FIRST_PORT": str(FIRST_PORT + 10 * number), "FIRST_WORKER_PORT": str(FIRST_WORKER_PORT + 1000 * number)}
            begun[machine] = subprocess.Popen(
                [RAY / "node", kind],
                env={**given, **here, **ports, **other},
                stdout=(tmp_path / f"{machine}.log").open("wb"),
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )
            wait_until_up(begun[machine], tmp_path / f"{machine}.log")
        yield {**here, "RAY_ADDRESS": f"127.0.0.1:{HEAD_PORT}"}, begun
    finally:
        for process in reversed(begun.values()):
            process.terminate()
        for process in begun.values():
            with suppress(subprocess.TimeoutExpired):
                process.wait(60.0)
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)


def wait_until_up(node: subprocess.Popen[bytes], log: Path) -> None:
    """Nodes of one machine must begin one after the other."""
    until = time.monotonic() + PATIENCE_S
    while "will now block" not in (said := log.read_text("utf-8", "replace")):
        assert node.poll() is None, said
        assert time.monotonic() < until, said
        time.sleep(0.2)


@pytest.mark.slow
def test_three_machines_of_which_a_regional_one_is_lost_give_the_rows_of_one(
    three_nodes: tuple[dict[str, str], dict[str, subprocess.Popen[bytes]]], start: Start, tmp_path: Path
) -> None:
    variables, nodes = three_nodes
    radar = '{{name = "{0}", region = "{0}", latitude_deg = {1}, longitude_deg = -43.1, range_nm = 5.0, rpm = 20.0}}'
    settings = {
        "radars": f"[{radar.format('north', -23.0)}, {radar.format('south', -23.1)}]",
        "tracks.plot_origin": "estimated",
        "input.count": "60",
        "cycles": "60",
        "warmup_s": "0.0",
    }
    words = [word for key, value in settings.items() for word in ("--set", f"{key}={value}")]
    command = ["run", "context-driven-1000", "--seed", str(SEED), *words, "--set"]
    alone, spread = tmp_path / "alone.db", tmp_path / "spread.db"
    one = start(*command, "workers.method=threads", "--db", url(alone))
    _, said = one.communicate(timeout=PATIENCE_S)
    assert one.returncode == 0, said
    run = start(*command, "workers.method=ray", "--workers", "2", "--db", url(spread), env=variables)
    until = time.monotonic() + PATIENCE_S
    while stored(spread) < 20:
        assert run.poll() is None, run.communicate()
        assert time.monotonic() < until
        time.sleep(0.01)
    os.killpg(nodes["region-2"].pid, signal.SIGKILL)
    _, said = run.communicate(timeout=PATIENCE_S)
    assert run.returncode == 0, said
    assert column(spread, "SELECT status FROM run") == ["finished"]
    assert rows(spread) == rows(alone)
    assert nodes["region-1"].poll() is None


@pytest.mark.slow
def test_the_live_demo_begins_shows_vessels_and_ends(tmp_path: Path) -> None:
    def demo(word: str, *more: str) -> subprocess.CompletedProcess[str]:
        line = [sys.executable, OPS / "demo.py", word, *more]
        return subprocess.run(line, cwd=tmp_path, capture_output=True, text=True, timeout=PATIENCE_S, check=False)

    try:
        begun = demo("start", "--port", "0")
        assert begun.returncode == 0, begun.stderr
        found = re.search(r"Live: (\d+) vessels, fed over sockets, at (http://127.0.0.1:\d+)", begun.stdout)
        assert found
        assert int(found[1]) > 0
        feeds = httpx.get(f"{found[2]}/api/v1/feeds").json()["feeds"]
        assert [feed["connected"] for feed in feeds] == [True, True, True]
    finally:
        ended = demo("stop")
    assert "has ended" in ended.stdout
    with pytest.raises(httpx.ConnectError):
        httpx.get(f"{found[2]}/healthz")
    assert "No live demo" in demo("stop").stdout
    assert rows(tmp_path / "out" / "live.db")["vessel"]


@pytest.mark.slow
def test_a_server_that_is_stopped_and_started_again_goes_on_with_the_same_vessels(tmp_path: Path, start: Start) -> None:
    with socket.socket() as one, socket.socket() as other:
        one.bind(("127.0.0.1", 0))
        other.bind(("127.0.0.1", 0))
        page, ais = one.getsockname()[1], other.getsockname()[1]
    path = tmp_path / "live.db"
    serve = ["serve", "guanabara", "--db", url(path), "--port", str(page), "--set", "radars=[]", "--feed"]

    def ids(cycle: int) -> dict[str, int]:
        until = time.monotonic() + PATIENCE_S
        while time.monotonic() < until:
            with suppress(httpx.HTTPError, KeyError):
                found = httpx.get(f"http://127.0.0.1:{page}/api/v1/picture", params={"sources": "ais", "limit": 1000}).json()
                if found["cycle"] >= cycle:
                    return {row["mmsi"]: row["vessel_id"] for row in found["vessels"]}
            time.sleep(0.2)
        raise TimeoutError(f"cycle {cycle} did not come")

    first = start(*serve, f"ais+listen://127.0.0.1:{ais}")
    feed = start("feed", "guanabara", "--set", "cycles=600", "--set", "radars=[]", "--to", f"ais+tcp://127.0.0.1:{ais}")
    before = ids(6)
    first.send_signal(signal.SIGINT)
    _, said = first.communicate(timeout=PATIENCE_S)
    assert first.returncode == 0, said
    last = stored(path) - 1
    second = start(*serve, f"ais+listen://127.0.0.1:{ais}")
    after = ids(last + 1)
    assert feed.poll() is None
    second.send_signal(signal.SIGINT)
    second.communicate(timeout=PATIENCE_S)
    common = before.keys() & after.keys()
    assert len(common) > 50
    assert {mmsi: before[mmsi] for mmsi in common} == {mmsi: after[mmsi] for mmsi in common}
    assert column(path, "SELECT count(*) FROM run") == [1]
    numbers = column(path, "SELECT number FROM cycle ORDER BY number")
    assert numbers == list(range(len(numbers)))
