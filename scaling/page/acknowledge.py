"""How long an alarm that is acknowledged in one page stays in another one, in a real Chromium:

python -m scaling.page.acknowledge --db URL [--alarms N]

The database is of a run with alarms. The acknowledgements are written to it.
"""

from __future__ import annotations

import argparse
import os
import statistics
import sys
import time

from coastwatch.operators import presentation
from coastwatch.operators.api.application import WEB
from coastwatch.operators.cli.serving import following
from scaling.page.browser import chromium, draws
from scaling.page.fleet import listening

GONE = """
(id) => new Promise((done) => {
  const waits = (row) => row.alarm_id === id && !row.acknowledged_by;
  const look = () => (coastwatch.alarms.rows.some(waits) ? setTimeout(look, 5) : done(Date.now()));
  look();
})
"""
ACKNOWLEDGE = """
(id) => {
  const began = Date.now();
  coastwatch.alarms.acknowledge(coastwatch.alarms.rows.find((row) => row.alarm_id === id));
  return began;
}
"""
OPEN = "coastwatch.alarms.rows.filter((row) => !row.acknowledged_by).map((row) => row.alarm_id)"


def main() -> None:
    """Print the median and the longest time."""
    parser = argparse.ArgumentParser(prog="python -m scaling.page.acknowledge", description=__doc__.split(":")[0])
    parser.add_argument("--db", required=True)
    parser.add_argument("--alarms", type=int, default=20)
    options = parser.parse_args()
    taken_s = []
    with (
        presentation.opened(options.db) as opened,
        following(opened, None) as service,
        listening(service, WEB) as address,
        chromium() as browser,
    ):
        pages = [browser.new_page() for _ in range(2)]
        for page in pages:
            page.goto(address)
            draws(page)
        time.sleep(3.0)  # both have asked for the alarms
        first, second = pages
        first.evaluate("document.getElementById('watch-name').value = 'Ana'")
        alarms = first.evaluate(OPEN)[: options.alarms]
        if not alarms:
            sys.exit(f"{options.db}: got no alarm that waits, needed a run with alarms, such as of guanabara")
        for alarm in alarms:
            began = first.evaluate(ACKNOWLEDGE, alarm)
            taken_s.append((second.evaluate(GONE, alarm) - began) / 1e3)
    longest = f"longest {max(taken_s):.2f} s"
    print(f"{len(alarms)} alarms: median {statistics.median(taken_s):.2f} s, {longest}, load {os.getloadavg()[0]:.1f}")


if __name__ == "__main__":
    main()
