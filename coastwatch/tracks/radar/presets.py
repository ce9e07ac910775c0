"""Trackers by name: each is a choice of parts. A scenario may name one, and give settings of its parts."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

Part = Mapping[str, object]

TAGS = {"association": "method", "motion": "kind", "messages": "method", "bank": "method"}
"""The setting of each part that says which one it is."""

Name = Literal[
    "sided_imm",
    "imm",
    "filterpy_imm",
    "vimmjipda",
    "sided_vimmjipda",
    "vimmjipda_literal",
    "vimmjipda_sequential",
    "vimmjipda_precise_batch",
    "vimmjipda_noisy_batch",
    "guided_vimmjipda",
    "imm_jpda",
    "multi_hypothesis",
    "sided_multi_hypothesis",
    "bp_particles",
    "table",
]

_IMM: Part = {"kind": "imm"}
_JIPDA: Part = {"method": "jipda"}
_TREES: Part = {"method": "multi_hypothesis"}
_STRAIGHT: Part = {"kind": "straight", "noise_m2_s3": 0.49, "share": 1.0}

PRESETS: Mapping[str, Mapping[str, Part]] = {
    "sided_imm": {},
    "imm": {"motion": _IMM},
    "filterpy_imm": {"motion": _IMM, "bank": {"method": "filterpy"}},
    "vimmjipda": {"association": _JIPDA, "motion": _IMM},
    "sided_vimmjipda": {"association": _JIPDA},
    "vimmjipda_literal": {
        "association": {"method": "jipda_literal"},
        "motion": _IMM,
        "upkeep": {"confirm_existence": 0.999, "rates": {"learnt": False}},
    },
    "vimmjipda_sequential": {"association": _JIPDA, "motion": _IMM, "messages": {"method": "sequential"}},
    "vimmjipda_precise_batch": {"association": _JIPDA, "motion": _IMM, "messages": {"method": "precise_batch"}},
    "vimmjipda_noisy_batch": {"association": _JIPDA, "motion": _IMM, "messages": {"method": "noisy_batch"}},
    "guided_vimmjipda": {"association": _JIPDA, "motion": _IMM, "messages": {"method": "guiding"}},
    "imm_jpda": {
        "association": {"method": "jpda"},
        "upkeep": {
            "detection_probability": 0.95,
            "false_plots_per_m2": 3e-7,
            "confirm_hits": 4,
            "confirm_looks": 5,
            "delete_misses": 12,
            "misses_per_hit": 2.0,
            "coast_s": 40.0,
        },
    },
    "multi_hypothesis": {"association": _TREES, "motion": _IMM, "messages": {"method": "sequential"}},
    "sided_multi_hypothesis": {"association": _TREES, "messages": {"method": "sequential"}},
    "bp_particles": {
        "association": _JIPDA,
        "motion": {"kind": "manoeuvres", "models": [_STRAIGHT]},
        "upkeep": {"hides": False, "exact_up_to": 1},
        "messages": {"method": "noisy_batch"},
        "bank": {"method": "particles"},
    },
    "table": {},
}
"""The parts of each tracker that are not the defaults of `TableTracker`. Settings of a part hold where the scenario has no table for
this part."""

SHORT: Mapping[str, tuple[str, ...]] = {
    **dict.fromkeys(("sided_imm", "imm", "filterpy_imm"), ("plot_origin",)),
    **dict.fromkeys(("vimmjipda_sequential", "vimmjipda_precise_batch", "vimmjipda_noisy_batch"), ("message_velocities",)),
    **dict.fromkeys(("multi_hypothesis", "sided_multi_hypothesis"), ("message_velocities",)),
    "guided_vimmjipda": ("plot_origin", "message_velocities"),
    "bp_particles": ("particles", "seed"),
}
"""Settings of some presets that stand in `[tracks]` itself. A setting of a part, if it is given, holds before them."""

ORIGINS = ("estimated", "known")
"""Values of `plot_origin`. "known": the association is `known_origin`, which no message guides."""


def expanded(data: Mapping[str, object], defaults: Mapping[str, str], upkeep_of: Mapping[str, str]) -> dict[str, object]:
    """A table `[tracks]` with all parts of its method.

    Args: defaults: each part where the preset names none; upkeep_of: the method of `upkeep` that each association needs.

    Raises: ValueError: `plot_origin` has another value than it may have.
    """
    out = dict(data)
    name = out.setdefault("method", "table")
    if not isinstance(name, str) or name not in PRESETS:
        return {"method": name}  # it is refused, whatever its settings
    preset = PRESETS[name]
    if name == "guided_vimmjipda" and out.get("plot_origin") == "known":
        preset = PRESETS["sided_imm"]
    for key in SHORT.get(name, ()):
        if key in out:
            part, settings = _in_part(key, out.pop(key), preset)
            given = out.get(part, {})
            if isinstance(given, Mapping):
                out[part] = {**settings, **given}
    for part, tag in TAGS.items():
        named = {tag: defaults[part], **preset.get(part, {})}
        out[part] = _with_tag(out.get(part), tag, named)
    association = out["association"]
    of = association.get("method") if isinstance(association, Mapping) else getattr(association, "method", None)
    if isinstance(of, str) and of in upkeep_of:
        out["upkeep"] = _with_tag(out.get("upkeep"), "method", {"method": upkeep_of[of], **preset.get("upkeep", {})})
    return out


def settings_of(name: str, every: set[str]) -> set[str]:
    """The settings that a preset is usually given: of another one they are left out if the method is overridden."""
    if name == "table":
        return every
    messages = {"messages"} if "messages" in PRESETS[name] else set()
    return {"method", "motion", "upkeep", "clutter", *messages, *SHORT.get(name, ())}


def _with_tag(given: object, tag: str, named: Part) -> object:
    """What a scenario gives for a part: as it is, or with the tag, or all that the preset names if nothing is given."""
    if given is None:
        return dict(named)
    return {tag: named[tag], **given} if isinstance(given, Mapping) and tag not in given else given


def _in_part(key: str, value: object, preset: Mapping[str, Part]) -> tuple[str, Part]:
    """The part and its setting that a short setting of a preset stands for."""
    if key == "plot_origin":
        if value not in ORIGINS:
            raise ValueError(f"plot_origin: got {value!r}, needed {' or '.join(map(repr, ORIGINS))}")
        own = preset.get("association", {"method": "nearest_neighbour"})
        return "association", {"method": "known_origin"} if value == "known" else own
    return ("messages", {"velocities": value}) if key == "message_velocities" else ("bank", {key: value})
