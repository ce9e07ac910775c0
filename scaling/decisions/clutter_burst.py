"""What a burst of clutter does to radar tracks: `python -m scaling.decisions.clutter_burst [--seeds 2001-2003] [--cycles 2000]`.

The question: how many false tracks does a tracker show where the clutter is 26 times what it expects for 30 s, and do its memory
and time come down again? The first table is `liland-tracking` without AIS, P_D 0.8, clutter 1e-6 and the burst after 50 s: means over
seeds of the share of the time on track, and of false tracks shown, with standard errors. The last lines are of one radar with 300 vessels
of `context-driven-1000` over many cycles, with a burst each minute: size of the tracker's checkpoint and processor time of a cycle, in
the first and in the last tenth of the run, each as a median of cycles before a burst.
"""

from __future__ import annotations

import argparse
import math
from time import process_time

import numpy as np

from coastwatch.reproduction.published import TrackLoss
from coastwatch.reproduction.targets import cycles
from coastwatch.reproduction.track_loss import measure
from coastwatch.scenario import load_scenario
from coastwatch.server.checkpoint import save
from scaling.load.seeds import seed_range

CLUTTER, BURST, DETECTED = "1e-6", "2.5e-5", "0.8"
RADAR = "input.radar."
SCENE = {"input.detection_probability": DETECTED, "input.clutter_per_m2": CLUTTER, "input.burst.per_m2": BURST}
EXISTENCE = {"tracks.upkeep.detection.detection_probability": DETECTED, "tracks.upkeep.detection.false_plots_per_m2": CLUTTER}
TABLE = (
    "{detection_probability=0.8, false_plots_per_m2=1e-6, delete_misses=10, misses_per_hit=2.0, look_slack=-0.2, max_speed_kn=70.0,"
    " echo_sigma_m=2.5}"
)
METHODS: dict[str, dict[str, str]] = {
    "imm": {"tracks.method": "imm", "tracks.upkeep": TABLE},
    "vimmjipda": {"tracks.method": "vimmjipda", **EXISTENCE},
    "multi_hypothesis": {"tracks.method": "multi_hypothesis", **EXISTENCE},
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=seed_range, default=range(2001, 2004), help="FIRST-LAST (default: 2001-2003)")
    parser.add_argument("--methods", nargs="+", default=list(METHODS), choices=METHODS)
    parser.add_argument("--cycles", type=int, default=0, help="of the long run; 0: no such run")
    asked = parser.parse_args()
    for method in asked.methods:
        found = [
            measure(load_scenario("liland-tracking", {**SCENE, **METHODS[method]}), seed, TrackLoss()) for seed in asked.seeds
        ]
        cells = []
        for key, times in (("online_tracking", 100.0), ("online_false_tracks", 1.0)):
            each = times * np.array([one[key] for one in found], np.float64)
            cells.append(f"{each.mean():.1f} +- {each.std(ddof=min(1, len(each) - 1)) / math.sqrt(len(each)):.1f}")
        print(f"{method:<18} online tracking {cells[0]} %, false tracks {cells[1]}", flush=True)
        if asked.cycles:
            print(f"{method:<18} {long_run(method, asked.cycles, asked.seeds[0])}", flush=True)


def long_run(method: str, count: int, seed: int) -> str:
    """Size of the checkpoint and time of a cycle at the start and the end of a run with a burst each minute."""
    burst = {"per_m2": "1.3e-5", "first_s": "45", "duration_s": "15", "every_s": "60"}
    settings = {
        "sonars": "[]",
        "stations": "[]",
        "input.count": "300",
        "cycles": str(count),
        "tracks.method": method,
        f"{RADAR}detection_probability": "0.9",
        f"{RADAR}clutter_per_m2": "5e-7",
        **{f"{RADAR}burst.{key}": value for key, value in burst.items()},
    }
    scenario = load_scenario("context-driven-1000", settings)
    recording = scenario.input.load(scenario.sensors(), seed, scenario.plan())
    start_s, begin, rows = scenario.plan().instant_s(0), process_time(), []
    for now_s, memory, _ in cycles(scenario, scenario.tracks, recording, scenario.tracks.init()):
        spent, quiet = process_time() - begin, 30.0 < (now_s - start_s) % 60.0 < 45.0
        rows.append((now_s, spent, len(save(memory)) if quiet else 0, quiet))
        begin = process_time()
    time_s, spent_s, octets, quiet = np.array(rows).T
    tenth = (time_s[-1] - time_s[0]) / 10.0
    parts = time_s < time_s[0] + 2.0 * tenth, time_s > time_s[-1] - tenth
    parts = parts[0] & (time_s > time_s[0] + tenth), parts[1]
    size = [np.median(octets[part & (quiet > 0)]) / 1e6 for part in parts]
    cost = [1e3 * np.median(spent_s[part & (quiet > 0)]) for part in parts]
    worst = [1e3 * spent_s[part].max() for part in parts]
    return (
        f"{len(rows)} cycles: checkpoint {size[0]:.2f}, {size[1]:.2f} MB; cycle {cost[0]:.1f}, {cost[1]:.1f} ms,"
        f" worst {worst[0]:.0f}, {worst[1]:.0f} ms"
    )


if __name__ == "__main__":
    main()
