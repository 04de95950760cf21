"""The table that follows the sliders, and the status over it, as HTML; all that comes from files is escaped."""

from collections.abc import Mapping, Sequence
from html import escape

import numpy as np

from warp_trunk.bone_motion.plan import PlannedSurgery
from warp_trunk.case import Case
from warp_trunk.measures import TrunkMeasures
from warp_trunk.measures.measures import measure_spine
from warp_trunk.measures.points import follow_points
from warp_trunk.measures.quantities import MeasureTable, measured
from warp_trunk.measures.rows import MISSING, number, skin_rows, spine_rows
from warp_trunk.measures.table import as_html
from warp_trunk.report.style import BEFORE, PLANS

from .session import PlanView
from .sliders import MotionPlan

NOTE = "A research simulation, not for clinical use."
UNSURE = "How sure the prediction is, <code>simulate --bands</code> computes."
_STATES = ("before", "plan", "kept")
"""States of the table; a kept plan has any title."""
_BARS, _ROW = 210, 17
"""Of the drawing of back surface rotation [px]."""
_STATUS = 78
"""Height of the words over the sliders [px]; longer ones are scrolled."""
_STALE = "opacity:.45"
_TABLE = (
    "<style>.numbers{border-collapse:collapse;font-size:13px;width:100%;font-variant-numeric:tabular-nums}"
    ".numbers th{text-align:left;font-weight:normal;overflow-wrap:anywhere}"
    ".numbers thead th,.numbers .group th{font-weight:bold;padding-top:7px}"
    ".numbers td,.numbers thead th+th{text-align:right;padding-left:8px}.numbers td{white-space:nowrap}"
    ".numbers tr+tr{border-top:1px solid #8883}</style>"
)
_BROKEN = "overflow-wrap:anywhere"
"""Of what may hold a path or the name of a plan: a panel is narrow, and what is wider is not seen."""


def status_html(view: PlanView | None, refusal: str, *, planning: bool = False) -> str:
    """The status of the view and its distance from the equilibrium, in words, or the reason why nothing is new.

    Its height does not change with what it says: the sliders below stay under the hand.
    """
    if view is None:
        said = _box("#777777", "Making the patient ready ...")
    elif planning:
        said = _box("#777777", "<b>Planning ...</b> Shown is the plan before.")
    elif refusal:
        reason = escape(refusal[:1].upper() + refusal[1:])
        said = _box("#b00020", f"<b>Not possible.</b> {reason}. Shown is the last plan that is.")
    else:
        said = _box(*_kind(view))
    note = f"<div style='font-size:11px;padding:2px 8px;opacity:.8'>{NOTE}</div>"
    return f"<div style='height:{_STATUS}px;overflow:auto'>{said}</div>{note}"


def line_html(text: str) -> str:
    """A line of small text."""
    return f"<div style='font-size:12px;padding:2px 10px;{_BROKEN}'>{escape(text)}</div>"


def _kind(view: PlanView) -> tuple[str, str]:
    if not view.relaxed:
        off = "" if view.error is None else "about "
        return "#c28a00", f"<b>Spline's image</b>, not relaxed yet: off by {off}{_size(view.error)}"
    if view.settled:
        return "#00794f", f"<b>Relaxed skin</b>, solved to {_size(view.error)}. {UNSURE}"
    return "#4c9a2a", f"<b>Relaxed skin</b>, solved to about {_size(view.error)}; refined at rest. {UNSURE}"


def _size(error: float | None) -> str:
    if error is None:
        return "an unknown way, often 5 to 20 mm"
    return "0.001 mm" if error < 0.001 else f"{error:.2g} mm" if error < 10.0 else f"{error:.0f} mm"


def _box(colour: str, text: str) -> str:
    return (
        f"<div style='border-left:5px solid {colour};padding:3px 8px;margin:0 0 5px;font-size:13px;"
        f"line-height:1.35;{_BROKEN}'>{text}</div>"
    )


