"""`coastwatch fuse`: recorded files of one's own to a stored picture, without writing a scenario."""

from __future__ import annotations

import argparse
from typing import Any

from coastwatch.operators.bad_input import BadInput
from coastwatch.operators.cli.arguments import add_set, pair
from coastwatch.operators.cli.runs import add_running, carry_out

RADAR = ("name", "latitude_deg", "longitude_deg", "range_nm", "rpm", "range_noise_m", "azimuth_noise_deg")
STATION = ("name", "latitude_deg", "longitude_deg", "range_nm")
SONAR = ("name", "latitude_deg", "longitude_deg", "range_nm", "bearing_noise_deg")
NEEDED = {RADAR: 5, STATION: 4, SONAR: 4}

TEXT = """\
Fuse recorded files into one stored picture; no scenario is needed. What the files hold is found out by looking into them."""


def add(commands: Any) -> None:
    """Adds `fuse` to the parser."""
    fuse = commands.add_parser("fuse", help="fuse recorded files of your own", description=TEXT)
    fuse.add_argument(
        "--ais", metavar="FILE", nargs="+", default=[], help="AIS: NMEA 0183 lines, CSV or Parquet; several in order of time"
    )
    fuse.add_argument("--plots", metavar="FILE", help="radar plots: CSV or Parquet with time, radar, range and azimuth")
    fuse.add_argument("--bearings", metavar="FILE", help="bearings: CSV or Parquet with time, sonar and bearing")
    sensor = {"action": "append", "default": [], "metavar": "SPEC"}
    fuse.add_argument("--radar", **sensor, type=_of(RADAR), help=_spec("a radar", RADAR))
    fuse.add_argument(
        "--station", **sensor, type=_of(STATION), help=_spec("an AIS receiver", STATION) + "; dark vessels need one"
    )
    fuse.add_argument("--sonar", **sensor, type=_of(SONAR), help=_spec("a sensor of bearings", SONAR))
    fuse.add_argument(
        "--columns",
        metavar="OURS=YOURS",
        type=_columns,
        default={},
        help="what your columns are called: time=when,mmsi=ship,sog=speed; ais.time=when is of the AIS tables only, so plots. "
        "and bearings.; usual names are found without",
    )
    fuse.add_argument("--period", metavar="S", type=float, default=3.0, help="seconds of one cycle (default: 3)")
    add_set(fuse, "override any setting of a scenario, e.g. tracks.method=imm; repeatable")
    add_running(fuse)
    fuse.set_defaults(act=_fuse)


def _spec(what: str, names: tuple[str, ...]) -> str:
    left_off = "" if len(names) == NEEDED[names] else "; what is in brackets may be left off and takes its default"
    return f'{what}: "{_form(names)}"{left_off}; repeatable'


def _form(names: tuple[str, ...]) -> str:
    """How the value of an option is written: name,...,rpm[,range_noise_m[,azimuth_noise_deg]]."""
    needed, more = names[: NEEDED[names]], names[NEEDED[names] :]
    return ",".join(needed) + "".join(f"[,{name}" for name in more) + "]" * len(more)


def _of(names: tuple[str, ...]) -> Any:
    """A function from text such as "north,50.7,-1.2,12" to the settings of a sensor."""

    def read(text: str) -> dict[str, Any]:
        parts = [part.strip() for part in text.split(",")]
        if not NEEDED[names] <= len(parts) <= len(names):
            raise argparse.ArgumentTypeError(f"got {text!r}, {len(parts)} values, needed {_form(names)}")
        try:
            return {names[0]: parts[0], **{n: float(p) for n, p in zip(names[1:], parts[1:], strict=False)}}
        except ValueError as error:
            raise argparse.ArgumentTypeError(f"got {text!r}: {error}; needed {_form(names)}") from None

    return read


def _columns(text: str) -> dict[str, str]:
    return dict(pair(part) for part in text.split(","))


def _fuse(options: argparse.Namespace) -> int:
    if not (options.ais or options.plots or options.bearings):
        raise BadInput("fuse: got no file, needed --ais, --plots or --bearings")
    if options.plots and not options.radar:
        raise BadInput("fuse --plots: got no radar, needed --radar for each radar in the file")
    if options.bearings and not options.sonar:
        raise BadInput("fuse --bearings: got no sensor, needed --sonar for each sensor in the file")
    from coastwatch.operators import recorded
    from coastwatch.scenario import make_scenario

    recorded.check_sensors(options.radar, options.station, options.sonar)
    sensors = {"radars": options.radar, "stations": options.station, "sonars": options.sonar}
    files = recorded.Files(tuple(options.ais), options.plots, options.bearings, options.columns)
    document = recorded.document(files, sensors, options.period)
    scenario = make_scenario(document, "coastwatch fuse", dict(options.settings))
    return carry_out(recorded.framed(scenario), options, None)
