"""What do all alarms cost in a cycle of a large picture?

    python -m scaling.decisions.alarm_cycle [VESSELS [ZONES [CYCLES]]]

Vessels lie along a coast of 4,000 NM, half of them in ports. A third is at rest, the others sail at up to 20 kn, one in fifty at up to
45 kn.
Zones are circles of 5 NM, polygons of 8 corners of the same size and lines, at ports. Processor time of each part, medians.
"""

from __future__ import annotations

import argparse
import statistics
from time import process_time

import numpy as np

from coastwatch.alarms import AlarmInput, AlarmRules, Zone, numbered
from coastwatch.alarms.close_approach import close_pairs
from coastwatch.alarms.watched import watch_vessels
from coastwatch.alarms.zone_alarms import shapes, zone_alarms
from coastwatch.batches import Flag, Members, Picture, Radars, Sensors, Sonars, Stations
from coastwatch.geodesy import KNOT_M_S, offset_deg
from coastwatch.operators.cli.arguments import count

PORTS, PERIOD_S, WARM = 200, 3.0, 6


def coast(vessels: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Positions of vessels, their velocities, and the ports."""
    ports = np.stack([np.linspace(-33.0, 5.0, PORTS), -35.0 - 15.0 * np.sin(np.linspace(0.0, 3.0, PORTS))], 1)
    in_port = rng.random(vessels) < 0.5
    spread_m = np.where(in_port, 8_000.0, 40_000.0)[:, None]
    position = offset_deg(ports[rng.integers(0, PORTS, vessels)], rng.normal(0.0, 1.0, (vessels, 2)) * spread_m)
    knots = np.where(rng.random(vessels) < 0.02, 45.0, 20.0) * rng.random(vessels) * (rng.random(vessels) > 1.0 / 3.0)
    course = rng.uniform(0.0, 2.0 * np.pi, vessels)
    return position, (knots * KNOT_M_S)[:, None] * np.stack([np.sin(course), np.cos(course)], 1), ports


def zones_at(ports: np.ndarray, zones: int, rng: np.random.Generator) -> tuple[Zone, ...]:
    """Circles, polygons and lines in turn, each with every rule of its kind."""
    out = []
    for k, port in enumerate(ports[rng.integers(0, len(ports), zones)]):
        angle = np.arange(8) * (np.pi / 4.0)
        corners = offset_deg(np.broadcast_to(port, (8, 2)), 9_000.0 * np.stack([np.sin(angle), np.cos(angle)], 1))
        points = tuple((float(a), float(b)) for a, b in corners)
        area = {"enter": True, "leave": True, "dwell_s": 600.0, "max_speed_kn": 15.0}
        shape = (
            {"kind": "circle", "centre_deg": tuple(port.tolist()), "radius_nm": 5.0, **area},
            {"kind": "polygon", "points_deg": points, **area},
            {"kind": "line", "points_deg": points[::4], "crossing": "both"},
        )[k % 3]
        out.append(Zone.model_validate({"name": f"zone {k}", **shape}))
    return tuple(out)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("vessels", nargs="?", type=count, default=100_000, help="default: 100,000")
    parser.add_argument("zones", nargs="?", type=count, default=50, help="default: 50")
    parser.add_argument("cycles", nargs="?", type=count, default=20, help=f"the first {WARM} do not count (default: 20)")
    asked = parser.parse_args()
    vessels, cycles = asked.vessels, asked.cycles
    rng = np.random.default_rng([19, vessels])
    position, velocity, ports = coast(vessels, rng)
    zones, rules = numbered(zones_at(ports, asked.zones, rng)), AlarmRules()
    one = np.array(["coast"], "U32")
    radars = Radars(one, np.zeros(1, np.int64), ports[:1], np.array([4e5]), *(np.full(1, v) for v in (3.0, 10.0, 0.005)))
    sensors = Sensors(radars, Stations.empty(), Sonars.empty(), ("coast",), ports[:1])
    ids, covariance = np.arange(1, vessels + 1), np.tile(np.diag([100.0, 100.0, 0.1, 0.1]), (vessels, 1, 1))
    flags = np.where(np.hypot(*velocity.T) == 0.0, int(Flag.STATIONARY), 0)
    members, memory, ms, last = Members(ids, ids, np.zeros(vessels, np.int64)), rules.init(), [], {}
    for number in range(cycles):
        time_s = 1e9 + PERIOD_S * number
        place = offset_deg(position, velocity * (PERIOD_S * number) + rng.normal(0.0, 10.0, (vessels, 2)))
        when, none = np.full(vessels, time_s), np.full(vessels, -1)
        picture = Picture(ids, when, place, velocity, covariance, np.full(vessels, 1e9 - 3600.0), when, ids, flags, none)
        marks = [process_time()]
        seen = watch_vessels(rules, memory.watched, picture, members, memory.members, sensors, time_s)
        marks.append(process_time())
        zone_alarms(rules, memory.zones, seen, shapes(zones, rules.zone_margin_m), time_s)
        marks.append(process_time())
        _, pairs = close_pairs(rules, memory.approaching, seen.picture, time_s)
        marks.append(process_time())
        memory, alarms = rules.step(memory, AlarmInput(picture, members, time_s, sensors, zones))
        marks.append(process_time())
        ms.append(1e3 * np.diff(marks))
        last = {"close pairs": len(pairs.first), "alarms": len(alarms)}
    past, of_zones, close, every = (statistics.median(column) for column in zip(*ms[WARM:], strict=True))
    print(f"{vessels} vessels, {asked.zones} zones: {last}")
    print(
        f"processor ms a cycle: all alarms {every:.1f}; of it vessels' past {past:.1f}, zones {of_zones:.1f}, close {close:.1f}"
    )


if __name__ == "__main__":
    main()
