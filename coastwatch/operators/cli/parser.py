"""Every command and option of the command line. It imports no command: `act` names the function that `main` imports and calls."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import Any, Literal, NamedTuple, get_args, get_origin

from coastwatch.operators.cli.arguments import (
    QUESTIONS,
    RADAR,
    SCENARIOS,
    SONAR,
    STATION,
    Parser,
    Version,
    add_box,
    add_db,
    add_format,
    add_moment,
    add_output,
    add_rows,
    add_run,
    add_running,
    add_set,
    add_span,
    age,
    column_names,
    completed_by,
    count,
    database,
    pair,
    png_file,
    position,
    seed,
    sensor,
    speed,
    whole,
    workers,
    written_as,
)
from coastwatch.operators.typed import utc
from coastwatch.operators.verdict import requirement

MOVES = "without latitude and longitude (name,,,range_nm,rpm) it moves, and each plot has site_latitude and site_longitude"
EPILOG = """\
exit codes: 0 done, 1 failed, 2 bad input, 4 a figure fell or a target was missed, 130 interrupted with Ctrl-C, 141\
 the reader of the output closed it.
COASTWATCH_TRACEBACK=1 in the environment prints the traceback of an error.
All commands, settings and questions: coastwatch/operators/REFERENCE.md"""


AddOptions = Callable[[Parser], None]


class Command(NamedTuple):
    """A command: its name, the function that carries it out, its line in `coastwatch --help`, and what adds its options."""

    name: str  # "run", or "db upgrade" of a group
    act: str
    summary: str
    add_options: AddOptions


COMMANDS: list[Command] = []
GROUPS = {
    "token": ("make tokens", "Tokens of `coastwatch serve --tokens`."),
    "db": ("upgrade, check, copy or prune a database", "Upgrade, check, copy or prune a database."),
}
"""Summary and description of each group of commands."""


def _command(name: str, act: str, summary: str) -> Callable[[AddOptions], AddOptions]:
    """Makes a command of the function that adds its options. The docstring of the function is the text above them."""

    def register(add_options: AddOptions) -> AddOptions:
        COMMANDS.append(Command(name, act, summary, add_options))
        return add_options

    return register


OF_MODELS = ("serve", "feed")
"""Commands whose options are read from models and formats, which take a second to import."""


def make_parser(command: str | None = None) -> Parser:
    """The parser of all commands. The parsed arguments have `act`, "module:function" in this package.

    Args: command: the only one that is to be parsed; the options of other ones of OF_MODELS are left out.
    """
    return make_parsers(command)[""]


def make_parsers(command: str | None = None) -> dict[str, Parser]:
    """The parser of each command by its name, and that of all under "". Args: as of `make_parser`."""
    parser = Parser(
        prog="coastwatch",
        description="One picture of a coast from radars, AIS and passive sonars.",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action=Version, nargs=0, help="print the version")
    parsers, places = {"": parser}, {"": parser.add_subparsers(title="commands", metavar="COMMAND", required=True)}
    for name, act, summary, add_options in COMMANDS:
        group, _, verb = name.rpartition(" ")
        if group not in places:
            summary_of_group, description = GROUPS[group]
            below = places[""].add_parser(group, help=summary_of_group, description=description)
            places[group] = below.add_subparsers(title="commands", metavar="COMMAND", required=True)
        description = " ".join((add_options.__doc__ or "").split())
        one = parsers[name] = places[group].add_parser(verb, help=summary, description=description)
        one.set_defaults(act=act, command=one.prog)
        if name not in OF_MODELS or command in (None, name):
            add_options(one)
    return parsers


@_command("run", "runs:run", "run a scenario and store the picture")
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


@_command("scenarios", "runs:scenarios", "list the scenarios")
def scenarios(parser: Parser) -> None:
    """List the scenarios that come with Coastwatch."""
    parser.add_argument("--json", action="store_true", help="print a JSON list of name and title")


@_command("fuse", "fuse:fuse", "fuse recorded files of your own")
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


@_command("serve", "serving:serve", "run live and serve the picture over HTTP and WebSocket")
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


@_command("feed", "serving:feed", "send a simulation or a recording to live feeds")
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


@_command("video", "video:video", "say what radar video comes")
def video(parser: Parser) -> None:
    """Say what radar video comes from a file or a feed, and what was lost. Then print the settings to begin with."""
    completed_by(parser.add_argument("source", metavar="FILE|URL", help="capture, file of CAT 240, or video+udp://..."))
    parser.add_argument("--seconds", metavar="S", type=float, default=10.0, help="of video to look at (default: 10)")


@_command("token add", "serving:add_token", "make a token")
def token_add(parser: Parser) -> None:
    """Make a token of a person or program and print it. The file keeps its hash. A viewer may read; an operator may also
    acknowledge; an admin may do all.
    """
    parser.add_argument("name", metavar="NAME", help="whose it is; it is named in the audit")
    parser.add_argument("--role", choices=("viewer", "operator", "admin"), default="viewer", help="default: viewer")
    parser.add_argument("--expires", metavar="UTC", type=utc, help="until when it is valid, ISO 8601 (default: for ever)")
    text = "file of tokens (default: tokens.toml)"
    completed_by(parser.add_argument("--tokens", metavar="FILE", default="tokens.toml", help=text))


@_command("reproduce", "reproduce:reproduce", "reproduce the published figures of a paper")
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


@_command("runs", "read:runs", "list or delete runs")
def runs(parser: Parser) -> None:
    """The runs of a database, newest first: scenario, seed, version, cycles, status and main scores. `runs delete ID` deletes
    one, `runs keep N` all but the newest N, 1 or more; a run that is being written stays. Status died: it was not ended, and its process
    is gone, or has written nothing for a minute. Status deleting: the next deletion, or the server, finishes it.
    """
    text = "what to do (default: list)"
    parser.add_argument("action", metavar="delete|keep", nargs="?", choices=("delete", "keep"), help=text)
    parser.add_argument("number", metavar="N", nargs="?", type=whole, help="number of the run to delete, or how many to keep")
    add_db(parser)
    add_rows(parser, ("table", "csv", "json"))


@_command("picture", "read:picture", "show or export the picture")
def picture(parser: Parser) -> None:
    """The picture of a run: one row per vessel. Speeds in knots, courses in degrees true, times in UTC, MMSI with nine digits.
    The table has the main columns; the other formats have all.
    """
    add_run(parser)
    add_moment(parser)
    add_rows(parser)


@_command("track", "read:track", "show one vessel and its history")
def track(parser: Parser) -> None:
    """One vessel: its details, its alarms, its tracks, its associations and its history, the newest rows of each. --json prints
    all rows of all; csv, geojson, parquet and gpx have the history, gpx as a track for a chart plotter. The history is what the
    watch saw. With --decided: its corrected past instead, the line to print after an incident.
    The last looks of a track are open until the next ones, or until it ends.
    """
    parser.add_argument("vessel", metavar="ID", type=whole, help="vessel id, as in `coastwatch picture` (not the MMSI)")
    add_run(parser)
    add_format(parser)
    text = "of --format table: newest rows of each table that are shown (default: 20)"
    parser.add_argument("--limit", metavar="N", type=count, help=text)
    text = "show where it was by what came later: states that a tracker decided and smoothed (`multi_hypothesis`)"
    parser.add_argument("--decided", action="store_true", help=text)


@_command("traffic", "read:traffic", "show the vessels in a box in a time span")
def traffic(parser: Parser) -> None:
    """The vessels in a box between two instants: points of their paths, by vessel and time. From each point until `to_utc` the
    vessel kept its course and speed, within `store.history_error_m`. Positions to 0.2 m.
    """
    add_span(parser)
    add_rows(parser)


@_command("encounters", "read:encounters", "show close encounters in a time span")
def encounters(parser: Parser) -> None:
    """Pairs of vessels that came close to each other in a box between two instants, the closest first: when and where, and for how
    long each had not been heard, so that its position is predicted (`first_silent_s`, `second_silent_s`).
    """
    add_span(parser)
    parser.add_argument("--within", metavar="M", type=float, default=500.0, help="largest distance, m (default: 500)")
    text = "smallest speed of the faster of the two, kn (default: 1)"
    parser.add_argument("--min-sog", metavar="KN", type=float, default=1.0, help=text)
    parser.add_argument("--count", metavar="N", type=count, default=100, help="largest number of pairs (default: 100)")
    add_rows(parser)


@_command("replay", "read:replay", "export recorded pictures")
def replay(parser: Parser) -> None:
    """Export the pictures of a recorded run (`store.recording`): one row per vessel and cycle, with the columns of `picture` as
    they were computed. Members are the tracks of radars, AIS and received tracks, written source:track. Then come the velocity
    in metres a second east and north, and the covariance of position and velocity in metres and seconds.
    """
    add_run(parser)
    text = "first instant (default: the first recorded cycle)"
    parser.add_argument("--from", metavar="UTC", type=utc, dest="from_s", help=text)
    text = "last instant (default: the last recorded cycle)"
    parser.add_argument("--to", metavar="UTC", type=utc, dest="to_s", help=text)
    add_box(parser, "only vessels in this box, degrees; W > E crosses the antimeridian")
    parser.add_argument("--format", choices=("csv", "parquet"), default="csv", help="default: csv")
    add_output(parser)


@_command("sensors", "read:sensors", "show sensors and their registration")
def sensors(parser: Parser) -> None:
    """The sensors of a run: specification, newest report and registration errors. Of a radar: the azimuth bias, range bias and
    time lag that are subtracted from its reports, one standard deviation after +-, and the state of the estimate (unknown,
    acquiring, probable, found, settled, doubtful). Evidence: the bias with the most, its odds against chance, how many voices
    speak for it (vessels under way, and squares of 1 km with vessels at rest) and the best other bias. The estimated lag is
    subtracted only once it is accurate. Of a sonar: its bearing bias. Signs: degrees clockwise, metres too long, seconds too
    late. AIS reports do not name their receiver, so all receivers show the newest.
    """
    add_run(parser)
    text = "instant, ISO 8601, e.g. 2026-07-01T12:00:00Z (default: the last cycle)"
    parser.add_argument("--at", metavar="UTC", type=utc, help=text)
    cover = (
        "the newest learnt cover of each radar instead: in each sector and ring the probability that a vessel with AIS is detected in "
        "a turn, and that a confirmed track gets a plot, with the turns behind them; CSV and JSON have every cell"
    )
    clutter = "the density of plots of no confirmed track instead, in a square kilometre and turn"
    standing = (
        "the standing echoes that a clutter map hides from the picture instead: quays, piles and moored boats, with the plots that "
        "each gives in a turn (`tracks.clutter.learnt`)"
    )
    video = "radars that send video to this server; token: COASTWATCH_TOKEN"
    grids = {"--cover": cover, "--clutter": clutter, "--standing": standing}
    flags: dict[str, dict[str, Any]] = {name: {"action": "store_true", "help": text} for name, text in grids.items()}
    parser.add_one_of(flags | {"--video": {"metavar": "URL", "help": video}})
    add_rows(parser, ("table", "csv", "json"))


@_command("query", "read:query", "answer a question, or list the questions")
def query(parser: Parser) -> None:
    """Answer one of the questions in db/operator. Without a name, list them with their parameters."""
    text = "name of the question (default: list all)"
    completed_by(parser.add_argument("name", metavar="NAME", nargs="?", help=text), QUESTIONS)
    add_run(parser)
    add_set(parser, "a parameter of the question, e.g. --set count=20; repeatable")
    text = "of questions `alarms` and `audit`: the {}, ISO 8601, e.g. 2026-07-01T12:00:00Z"
    parser.add_argument("--from", metavar="UTC", type=utc, dest="from_s", help=text.format("first instant"))
    parser.add_argument("--to", metavar="UTC", type=utc, dest="to_s", help=text.format("last instant"))
    parser.add_argument("--kind", metavar="KIND", help="of question `alarms`: only these, e.g. dark")
    text = (
        "answer as of this instant, ISO 8601 (default: the last cycle). Of bearing tracks the past has only those that were given to a "
        "vessel, without rates, from the site of the sonar in the scenario"
    )
    parser.add_argument("--at", metavar="UTC", type=utc, help=text)
    add_rows(parser)


@_command("plot", "read:plot", "draw the picture as a PNG")
def plot(parser: Parser) -> None:
    """Draw the picture: coverage, vessels by kind of sensor, bearing lines, uncertainty, trails and the coastline. With a scenario
    and --video, draw one turn of radar video instead: coastwatch plot heymann-table-1 --video radar --turn 20.
    """
    text = "with --video: the scenario whose radar video is drawn: a name, folder, or .toml file"
    completed_by(parser.add_argument("scenario", metavar="SCENARIO", nargs="?", help=text), SCENARIOS)
    text = (
        "draw one turn of the video of this radar: north up, range rings in NM, levels in grey, plots as circles. --at is an instant in "
        "the turn"
    )
    parser.add_argument("--video", metavar="RADAR", help=text)
    text = "with --video: the turn, counted from 1 by the radar's rpm (default: 10, or the last of a shorter run)"
    parser.add_argument("--turn", metavar="N", type=count, help=text)
    add_set(parser, "with --video: override a setting of the scenario; repeatable")
    add_run(parser)
    add_moment(parser)
    text = "file to write (default: picture.png)"
    parser.add_argument("--output", metavar="PNG", type=png_file, default="picture.png", help=text)
    text = (
        "GeoJSON of land or shore lines, or none (default: the scenario's, if it has one, else Natural Earth 1:10m for a frame of 8 NM "
        "or more)"
    )
    completed_by(parser.add_argument("--coastline", metavar="FILE", help=text))
    text = "how many of the longest vessels in the frame are named (default: 8)"
    parser.add_argument("--names", metavar="N", type=whole, default=8, help=text)
    text = "colour the cells of each radar by its learnt cover, or by the density of its false plots"
    parser.add_argument("--cover", choices=("detection", "clutter"), help=text)
    text = "a vessel that is marked and named, by its id; repeatable"
    parser.add_argument("--vessel", metavar="ID", type=whole, action="append", default=[], help=text)


@_command("db upgrade", "database:upgrade", "create a database or upgrade it to this version")
def db_upgrade(parser: Parser) -> None:
    """Create the database, or upgrade an old one to this version's schema. Its content is kept."""
    add_db(parser)


