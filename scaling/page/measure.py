"""What the page of the map costs with many vessels in view, in a real Chromium:

    python -m scaling.page.measure [--vessels N] [--frames N] [--minutes M]

The script of a frame is the page's own work on the main thread: uniforms, draw call, marks, MapLibre. The asked bound is 6 ms.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from pathlib import Path
from typing import Any

from coastwatch.operators.api.application import WEB
from scaling.page.browser import chromium, draws
from scaling.page.fleet import served_fleet

VIEWS = (("zoom 4.5, all in view", 55.0, 3.5, 4.5), ("zoom 9, symbols and names", 51.5, 3.0, 9.0))
PAN = """
async ([lat, lon, zoom, frames]) => {
  const { map } = coastwatch;
  map.jumpTo({ center: [lon, lat], zoom });
  await new Promise((done) => map.once('idle', done).triggerRepaint());
  const script = [];
  await new Promise((done) => {
    const frame = (k) => requestAnimationFrame(() => {
      const reach = 0.4 * 2 ** (5 - zoom);
      map.setCenter([lon + reach * Math.sin(k / 15), lat + 0.6 * reach * Math.cos(k / 15)]);
      const began = performance.now();
      map.redraw();
      script.push(performance.now() - began);
      if (k < frames) frame(k + 1);
      else done();
    });
    frame(1);
  });
  script.sort((a, b) => a - b);
  return [script[Math.floor(frames / 2)], script[Math.floor(frames * 0.95)]];
}
"""
DECODE = """
(repeats) => fetch('./api/v1/frame').then((answer) => answer.arrayBuffer()).then((bytes) => {
  const picture = new coastwatch.live.constructor(), took = [];
  for (let k = 0; k < repeats; k++) {
    const began = performance.now();
    picture.apply(bytes);
    took.push(performance.now() - began);
  }
  return [took.sort((a, b) => a - b)[Math.floor(repeats / 2)], bytes.byteLength];
})
"""
SHOW = """
(repeats) => {
  const took = [];
  for (let k = 0; k < repeats; k++) {
    const began = performance.now();
    coastwatch.pictureChanged();
    took.push(performance.now() - began);
  }
  return took.sort((a, b) => a - b)[Math.floor(repeats / 2)];
}
"""


def processor_s(session: Any) -> tuple[float, float]:
    """Processor time of the main thread so far: of script, and of all its tasks. Args: session: of the DevTools protocol."""
    metrics = {one["name"]: float(one["value"]) for one in session.send("Performance.getMetrics")["metrics"]}
    return metrics["ScriptDuration"], metrics["TaskDuration"]


def measured(page: Any, vessels: int, frames: int) -> list[tuple[str, str]]:
    """Rows of the table. Args: page: of playwright, with the map open."""
    session, rows = page.context.new_cdp_session(page), []
    session.send("Performance.enable", {"timeDomain": "threadTicks"})
    for name, *view in VIEWS:
        page.evaluate(PAN, [*view, 10])
        before = processor_s(session)
        median, late = page.evaluate(PAN, [*view, frames])
        script, tasks = ((after - first) / frames * 1e3 for after, first in zip(processor_s(session), before, strict=True))
        rows.append((f"a frame, {name}", f"script {script:.1f} ms of processor, main thread {tasks:.1f} ms (means)"))
        rows.append(("  drawing on the clock", f"median {median:.1f} ms, 95 %: {late:.1f} ms"))
    decode, size = page.evaluate(DECODE, 7)
    rows.append(("full frame: bytes, decoding", f"{size / 1e6:.2f} MB, {decode:.1f} ms"))
    delta = page.evaluate("coastwatch.stats")
    rows.append(("newest delta: bytes, decoding", f"{delta['bytes'] / 1e6:.3f} MB, {delta['decode_ms']:.1f} ms"))
    rows.append(("a new picture on the main thread", f"{page.evaluate(SHOW, 7):.1f} ms"))
    page.evaluate("window.gc?.()")
    rows.append(("JavaScript heap", f"{page.evaluate('performance.memory.usedJSHeapSize') / 1e6:.0f} MB"))
    assert page.evaluate("coastwatch.live.vessels") == vessels
    return rows


def heap_over(page: Any, minutes: float) -> list[tuple[str, str]]:
    """The JavaScript heap after a collection, each ten seconds. Args: minutes: how long to look."""
    heaps = []
    end = time.monotonic() + minutes * 60.0
    while time.monotonic() < end:
        page.evaluate("window.gc?.()")
        heaps.append(page.evaluate("performance.memory.usedJSHeapSize") / 1e6)
        time.sleep(10.0)
    tenth = max(len(heaps) // 10, 1)
    first, last = (sorted(part)[tenth // 2] for part in (heaps[:tenth], heaps[-tenth:]))
    frames = page.evaluate("coastwatch.stats.frames")
    said = f"{first:.1f} MB at first, {last:.1f} at last ({100 * (last / first - 1):+.1f} %), {max(heaps):.1f} at most, {frames} frames"
    return [(f"heap over {minutes:g} minutes live", said)]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m scaling.page.measure", description=__doc__.split(":")[0])
    parser.add_argument("--vessels", type=int, default=100_000)
    parser.add_argument("--frames", type=int, default=120, help="of each pan")
    parser.add_argument("--minutes", type=float, default=0.0, help="then look at the heap for so long; 30 are asked")
    options = parser.parse_args()
    with (
        tempfile.TemporaryDirectory() as folder,
        served_fleet(options.vessels, 1, Path(folder), WEB) as address,
        chromium("--enable-precise-memory-info", "--js-flags=--expose-gc") as browser,
    ):
        page = browser.new_page(viewport={"width": 1280, "height": 800}, bypass_csp=True)
        began = time.monotonic()
        page.goto(f"{address}/?lat=55&lon=3.5&zoom=4.5")
        draws(page)
        drawn_s = time.monotonic() - began
        time.sleep(8.0)  # two deltas
        rows = [("navigation to vessels drawn", f"{drawn_s:.1f} s"), *measured(page, options.vessels, options.frames)]
        if options.minutes:
            rows += heap_over(page, options.minutes)
        gpu = "software" if page.evaluate("coastwatch.software") else "GPU"
        print(f"{options.vessels:,} vessels, Chromium {browser.version}, {gpu}, load {os.getloadavg()[0]:.1f}")
    for name, figure in rows:
        print(f"{name:40} {figure}")


if __name__ == "__main__":
    main()
