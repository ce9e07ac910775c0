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

from coastwatch.batches.ais_codes import (
    CLASS_OF_TYPE as CLASS_OF_TYPE,
    CLASSES as CLASSES,
    NavStatus as NavStatus,
    PositionAccuracy as PositionAccuracy,
    VesselClass as VesselClass,
    nav_status_text as nav_status_text,
)
from coastwatch.batches.events import BegunEvents as BegunEvents, EventChanges as EventChanges, EventSpans as EventSpans
from coastwatch.batches.hearing import Hearing as Hearing, SensorHearing as SensorHearing
from coastwatch.batches.kinds import ALARM_KINDS as ALARM_KINDS, AlarmKind as AlarmKind, Flag as Flag
from coastwatch.batches.reports import (
    AisReports as AisReports,
    AisStatics as AisStatics,
    BearingReports as BearingReports,
    Fault as Fault,
    FileContent as FileContent,
    HeadingReports as HeadingReports,
    Noise as Noise,
    RadarReports as RadarReports,
    Recording as Recording,
    Reports as Reports,
    ReportStream as ReportStream,
    TrackReports as TrackReports,
    Trajectories as Trajectories,
    Truth as Truth,
)
from coastwatch.batches.sensors import (
    ID_STRIDE as ID_STRIDE,
    AzimuthReference as AzimuthReference,
    Radars as Radars,
    Rings as Rings,
    Sensors as Sensors,
    Sonars as Sonars,
    SourceKind as SourceKind,
    Stations as Stations,
    TrackSources as TrackSources,
)
from coastwatch.batches.struct import Batch as Batch, Struct as Struct, column as column, optional_column as optional_column
from coastwatch.batches.video import (
    Extractions as Extractions,
    RadarExcess as RadarExcess,
    RadarVideo as RadarVideo,
    Videos as Videos,
)
from coastwatch.batches.yields import (
    COVER_AZIMUTHS as COVER_AZIMUTHS,
    COVER_RANGES as COVER_RANGES,
    AisAlarms as AisAlarms,
    AisDetection as AisDetection,
    AisFeeds as AisFeeds,
    Associations as Associations,
    BearingAssociations as BearingAssociations,
    BearingMembers as BearingMembers,
    BearingTracks as BearingTracks,
    DecidedPath as DecidedPath,
    ExpectedVessels as ExpectedVessels,
    FusedTracks as FusedTracks,
    HeldVessels as HeldVessels,
    HullOffsets as HullOffsets,
    Measurements as Measurements,
    Members as Members,
    Messages as Messages,
    Octants as Octants,
    Picture as Picture,
    Plots as Plots,
    RadarCorrections as RadarCorrections,
    RadarCover as RadarCover,
    RegistrationState as RegistrationState,
    Spots as Spots,
    StandingEchoes as StandingEchoes,
    Tracks as Tracks,
    TrackSourceStates as TrackSourceStates,
    Unproven as Unproven,
    VesselAlarms as VesselAlarms,
    VesselBearings as VesselBearings,
    cover_cell as cover_cell,
    joint_keys as joint_keys,
    member_rows as member_rows,
)
from coastwatch.kernels.arrays import Array as Array, Bools as Bools, Floats as Floats, Ints as Ints, Rows as Rows