@_command("db check", "database:check", "compare a database with this version's schema")
def db_check(parser: Parser) -> None:
    """Compare the database with this version's schema. Exit code 0: they agree; 1: one line per difference."""
    add_db(parser)


@_command("db backup", "database:backup", "copy a database while it is in use")
def db_backup(parser: Parser) -> None:
    """Copy an SQLite database to a new file while others read and write it: the state of one moment, with whole cycles. Into a
    folder, the copy is named after the database and the time. PostgreSQL: pg_dump.
    """
    completed_by(parser.add_argument("target", metavar="FILE|FOLDER", help="a new file, or a folder of copies"))
    add_db(parser)
    text = "then delete all but the newest N copies of this database in the folder"
    parser.add_argument("--keep", metavar="N", type=count, help=text)


@_command("db restore", "database:restore", "bring a backup back")
def db_restore(parser: Parser) -> None:
    """Copy a backup to where there is no database. Then `coastwatch db upgrade` brings an old one to this version."""
    completed_by(parser.add_argument("source", metavar="FILE", help="a file that `db backup` wrote"))
    add_db(parser)


@_command("db prune", "database:prune", "delete what is old")
def db_prune(parser: Parser) -> None:
    """Delete what is old, also beside a run that goes on: runs that ended so long ago, and of the others history, details
    (associations, spots, timings, registrations), events and recording that are so much older than the newest cycle. The
    current picture stays. An SQLite file does not shrink; backup and restore make a smaller one. Settings `store.history_hours`
    and the like do it in every cycle.
    """
    add_db(parser)
    text = "how old: a whole number with h, d or w, such as 12h, 30d or 8w"
    parser.add_argument("--older-than", metavar="AGE", type=age, required=True, help=text)
    text = "only this, of all runs: history, details, events, recording or audit (who changed what); repeatable"
    kinds = ("history", "details", "events", "recording", "audit")
    parser.add_argument("--only", metavar="KIND", choices=kinds, action="append", default=[], help=text)


@_command("completion", "parser:print_completion", "print a completion script for a shell")
def completion(parser: Parser) -> None:
    """Print the script with which a shell completes commands, options, scenarios and questions. bash: eval "$(coastwatch
    completion bash)"; zsh: coastwatch completion zsh > FOLDER_OF_FPATH/_coastwatch.
    """
    parser.add_argument("shell", choices=("bash", "zsh", "tcsh"), help="the shell")


def print_completion(options: argparse.Namespace) -> int:
    """Carries out `completion`."""
    import shtab

    from coastwatch.shipped import operator_queries_folder, scenarios_folder

    names = {
        SCENARIOS: sorted(path.parent.name for path in scenarios_folder().glob("*/scenario.toml")),
        QUESTIONS: sorted(path.stem for path in operator_queries_folder().glob("*.sql")),
    }
    words = {function: " ".join(listed) for function, listed in names.items()}
    preamble = {
        "bash": "".join(f'{function}() {{ compgen -W "{listed}" -- "$1"; }}\n' for function, listed in words.items()),
        "zsh": "".join(f"{function}() {{ _values name {listed} }}\n" for function, listed in words.items()),
    }
    print(shtab.complete(make_parser(), options.shell, preamble=preamble.get(options.shell, "")))
    return 0
