"""Options of the commands that run, feed or reproduce something."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal, get_args, get_origin

from coastwatch.operators.cli.arguments import (
    RADAR,
    SCENARIOS,
    SONAR,
    STATION,
    Parser,
    add_running,
    add_set,
    column_names,
    completed_by,
    count,
    database,
    pair,
    position,
    seed,
    sensor,
    speed,
    whole,
    workers,
    written_as,
)
from coastwatch.operators.cli.commands import Commands
from coastwatch.operators.typed import utc
from coastwatch.operators.verdict import requirement

MOVES = "without latitude and longitude (name,,,range_nm,rpm) it moves, and each plot has site_latitude and site_longitude"
COMMANDS = Commands()


@COMMANDS.command("run", "runs:run", "run a scenario and store the picture")
def run(parser: Parser) -> None:
    """Run a scenario and store the picture of every cycle. Ctrl-C stops it after the cycle in progress; --resume continues it."""
    text = "name (see `coastwatch scenarios`), folder, or .toml file"
    completed_by(parser.add_argument("scenario", metavar="SCENARIO", help=text), SCENARIOS)
    parser.add_argument("--seed", metavar="N", type=seed, help="seed of all randomness (default: the scenario's)")
    add_set(parser, "override a setting, value as in TOML: radars.0.rpm=20, tracks.method=imm; repeatable")
    add_running(parser)
    text = "a figure of the scores must be so, e.g. associations.f1>=0.999; repeatable. Exit code 4 and a sentence if it is not"
    parser.add_argument("--require", metavar="FIGURE>=N", action="append", default=[], type=requirement, help=text)
    text = (
        "compare scores with the last good run of this scenario and seed in the database: exit code 4 and a sentence for each figure "
        "that is worse. A run of which a figure fell is not good"
    )
    parser.add_argument("--compare", choices=("last",), help=text)
    text = "how much worse a figure may be: shares as they are, errors relative to the last good run (default: 0.002)"
    parser.add_argument("--tolerance", metavar="N", type=float, default=0.002, help=text)
    text = "then delete all but the newest N runs of this scenario; the last good one stays, for --compare"
    parser.add_argument("--keep", metavar="N", type=count, help=text)
    text = "also write the picture of every cycle as CSV: time (Unix s), track_id, north, east (m), vn, ve (m/s), latitude, longitude"
    parser.add_argument("--tracks-csv", metavar="FILE", help=text)
    text = "the point where north and east are 0 (default: the centre of the scenario's area)"
    parser.add_argument("--tracks-origin", metavar="LAT,LON", type=position, help=text)


@COMMANDS.command("scenarios", "runs:scenarios", "list the scenarios")
def scenarios(parser: Parser) -> None:
    """List the scenarios that come with Coastwatch."""
    parser.add_argument("--json", action="store_true", help="print a JSON list of name and title")


@COMMANDS.command("fuse", "fuse:fuse", "fuse recorded files of your own")
def fuse(parser: Parser) -> None:
    """Fuse recorded files into one stored picture, without a scenario. The format of each file is detected from its content."""
    text = "AIS: NMEA 0183 lines, CSV or Parquet; several files in order of time"
    completed_by(parser.add_argument("--ais", metavar="FILE", nargs="+", default=[], help=text))
    text = "radar plots: CSV or Parquet with time, radar, range and azimuth"
    completed_by(parser.add_argument("--plots", metavar="FILE", help=text))
    text = (
        "radar video: a capture (PCAP) of ASTERIX CAT 240, with options as of --feed: turns.pcap, "
        "'video+file:turns.pcap?25/1=north&25/2=south' with SAC/SIC of each radar; without, SIC 1 is the first --radar; a table of "
        "pictures of a screen, 'pictures+file:turns.csv?pixel_m=10&head_up=true', or HDF5 of HAXR, "
        "'haxr+file:port.hdf5?day=2025-06-01', with radar=NAME where there are several. What a file has, and "
        "settings: coastwatch video FILE"
    )
    completed_by(parser.add_argument("--video", metavar="FILE", nargs="+", default=[], help=text))
    text = "bearings: CSV or Parquet with time, sonar and bearing"
    completed_by(parser.add_argument("--bearings", metavar="FILE", help=text))
    text = (
        "finished tracks of other systems, each file a source of its own: CSV or Parquet with time, track, position and velocity, or "
        "NMEA 0183 with TTM or TLL"
    )
    completed_by(parser.add_argument("--tracks", metavar="FILE", nargs="+", default=[], help=text))
    text = (
        "a file of what a live feed carries, as lines, data blocks or a capture (PCAP), with options as of serve --feed: "
        "asterix+file:plots.pcap?port=8600, json+file:bearings.jsonl; repeatable"
    )
    parser.add_argument("--feed", metavar="FORMAT+file:FILE", action="append", default=[], help=text)
    text = "where the radar of TTM sentences stands, if they come without the position of an own ship"
    parser.add_argument("--track-site", metavar="LAT,LON", type=position, help=text)
    one: dict[str, Any] = {"action": "append", "default": [], "metavar": "SPEC"}
    more = "any other of its settings by number, as --set radars.0.azimuth_reference=magnetic"
    parser.add_argument("--radar", **one, type=sensor(RADAR), help=f"a radar: {written_as(RADAR)}; {MOVES}; {more}; repeatable")
    text = f"an AIS receiver: {written_as(STATION)}; repeatable; the dark flag needs one"
    parser.add_argument("--station", **one, type=sensor(STATION), help=text)
    parser.add_argument("--sonar", **one, type=sensor(SONAR), help=f"a bearing sensor: {written_as(SONAR)}; repeatable")
    text = (
        "names of your columns: time=when,mmsi=ship,sog=speed. A prefix limits one to a kind of table: ais.time=when, plots.time=t, "
        "bearings.time=t, tracks.track=nr. Usual names need none"
    )
    parser.add_argument("--columns", metavar="OURS=YOURS", type=column_names, default={}, help=text)
    text = "seconds of one cycle (default: 3, or 10 of AIS alone, since few vessels report more often)"
    parser.add_argument("--period", metavar="S", type=float, help=text)
    add_set(parser, "override any setting of a scenario, e.g. tracks.method=imm; repeatable")
    add_running(parser)


@COMMANDS.command("serve", "serving:serve", "run live and serve the picture over HTTP and WebSocket")
def serve(parser: Parser) -> None:
    """Serve the picture to browsers and programs: map, API and live stream. With a scenario, run it as time passes and serve
    each picture: a simulation begins now. Without one, follow the run that another process writes to the database. The file of
    a server has these options in its tables [server], [[feeds]] and [[regions]]; variables such as COASTWATCH_PORT and
    COASTWATCH_FEED, several values with blanks between, go before the file. Ctrl-C stops it after a whole cycle.
    """
    from coastwatch.server.deployment import FROM_FILE_ALONE, Deployment, Option, flag  # other commands do not wait for it

    # ranges refused in one sentence
    narrower: dict[str, Callable[[str], object]] = {"workers": workers, "speed": speed, "db": database}
    for name, field in Deployment.model_fields.items():
        if name in FROM_FILE_ALONE:
            continue
        option = next((about for about in field.metadata if isinstance(about, Option)), Option())
        text, metavar, origin = field.description, option.metavar, get_origin(field.annotation)
        if name == "scenario":
            completed_by(parser.add_argument(name, metavar=metavar, nargs="?", help=text), SCENARIOS)
        elif field.annotation is bool:
            parser.add_argument(flag(name), dest=name, action="store_true", default=None, help=text)
        elif origin is Literal:
            parser.add_argument(flag(name), dest=name, choices=get_args(field.annotation), help=text)
        elif origin in (tuple, dict):
            read: Callable[[str], object] = pair if origin is dict else str
            parser.add_argument(flag(name), dest=name, metavar=metavar, action="append", type=read, help=text)
        else:
            kinds = {field.annotation, *get_args(field.annotation)}
            read = narrower.get(name, whole if int in kinds else float if float in kinds else str)
            added = parser.add_argument(flag(name), dest=name, metavar=metavar, type=read, help=text)
            if option.is_file:
                completed_by(added)


@COMMANDS.command("feed", "feeding:feed", "send a simulation or a recording to live feeds")
def feed(parser: Parser) -> None:
    """Send the reports of a scenario, or the sentences of a recorded file, to live feeds by their times: a load generator, and
    a demo of live feeds. A simulation at speed 1 begins now. It prints how many lines or datagrams it sent.
    """
    text = "name of a scenario, folder, .toml file, a file of AIS sentences, or a capture (PCAP)"
    completed_by(parser.add_argument("source", metavar="SCENARIO|FILE", help=text))
    from coastwatch.formats.registry import ENCODED, FORMATS  # other commands do not wait for them

    datagrams = ", ".join(f"{name}+udp" for name in ENCODED if FORMATS[name].in_datagrams)
    lines = ", ".join(name for name in ENCODED if not FORMATS[name].in_datagrams)
    text = f"where to, as --feed of serve: {datagrams}; or {lines} with +tcp (connect), +listen, +udp or +file; repeatable"
    parser.add_argument("--to", metavar="URL", action="append", required=True, help=text)
    add_set(parser, "override a setting of the scenario; repeatable")
    text = "times as fast as the clock, 0.1 to 100 (default: 1)"
    parser.add_argument("--speed", metavar="N", type=speed, default=1.0, help=text)


@COMMANDS.command("video", "video:video", "say what radar video comes")
def video(parser: Parser) -> None:
    """Say what radar video comes from a file or a feed, and what was lost. Then print the settings to begin with."""
    completed_by(parser.add_argument("source", metavar="FILE|URL", help="capture, file of CAT 240, or video+udp://..."))
    parser.add_argument("--seconds", metavar="S", type=float, default=10.0, help="of video to look at (default: 10)")


@COMMANDS.command("token add", "serving:add_token", "make a token")
def token_add(parser: Parser) -> None:
    """Make a token of a person or program and print it. The file keeps its hash. A viewer may read; an operator may also
    acknowledge; an admin may do all.
    """
    parser.add_argument("name", metavar="NAME", help="whose it is; it is named in the audit")
    parser.add_argument("--role", choices=("viewer", "operator", "admin"), default="viewer", help="default: viewer")
    parser.add_argument("--expires", metavar="UTC", type=utc, help="until when it is valid, ISO 8601 (default: for ever)")
    text = "file of tokens (default: tokens.toml)"
    completed_by(parser.add_argument("--tokens", metavar="FILE", default="tokens.toml", help=text))


@COMMANDS.command("reproduce", "reproduce:reproduce", "reproduce the published figures of a paper")
def reproduce(parser: Parser) -> None:
    """Reproduce every published figure of a paper: run its methods as published and ours over seeds 1000, 1001, ..., then write
    an HTML report and a JSON file. Exit code 4 if a target is missed or an ordering of the paper fails; the last lines say which.
    Finished runs stay in the output folder: the same command goes on with what is missing.
    """
    parser.add_argument("paper", metavar="PAPER", help="the paper: hem, heymann, liland, rangel or sagild")
    text = "runs of each variant (default: as many as the paper averages)"
    parser.add_argument("--runs", metavar="N", type=count, help=text)
    text = "seed of the first run of each variant; the others follow (default: 1000)"
    parser.add_argument("--seed", metavar="N", type=seed, default=1000, help=text)
    parser.add_argument("--workers", metavar="N", type=workers, default=1, help="processes that share the runs (default: 1)")
    text = "folder of the report and the finished runs (default: reproduction-PAPER)"
    parser.add_argument("--output", metavar="DIR", help=text)
    text = "only these scenarios, e.g. tables-1-2 figure-3 (default: all)"
    parser.add_argument("--only", metavar="NAME", nargs="+", default=[], help=text)
