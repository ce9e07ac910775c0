"""Records of AIS tracking: what stands of a track, a report, the answer to a report, and the settings. Arrays of these go into kernels.

A track is a row of TRACK, with an IMM filter in the plane at its anchor; a report is a row of REPORT; RULES are the settings.
SI and radians, but for latitudes and longitudes in degrees.
"""

import numpy as np

from coastwatch.kernels.filters.kalman import SIZE
from coastwatch.kernels.jit import jit

MODELS = 3  # room in a row; fewer may be in use. One layout: numba caches code by the name of a record type, not by its size
TRACK = np.dtype(
    [
        *((name, "i8") for name in ("mmsi", "number", "confirmed", "hits", "class_b", "origin", "status")),
        ("updated", "f8"),  # time of the newest report in this track
        ("started", "f8"),
        ("received", "f8"),  # time of the newest report of the vessel
        ("interval", "f8"),  # between its reports, as learned
        ("gap", "f8"),  # between its two newest reports
        ("expected", "f8"),  # interval until the next report
        ("patience", "f8"),  # time without a report after which the track is not predicted
        ("alarm", "f8"),  # time until which an impossible speed is flagged
        ("anchor_lat", "f8"),
        ("anchor_lon", "f8"),
        *((name, "f8") for name in ("lat", "lon", "sog", "cog", "ee", "en", "nn", "error")),  # as in REPORT, of the newest one
        ("mode_probability", "f8", (MODELS,)),
        ("state", "f8", (MODELS, SIZE)),  # in the plane at the anchor
        ("covariance", "f8", (MODELS, SIZE, SIZE)),
    ]
)
# sog in m/s, cog in radians clockwise from north, NaN where not available; ee, en, nn: covariance of the position, east and north;
# jitter: standard deviation of the time; error: by which the message itself contradicts the time; status: navigational, -1 if not sent
REPORT = np.dtype(
    [
        *((name, "i8") for name in ("mmsi", "class_b", "origin", "status", "feed")),
        *((name, "f8") for name in ("time", "lat", "lon", "sog", "cog", "ee", "en", "nn", "jitter", "error")),
    ]
)
OUTCOME = np.dtype(
    [
        ("verdict", "i8"),  # TAKEN, REPEAT, IMPOSSIBLE, CROWDED or DOUBTED
        ("delay", "f8"),  # s, how late its stamp is against the way sailed since the report before; NaN: not measured
        ("variance", "f8"),  # of the delay where stamps are exact
    ]
)
RULES = np.dtype(
    [
        ("sog_variance", "f8"),
        ("cog_variance", "f8"),
        ("still_speed", "f8"),  # under which a report without COG says that the vessel stands
        ("polar_speed", "f8"),  # at which COG begins to mean something
        ("start_speed_variance", "f8"),
        ("max_speed", "f8"),
        ("acceleration", "f8"),  # of a ship, at most
        ("stamp", "f8"),  # error of the time between two reports
        ("stamp_most", "f8"),  # by which a report may be off along the track of its vessel
        ("repeat", "f8"),  # the same position so soon is the same fix
        ("patience_least", "f8"),
        ("patience_factor", "f8"),
        ("moving_a", "f8"),  # nominal intervals
        ("moving_b", "f8"),
        ("slow", "f8"),
        ("first", "f8"),  # interval to expect before a second report shows it
        ("slow_speed", "f8"),
        ("anchor_speed", "f8"),  # under which a status of at anchor, moored or aground is believed
        ("forget", "f8"),  # after which an MMSI is a new vessel
        ("alarm", "f8"),
        ("jump_speed", "f8"),  # by which a vessel may have been faster than it said before and after a silence
        ("jump_least", "f8"),  # distance under which a report is no jump
        ("jump_time", "f8"),  # silence after which a vessel may have gained speed and lost it again
        ("reach", "f8"),  # from the anchor, before a new one is taken
    ]
)
TAKEN, REPEAT, IMPOSSIBLE, CROWDED, DOUBTED = 0, 1, 2, 3, 4


@jit
def mean_of(track, component):  # type: ignore[no-untyped-def]
    """One component of the state, averaged over the models."""
    total = 0.0
    for j in range(MODELS):
        total += track.mode_probability[j] * track.state[j, component]
    return total
