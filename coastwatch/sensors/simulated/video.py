"""The feed of simulated radar video: ships on set courses, in sea clutter, turn by turn.

Source: F. Heymann et al., Validation of Radar Image Tracking Algorithms with Simulated Data, section 2; what the paper leaves open is
set here.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from coastwatch.batches import Array, Fault, FileContent, Floats, Ints, RadarVideo, Recording, Reports, Sensors, Videos
from coastwatch.errors import InputError
from coastwatch.geodesy import KNOT_M_S, NAUTICAL_MILE_M, from_plane, offset_deg, to_plane
from coastwatch.kernels.tables.lookup import row_of
from coastwatch.sensors.simulated.ais import AisTruth, transmit, transmit_static_data, transponders
from coastwatch.sensors.simulated.echoes import TURN_RAD, Disc, Hulls, Power, Rain, add_ships, background
from coastwatch.sensors.simulated.radar import require_usable_radars
from coastwatch.sensors.simulated.simulation import inside
from coastwatch.sensors.simulated.trajectories import PiecewiseMotion, advanced
from coastwatch.stage import Latitude, Longitude, Method, NotNegative, Plan, Positive, Settings, Share

VIDEO = 71  # stream of random numbers
NOISE_DB = 10.0  # of level 0 under the mean noise
LINEAR_NOISE = 3.0  # level of the noise in linear video
STC_M, STC_DB_A_DECADE = 2.0 * NAUTICAL_MILE_M, 40.0  # range from which on the gain is whole, and its slope
BEAM_ROUNDS = 3  # iterations until the beam meets a ship
NEAR_M = 60.0  # beyond a hull and a beam, within which a plot is of it
QUARTER = 0.25  # of a turn: near the antenna no more than so much is near a hull


class Leg(Settings):
    """A part of a ship's way."""

    duration_s: Positive
    turn_rate_deg_s: Annotated[float, Field(ge=-10.0, le=10.0)] = 0.0  # positive turns to starboard


class Ship(Settings):
    """A ship and its way."""

    latitude_deg: Latitude  # at the start
    longitude_deg: Longitude  # at the start
    course_deg: Annotated[float, Field(ge=0.0, le=360.0)] = 0.0  # at the start; of one at anchor its heading
    speed_kn: Annotated[float, Field(ge=0.0, le=60.0)] = 0.0
    legs: tuple[Leg, ...] = ()  # one after the other, again and again; none: straight on
    length_m: Positive = 32.0
    width_m: Positive = 11.0
    antenna_m: Annotated[float, Field(ge=-250.0, le=250.0)] = 0.0  # of its AIS on the ship, ahead of the middle positive

    @model_validator(mode="after")
    def _has_its_antenna(self) -> Self:
        if abs(self.antenna_m) > (half_m := 0.5 * self.length_m):
            raise InputError(f"antenna_m: got {self.antenna_m}, needed {-half_m} to {half_m}: half of length_m")
        return self


class Receiver(Settings):
    """What becomes of the power before it is sent. A level is `db_per_level` of the radar, from 10 dB under the noise on."""

    bits: Literal[1, 2, 4, 8, 16, 32] = 8  # of a cell; levels over the highest are cut, those of 16 and 32 bits have 8
    stc_db: float = Field(
        default=0.0,
        ge=0.0,
        le=100.0,
        description="sensitivity time control: most by which the gain is lowered near the radar, with r^4 up to 2 NM",
    )
    saturation_db: float | None = Field(
        default=None, ge=0.0, le=200.0, description="over the noise, where echoes are cut; none: nowhere"
    )

    def received(self, power: Array, range_m: Floats) -> Array:
        """What the gain leaves of the power. The gain is that of noise too. (S, C) float32. Args: power: (S, C); range_m: (C,)."""
        if self.stc_db:
            lowered_db = np.clip(STC_DB_A_DECADE * np.log10(STC_M / range_m), 0.0, self.stc_db)
            power = power * (10.0 ** (-lowered_db / 10.0)).astype(np.float32)
        if self.saturation_db is not None:
            power = np.minimum(power, np.float32(10.0 ** (self.saturation_db / 10.0)))
        return power


