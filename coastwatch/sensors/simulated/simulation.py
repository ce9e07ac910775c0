"""The simulated feed: draws vessels and their motion, and the reports of radars, AIS and sonars."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Literal, Self, TypeVar

import numpy as np
from pydantic import Field, model_validator

from coastwatch.batches import (
    CLASS_OF_TYPE,
    Array,
    BearingReports,
    Bools,
    Floats,
    Noise,
    RadarReports,
    Recording,
    Reports,
    Sensors,
)
from coastwatch.errors import InputError
from coastwatch.geodesy import KNOT_M_S, NAUTICAL_MILE_M
from coastwatch.sensors.simulated.ais import (
    POSITION_STEP_DEG,
    SOG_STEP_KN,
    AisTruth,
    transmit,
    transmit_static_data,
    transponders,
    true_types,
)
from coastwatch.sensors.simulated.formations import Convoys, Passings, in_formation
from coastwatch.sensors.simulated.harbour import Anchorages, Area, Lanes, Row, StandingEchoes, in_harbour, standing
from coastwatch.sensors.simulated.radar import RadarTruth, observe, require_usable_radars
from coastwatch.sensors.simulated.sonar import SonarTruth, listen
from coastwatch.sensors.simulated.trajectories import VesselMotion, draw_motion
from coastwatch.stage import Latitude, Longitude, Method, Plan

POSITIONS = 51  # stream of random numbers
TRIES = 100  # draws of `count` positions before the water is refused as too small
ROUNDING = np.sqrt(12.0)  # a resolution divided by the standard deviation of its rounding error
AnyTruth = TypeVar("AnyTruth", RadarTruth, SonarTruth)
AnyReports = TypeVar("AnyReports", RadarReports, BearingReports)


class Simulated(Method):
    """Vessels spread evenly over a rectangle, observed by the scenario's sensors.

    The scenario specifies the sensors; the settings here say how they depart from that (misses, clutter, biases, faults).
    Every purpose has its own stream of random numbers: a change of clutter, for example, moves no vessel.

    Source: P. Rangel et al., Enhancing Performance and Reliability in Maritime Target Fusion Through a Context-Driven Approach,
    sections III-B and IV.
    """

    method: Literal["simulated"] = "simulated"
    area_latitude_deg: Latitude  # of the middle of the rectangle
    area_longitude_deg: Longitude  # of the middle of the rectangle
    area_width_nm: Annotated[float, Field(gt=0.0, le=5000.0)] = 10.0  # east to west
    area_height_nm: Annotated[float, Field(gt=0.0, le=5000.0)] = 10.0  # north to south
    water_deg: tuple[
        tuple[float, float], ...
    ] = ()  # corners (latitude, longitude) of the water in the area; none: the whole area
    count: Annotated[int, Field(ge=0, le=1_000_000)] = 1000  # vessels
    places_deg: tuple[
        tuple[float, float], ...
    ] = ()  # latitude, longitude at the start of the first vessels; the others are drawn
    motion: VesselMotion = VesselMotion()  # speeds, manoeuvres, process noise, entering and leaving
    convoys: Convoys = Convoys()  # vessels in a line
    passings: Passings = Passings()  # pairs of vessels that pass each other closely
    lanes: Lanes = Lanes()  # vessels that follow straight lanes
    anchorages: Anchorages = Anchorages()  # vessels at anchor
    moored: tuple[Row, ...] = ()  # rows of moored vessels: the first of all vessels, row by row
    standing: StandingEchoes = StandingEchoes()  # things that do not move and give echoes
    radar: RadarTruth = RadarTruth()  # how radars depart from their specification
    radars: tuple[RadarTruth, ...] = ()  # the same of single radars, by name; they take nothing from `radar`
    ais: AisTruth = AisTruth()  # which vessels carry AIS, and what is received
    sonar: SonarTruth = SonarTruth()  # how bearing sensors depart from their specification
    sonars: tuple[SonarTruth, ...] = ()  # the same of single sensors, by name; they take nothing from `sonar`

    @model_validator(mode="after")
    def _formations_have_vessels(self) -> Self:
        if self.convoys.share + self.passings.share > 1.0:
            raise InputError(
                f"convoys.share + passings.share: got {self.convoys.share} + {self.passings.share}, needed at most 1 in all"
            )
        return self

    def load(self, sensors: Sensors, seed: int, plan: Plan) -> Recording:
        """The reports of a run, with the truth at its instants.

        Raises: InputError if [[input.radars]] or [[input.sonars]] name a sensor that the scenario does not have.
        """
        require_usable_radars(sensors.radars, "simulated", least=0)
        radar_truths = truths_of("radars", sensors.radars.name, self.radar, self.radars)
        sonar_truths = truths_of("sonars", sensors.sonars.name, self.sonar, self.sonars)
        start_s, stop_s = plan.start_s, plan.instant_s(plan.cycles - 1)
        span_s = stop_s - start_s
        vessels = draw_motion(self.motion, self._start_positions(seed), start_s, span_s, seed)
        vessels = in_formation(self.convoys, self.passings, vessels, span_s, seed)
        vessels = in_harbour(self.lanes, self.anchorages, self.moored, self.motion, vessels, self._area(), span_s, seed)
        echoes = standing(self.standing, self._area(), seed)
        vessel, span = np.arange(self.count), (start_s, stop_s, seed)
        senders = transponders(self.ais, self.count, seed)
        ais = transmit(self.ais, senders, sensors.stations, vessels.state, *span)
        sounds = CLASS_OF_TYPE[true_types(senders, self.count, seed)]
        return Recording(
            reports=Reports(
                radar=_arrived(observe(sensors.radars, radar_truths, vessels.position, vessel, *span, echoes), stop_s),
                ais=ais,
                statics=transmit_static_data(self.ais, senders, ais.mmsi, *span),
                bearing=_arrived(listen(sensors.sonars, sonar_truths, vessels.position, vessel, sounds, *span), stop_s),
            ),
            truth=vessels.sampled(plan.instants_s),
            silenced=tuple(int(v) for v in senders.row[senders.silent]),
            noise=self._noise(sensors, radar_truths),
        )

    def _start_positions(self, seed: int) -> Floats:
        """Positions of the vessels at the start: as set; the others evenly over the area or its water. (V, 2)"""
        if len(self.places_deg) > self.count:
            raise InputError(f"input.places_deg: got {len(self.places_deg)} places, needed at most input.count = {self.count}")
        rng, area, found = np.random.default_rng([seed, POSITIONS]), self._area(), np.zeros((0, 2))
        for _ in range(TRIES):
            more = area.drawn(rng, self.count)
            found = np.concatenate([found, more[inside(more, np.array(self.water_deg))] if self.water_deg else more])
            if len(found) >= self.count:
                set_deg = np.array(self.places_deg, np.float64).reshape(-1, 2)
                return np.concatenate([set_deg, found[len(set_deg) : self.count]])
        raise InputError(
            f"input.water_deg: got under 1 % of the area around {self.area_latitude_deg}, {self.area_longitude_deg}"
        )

    def _area(self) -> Area:
        return Area(
            middle_deg=(self.area_latitude_deg, self.area_longitude_deg),
            width_m=self.area_width_nm * NAUTICAL_MILE_M,
            height_m=self.area_height_nm * NAUTICAL_MILE_M,
        )

    def _noise(self, sensors: Sensors, truths: Sequence[RadarTruth]) -> Noise:
        factor = np.array([t.noise_factor for t in truths])
        wire, degree_m = float(self.ais.wire_steps), 60.0 * NAUTICAL_MILE_M
        return Noise(
            range_sigma_m=factor * sensors.radars.range_sigma_m,
            azimuth_sigma_rad=factor * sensors.radars.azimuth_sigma_rad,
            range_bias_m=np.array([t.range_bias_m for t in truths]),
            azimuth_bias_rad=np.radians([t.azimuth_bias_deg for t in truths]),
            time_bias_s=np.array([t.time_bias_s for t in truths]),
            site_error_m=np.array([t.site_error_m for t in truths], np.float64).reshape(-1, 2),
            ais_position_sigma_m=float(np.hypot(self.ais.position_sigma_m, wire * POSITION_STEP_DEG * degree_m / ROUNDING)),
            ais_velocity_sigma_m_s=float(np.hypot(self.ais.velocity_sigma_kn, wire * SOG_STEP_KN / ROUNDING)) * KNOT_M_S,
        )


def truths_of(kind: str, names: Array, every: AnyTruth, named: Sequence[AnyTruth]) -> tuple[AnyTruth, ...]:
    """The settings of each sensor: those under its name, or else those of all.

    Raises: InputError if a name is not of a sensor, or occurs twice.
    """
    by_name = {t.name: t for t in named}
    known = [str(n) for n in names]
    if set(by_name) - set(known) or len(by_name) < len(named):
        raise InputError(f"input.{kind}: got the names {[t.name for t in named]}, needed each once and one of {known}")
    return tuple(by_name.get(name, every) for name in known)


def inside(position_deg: Floats, corners_deg: Floats) -> Bools:
    """Whether each position is inside a polygon (even-odd rule). Args: (V, 2), (C, 2); not across the antimeridian. Returns: (V,).

    Each side takes only the positions between the latitudes of its ends.
    """
    order = np.argsort(position_deg[:, 0])
    lat, lon = position_deg[order].T
    here, there = corners_deg, np.roll(corners_deg, -1, axis=0)
    ends = np.searchsorted(lat, np.sort(np.stack([here[:, 0], there[:, 0]], axis=-1), axis=1))
    crosses = np.zeros(len(lat), np.bool_)
    for k in np.flatnonzero(ends[:, 0] < ends[:, 1]).tolist():
        (lat_1, lon_1), (lat_2, lon_2), between = here[k], there[k], slice(*ends[k])
        crosses[between] ^= lon[between] < lon_1 + (lat[between] - lat_1) / (lat_2 - lat_1) * (lon_2 - lon_1)
    out = np.empty(len(lat), np.bool_)
    out[order] = crosses
    return out


def _arrived(reports: AnyReports, stop_s: float) -> AnyReports:
    """The reports that arrive before the end."""
    return reports.take(reports.received_s <= stop_s)
