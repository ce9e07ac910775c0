"""Radar video for viewers: bytes and server time of a turn, and what the page pays for it.

    python -m scaling.page.video turns [--seeds 2001 2002 2003]
    python -m scaling.page.video page [--vessels 10000] [--frames 200]

`turns` sends simulated turns to a viewer that wants every sector. `page` has four radars of 4096 spokes of 2048 cells, and pans with
the layer off and on. How far the page is behind the beam: `python -m scaling.load.video live --viewer`.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import threading
import time
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import numpy as np

from coastwatch.batches import RadarVideo
from coastwatch.operators.api.application import WEB
from coastwatch.operators.api.video_stream import message
from coastwatch.scenario import load_scenario
from coastwatch.server.live_video import LiveVideo
from scaling.load.video import PERIOD_S, SITES, noise_and_ships, sensors
from scaling.page.browser import chromium, draws
from scaling.page.fleet import served_fleet
from scaling.page.measure import PAN, processor_s

TURNS = 4  # of each seed; the first is not whole
PARTS = 48  # of a turn, as a feed gives them: 50 ms
SPOKES, CELLS, RANGE_M = 4096, 2048, 22_224.0
VIEW = (54.35, 12.1, 9.0)
SCENES = "12 NM, receiver noise and 40 ships", "the same, a quarter land of 20 dB"


def whole(level: np.ndarray, sensor: int = 0) -> RadarVideo:
    """A turn of a radar of 12 NM."""
    turn = (np.arange(len(level)) + 0.5) / len(level)
    site_deg = np.tile(SITES[sensor % len(SITES)], (len(level), 1))
    beam_s = turn * PERIOD_S
    return RadarVideo(sensor, 0.0, RANGE_M / level.shape[1], beam_s, beam_s, turn * 2.0 * np.pi, site_deg, level)


def scene(name: str, seed: int) -> tuple[LiveVideo, list[RadarVideo]]:
    """Turns of a scene. Args: name: of a scenario, else one of SCENES."""
    if name not in SCENES:
        scenario = load_scenario(name, {})
        of, plan = scenario.sensors(), scenario.plan()
        stream = scenario.input.load(of, seed, plan).reports
        ends = [plan.start_s + PERIOD_S * k for k in range(TURNS + 1)]
        return LiveVideo(of.radars), [stream.between(*span).video.parts[0] for span in pairwise(ends)]
    level = noise_and_ships(SPOKES, CELLS, seed)
    if name == SCENES[1]:
        level[: SPOKES // 4, CELLS // 3 :] = np.minimum(level[: SPOKES // 4, CELLS // 3 :], 215) + 40
    return LiveVideo(sensors(1).radars), [whole(level)] * TURNS


def turns(seeds: list[int]) -> None:
    """Print bytes and processor time of a turn."""
    for name in ("heymann-table-1", "video-harbour", *SCENES):
        sizes, taking, sending, idle, lit = list[float](), list[float](), list[float](), list[float](), list[float]()
        for seed in seeds:
            made, videos = scene(name, seed)
            seen = {0: 0}
            for turn, video in enumerate(videos):
                pieces = [video.take(rows) for rows in np.array_split(np.arange(len(video)), PARTS)]
                begun_s = time.process_time()
                for piece in pieces:
                    made.take_as_sent(piece)  # nobody has asked before the first turn
                (taking if turn else idle).append(time.process_time() - begun_s)
                made.ask(seen)
                begun_s = time.process_time()
                sectors = made.since(seen)
                size = sum(len(message(made.run, sector)) for sector in sectors)
                if len(sectors) == 16:
                    sending.append(time.process_time() - begun_s)
                    sizes.append(size)
                    lit.append(float(np.mean([(sector.levels() > 0).mean() for sector in sectors])))
                seen[0] = max((sector.number for sector in sectors), default=0)
        row = f"{np.mean(sizes) / 1e3:.1f} kB (most {max(sizes) / 1e3:.1f}), {100 * np.mean(lit):.1f} % lit, ms: "
        row += f"taken {1e3 * np.median(taking):.1f}, sent {1e3 * np.median(sending):.1f}, nobody looks {1e3 * np.median(idle):.3f}"
        print(f"{name:36} {row}")


def on_the_page(vessels: int, frames: int) -> None:
    """Print script of a frame with the layer off and on."""
    video, stop = LiveVideo(sensors(4).radars), threading.Event()
    pieces = [
        [whole(noise_and_ships(SPOKES, CELLS, 1), radar).take(rows) for rows in np.array_split(np.arange(SPOKES), PARTS)]
        for radar in range(4)
    ]

    def go_on() -> None:
        k = 0
        while not stop.wait(PERIOD_S / PARTS):
            for parts in pieces:
                video.take_as_sent(parts[k % PARTS])
            k += 1

    thread = threading.Thread(target=go_on)
    with (
        tempfile.TemporaryDirectory() as folder,
        served_fleet(vessels, 1, Path(folder), WEB, video) as address,
        chromium() as browser,
    ):
        thread.start()
        page = browser.new_page(viewport={"width": 1280, "height": 800}, bypass_csp=True)
        page.goto(f"{address}/?lat={VIEW[0]}&lon={VIEW[1]}&zoom={VIEW[2]}&layers=labels,vectors")
        draws(page)
        session = page.context.new_cdp_session(page)
        session.send("Performance.enable", {"timeDomain": "threadTicks"})
        switch: Callable[[str], object] = lambda what: page.evaluate(  # noqa: E731
            f"(coastwatch.state.layers.{what}('video'), coastwatch.layersChanged())"
        )
        for name in ("delete", "add") * 3:
            switch(name)
            time.sleep(2.0 * PERIOD_S)
            page.evaluate(PAN, [*VIEW, 10])
            assert page.evaluate("coastwatch.video.picture.radars.size") == (4 if name == "add" else 0)
            before, begun_s = processor_s(session), time.monotonic()
            page.evaluate(PAN, [*VIEW, frames])
            script, tasks = ((after - first) / frames * 1e3 for after, first in zip(processor_s(session), before, strict=True))
            print(
                f"video {'on' if name == 'add' else 'off'}: a frame {script:.2f} ms of script, {tasks:.2f} ms of all tasks, "
                f"{(time.monotonic() - begun_s) / frames * 1e3:.0f} ms on the clock"
            )
        stop.set()
        thread.join()


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("turns", "page"))
    parser.add_argument("--seeds", type=int, nargs="+", default=[2001, 2002, 2003])
    parser.add_argument("--vessels", type=int, default=10_000)
    parser.add_argument("--frames", type=int, default=200, help="of each pan")
    o = parser.parse_args()
    print(f"load {os.getloadavg()[0]:.1f}")
    if o.what == "turns":
        turns(o.seeds)
    else:
        on_the_page(o.vessels, o.frames)


if __name__ == "__main__":
    main()
