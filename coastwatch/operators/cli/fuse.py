"""`fuse`: recorded files of your own to a stored picture, without a scenario."""

from __future__ import annotations

import argparse
import errno
import os
from pathlib import Path

from coastwatch.errors import InputError
from coastwatch.operators import recorded
from coastwatch.operators.cli.runs import carry_out
from coastwatch.scenario import make_scenario
from coastwatch.sensors.files import wire_file


def fuse(options: argparse.Namespace) -> int:
    if not (options.ais or options.plots or options.bearings or options.tracks or options.feed):
        raise InputError("fuse: got no file, needed --ais, --plots, --bearings, --tracks or --feed")
    if options.plots and not options.radar:
        raise InputError("fuse --plots: got no radar, needed --radar for each radar in the file")
    if options.bearings and not options.sonar:
        raise InputError("fuse --bearings: got no sensor, needed --sonar for each sensor in the file")
    recorded.check_sensors(options.radar, options.station, options.sonar)
    sensors = {"radars": options.radar, "stations": options.station, "sonars": options.sonar}
    feeds = [wire_file(text) for text in options.feed]
    for name in (*options.ais, options.plots, options.bearings, *options.tracks, *(str(feed.path) for feed in feeds)):
        if name is not None and not Path(name).exists():  # the reader of scenarios would look in the checkout too
            raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), name)
    files = recorded.Files(
        tuple(options.ais), options.plots, options.bearings, tuple(options.tracks), options.columns, tuple(feeds)
    )
    sensors["track_sources"] = recorded.track_sources(files, options.track_site)
    document = recorded.document(files, sensors, files.default_period_s if options.period is None else options.period)
    scenario = make_scenario(document, "coastwatch fuse", dict(options.settings))
    return carry_out(recorded.framed(scenario), options, None)
