"""Settings of the alarms, apart from the method that uses them, so that every module here can read them."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from coastwatch.stage import Method, NotNegative, Positive, PositiveShare, Share


class AlarmSettings(Method):
    """Settings of `AlarmRules`."""

    method: Literal["rules"] = "rules"
    open_s: NotNegative = 6.0  # how long a condition must hold before its alarm begins
    close_s: NotNegative = 15.0  # how long it must not hold before the alarm ends
    zone_margin_m: NotNegative = 50.0  # a vessel leaves a zone when it is so far outside
    zone_speed_margin_kn: NotNegative = 1.0  # an alarm for speed ends so far below (above) the limit
    line_margin_m: Positive = 50.0  # a vessel must move so far before a crossing is looked for
    moment_s: NotNegative = 60.0  # how long an alarm for leaving a zone or crossing a line lasts
    forget_s: NotNegative = 300.0  # a vessel that is away for longer is new to zones and lines when it returns
    first_seen_s: NotNegative = 60.0  # a vessel first seen inside a zone has entered it when it has been there for so long
    start_up_s: NotNegative = 600.0  # of a run: what is first seen inside a zone until then was there before
    cpa_nm: NotNegative = 0.05  # distance of closest approach (CPA) below which two vessels are too close; 0: no such alarm
    tcpa_min: Annotated[float, Field(gt=0.0, le=60.0)] = 3.0  # time to closest approach (TCPA) within which the alarm begins
    cpa_open_s: NotNegative = 60.0  # in place of `open_s`: a turn must not raise alarms
    cpa_oldest_s: NotNegative = 60.0  # a pair raises no alarm if the newest report of one of the two is older
    cpa_hold_factor: Annotated[float, Field(ge=1.0, le=3.0)] = 1.5  # the alarm lasts within so many times both limits
    cpa_relative_kn: NotNegative = 3.0  # least relative speed: vessels in company are no danger to each other
    cpa_under_way_kn: NotNegative = 3.0  # least speed of each of the two, or of one of them with `cpa_at_rest`
    cpa_at_rest: bool = False  # also between a vessel under way and one that is stationary, anchored or moored
    cpa_known_s: NotNegative = 60.0  # each of the two must have been in the picture for so long
    swing_m: NotNegative = 300.0  # radius of the swing circle of an anchored vessel; 0: no alarm for dragging
    settle_s: NotNegative = 600.0  # the anchorage is the mean position of so long after the vessel came to rest
    rest_s: NotNegative = 3600.0  # what has no status "at anchor" must have been stationary for so long
    drag_kn: Positive = 3.0  # what is faster is under way, whatever its status says
    lost_after_s: NotNegative = 120.0  # without a track; 0: no alarm for lost vessels
    lost_for_s: NotNegative = 1800.0  # the alarm ends if the vessel has not returned so long after its last track
    lost_known_s: NotNegative = 300.0  # it must have been in the picture for so long
    lost_under_way_kn: NotNegative = 3.0  # it must have had this speed
    should_see: Share = 0.5  # least learnt probability of detection that counts as cover
    cover_looks: NotNegative = (
        24.0  # turns at AIS vessels in a cell of a radar, from which its learnt cover counts, not its range
    )
    cover_margin: PositiveShare = 0.9  # share of a sensor's range that counts as cover
