"""The report as one HTML page that needs no other file and no network."""

from __future__ import annotations

import html
import math
from collections.abc import Iterator, Sequence

from coastwatch.reproduction.figures import Made, Order, Row, Spread, values
from coastwatch.reproduction.json_report import Folder, Reproduction, seeds
from coastwatch.reproduction.report_plots import drawn
from coastwatch.spelling import printable_lines

CSS = """
body { font: 15px/1.5 system-ui, sans-serif; color: #1d2733; background: #fff; max-width: 70rem;
  margin: 2rem auto; padding: 0 1.2rem; }
h1 { font-size: 1.6rem; margin-bottom: .2rem; } h2 { font-size: 1.2rem; margin-top: 2.6rem;
  border-top: 1px solid #d5dce2; padding-top: 1rem; }
h3 { font-size: 1rem; margin: 1.4rem 0 .3rem; } p { max-width: 52rem; } .faint { color: #5b6b7a; font-size: .88rem; }
.wide { overflow-x: auto; } table { border-collapse: collapse; font-size: .88rem; font-variant-numeric: tabular-nums; }
th, td { padding: .22rem .7rem; text-align: right; border-bottom: 1px solid #e3e8ec; white-space: nowrap; }
th:first-child, td:first-child { text-align: left; white-space: normal; min-width: 14rem; } thead th { border-bottom: 2px solid #93a1ad; }
.yes { color: #1b7a3d; } .no { color: #b3261e; font-weight: 600; } .sd { color: #7d8894; } .note { color: #7d8894; font-size: .8rem; }
figure { margin: 1rem 0; } figure img { max-width: 100%; } figcaption { color: #5b6b7a; font-size: .85rem; max-width: 52rem; }
code { font-size: .85em; } nav a { margin-right: .9rem; } @media print { h2 { break-before: page; } }
"""
LEADING = ("F1", "MCC", "specificity", "position", "share", "fused targets")  # published figures in the summary
# path, heading, unit, digits: columns of the table of variants, by the stage of the folder
DECISIONS = (("f1", "F1", "%", 2), ("precision", "precision", "%", 2), ("recall", "recall", "%", 2), ("accuracy", "accuracy", "%", 2),
             ("specificity", "specificity", "%", 2), ("mcc", "MCC", "", 3), ("swaps", "swaps", "", 0))  # fmt: skip
ERRORS = (("fused_tracks.position_rmse_m", "position, m", "", 2), ("fused_tracks.course_rmse_deg", "course, deg", "", 2),
          ("fused_tracks.speed_rmse_kn", "speed, kn", "", 3), ("fused_tracks.bound_position_rmse_m", "bound, m", "", 2),
          ("fused_tracks.radar_position_rmse_m", "radar alone, m", "", 2),
          ("fused_tracks.ais_position_rmse_m", "AIS alone, m", "", 2))  # fmt: skip
TIMES = (("timings_s.associations.median", "association, ms", "ms", 3), ("timings_s.spots.median", "forming the spots, ms", "ms", 3),
         ("associations.recall", "recall", "%", 2))  # fmt: skip
COUNTS = (("picture.fused", "fused", "", 0), ("picture.radar_only", "radar alone", "", 0),
          ("picture.AIS_only", "AIS alone", "", 0), ("picture.bearings", "bearings", "", 0))  # fmt: skip
SYSTEMS = (
    ("system.rmse", "RMSE of 4 states", "", 2),
    ("system.position_rmse_m", "position", "m", 2),
    ("system.anees", "ANEES", "", 2),
    ("system.gospa_m", "GOSPA", "m", 1),
    ("system.ospa2_m", "OSPA(2)", "m", 1),
    ("system.present", "with a track", "%", 1),
    ("system.false", "false", "", 2),
)
TARGETS = (("targets.ospa_m", "OSPA, m", "", 1), ("targets.error_m", "TLE, m", "", 2), ("targets.probability", "TPD", "%", 1),
           ("targets.false_tracks", "TFAR", "", 3), ("targets.breaks", "breaks", "", 2), ("targets.nees", "ANEES", "", 2),
           ("targets.id_right", "id right", "%", 1), ("targets.id_wrong", "id wrong", "%", 1),
           ("targets.genie_ospa_m", "OSPA of the bound, m", "", 1))  # fmt: skip
