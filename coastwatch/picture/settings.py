"""Settings of the picture, apart from the method that uses them, so that every module here can read them."""

from __future__ import annotations

from typing import Literal

from coastwatch.stage import Count, Method, NotNegative, Positive, PositiveShare, Share


class IdentitySettings(Method):
    """Settings of `Identity`."""

    method: Literal["identity"] = "identity"
    coast_s: NotNegative = 30.0  # how long a vessel without tracks is shown
    hold_s: NotNegative = 120.0  # how long it may return by position and velocity
    return_s: NotNegative = 3600.0  # how long it may return by its MMSI
    return_gate: Positive = 18.0  # ratio: squared Mahalanobis distance of position and velocity
    drift_m_s15: Positive = 0.15  # growth of the uncertainty of a vessel without tracks
    max_speed_kn: Positive = 60.0  # of a return by MMSI
    dark_after_s: NotNegative = 60.0  # radar without AIS where a station should hear it
    dark_unshown_s: NotNegative = (
        30.0  # of what is shown later than so long after its first plot, the excess counts too, up to this
    )
    dark_coast_s: NotNegative = 120.0  # how long a dark vessel without tracks is shown, up to `hold_s`
    unseen_after_s: NotNegative = 60.0  # from the last radar to an AIS report, where a radar should see it
    should_see: Share = 0.5  # least detection probability, in a turn, of a radar that should see a vessel
    paired_s: NotNegative = 30.0  # how long AIS and radar were one vessel before their split counts
    contradicted_for_s: NotNegative = 300.0  # how long after the split the flag may be set
    contradicted_after_s: NotNegative = 9.0  # how long after the split the flag is set first
    contradicted_from_m: NotNegative = 100.0  # least distance of the two tracks
    taken_from_m: NotNegative = 1000.0  # from a radar track to AIS that goes on under its vessel's MMSI
    stationary_m: NotNegative = 25.0  # what has moved less, or less than its noise, may be stationary
    stationary_after_s: NotNegative = 120.0  # how long it must have stayed there
    under_way_kn: Positive = 1.0  # and so long that a vessel of this speed would have left
    anchorage_ships: Count = 3  # at anchor with AIS, among which a stationary vessel that never sent AIS is dark
    anchorage_m: NotNegative = 1000.0  # at most, to these
    cover_margin: PositiveShare = 0.95  # share of a sensor's range that counts as covered
    confirmed_share: Share = (
        0.0  # of its time that others confirm a track of a radar inside the range of another region's; 0: it is shown anyway
    )
    confirm_s: Positive = 10.0  # time that the share of its region is worth
