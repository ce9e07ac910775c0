"""Coastwatch: one picture of a coast from radars, AIS and passive sonars.

The map, in the order in which data flows (each stage is a folder with a README):

| stage          | takes                          | yields                                            |
|----------------|--------------------------------|---------------------------------------------------|
| sensors        | recordings, simulation         | Reports: what a sensor said, in its coordinates   |
| plots          | radar reports                  | Plots in a region's plane, with covariance        |
| tracks         | plots, AIS reports, bearings   | Tracks and BearingTracks                          |
| spots          | tracks of all sources          | Spots and Octants: who is compared with whom      |
| associations   | tracks in a spot               | Associations: which tracks are one vessel         |
| fused_tracks   | associated tracks              | FusedTracks: one estimate a vessel                |
| picture        | fused tracks                   | Picture: stable identity, sources, flags          |
| registration   | plots, tracks, bearings        | RadarCorrections for the plots of the next cycle  |
| scores         | truth and any of the above     | numbers                                           |

`batches` is what flows, `scenario` one TOML file, `pipeline` the whole flow on one page, `workers` how it is spread,
`store` where it is kept, `server` where clocks and processes live, `operators` how people see it.
"""