HOW = """
<p>Columns: <b>published</b>, the paper's value. <b>Literal</b>, the methods as the paper describes them, run here; where the
paper is not specific, the choice is named. <b>Our default</b>, the methods of <code>coastwatch run</code>. <b>Bound</b>, the exact filter
that knows the true motion and every noise: no method can be better. Vessels that brake or sway in lanes have none. Each is the mean
over runs &plusmn; the standard deviation of one run. "Asked" says whether the project's own target is reached,
by the named variant if it is not the default.</p>"""
OPEN = """
<p>The paper does not give radar range, process noise, window p, confidence and AIS interval. These matter more than the methods; the
README of each scenario lists the values. A decision is counted per track and cycle; a swap is FN and FP. F1 is shown with
specificity and MCC, because on the paper's Table III "always associate" has an F1 of 91.8 %. No setting was chosen on seeds from
1000 on. One of them, 1003, showed an error of the bearing association, which was then corrected.</p>"""


def escape(text: str) -> str:
    """A text of a file as HTML; control characters are shown as escapes."""
    return html.escape(printable_lines(text))


def text(reproduction: Reproduction) -> str:
    """The whole page."""
    return "".join(_page(reproduction))


def _page(reproduction: Reproduction) -> Iterator[str]:
    title = f"Reproduction of {escape(reproduction.paper.capitalize())} et al."
    yield f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>{title}</title><style>{CSS}</style></head><body>'
    yield f"<h1>{title}</h1><p class=faint>{_conditions(reproduction)}</p>"
    yield (
        "<nav>"
        + "".join(f'<a href="#{f.name}">{escape(f.of.title.split(":")[0])}</a>' for f in reproduction.folders)
        + "</nav>"
    )
    yield from _summary(reproduction)
    yield HOW
    if any(variant.name == "literal" for folder in reproduction.folders for variant in folder.of.variant):
        yield OPEN
    for folder in reproduction.folders:
        yield from _section(folder)
    yield "</body></html>\n"


def _conditions(reproduction: Reproduction) -> str:
    used, m = seeds(reproduction.folders), reproduction.machine
    runs = sum(len(made.records) for folder in reproduction.folders for made in folder.made)
    conditions = (
        reproduction.date_utc,
        f"code {reproduction.code}",
        f"{runs} runs, seeds {used[0]} to {used[-1]}" if used else "no runs",
        f"{m.get('processors')} x {m.get('processor')}, {m.get('system')}, Python {m.get('python')}",
    )
    return " &middot; ".join(escape(str(part)) for part in conditions) + f"<br><code>{escape(reproduction.command)}</code>"


def _summary(reproduction: Reproduction) -> Iterator[str]:
    every = [row for folder in reproduction.folders for row in folder.rows]
    known = [row.reached for row in every if row.reached is not None]
    beaten = [b for row in every if (b := better_than_published(row)) is not None]
    yield "<h3>In short</h3><ul>"
    yield f"<li>{sum(known)} of {len(known)} targets of the project are reached.</li>"
    yield f"<li>Our default is as good as published, or better, in {sum(beaten)} of {len(beaten)} figures.</li>"
    for row in (r for r in every if r.reached is False):
        yield f"<li class=no>Missed: {escape(_title(row))}: asked {_plain(row.figure.asked, row)}, got {_cell(row.asked_of, row)}.</li>"
    yield "</ul>"
    for row in (r for r in every if better_than_published(r) is False):
        yield f"<li>Worse than published: {escape(_title(row))}: {_plain(row.figure.published, row)}, ours {_cell(row.default, row)}.</li>"
    head = ("figure", "published", "literal", "our default", "bound")
    lead = [r for r in every if r.figure.published is not None and any(word in r.figure.name for word in LEADING)]
    yield _table(head, [(_title(row), *_columns(row)) for row in lead])


def better_than_published(row: Row) -> bool | None:
    """Whether the default is at least as good as published; None if there is nothing to compare."""
    published, got = row.figure.published, row.default.mean
    if published is None or not row.figure.compared or math.isnan(got):
        return None
    return got <= published if row.figure.better == "lower" else got >= published


