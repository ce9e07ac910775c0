"""Every kind of data that flows: shapes, units, axis letters. The first file to read.

Axis letters, fixed once:
    M reports or plots      N tracks          V vessels (truth, fused, picture)     A associated pairs
    K spots                 W window          L members (track in vessel)           H halo entries
    T instants              J models of an IMM (kernels only)
    S spokes of video       C cells of a spoke

Positions are latitude, longitude in degrees (WGS 84); velocities are metres a second east, north; times are seconds since
the Unix epoch, UTC. A covariance of a track is of east, north, east rate, north rate in the local tangent plane at the track.
An absent value is NaN, or -1 for a number that names something. `origin` is the true vessel of a row where the input is
simulated, -1 elsewhere. Scores read it. A method that reads it has a setting with "known origin" in its name.
"""

from coastwatch.batches.ais_codes import NavStatus, PositionAccuracy, nav_status_text
from coastwatch.batches.classes import CLASS_OF_TYPE, CLASSES, VesselClass
from coastwatch.batches.events import BegunEvents, EventChanges, EventSpans
from coastwatch.batches.hearing import Hearing, SensorHearing
from coastwatch.batches.kinds import ALARM_KINDS, AlarmKind, Flag
from coastwatch.batches.reports import (
    AisReports,
    AisStatics,
    BearingReports,
    Fault,
    FileContent,
    Noise,
    RadarReports,
    Recording,
    Reports,
    ReportStream,
    TrackReports,
    Trajectories,
    Truth,
)
from coastwatch.batches.sensors import (
    ID_STRIDE,
    Radars,
    Rings,
    Sensors,
    Sonars,
    SourceKind,
    Stations,
    TrackSources,
)
from coastwatch.batches.struct import Batch, Struct, column, optional_column
from coastwatch.batches.video import Extractions, RadarVideo, Videos
from coastwatch.batches.yields import (
    COVER_AZIMUTHS,
    COVER_RANGES,
    AisAlarms,
    AisDetection,
    AisFeeds,
    Associations,
    BearingAssociations,
    BearingMembers,
    BearingTracks,
    DecidedPath,
    ExpectedVessels,
    FusedTracks,
    HeldVessels,
    Measurements,
    Members,
    Messages,
    Octants,
    Picture,
    Plots,
    RadarCorrections,
    RadarCover,
    RegistrationState,
    Spots,
    StandingEchoes,
    Tracks,
    TrackSourceStates,
    VesselAlarms,
    VesselBearings,
    cover_cell,
    joint_keys,
)
from coastwatch.kernels.arrays import Array, Bools, Floats, Ints, Rows

__all__ = [
    "ALARM_KINDS",
    "CLASSES",
    "CLASS_OF_TYPE",
    "COVER_AZIMUTHS",
    "COVER_RANGES",
    "ID_STRIDE",
    "AisAlarms",
    "AisDetection",
    "AisFeeds",
    "AisReports",
    "AisStatics",
    "AlarmKind",
    "Array",
    "Associations",
    "Batch",
    "BearingAssociations",
    "BearingMembers",
    "BearingReports",
    "BearingTracks",
    "BegunEvents",
    "Bools",
    "DecidedPath",
    "EventChanges",
    "EventSpans",
    "ExpectedVessels",
    "Extractions",
    "Fault",
    "FileContent",
    "Flag",
    "Floats",
    "FusedTracks",
    "Hearing",
    "HeldVessels",
    "Ints",
    "Measurements",
    "Members",
    "Messages",
    "NavStatus",
    "Noise",
    "Octants",
    "Picture",
    "Plots",
    "PositionAccuracy",
    "RadarCorrections",
    "RadarCover",
    "RadarReports",
    "RadarVideo",
    "Radars",
    "Recording",
    "RegistrationState",
    "ReportStream",
    "Reports",
    "Rings",
    "Rows",
    "SensorHearing",
    "Sensors",
    "Sonars",
    "SourceKind",
    "Spots",
    "StandingEchoes",
    "Stations",
    "Struct",
    "TrackReports",
    "TrackSourceStates",
    "TrackSources",
    "Tracks",
    "Trajectories",
    "Truth",
    "VesselAlarms",
    "VesselBearings",
    "VesselClass",
    "Videos",
    "column",
    "cover_cell",
    "joint_keys",
    "nav_status_text",
    "optional_column",
]
