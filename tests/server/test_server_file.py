"""The file of a server: its options, what the command line replaces, and what is refused by file and key."""

from __future__ import annotations

from pathlib import Path

import pytest

from coastwatch.alarms import numbered
from coastwatch.errors import AddressError, InputError
from coastwatch.operators.cli.parser import make_parser
from coastwatch.scenario import load_scenario
from coastwatch.server.deployment import FROM_FILE_ALONE, Deployment, deployment, variable, with_zones
from coastwatch.server.regions.client import check_files, parsed_region
from coastwatch.shipped import DEFAULT_DB

pytestmark = pytest.mark.contract

WHOLE = """
[server]
scenario = "guanabara"
settings = { period_s = 2.5, "tracks.method" = "imm", "store.overlap" = false }
db = "watch.db"
role = "centre"
port = 8123
tokens = "tokens.toml"
clock = "feeds"
[[feeds]]
name = "harbour"
url = "ais+tcp://a:1"
[[feeds]]
url = "json+listen://b:2?source=x"
[[regions]]
name = "north"
url = "wss://n:3?token-file=t"
"""


def of_words(*words: str, **variables: str) -> Deployment:
    return deployment(vars(make_parser("serve").parse_args(["serve", *words])), variables)


def options(path: Path, text: str, *words: str, **variables: str) -> Deployment:
    path.write_text(text, "utf-8")
    return of_words(str(path), *words, **variables)


def test_the_file_that_ops_shows_is_taken(tmp_path: Path) -> None:
    found = options(tmp_path / "watch.toml", (Path(__file__).parents[2] / "ops" / "watch.toml").read_text("utf-8"))
    assert (found.role, len(found.feed), len(found.region), len(found.webhooks), len(found.zones)) == ("centre", 1, 1, 1, 1)


def test_a_file_takes_the_place_of_options(tmp_path: Path) -> None:
    found = options(tmp_path / "watch.toml", WHOLE)
    assert (found.scenario, found.db, found.role) == ("guanabara", str(tmp_path / "watch.db"), "centre")
    assert (found.host, found.port, found.clock, found.lateness, found.speed) == ("127.0.0.1", 8123, "feeds", 5.0, 1.0)
    assert found.tokens == str(tmp_path / "tokens.toml")
    assert found.feed == ("ais+tcp://a:1?name=harbour", "json+listen://b:2?source=x")
    assert found.region == (f"wss://n:3?token-file={tmp_path}/t&name=north",)
    assert dict(found.settings) == {"period_s": "2.5", "tracks.method": "imm", "store.overlap": "false"}


def test_the_command_line_goes_before_the_file(tmp_path: Path) -> None:
    words = ["--port", "9", "--role", "region", "--db", "other.db", "--feed", "ais+udp://c:4", "--set", "period_s=7"]
    found = options(tmp_path / "watch.toml", WHOLE, *words)
    assert (found.port, found.role, found.lateness, found.db) == (9, "region", 2.0, "other.db")
    assert found.feed == ("ais+udp://c:4",)
    assert dict(found.settings)["period_s"] == "7"


def test_the_environment_goes_before_the_file_and_after_the_command_line(tmp_path: Path) -> None:
    variables = {
        "COASTWATCH_PORT": "9",
        "COASTWATCH_LATENESS_S": "7.5",
        "COASTWATCH_DB": "other.db",
        "COASTWATCH_NEW": "true",
        "COASTWATCH_TOKENS": "",
        "COASTWATCH_FEED": "ais+udp://c:4 'ais+file:///var/log/a b.nmea'",
        "COASTWATCH_SETTINGS": "period_s=7 seed=5",
        "COASTWATCH_TRACEBACK": "1",
    }
    found = options(tmp_path / "watch.toml", WHOLE, "--port", "10", "--set", "seed=6", **variables)
    assert (found.port, found.lateness, found.db, found.new, found.role) == (10, 7.5, "other.db", True, "centre")
    assert found.tokens == str(tmp_path / "tokens.toml")  # an empty variable says nothing
    assert found.feed == ("ais+udp://c:4", "ais+file:///var/log/a b.nmea")
    assert found.settings == {"period_s": "7", "tracks.method": "imm", "store.overlap": "false", "seed": "6"}
    assert of_words(**variables, COASTWATCH_SCENARIO=str(tmp_path / "watch.toml")).scenario == "guanabara"


@pytest.mark.parametrize("name", [name for name in Deployment.model_fields if name not in FROM_FILE_ALONE])
def test_each_option_has_a_variable(name: str) -> None:
    kind = str(Deployment.model_fields[name].annotation)
    text = "region" if name == "role" else "feeds" if name == "clock" else "json" if name == "log_format" else "4"
    text = {"bool": "true", "dict": "a=b"}.get(next((word for word in ("bool", "dict") if word in kind), ""), text)
    found = getattr(of_words(**{variable(name): text}), name)
    assert found != Deployment.model_fields[name].get_default(call_default_factory=True)


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("PORT", "70000", "got '70000', needed 65535 or less"),
        ("PORT", "http", "got 'http', needed a whole number"),
        ("LATENESS_S", "-1", "got '-1', needed 0 or more"),
        ("NEW", "perhaps", "got 'perhaps', needed true or false"),
        ("ROLE", "king", "got 'king', needed 'all', 'region' or 'centre'"),
        ("SETTINGS", "period_s", "got 'period_s', needed KEY=VALUE, quoted as in a shell, with blanks between"),
        ("FEED", "'a", 'got "\'a", needed URLs, quoted as in a shell, with blanks between'),
    ],
)
def test_what_is_wrong_in_the_environment_is_named_by_its_variable(name: str, text: str, said: str) -> None:
    with pytest.raises(InputError) as error:
        of_words("guanabara", **{f"COASTWATCH_{name}": text})
    assert str(error.value) == f"COASTWATCH_{name}: {said}"


