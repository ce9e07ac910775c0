"""Vessels as events of Cursor on Target, for TAK."""

from __future__ import annotations

import math
from collections.abc import Iterator
from xml.sax.saxutils import quoteattr

from coastwatch.formats.format import Format, Vessels, rounded_deg
from coastwatch.geodesy import NAUTICAL_MILE_M
from coastwatch.spelling import utc_text

STALE_CYCLES = 3
CE90 = 2.146  # radius of 90 % over the standard deviation per axis
UNKNOWN = 9_999_999.0


class CursorOnTarget:
    """Events of Cursor on Target 2.0. A vessel is stale after three cycles. Source: MITRE, Cursor on Target, event schema 2.0."""

    def messages(self, vessels: Vessels) -> Iterator[bytes]:
        """As of `Encoder`."""
        now, stale = utc_text(vessels.time_s), utc_text(vessels.time_s + STALE_CYCLES * vessels.period_s)
        columns = (vessels.vessel_id, *vessels.position_deg.T, vessels.sog_kn, vessels.cog_deg, vessels.major_m, vessels.mmsi)
        for vessel, latitude, longitude, sog, cog, major, mmsi, name in zip(
            *(column.tolist() for column in columns), vessels.name, strict=True
        ):
            ce = CE90 * major if math.isfinite(major) else UNKNOWN
            call = name or (f"{mmsi:09d}" if mmsi >= 0 else f"vessel {vessel}")
            moving = ""
            if math.isfinite(sog) and math.isfinite(cog):
                moving = f'<track course="{rounded_deg(cog, 1):.1f}" speed="{sog * NAUTICAL_MILE_M / 3600.0:.2f}"/>'
            yield (
                f'<event version="2.0" uid="coastwatch-{vessels.run_id}-{vessel}" type="a-u-S-X" how="m-f" time="{now}" '
                f'start="{now}" stale="{stale}"><point lat="{latitude:.7f}" lon="{longitude:.7f}" hae="{UNKNOWN}" ce="{ce:.1f}" '
                f'le="{UNKNOWN}"/><detail><contact callsign={quoteattr(call)}/>{moving}</detail></event>\n'
            ).encode()


COT = Format("cot", pictures=lambda to: CursorOnTarget())
