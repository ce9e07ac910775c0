"""What each column that operators read holds: its type in Parquet, and its decimals."""

from __future__ import annotations

from typing import Literal

Kind = Literal["text", "whole", "number", "yes_no", "instant", "flags"]

TEXTS = {
    "answers", "body", "call_sign", "client", "cycles_done", "evidence", "first_source", "health", "heard_by", "kind", "last_ais_name",
    "members", "method", "name", "nav_status", "parameters", "path", "question", "region", "role", "says",
    "scenario", "second_source", "source", "sources", "specification", "stage", "state", "status", "title",
    "version", "video", "what", "who",
}  # fmt: skip
WHOLE = {
    "cycle", "cycles", "cycles_stored", "gaps", "dropped", "http_status", "number", "parts_lost", "priority", "run", "seed", "ship_type",
    "spokes_a_turn", "spokes_lost",
    "states", "subject", "tracks", "vessels", "vessels_of_it_alone",
    "voices", "workers",
}  # fmt: skip
WHOLE_ENDINGS = ("_id", "_cycle", "_track")
NUMBERS = {
    "ais_detection", "ais_looks", "compared", "false_plots_per_km2", "plots_per_turn", "track_detection", "track_looks", "turns",
    "detection_probability", "false_plots_a_turn", "lost_share", "plots_a_turn", "threshold_db",
    "existence", "found_odds", "range_scale", "range_scale_sigma", "odds", "residuals", "rival_share", "rows_a_cycle", "share", "statistic",
}  # fmt: skip
KINDS: dict[str, Kind] = {
    "flags": "flags",
    "in_picture": "yes_no",
    **dict.fromkeys(TEXTS, "text"),
    **dict.fromkeys(WHOLE, "whole"),
    **dict.fromkeys(NUMBERS, "number"),
}

DIGITS = {
    **dict.fromkeys(("latitude_deg", "longitude_deg"), 6),
    **dict.fromkeys(("ais_looks", "track_looks", "turns"), 1),
    **dict.fromkeys(("sog_kn", "plots_per_turn"), 2),
    **dict.fromkeys(("statistic", "existence", "ais_detection", "track_detection"), 3),
    **dict.fromkeys(("share", "azimuth_bias_deg", "azimuth_sigma_deg", "azimuth_change_deg"), 4),
    **dict.fromkeys(("false_plots_per_km2", "range_scale", "range_scale_sigma"), 5),
}
ENDINGS = {"_deg": 2, "_deg_s": 4, "_m": 1, "_nm": 3, "_kn": 2, "_ms": 3, "_s": 3, "_min": 2}
OTHER_DIGITS = 6


def kind_of(name: str) -> Kind | None:
    """What a column holds, by its name; None: unknown."""
    if name in KINDS:
        return KINDS[name]
    if name.endswith("_utc"):
        return "instant"
    if name.endswith("mmsi"):
        return "text"
    if name.endswith(WHOLE_ENDINGS):
        return "whole"
    return "number" if _ending(name) else None


def digits_of(name: str) -> int:
    """Decimals of the numbers of a column."""
    return DIGITS.get(name, ENDINGS.get(_ending(name), OTHER_DIGITS))


def rounded(value: float, digits: int) -> float:
    """A number with so many decimals; never -0."""
    return round(value, digits) + 0.0


def _ending(name: str) -> str:
    """The unit at the end of a name; empty if it has none."""
    return max((ending for ending in ENDINGS if name.endswith(ending)), key=len, default="")