def test_without_a_file_options_have_their_defaults() -> None:
    found = of_words("guanabara")
    assert found.db == DEFAULT_DB == make_parser().parse_args(["picture"]).db
    assert (found.scenario, found.host, found.port, found.role, found.feed) == ("guanabara", "127.0.0.1", 8100, "all", ())
    assert (found.clock, found.lateness, found.settings) == ("wall", 2.0, {})


BAY = """
[[zones]]
name = "NAME"
kind = "circle"
centre_deg = [-22.9, -43.15]
radius_nm = 1.0
enter = true
"""


def test_zones_of_a_file_follow_those_of_its_scenario(tmp_path: Path) -> None:
    scenario = load_scenario("guanabara")
    found = options(tmp_path / "watch.toml", WHOLE + BAY.replace("NAME", "bay"))
    made = with_zones(scenario, found.zones)
    assert [(number, zone.name) for number, zone in numbered(made.zones)] == [
        (1, "fort"),
        (2, "channel"),
        (3, "bar"),
        (4, "bay"),
    ]
    assert (made.zones[3].enter, made.zones[3].radius_nm) == (True, 1.0)
    assert with_zones(scenario, options(tmp_path / "watch.toml", WHOLE).zones).zones == scenario.zones
    with pytest.raises(InputError, match="zones: got the name 'fort' 2 times"):
        with_zones(scenario, options(tmp_path / "watch.toml", WHOLE + BAY.replace("NAME", "fort")).zones)


def test_files_in_addresses_lie_beside_the_file_of_the_server(tmp_path: Path) -> None:
    (tmp_path / "north.token").write_text("x", "utf-8")
    region = '[[regions]]\nname = "north"\nurl = "wss://north.example:8100?token-file=north.token&ca-file=/etc/ca.pem"'
    (url,) = options(tmp_path / "watch.toml", '[server]\nrole = "centre"\n' + region).region
    found = parsed_region(url)
    assert (found.name, found.token_file, found.ca_file) == ("north", str(tmp_path / "north.token"), "/etc/ca.pem")
    with pytest.raises(AddressError, match=r"region north: got ca-file=/etc/ca\.pem, needed a file that is there"):
        check_files(found)


def test_a_scenario_is_no_server_file(tmp_path: Path) -> None:
    path = tmp_path / "scenario.toml"
    assert options(path, 'name = "sea"').scenario == str(path)
    assert options(path, "a = [").scenario == str(path)  # the reader of scenarios says what is wrong


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[server]\nport = 70000", "server.port: got 70000, needed 65535 or less"),
        ('[server]\nport = "8192"', "server.port: got '8192', needed"),
        ('[server]\nlateness_s = "2"', "server.lateness_s: got '2', needed"),
        ("[server]\nprot = 1", "server.prot: got 1 for an unknown setting"),
        ('[server]\nrole = "king"', "server.role: got 'king', needed 'all', 'region' or 'centre'"),
        ("[server]\n[[feeds]]\nname = 'a'", "feeds.0.url: got nothing"),
        ("[server]" + BAY, "zones: got them without server.scenario, needed both"),
        ('[server]\nscenario = "guanabara"' + BAY.replace("radius_nm = 1.0", ""), "zones.0: got a circle with other keys"),
        ("[server]\n[zoo]", "zoo: got {} for an unknown setting"),
    ],
)
def test_what_is_wrong_is_named_by_file_and_key(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(InputError) as error:
        options(tmp_path / "watch.toml", text)
    assert str(error.value).startswith(f"{tmp_path / 'watch.toml'}: {said}")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--port", "70000"], "--port: got 70000, needed 65535 or less"),
        (["--lateness", "-1"], "--lateness: got -1.0, needed 0 or more"),
        (["--workers", "0"], "--workers: got '0', needed 1 or more"),
        (["--speed", "1000"], "--speed: got '1000', needed 0.1 to 100"),
    ],
)
def test_what_is_wrong_on_the_command_line_is_named_by_its_option(words: list[str], said: str) -> None:
    with pytest.raises(InputError) as error:
        of_words("guanabara", *words)
    assert str(error.value).startswith(said)


def test_web_hooks_of_the_command_line_go_before_those_of_the_file(tmp_path: Path) -> None:
    text = '[server]\n[[webhooks]]\nurl = "https://a/x"\nkinds = ["dark"]\nsecret_file = "s"'
    (of_file,) = options(tmp_path / "watch.toml", text).webhooks
    assert (of_file.url, of_file.kinds, of_file.secret_file) == ("https://a/x", ("dark",), str(tmp_path / "s"))
    words = ["--webhook", "https://b/y", "--webhook-secret-file", "t"]
    (given,) = options(tmp_path / "watch.toml", text, *words).webhooks
    assert (given.url, given.kinds, given.secret_file) == ("https://b/y", (), "t")


def test_settings_of_the_command_line_need_no_file() -> None:
    made = of_words("guanabara", "--set", "period_s=1.0", "--set", "seed=7")
    assert made.settings == {"period_s": "1.0", "seed": "7"}
    assert load_scenario("guanabara", made.settings).period_s == 1.0
