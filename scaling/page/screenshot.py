"""Take a picture of the page of the map on a stored run:

python -m scaling.page.screenshot --db URL --output FILE.png [--query TEXT] [--size WIDTHxHEIGHT]
"""

from __future__ import annotations

import argparse
import io
import time
from pathlib import Path

from PIL import Image

from coastwatch.operators import presentation
from coastwatch.operators.api.application import WEB
from coastwatch.operators.cli.serving import following
from scaling.page.browser import chromium, draws
from scaling.page.fleet import listening

SETTLE_S = 6.0  # coast, names and the panel come after the vessels
COLOURS = 256  # of the PNG: half of the bytes


def main() -> None:
    """Write the picture."""
    parser = argparse.ArgumentParser(prog="python -m scaling.page.screenshot", description=__doc__.split(":")[0])
    parser.add_argument("--db", required=True)
    parser.add_argument("--output", type=Path, required=True)
    parser.add_argument("--query", default="", help="state of the page, as in its address")
    parser.add_argument("--size", default="1280x760")
    options = parser.parse_args()
    width, height = map(int, options.size.split("x"))
    with (
        presentation.opened(options.db) as opened,
        following(opened, None) as service,
        listening(service, WEB) as address,
        chromium() as browser,
    ):
        page = browser.new_page(viewport={"width": width, "height": height}, reduced_motion="reduce")  # nothing flashes
        page.goto(f"{address}/?{options.query}")
        draws(page)
        page.evaluate("(coastwatch.map.setPixelRatio(1), 0)")  # without a GPU it is less
        time.sleep(SETTLE_S)
        taken = page.screenshot()
    options.output.parent.mkdir(parents=True, exist_ok=True)
    few = Image.open(io.BytesIO(taken)).convert("RGB").quantize(COLOURS, Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE)
    few.save(options.output, optimize=True)
    print(options.output)


if __name__ == "__main__":
    main()