class SimulatedVideo(Method):
    """Ships as scatterers in noise, K-distributed sea clutter, rain and land, behind each other or not, as video of all radars.

    Every turn has random numbers of its own, so that a run may begin anywhere.
    """

    method: Literal["simulated_video"] = "simulated_video"
    ships: tuple[Ship, ...] = ()
    spokes: Annotated[int, Field(ge=8, le=16_384)] = 1024  # whole number in a turn
    cells: Annotated[int, Field(ge=8, le=65_536)] = 1024  # whole number in the range of the radar
    power: Power = Power()  # strengths of echoes
    receiver: Receiver = Receiver()  # gain, saturation and depth
    rain: tuple[Rain, ...] = ()  # showers
    land_deg: tuple[tuple[tuple[Latitude, Longitude], ...], ...] = ()
    """Rings of corners, latitude and longitude, of land; none: the land of `coastline`."""
    ais: AisTruth = AisTruth(share=0.0)  # which ships carry AIS, and what is received; headings and sizes are true
    lost_share: Share = 0.0  # of the spokes
    jitter_deg: NotNegative = 0.0  # most by which a spoke is off its azimuth

    def load(self, sensors: Sensors, seed: int, plan: Plan) -> Recording:
        """The video of a run as a stream, with the truth at its instants. Raises: InputError if the scenario has no radar."""
        require_usable_radars(sensors.radars, "simulated_video")
        start_s, stop_s = plan.start_s, plan.instant_s(plan.cycles - 1)
        vessels = motion_of(self.ships, start_s, stop_s - start_s)
        others = self._of_ais(sensors, vessels, seed, (start_s, stop_s))
        stream = VideoStream(self, sensors, vessels, seed, (start_s, stop_s), others)
        return Recording(stream, vessels.sampled(plan.instants_s), beside=others)

    def _of_ais(self, sensors: Sensors, vessels: PiecewiseMotion, seed: int, span_s: tuple[float, float]) -> Reports:
        """The AIS of a run. Positions are those of antennas."""
        ships = self.ships
        senders = transponders(self.ais, len(ships), seed)
        if not len(senders.row):
            return Reports()
        before_m = np.array([ship.antenna_m for ship in ships])
        length_m, width_m = np.array([[ship.length_m, ship.width_m] for ship in ships]).T

        def of_antenna(row: Ints, time_s: Floats) -> tuple[Floats, Floats]:
            position, velocity = vessels.state(row, time_s)
            heading = _headings(ships, row, velocity)
            ahead = before_m[row, None] * np.column_stack([np.sin(heading), np.cos(heading)])
            return offset_deg(position, ahead), velocity

        ais = transmit(self.ais, senders, sensors.stations, of_antenna, *span_s, seed)
        heading = np.degrees(_headings(ships, ais.origin, vessels.state(ais.origin, ais.time_s)[1])) % 360.0
        statics = transmit_static_data(self.ais, senders, ais.mmsi, *span_s, seed)
        ship = senders.row[row_of(senders.mmsi, statics.mmsi)]
        return Reports(
            ais=replace(ais, heading_deg=heading),
            statics=replace(
                statics,
                length_m=length_m[ship],
                beam_m=width_m[ship],
                to_bow_m=0.5 * length_m[ship] - before_m[ship],
                to_stern_m=0.5 * length_m[ship] + before_m[ship],
                to_port_m=0.5 * width_m[ship],
                to_starboard_m=0.5 * width_m[ship],
            ),
        )


def motion_of(ships: tuple[Ship, ...], start_s: float, span_s: float) -> PiecewiseMotion:
    """The motion of ships on their legs."""
    ways = [_way(ship, span_s) for ship in ships]
    longest, count = max((len(way) for way in ways), default=1), len(ships)
    break_s, rate = np.full((count, longest), np.inf), np.zeros((count, longest))
    position, velocity = np.zeros((count, longest, 2)), np.zeros((count, longest, 2))
    for v, (ship, way) in enumerate(zip(ships, ways, strict=True)):
        course = np.radians(ship.course_deg)
        now = np.zeros((1, 2)), ship.speed_kn * KNOT_M_S * np.array([[np.sin(course), np.cos(course)]])
        for k, (begun_s, rate_rad_s) in enumerate(way):
            if k:
                now = advanced(*now, rate[v, k - 1 : k], np.zeros((1, 2)), np.array([begun_s - break_s[v, k - 1]]))
            break_s[v, k], rate[v, k], position[v, k], velocity[v, k] = begun_s, rate_rad_s, now[0][0], now[1][0]
    return PiecewiseMotion(
        start_s=start_s,
        keep=1.0,
        anchor_deg=np.array([[ship.latitude_deg, ship.longitude_deg] for ship in ships]).reshape(-1, 2),
        break_s=break_s,
        position_m=position,
        velocity_m_s=velocity,
        turn_rate_rad_s=rate,
        acceleration_m_s2=np.zeros((count, longest, 2)),
        appear_s=np.full(count, -np.inf),
        disappear_s=np.full(count, np.inf),
        kick_s=np.zeros((count, 0)),
        kick_m_s=np.full(count, np.nan),
    )