def _section(folder: Folder) -> Iterator[str]:
    yield f'<h2 id="{folder.name}">{escape(folder.of.title)}</h2>'
    yield f"<p>{escape(' '.join(folder.of.why.split()))}</p>"
    head = ("figure", "published", "literal", "our default", folder.of.bound_name, "asked")
    yield _table(head, [(_title(row), *_columns(row), _verdict(row)) for row in folder.rows])
    if folder.orders:
        titles = ("ordering", "at", "difference", "standard error", "")
        yield _table(titles, [_order(order) for order in folder.orders])
    for kind in folder.of.plots:
        for uri, caption in drawn(kind, folder.of, folder.made):
            yield f'<figure><img alt="{escape(caption)}" src="{uri}"><figcaption>{escape(caption)}</figcaption></figure>'
    yield "<h3>All variants</h3>"
    columns = _columns_of(folder)
    rows = [
        (
            _name_of(made),
            str(len(made.records)),
            *(_spread(Spread(values(made.records, path)), unit, digits) for path, _, unit, digits in columns),
        )
        for made in folder.made
    ]
    yield _table(("variant", "runs", *(heading for _, heading, _, _ in columns)), rows)
    yield f"<p class=faint>Raw values of every run and all settings: the JSON beside this page, <code>scenarios.{folder.name}</code>.</p>"


def _order(order: Order) -> Sequence[str]:
    o = order.ordering
    at = escape(", ".join(str(value) for _, value in order.point))
    said = o.title
    colour = {"holds": "yes", "fails": "no"}.get(order.verdict, "note")
    numbers = f"{order.difference.mean:.3g}", f"{order.error:.2g}"
    return said, at, *numbers, f"<span class={colour}>{order.verdict}</span>"


def _columns_of(folder: Folder) -> Sequence[tuple[str, str, str, int]]:
    if folder.of.picture:
        return COUNTS
    if folder.of.targets:
        return TARGETS
    if folder.of.systems:
        return SYSTEMS
    if folder.of.serial:
        return TIMES
    if any(f.path.startswith("fused_tracks") for f in folder.of.figure):
        return ERRORS
    stage = "bearing_associations" if any(f.path.startswith("bearing") for f in folder.of.figure) else "associations"
    return tuple((f"{stage}.{name}", heading, unit, digits) for name, heading, unit, digits in DECISIONS)


def _name_of(made: Made) -> str:
    point = ", ".join(f"{key.rpartition('.')[2].replace('_', ' ')} {value}" for key, value in made.wanted.point)
    return f"{made.wanted.variant.title}" + (f" ({point})" if point else "")


def _title(row: Row) -> str:
    return row.figure.name + (f" [{row.figure.source}]" if row.figure.source else "")


def _columns(row: Row) -> tuple[str, str, str, str]:
    return _plain(row.figure.published, row), _cell(row.literal, row), _cell(row.default, row), _cell(row.bound, row)


def _verdict(row: Row) -> str:
    if row.figure.asked is None:
        return ""
    word = {True: "<span class=yes>reached</span>", False: "<span class=no>missed</span>", None: "not measured"}[row.reached]
    who = "" if row.figure.asked_of == "default" else f" <span class=note>by {escape(row.figure.asked_of)}</span>"
    return f"{'&le;' if row.figure.better == 'lower' else '&ge;'} {_plain(row.figure.asked, row)} {word}{who}"


def _cell(spread: Spread, row: Row) -> str:
    return _spread(spread, row.figure.unit, row.figure.digits)


def _plain(value: float | None, row: Row) -> str:
    return "" if value is None else _number(value, row.figure.unit, row.figure.digits)


def _spread(spread: Spread, unit: str, digits: int) -> str:
    if not spread.values:
        return ""
    mean = _number(spread.mean, unit, digits)
    return (
        mean
        if math.isnan(spread.std)
        else f"{mean} <span class=sd>&plusmn; {_number(spread.std, unit, digits, bare=True)}</span>"
    )


def _number(value: float, unit: str, digits: int, *, bare: bool = False) -> str:
    scale = {"%": 100.0, "ms": 1000.0}.get(unit, 1.0)
    return f"{scale * value:,.{digits}f}" + ("" if bare or unit in ("", "ms") else f" {unit}")


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """An HTML table. The first cell of a row is text, the others are HTML."""
    top = "".join(f"<th>{escape(h)}</th>" for h in head)
    body = "".join(
        "<tr><td>" + escape(first) + "</td>" + "".join(f"<td>{cell}</td>" for cell in rest) + "</tr>" for first, *rest in rows
    )
    return f'<div class="wide"><table><thead><tr>{top}</tr></thead><tbody>{body}</tbody></table></div>'
