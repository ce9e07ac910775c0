"""Options of the commands that read a database."""

from __future__ import annotations

from typing import Any

from coastwatch.operators.cli.arguments import (
    QUESTIONS,
    SCENARIOS,
    Parser,
    add_box,
    add_db,
    add_format,
    add_moment,
    add_output,
    add_rows,
    add_run,
    add_set,
    add_span,
    completed_by,
    count,
    png_file,
    whole,
)
from coastwatch.operators.cli.commands import Commands
from coastwatch.operators.typed import utc

COMMANDS = Commands()


@COMMANDS.command("runs", "read:runs", "list or delete runs")
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


@COMMANDS.command("picture", "read:picture", "show or export the picture")
def picture(parser: Parser) -> None:
    """The picture of a run: one row per vessel. Speeds in knots, courses in degrees true, times in UTC, MMSI with nine digits.
    The table has the main columns; the other formats have all.
    """
    add_run(parser)
    add_moment(parser)
    add_rows(parser)


@COMMANDS.command("track", "read:track", "show one vessel and its history")
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


@COMMANDS.command("traffic", "read:traffic", "show the vessels in a box in a time span")
def traffic(parser: Parser) -> None:
    """The vessels in a box between two instants: points of their paths, by vessel and time. From each point until `to_utc` the
    vessel kept its course and speed, within `store.history_error_m`. Positions to 0.2 m.
    """
    add_span(parser)
    add_rows(parser)


@COMMANDS.command("encounters", "read:encounters", "show close encounters in a time span")
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


@COMMANDS.command("replay", "read:replay", "export recorded pictures")
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


@COMMANDS.command("sensors", "read:sensors", "show sensors and their registration")
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


@COMMANDS.command("query", "read:query", "answer a question, or list the questions")
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


@COMMANDS.command("plot", "read:plot", "draw the picture as a PNG")
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
