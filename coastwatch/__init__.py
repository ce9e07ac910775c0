"""Coastwatch: one picture of a coast from radars, AIS and passive sonars.

The map, in the order in which data flows (each stage is a folder with a README):

| stage          | takes                          | yields                                            |
|----------------|--------------------------------|---------------------------------------------------|
| formats        | bytes of a wire                | Reports, and back                                 |
| sensors        | recordings, simulation         | Reports of a sensor, in its own coordinates       |
| plots          | radar reports                  | Plots in a region's plane, with covariance        |
| tracks         | plots, AIS reports, bearings   | Tracks and BearingTracks                          |
| spots          | tracks of all sources          | Spots and Octants: tracks that may be compared    |
| associations   | tracks in a spot               | Associations: which tracks are one vessel         |
| fused_tracks   | associated tracks              | FusedTracks: one estimate a vessel                |
| picture        | fused tracks                   | Picture: stable identity, sources, flags          |
| alarms         | picture, zones                 | VesselAlarms: what holds beside the flags         |
| registration   | plots, tracks, bearings        | RadarCorrections for the plots of the next cycle  |
| cover          | plots, tracks, associations    | RadarCover and AisDetection for the next cycle    |
| scores         | truth and any of the above     | numbers                                           |

Around them: `batches` defines the data that flows, `formats` the bytes of a wire, and `errors` the errors that an operator reads.
`scenario` reads the settings of a run from a TOML file. `regional` is the flow of a regional centre, from reports to tracks, `centre`
that of the high-level centre, from tracks to the picture, and `cycle` runs both: a page each. `workers` spreads it over processors,
`store` writes it to a database. `server` reads the clock and starts processes. `operators` is the command line. `reproduction` runs
the scenarios of a paper and reports its figures. `kernels` computes on bare arrays.
"""
