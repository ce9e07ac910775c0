"""`fuse`: recorded files of your own to a stored picture, without a scenario."""

from __future__ import annotations

import argparse
import errno
import os
import sys
from pathlib import Path

from coastwatch.errors import InputError
from coastwatch.operators import recorded
from coastwatch.operators.cli.common_vessels import CommonVessels
from coastwatch.operators.cli.runs import carry_out
from coastwatch.scenario import make_scenario
from coastwatch.sensors.recorded.wire.stream import WireFile, wire_file
from coastwatch.spelling import printable

VIDEO = "video"
PICTURES = (b"\x89PNG", b"\xff\xd8\xff")
"""How files of PNG and JPEG begin."""


def fuse(options: argparse.Namespace) -> int:
    if not (options.ais or options.plots or options.video or options.bearings or options.tracks or options.feed):
        raise InputError("fuse: got no file, needed --ais, --plots, --video, --bearings, --tracks or --feed")
    if options.plots and not options.radar:
        raise InputError("fuse --plots: got no radar, needed --radar for each radar in the file")
    if options.bearings and not options.sonar:
        raise InputError("fuse --bearings: got no sensor, needed --sonar for each sensor in the file")
    recorded.check_sensors(options.radar, options.station, options.sonar)
    sensors = {"radars": options.radar, "stations": options.station, "sonars": options.sonar}
    found = {text: recorded.screen_file(text) for text in options.video}
    screens = [file for file in found.values() if file is not None]
    feeds = [*map(wire_file, options.feed), *(_video_file(text) for text, file in found.items() if file is None)]
    of_feeds = [str(path) for path in (*(feed.path for feed in feeds), *(file.path for file in screens))]
    for name in (*options.ais, options.plots, options.bearings, *options.tracks, *of_feeds):
        if name is not None and not Path(name).exists():  # the reader of scenarios would look in the checkout too
            raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), name)
    _check_video([feed.path for feed in feeds if feed.format == VIDEO], [file.path for file in screens], options)
    files = recorded.Files(
        tuple(options.ais),
        options.plots,
        options.bearings,
        tuple(options.tracks),
        options.columns,
        tuple(feeds),
        tuple(screens),
    )
    sensors["track_sources"] = recorded.track_sources(files, options.track_site, [sonar["name"] for sonar in options.sonar])
    document = recorded.document(files, sensors, files.default_period_s if options.period is None else options.period)
    scenario = make_scenario(document, "coastwatch fuse", dict(options.settings))
    scenario = recorded.framed(scenario)
    common = CommonVessels(scenario.sensors())
    code = carry_out(scenario, options, None, common.add if options.radar else None)
    for warning in common.warnings():
        print(f"coastwatch: warning: {printable(warning)}", file=sys.stderr)
    return code


def _video_file(text: str) -> WireFile:
    """A value of --video. Raises: InputError."""
    file = wire_file(text, VIDEO)
    if file.format != VIDEO:
        raise InputError(
            f"fuse --video: got {text!r}, needed a capture or a file of CAT 240, a table of pictures or HDF5 of HAXR: use --feed for "
            "other formats"
        )
    return file


def _check_video(paths: list[Path], screens: list[Path], options: argparse.Namespace) -> None:
    """Refuses video without the radars that send it, and pictures without their table. Raises: InputError, OSError."""
    if (paths or screens) and not options.radar:
        raise InputError("fuse --video: got no radar, needed --radar for each radar in the file: see coastwatch video FILE")
    for radar in options.radar if (paths or screens) and not options.plots else ():
        if "latitude_deg" not in radar:
            raise InputError(f"--radar {radar['name']}: got no latitude and longitude, needed both: video does not have them")
    for path in paths:
        with path.open("rb") as file:
            if file.read(4).startswith(PICTURES):
                raise InputError(
                    f"{path}: got a picture, needed a table with columns file and time that names pictures (PNG): "
                    f"{recorded.SCREEN_EXAMPLES['pictures']}"
                )
