"""Every kind of data that flows: shapes, units, axis letters. The first file to read.

Axis letters, fixed once:
    M reports or plots      N tracks          V vessels (truth, fused, picture)     A associated pairs
    K spots                 W window          L members (track in vessel)           H halo entries
    T instants              J models of an IMM (kernels only)

Positions are latitude, longitude in degrees (WGS 84); velocities are metres a second east, north; times are seconds since
the Unix epoch, UTC. A covariance of a track is of east, north, east rate, north rate in the local tangent plane at the track.
An absent value is NaN, or -1 for a number that names something. `origin` is the true vessel of a row where the input is
simulated, -1 elsewhere. Scores read it. A method that reads it has a setting with "known origin" in its name.
"""

from coastwatch.batches.ais_codes import NavStatus, PositionAccuracy, nav_status_text
from coastwatch.batches.classes import CLASS_OF_TYPE, CLASSES, VesselClass
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
    Radars,
    Sensors,
    Sonars,
    SourceKind,
    Stations,
    TrackSources,
)
from coastwatch.batches.struct import (
    Array,
    Batch,
    Bools,
    Floats,
    Ints,
    Rows,
    Struct,
    column,
)
from coastwatch.batches.yields import (
    AisAlarms,
    AisFeeds,
    Associations,
    BearingAssociations,
    BearingMembers,
    BearingTracks,
    Flag,
    FusedTracks,
    HeldVessels,
    Measurements,
    Members,
    Messages,
    Octants,
    Picture,
    Plots,
    RadarCorrections,
    RegistrationState,
    Spots,
    Tracks,
    TrackSourceStates,
    VesselBearings,
)

__all__ = [
    "CLASSES",
    "CLASS_OF_TYPE",
    "AisAlarms",
    "AisFeeds",
    "AisReports",
    "AisStatics",
    "Array",
    "Associations",
    "Batch",
    "BearingAssociations",
    "BearingMembers",
    "BearingReports",
    "BearingTracks",
    "Bools",
    "Fault",
    "FileContent",
    "Flag",
    "Floats",
    "FusedTracks",
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
    "RadarReports",
    "Radars",
    "Recording",
    "RegistrationState",
    "ReportStream",
    "Reports",
    "Rows",
    "Sensors",
    "Sonars",
    "SourceKind",
    "Spots",
    "Stations",
    "Struct",
    "TrackReports",
    "TrackSourceStates",
    "TrackSources",
    "Tracks",
    "Trajectories",
    "Truth",
    "VesselBearings",
    "VesselClass",
    "column",
    "nav_status_text",
]
