"""Track loss in the scene of Liland over seeds: `python -m scaling.decisions.track_loss --seeds 3001-3010 [--set KEY=VALUE ...]`.

The question: which settings of a tracker keep vessels that are seen in every second turn among clutter? It prints the scores of
`coastwatch reproduce liland`, mean and standard error over the runs of one scenario, for settings that no variant has.
"""

from __future__ import annotations

import argparse

import numpy as np

from coastwatch.operators.cli.arguments import pair
from coastwatch.reproduction.published import TrackLoss
from coastwatch.reproduction.track_loss import measure
from coastwatch.scenario import load_scenario
from scaling.load.seeds import conditions, seed_range

SHARES = "loss", "tracking", "online_tracking"
FIGURES = *SHARES, "online_false_tracks", "rmsd_m", "online_rmsd_m", "look_s"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=seed_range, default=range(101, 105), help="FIRST-LAST (default: 101-104)")
    parser.add_argument("--scenario", default="liland-tracking", help="default: liland-tracking")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", type=pair, help="a setting of the scenario")
    asked = parser.parse_args()
    settings = dict(asked.set)
    scenario = load_scenario(asked.scenario, settings)
    runs = [measure(scenario, seed, TrackLoss()) for seed in asked.seeds]
    print(f"{conditions(asked.scenario, settings)}; {len(runs)} seeds from {asked.seeds[0]}")
    for name in FIGURES:
        values = np.array([value for run in runs if (value := run[name]) is not None]) * (100.0 if name in SHARES else 1.0)
        error = values.std(ddof=1) / np.sqrt(len(values)) if len(values) > 1 else np.nan
        print(f"{name + (', %' if name in SHARES else ''):<24} {values.mean() if len(values) else np.nan:9.3f} +- {error:.3f}")


if __name__ == "__main__":
    main()
