"""The specifications of the sensors of a scenario, and the same as arrays."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from coastwatch.batches import Array, AzimuthReference, Floats, Radars, Sensors, Sonars, Stations, TrackSources
from coastwatch.errors import InputError
from coastwatch.geodesy import NAUTICAL_MILE_M, earth_centred
from coastwatch.stage import Latitude, Longitude, NotNegative, Positive, Settings

MOST_APART_NM = 500.0  # between radars of a region: distances in its plane are 0.3 % short at 250 nm
Name = Annotated[str, Field(min_length=1, max_length=32)]
RangeNm = Annotated[float, Field(gt=0.0, le=2000.0)]
TurnsAMinute = Annotated[float, Field(gt=0.0, le=1000.0)]


class Area(Settings):
    """The rectangle that `coastwatch plot` draws."""

    latitude_deg: Latitude
    longitude_deg: Longitude
    width_nm: Positive = 10.0
    height_nm: Positive = 10.0


class Radar(Settings):
    """The specification of a radar."""

    name: Name  # unique among the radars
    region: Name = "region"  # the radars of a region make one set of tracks; not "ais"
    latitude_deg: Latitude | None = None  # of the antenna; none: a radar that moves, with its position in each row of its plots
    longitude_deg: Longitude | None = None
    range_nm: RangeNm
    rpm: TurnsAMinute
    range_noise_m: Positive = 10.0
    azimuth_noise_deg: Positive = 0.3
    beam_deg: Positive = 1.0  # width of the beam at half power, for video
    pulse_m: Positive = 45.0  # length of the pulse in range, for video
    blind_m: NotNegative = 250.0  # in video no plot is nearer
    db_per_level: NotNegative = 0.5  # a step of its video; 0: its levels are linear in amplitude
    azimuth_reference: Literal["true", "magnetic", "heading"] = (
        "true"  # heading: from the bow of its ship; a feed `heading` gives it
    )
    magnetic_variation_deg: Annotated[float, Field(ge=-180.0, le=180.0)] | None = (
        None  # east positive, where azimuths are magnetic
    )

    @model_validator(mode="after")
    def _has_both_or_none(self) -> Self:
        if (self.latitude_deg is None) != (self.longitude_deg is None):
            raise InputError(
                f"got latitude_deg {self.latitude_deg} and longitude_deg {self.longitude_deg}, needed both or none"
            )
        if (self.azimuth_reference == "magnetic") != (self.magnetic_variation_deg is not None):
            raise InputError(
                f"got azimuth_reference {self.azimuth_reference!r} and magnetic_variation_deg {self.magnetic_variation_deg}, "
                "needed a variation with 'magnetic', and with no other"
            )
        return self


class Station(Settings):
    """An AIS receiver: AIS is received inside its range."""

    name: Name  # unique among the stations
    latitude_deg: Latitude
    longitude_deg: Longitude
    range_nm: RangeNm


class Sonar(Settings):
    """A bearing sensor: a passive sonar, a camera, a direction finder."""

    name: Name  # unique among the sonars, radars, regions and sources of tracks; not "ais"
    latitude_deg: Latitude
    longitude_deg: Longitude
    range_nm: RangeNm
    bearing_noise_deg: Positive = 1.0
    interval_s: Positive = 3.0
    arc_from_deg: Annotated[float, Field(ge=0.0, le=360.0)] = 0.0
    arc_to_deg: Annotated[float, Field(ge=0.0, le=360.0)] = 360.0


class TrackSource(Settings):
    """A system that sends finished tracks: a coast radar with a tracker of its own, another centre."""

    name: Name  # unique among the sources of tracks; not "ais"
    latitude_deg: Latitude | None = None  # of the radar, where sentences give range and bearing without a position of their own
    longitude_deg: Longitude | None = None  # of the radar
    heading_deg: Annotated[float, Field(ge=0.0, lt=360.0)] = 0.0  # of a radar that does not move, for relative bearings
    position_sigma_m: Positive = 50.0  # per axis, of tracks without covariance, until their differences to AIS are known
    velocity_sigma_m_s: Positive = 1.0  # per axis, the same
    patience_s: Positive = 30.0  # a track is dropped if it is not sent for this time or for 2.5 of its own intervals


def refuse_shared_names(radars: Sequence[Radar], track_sources: Sequence[TrackSource], sonars: Sequence[Sonar]) -> None:
    """Refuses a name that two kinds of sources or sensors share: pictures and questions tell sources by their names alone.

    A track source may have the name of a region: at a centre it takes the place of that region.

    Raises: InputError.
    """
    of_ais = {"ais": "AIS"}
    of_others = of_ais | {radar.name: "a radar" for radar in radars} | {radar.region: "a region" for radar in radars}
    of_others |= {source.name: "a track source" for source in track_sources}
    regions, systems, bearings = [r.region for r in radars], [t.name for t in track_sources], [s.name for s in sonars]
    for kind, names, taken in (
        ("region", regions, of_ais),
        ("track_sources", systems, of_ais),
        ("sonars", bearings, of_others),
    ):
        for name in names:
            if name in taken:
                raise InputError(f"{kind}: got the name {name!r}, which is also that of {taken[name]}, needed another one")


def refuse_scattered_regions(radars: Sequence[Radar]) -> None:
    """Refuses a region whose radars are so far apart that one plane cannot hold them, as where a sign is wrong. Raises: InputError."""
    for region in dict.fromkeys(radar.region for radar in radars):
        ours = [r for r in radars if r.region == region and r.latitude_deg is not None]
        if ours:
            sites = earth_centred(_sites(ours))
            apart_nm = np.hypot.reduce(sites - sites[0], axis=1) / NAUTICAL_MILE_M
            if apart_nm.max() > MOST_APART_NM:
                raise InputError(
                    f"radars: got {ours[0].name!r} and {ours[int(apart_nm.argmax())].name!r} of region {region!r} "
                    f"{apart_nm.max():,.0f} nm apart, needed {MOST_APART_NM:.0f} at most; is the sign of a position wrong?"
                )


def sensors_of(
    radars: Sequence[Radar],
    stations: Sequence[Station],
    sonars: Sequence[Sonar],
    track_sources: Sequence[TrackSource] = (),
) -> Sensors:
    """The sensors as arrays. Regions are numbered by their first radar; a region's plane is tangent at the mean of its radars."""
    regions = list(dict.fromkeys(r.region for r in radars))
    number, sites = np.array([regions.index(r.region) for r in radars], np.int64), _sites(radars)
    origins = [_mean_position(sites[number == k]) for k in range(len(regions))]
    return Sensors(
        radars=Radars(
            name=_names(radars),
            region=number,
            site_deg=sites,
            range_m=_column(radars, "range_nm") * NAUTICAL_MILE_M,
            period_s=60.0 / _column(radars, "rpm"),
            range_sigma_m=_column(radars, "range_noise_m"),
            azimuth_sigma_rad=np.radians(_column(radars, "azimuth_noise_deg")),
            beam_rad=np.radians(_column(radars, "beam_deg")),
            pulse_m=_column(radars, "pulse_m"),
            blind_m=_column(radars, "blind_m"),
            db_per_level=_column(radars, "db_per_level"),
            azimuth_reference=np.array([AzimuthReference[r.azimuth_reference.upper()] for r in radars], np.int64),
            variation_rad=np.radians(
                [np.nan if r.magnetic_variation_deg is None else r.magnetic_variation_deg for r in radars]
            ),
        ),
        stations=Stations(
            name=_names(stations), site_deg=_sites(stations), range_m=_column(stations, "range_nm") * NAUTICAL_MILE_M
        ),
        sonars=Sonars(
            name=_names(sonars),
            site_deg=_sites(sonars),
            range_m=_column(sonars, "range_nm") * NAUTICAL_MILE_M,
            bearing_sigma_rad=np.radians(_column(sonars, "bearing_noise_deg")),
            interval_s=_column(sonars, "interval_s"),
            arc_from_deg=_column(sonars, "arc_from_deg"),
            arc_to_deg=_column(sonars, "arc_to_deg"),
        ),
        region_names=tuple(regions),
        region_origin_deg=np.array(origins).reshape(-1, 2),
        track_sources=TrackSources(
            name=_names(track_sources),
            site_deg=_sites(track_sources),
            heading_deg=_column(track_sources, "heading_deg"),
            position_sigma_m=_column(track_sources, "position_sigma_m"),
            velocity_sigma_m_s=_column(track_sources, "velocity_sigma_m_s"),
            patience_s=_column(track_sources, "patience_s"),
        ),
    )


AnySensor = Radar | Station | Sonar | TrackSource


def _names(sensors: Sequence[AnySensor]) -> Array:
    return np.array([s.name for s in sensors], "U32")


def _column(sensors: Sequence[AnySensor], field: str) -> Floats:
    return np.array([getattr(s, field) for s in sensors], np.float64)


def _sites(sensors: Sequence[AnySensor]) -> Floats:
    """(N, 2); NaN where a position is not set."""
    return np.array([[s.latitude_deg, s.longitude_deg] for s in sensors], np.float64).reshape(-1, 2)


def _mean_position(positions_deg: Floats) -> Floats:
    """The mean of nearby positions, also across the antimeridian."""
    first = positions_deg[0]
    east = (positions_deg[:, 1] - first[1] + 180.0) % 360.0 - 180.0
    return np.asarray(first + np.column_stack([positions_deg[:, 0] - first[0], east]).mean(0))