def _way(ship: Ship, span_s: float) -> list[tuple[float, float]]:
    """When each leg begins, and its turn rate, positive to port."""
    way, now_s = [(0.0, 0.0)] if not ship.legs else [], 0.0
    while ship.legs and now_s <= span_s:
        for leg in ship.legs:
            way.append((now_s, -float(np.radians(leg.turn_rate_deg_s))))
            now_s += leg.duration_s
    return way


class VideoStream:
    """The video of simulated radars as a `ReportStream`, one turn after the other. The first turn of each begins with the run."""

    def __init__(
        self,
        settings: SimulatedVideo,
        sensors: Sensors,
        vessels: PiecewiseMotion,
        seed: int,
        span_s: tuple[float, float],
        others: Reports,
    ) -> None:
        """Args: others: that come beside the video."""
        self._others = others
        self._settings, self._sensors, self._vessels, self._seed, self._span_s = settings, sensors, vessels, seed, span_s
        self._discs = [_disc(settings, sensors, radar) for radar in range(len(sensors.radars))]
        self._newest: dict[int, tuple[int, RadarVideo]] = {}

    def between(self, after_s: float, until_s: float) -> Reports:
        start_s, stop_s = self._span_s
        parts = []
        for radar, period_s in enumerate(self._sensors.radars.period_s.tolist()):
            first = max(int((max(after_s, start_s) - start_s) // period_s), 0)
            end = int((min(until_s, stop_s) - start_s) // period_s) + 1
            turns = (self._turn(radar, number) for number in range(first, end))
            parts.append(Videos(tuple(turns)).between(after_s, min(until_s, stop_s)))
        return Reports.merged([self._others.between(after_s, until_s), *(Reports(video=part) for part in parts)])

    def rest(self, after_s: float) -> int:
        """As `ReportStream.rest`: a simulation ends with its run."""
        return 0

    def faults(self) -> tuple[Fault, ...]:
        return ()

    def contents(self) -> tuple[FileContent, ...]:
        return ()

    def _turn(self, radar: int, number: int) -> RadarVideo:
        """The video of one turn of a radar; the newest one is kept, as cycles may end in mid-turn."""
        newest, video = self._newest.get(radar, (-1, None))
        if video is None or newest != number:
            video = self._simulated(radar, number)
            self._newest[radar] = number, video
        return video

    def _simulated(self, radar: int, number: int) -> RadarVideo:
        s, radars, disc = self._settings, self._sensors.radars, self._discs[radar]
        rng = np.random.default_rng([self._seed, VIDEO, radar, number])
        site_deg, period_s = radars.site_deg[radar], float(radars.period_s[radar])
        begun_s = self._span_s[0] + number * period_s
        hulls = self._hulls(site_deg, begun_s, period_s)
        power = background(disc, s.power, rng)
        add_ships(power, disc, hulls, s.power, rng)
        azimuth = disc.azimuth
        if s.jitter_deg:
            azimuth = azimuth + np.radians(s.jitter_deg) * rng.uniform(-1.0, 1.0, s.spokes)
        time_s = begun_s + disc.azimuth / TURN_RAD * period_s
        video = RadarVideo(
            sensor=radar,
            first_m=0.0,
            cell_m=disc.cell_m,
            time_s=time_s,
            received_s=time_s,
            azimuth_rad=azimuth % TURN_RAD,
            site_deg=np.tile(site_deg, (s.spokes, 1)),
            level=_levels(s.receiver.received(power, disc.range_m), float(radars.db_per_level[radar]), s.receiver.bits),
            bits=s.receiver.bits,
            vessel_m=_ranges(disc, hulls),
        )
        return video.take(rng.random(s.spokes) >= s.lost_share) if s.lost_share else video

    def _hulls(self, site_deg: Floats, begun_s: float, period_s: float) -> Hulls:
        """The ships where the beam of a turn meets them."""
        s, row = self._settings, np.arange(len(self._settings.ships))
        time_s = np.full(len(row), begun_s + 0.5 * period_s)
        for _ in range(BEAM_ROUNDS):
            at = to_plane(self._vessels.position(row, time_s), site_deg)
            time_s = begun_s + np.arctan2(at[:, 0], at[:, 1]) % TURN_RAD / TURN_RAD * period_s
        position, velocity = self._vessels.state(row, time_s)
        heading = _headings(s.ships, row, velocity)
        sizes = np.array([[ship.length_m, ship.width_m] for ship in s.ships]).reshape(-1, 2)
        return Hulls(to_plane(position, site_deg), heading, sizes[:, 0], sizes[:, 1])


def _headings(ships: tuple[Ship, ...], row: Ints, velocity_m_s: Floats) -> Floats:
    """The headings of ships, rad: their course, or as set at anchor. (M,) Args: row: (M,) of `ships`; velocity_m_s: (M, 2)."""
    at_anchor = np.radians([ship.course_deg for ship in ships])[row]
    return np.where(np.hypot(*velocity_m_s.T) > 0.0, np.arctan2(velocity_m_s[:, 0], velocity_m_s[:, 1]), at_anchor)


def _disc(s: SimulatedVideo, sensors: Sensors, radar: int) -> Disc:
    """The cells of a radar, with land and rain on them."""
    radars = sensors.radars
    azimuth = (np.arange(s.spokes) + 0.5) * TURN_RAD / s.spokes
    range_m = (np.arange(s.cells) + 0.5) * float(radars.range_m[radar]) / s.cells
    east_north = range_m[:, None] * np.stack([np.sin(azimuth), np.cos(azimuth)], axis=-1)[:, None, :]
    land = rain = None
    if rings := s.land_deg or sensors.land_deg:
        position = from_plane(east_north.reshape(-1, 2), radars.site_deg[radar])
        flat = np.zeros(len(position), np.bool_)
        for corners in map(np.array, rings):
            near = np.flatnonzero(((position >= corners.min(axis=0)) & (position <= corners.max(axis=0))).all(axis=1))
            flat[near] ^= inside(position[near], corners)
        land = flat.reshape(s.spokes, s.cells)
    if s.rain:
        rain = np.zeros((s.spokes, s.cells), np.float32)
        for shower in s.rain:
            middle = to_plane(np.array([shower.latitude_deg, shower.longitude_deg]), radars.site_deg[radar])
            off = np.square(east_north - middle).sum(axis=2) / shower.radius_m**2
            rain += (10.0 ** (shower.rain_db / 10.0) * np.exp(-(off**2))).astype(np.float32)
    return Disc(azimuth, range_m, float(radars.beam_rad[radar]), float(radars.pulse_m[radar]), land, rain)


def _levels(power: Array, db_per_level: float, bits: int) -> Array:
    """Power as levels of video. uint8"""
    highest = float((1 << min(bits, 8)) - 1)
    if db_per_level == 0.0:
        return np.asarray(np.clip(LINEAR_NOISE * np.sqrt(power), 0.0, highest).astype(np.uint8))
    decibels = np.float32(10.0) * np.log10(np.maximum(power, np.float32(1e-3)))
    return np.asarray(np.clip((decibels + np.float32(NOISE_DB)) / np.float32(db_per_level), 0.0, highest).astype(np.uint8))


def _ranges(disc: Disc, hulls: Hulls) -> Floats:
    """As of `RadarVideo.vessel_m`. (S, V)"""
    distance, towards = np.hypot(*hulls.east_north_m.T), np.arctan2(*hulls.east_north_m.T)
    reach = (0.5 * hulls.length_m + NEAR_M) / np.maximum(distance, 1.0) + disc.beam_rad
    off = np.abs((disc.azimuth[:, None] - towards + np.pi) % TURN_RAD - np.pi)
    return np.where(off <= np.minimum(reach, QUARTER * TURN_RAD), distance, np.nan)
