"""The table that follows the sliders, and the words over it, as HTML; all that comes from files is escaped."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from html import escape
from typing import TYPE_CHECKING

import numpy as np

from warp_trunk.bone_motion.plan import PlannedSurgery
from warp_trunk.measures.points import follow_points
from warp_trunk.report.style import BEFORE, PLANS

from .motion_wish import MotionPlan

if TYPE_CHECKING:
    from warp_trunk.case import Case
    from warp_trunk.measures import TrunkMeasures

    from .session import Refusal, View

NOTE = "A research simulation, not for clinical use."
_BARS, _ROW = 210, 17
"""Of the drawing of back surface rotation [px]."""
_STATUS = 78
"""Height of the words over the sliders [px]; longer ones are scrolled."""
_STALE = "opacity:.45"
_BROKEN = "overflow-wrap:anywhere"
"""Of what may hold a path or the name of a plan: a panel is narrow, and what is wider is not seen."""


def status_html(view: View | None, refusal: Refusal | None) -> str:
    """What is shown and how far it is from the truth of the model, in words, or why nothing new is.

    Its height does not change with what it says: the sliders below stay under the hand.
    """
    if view is None:
        said = _box("#777777", "Making the patient ready ...")
    elif refusal is not None:
        reason = escape(refusal.reason[:1].upper() + refusal.reason[1:])
        said = _box("#b00020", f"<b>Not possible.</b> {reason}. Shown is the last plan that is.")
    else:
        said = _box(*_kind(view))
    note = f"<div style='font-size:11px;padding:2px 8px;opacity:.8'>{NOTE}</div>"
    return f"<div style='height:{_STATUS}px;overflow:auto'>{said}</div>{note}"


def line_html(text: str) -> str:
    """A line of small text."""
    return f"<div style='font-size:12px;padding:2px 10px;{_BROKEN}'>{escape(text)}</div>"


def _kind(view: View) -> tuple[str, str]:
    if not view.relaxed:
        off = "by an unknown way, often 5 to 20 mm" if view.error is None else f"by about {_size(view.error)}"
        return "#c28a00", f"<b>Spline's image</b>, not relaxed yet: off {off}"
    if view.settled:
        return "#00794f", f"<b>Relaxed skin</b>, within {_size(view.error)} of its equilibrium"
    return "#4c9a2a", f"<b>Relaxed skin</b>, about {_size(view.error)} from its equilibrium; refined at rest"


def _size(error: float | None) -> str:
    if error is None:
        return "an unknown way"
    return "0.001 mm" if error < 0.001 else f"{error:.2g} mm" if error < 10.0 else f"{error:.0f} mm"


def _box(colour: str, text: str) -> str:
    return (
        f"<div style='border-left:5px solid {colour};padding:3px 8px;margin:0 0 5px;font-size:13px;"
        f"line-height:1.35;{_BROKEN}'>{text}</div>"
    )


def numbers_html(
    case: Case,
    before: TrunkMeasures,
    view: View,
    measures: TrunkMeasures | None,
    kept: tuple[str, View] | None = None,
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
    views = [view, *([] if kept is None else [kept[1]])]
    titles = ["before", "plan", *([] if kept is None else [kept[0]])]
    head = "".join(
        f"<th style='text-align:right;padding-left:8px;{_BROKEN * (place == 2)}'>{escape(title)}</th>"
        for place, title in enumerate(titles)
    )
    rows = [f"<tr><th></th>{head}</tr>", *_plan_rows(case, views)]
    back = [before, measures, *([] if kept is None else [kept[1].measures])]
    rows += _back_rows(back, stale)
    style = "border-collapse:collapse;font-size:13px;width:100%;font-variant-numeric:tabular-nums"
    table = f"<table style='{style}'>{''.join(rows)}</table>"
    look = "".join(_box("#b25d00", f"<b>Look:</b> {escape(warning)}") for warning in view.warnings)
    return f"<div style='padding:0 16px 12px 4px'>{look}{table}{_rotation(back, titles, stale)}</div>"


def _plan_rows(case: Case, views: Sequence[View]) -> Iterator[str]:
    """The rows of what is planned: the spine, or the points that follow the motions."""
    spines = [view.surgery for view in views if isinstance(view.surgery, PlannedSurgery)]
    if spines:
        yield from _spine_rows(spines)
        return
    followed = [
        follow_points(case, view.skin, view.surgery.bones.__getitem__)
        for view in views
        if isinstance(view.surgery, MotionPlan)
    ]
    if followed[0]:
        yield _title("Points")
    for row, point in enumerate(followed[0]):
        moved = [float(np.linalg.norm(points[row].way)) for points in followed]
        yield _row(f"{point.name} moves by [mm]", [None, *moved])
        if point.ratio is not None:
            ratios = [None, *(points[row].ratio for points in followed)]
            yield _row(f"{point.name}, ratio to bone", ratios, digits=2)


def _spine_rows(plans: Sequence[PlannedSurgery]) -> Iterator[str]:
    first = plans[0]
    yield _title("Spine")
    for row, curve in enumerate(first.curves):
        was = curve.before
        name = f"Cobb {was.upper}-{was.lower}, {was.convex} [°]"
        after = [plan.curves[row].cobb_after if row < len(plan.curves) else None for plan in plans]
        yield _row(name, [was.angle, *after])
    for row, curve in enumerate(first.curves):
        turned = [plan.curves[row].rotation for plan in plans if row < len(plan.curves)]
        values = [curve.rotation[0], *(after for _, after in turned)]
        yield _row(f"Rotation of the apex, {curve.before.apex} [°]", values, sign=True)
    for name in first.measures:
        unit = "°" if name.startswith(("kyphosis", "lordosis")) else "mm"
        if name.startswith(("kyphosis T5", "lordosis L1-L5", "trunk shift")):
            values = [first.measures[name][0], *(plan.measures[name][1] for plan in plans)]
            yield _row(f"{name[:1].upper()}{name[1:]} [{unit}]", values, sign=unit == "mm")
    yield _row("Height gained [mm]", [None, *(plan.height_gained for plan in plans)], sign=True)


def _back_rows(back: Sequence[TrunkMeasures | None], stale: bool) -> Iterator[str]:
    part = "Back" if any(m is not None and m.tangents for m in back) else "Skin"
    yield _title(part + (", of the skin relaxed last" if stale else ""))
    for name, read in (
        ("Largest rotation T1-T12 [°]", lambda m: m.max_thoracic_bsr),
        ("Largest rotation L1-L5 [°]", lambda m: m.max_lumbar_bsr),
        ("Largest hump [mm]", lambda m: m.max_hump),
        ("Right shoulder higher by [mm]", lambda m: None if m.shoulders is None else m.shoulders.difference),
        ("Skin moves at most [mm]", lambda m: m.skin_change_max),
    ):
        values = [None if m is None else read(m) for m in back]
        if part == "Back" or any(value is not None for value in values):
            yield _row(name, values, sign=True, stale=stale)


def _title(text: str) -> str:
    return f"<tr><th colspan='9' style='text-align:left;padding-top:7px'>{text}</th></tr>"


def _row(
    name: str, values: Sequence[float | None], *, sign: bool = False, stale: bool = False, digits: int = 1
) -> str:
    cells = ""
    for place, value in enumerate(values):
        faint = _STALE if stale and place == 1 else ""
        cells += f"<td style='text-align:right;padding-left:8px;{faint}'>{_number(value, sign, digits)}</td>"
    return f"<tr style='border-top:1px solid #8883'><td>{escape(name)}</td>{cells}</tr>"


def _number(value: float | None, sign: bool, digits: int = 1) -> str:
    if value is None:
        return "–"
    return f"{value:+z.{digits}f}" if sign and round(value, digits) else f"{value:z.{digits}f}"


def _rotation(back: Sequence[TrunkMeasures | None], titles: Sequence[str], stale: bool) -> str:
    """Back surface rotation by level: bars from the middle to the side that stands further back."""
    known = [(title, m, colour) for title, m, colour in zip(titles, back, _COLOURS, strict=False) if m is not None]
    levels = list(known[0][1].bsr)
    if not levels:
        return ""
    most = max([5.0, *(abs(a) for _, m, _ in known for a in m.bsr.values() if a is not None)])
    middle, scale, thick = 30 + _BARS / 2, _BARS / 2 / most, (_ROW - 4) / len(known)
    height = _ROW * len(levels)
    drawn = [f"<line x1='{middle}' x2='{middle}' y1='0' y2='{height}' stroke='currentColor'/>"]
    for row, level in enumerate(levels):
        drawn.append(_text(0, row, level))
        for place, (_, measures, colour) in enumerate(known):
            angle = measures.bsr.get(level)
            if angle is None:
                continue
            left, wide, top = middle + min(0.0, angle * scale), abs(angle) * scale, _ROW * row + 2 + place * thick
            faint = _STALE if stale and place == 1 else ""
            drawn.append(
                f"<rect x='{left:.1f}' y='{top:.1f}' width='{wide:.1f}' height='{thick:.1f}' fill='{colour}' "
                f"style='{faint}'/>"
            )
        shown = known[min(1, len(known) - 1)][1].bsr.get(level)
        drawn.append(_text(34 + _BARS, row, _number(shown, True)))
    legend = " ".join(f"<span style='color:{colour}'>■</span> {escape(title)}" for title, _, colour in known)
    return (
        f"<div style='font-size:13px;padding-top:9px;{_BROKEN}'><b>Rotation of the back by level [°]</b><br>"
        f"{legend}<br>to the right: the right side stands further back</div>"
        f"<svg viewBox='0 0 {70 + _BARS} {height}' style='width:100%;max-width:340px'>{''.join(drawn)}</svg>"
    )


def _text(left: float, row: int, text: str) -> str:
    return f"<text x='{left}' y='{_ROW * row + 12}' font-size='11' fill='currentColor'>{escape(text)}</text>"


_COLOURS = (BEFORE.colour, PLANS[0].colour, PLANS[1].colour)