def numbers_html(
    case: Case,
    before: TrunkMeasures,
    view: PlanView,
    measures: TrunkMeasures | None,
    kept: tuple[str, PlanView] | None = None,
) -> str:
    """The table of a view, below its warnings.

    Args:
        case: the patient, with the points that are followed.
        before: measures before surgery.
        view: what is shown.
        measures: those of the back, of an earlier view where that of this one are still to come.
        kept: name and view of the plan to compare with.
    """
    stale = measures is not None and measures is not view.measures
    views = [(view, measures), *([] if kept is None else [(kept[1], kept[1].measures)])]
    titles = ["before", "plan", *([] if kept is None else [kept[0]])]
    states, numbers = _STATES[: len(titles)], measured(_STATES[0], before)
    for state, (each, of_skin) in zip(states[1:], views, strict=True):
        if of_skin is not None:
            numbers += measured(state, of_skin, of="skin")
        if isinstance(each.surgery, PlannedSurgery):
            spine = measure_spine(each.surgery.landmarks_after)
            numbers += measured(state, spine, before.cobb, of="spine")
    table = MeasureTable(numbers)
    part = "The back" if before.tangents else "The skin"
    groups = {part + ", of the skin relaxed last" * stale: skin_rows(table, states)}
    groups |= spine_rows(table, before, states)
    rows = _point_rows(case, [each for each, _ in views])
    for heading, group in groups.items():
        shown = [row.cells() for row in group if row.short or row.values[0] is None]  # what plans are chosen by
        rows += [[heading], *shown] if shown else []
    look = "".join(_box("#b25d00", f"<b>Look:</b> {escape(warning)}") for warning in view.warnings)
    cells = as_html(["", *titles], rows, "Numbers of the plan", "numbers")
    bars = _rotation(table, dict(zip(states, titles, strict=True)), stale)
    return f"<div style='padding:0 16px 12px 4px'>{_TABLE}{look}{cells}{bars}</div>"


def _point_rows(case: Case, views: Sequence[PlanView]) -> list[list[str]]:
    """How far the points of the case follow the motions of its bones, in each view."""
    followed = [
        follow_points(case, view.skin, view.motions.__getitem__)
        for view in views
        if isinstance(view.surgery, MotionPlan)
    ]
    rows = [["Points"]] if followed and followed[0] else []
    for row, point in enumerate(followed[0] if followed else ()):
        moved = [number(float(np.linalg.norm(points[row].way))) for points in followed]
        rows.append([f"{point.name} moves by [mm]", MISSING, *moved])
        if point.ratio is not None:
            ratios = [MISSING if (share := points[row].ratio) is None else f"{share:.2f}" for points in followed]
            rows.append([f"{point.name}, ratio to bone", MISSING, *ratios])
    return rows


def _rotation(table: MeasureTable, titles: Mapping[str, str], stale: bool) -> str:
    """Back surface rotation by level: bars from the middle to the side that stands further back."""
    columns = {state: table.values(state, "bsr_deg") for state in titles}
    known = [(state, colour) for state, colour in zip(titles, _COLOURS, strict=False) if columns[state]]
    levels = list(columns[_STATES[0]])
    if not levels:
        return ""
    most = max([5.0, *(abs(a) for column in columns.values() for a in column.values() if a is not None)])
    middle, scale, thick = 30 + _BARS / 2, _BARS / 2 / most, (_ROW - 4) / len(known)
    height = _ROW * len(levels)
    drawn = [f"<line x1='{middle}' x2='{middle}' y1='0' y2='{height}' stroke='currentColor'/>"]
    for row, level in enumerate(levels):
        drawn.append(_text(0, row, level))
        for place, (state, colour) in enumerate(known):
            angle = columns[state].get(level)
            if angle is None:
                continue
            left, wide, top = middle + min(0.0, angle * scale), abs(angle) * scale, _ROW * row + 2 + place * thick
            faint = _STALE if stale and place == 1 else ""
            drawn.append(
                f"<rect x='{left:.1f}' y='{top:.1f}' width='{wide:.1f}' height='{thick:.1f}' fill='{colour}' "
                f"style='{faint}'/>"
            )
        shown = columns[known[min(1, len(known) - 1)][0]].get(level)
        drawn.append(_text(34 + _BARS, row, number(None if shown is None else abs(shown))))
    legend = " ".join(f"<span style='color:{colour}'>■</span> {escape(titles[state])}" for state, colour in known)
    return (
        f"<div style='font-size:13px;padding-top:9px;{_BROKEN}'><b>Rotation of the back by level [°]</b><br>"
        f"{legend}<br>to the right: the right side stands further back</div>"
        f"<svg viewBox='0 0 {70 + _BARS} {height}' style='width:100%;max-width:340px'>{''.join(drawn)}</svg>"
    )


def _text(left: float, row: int, text: str) -> str:
    return f"<text x='{left}' y='{_ROW * row + 12}' font-size='11' fill='currentColor'>{escape(text)}</text>"


_COLOURS = (BEFORE.colour, PLANS[0].colour, PLANS[1].colour)
