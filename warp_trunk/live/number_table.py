"""The table that follows the sliders, and the status over it, as HTML of the template `numbers.html`."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from warp_trunk.bone_motion.plan import PlannedSurgery, fixed_numbers, plan_words
from warp_trunk.case import Case
from warp_trunk.measures import TrunkMeasures
from warp_trunk.measures.body_part import follow_points
from warp_trunk.measures.levels import JUDGED
from warp_trunk.measures.measures import measure_spine
from warp_trunk.measures.number_text import MISSING, number, sided
from warp_trunk.measures.quantities import BEFORE, PREDICTED, QUANTITIES, MeasureTable, measured
from warp_trunk.measures.rows import MeasureRow, skin_heading, skin_rows, spine_rows
from warp_trunk.measures.verdicts import NOT_KNOWN, is_known
from warp_trunk.report import style
from warp_trunk.report.page import environment

from .session import PlanView
from .sliders import MotionPlan

_STATES = (BEFORE, "plan", "kept")
"""States of the table; a kept plan has any title."""
_STATE_OF = {BEFORE: BEFORE, PREDICTED: "plan"}
"""The states of the table that have intervals, by those of intervals."""
WAITING = ": measured when its skin is relaxed"
"""The heading goes on so while it is not."""
_COLOURS = (style.BEFORE.colour, style.PLANS[0].colour, style.PLANS[1].colour)
"""Of their bars."""
_MIDDLE, _HALF, _ROW = 125.0, 92.0, 17.0
"""Where bars of back surface rotation begin, their largest length and the height of a level [px]."""


def _html(macro: str, *values: Any) -> str:
    return str(getattr(environment("live", "report").get_template("numbers.html").module, macro)(*values))


def status_html(
    view: PlanView | None, refusal: str, *, planning: bool = False, doing: str = "", invented: bool = False
) -> str:
    """The status of the view and its distance from the equilibrium, in words, or the reason why nothing is new.

    Its height does not change with what it says: the sliders below stay under the hand.

    Args:
        view: what is shown.
        refusal: why a newer plan is not possible.
        planning: whether a newer plan is being found.
        doing: what a relaxation is at.
        invented: whether parts of the skin were not measured, which are hatched.
    """
    error = _size(None if view is None else view.error)
    return _html("status", view, refusal[:1].upper() + refusal[1:], planning, error, doing, invented)


def line_html(text: str) -> str:
    """A line of small text."""
    return _html("line", text)


def _size(error: float | None) -> str:
    if error is None:
        return "an unknown way, often 5 to 20 mm"
    return "0.001 mm" if error < 0.001 else f"{error:.2g} mm" if error < 10.0 else f"{error:.0f} mm"


def numbers_html(
    case: Case,
    before: TrunkMeasures,
    view: PlanView,
    other: tuple[str, PlanView] | None = None,
) -> str:
    """The table of a view, below its warnings.

    While the skin of a plan is not relaxed and measured, its numbers are blank: those of the plan before would
    stand beside the curves of this one.

    Args:
        case: the patient, with the points that are followed.
        before: measures before surgery.
        view: what is shown.
        other: name and view of the plan to compare with.
    """
    views = [view, *([] if other is None else [other[1]])]
    titles = ["before", "plan", *([] if other is None else [other[0]])]
    states, numbers = _STATES[: len(titles)], measured(BEFORE, before)
    for state, each in zip(states[1:], views, strict=True):
        if each.measures is not None:
            numbers += measured(state, each.measures, before, of="skin")
        if isinstance(each.surgery, PlannedSurgery):
            spine = measure_spine(each.surgery.landmarks_after)
            numbers += measured(state, spine, before, of="spine")
    intervals = [replace(row, state=name) for row in view.intervals if (name := _STATE_OF.get(row.state))]
    table = MeasureTable(numbers).with_intervals(intervals)
    plan = view.surgery.plan if isinstance(view.surgery, PlannedSurgery) else None
    fixed = {} if plan is None else fixed_numbers(plan)
    groups = {skin_heading(before) + WAITING * (view.measures is None): skin_rows(table, states)}
    groups |= spine_rows(table, before, states)
    rows = _point_rows(case, views)

    def cells(row: MeasureRow) -> list[str]:
        row = replace(row, fixed=fixed.get((row.quantity.key, row.level), ""))
        title, was, will, *other = row.cells()
        return [title, was, will, *([row.interval] if intervals else []), *other]

    for heading, group in groups.items():
        shown = [cells(row) for row in group if row.short or row.values[0] is None]  # what plans are chosen by
        rows += [[heading], *shown] if shown else []
    levels, colours, bars = _rotation(table, states)
    legend = [(titles[states.index(state)], colour) for state, colour in colours.items()]
    if intervals:
        titles.insert(2, "19 of 20")
    words = "" if plan is None else plan_words(plan)
    return _html("numbers", view.warnings, words, titles, rows, levels, legend, bars)


def _point_rows(case: Case, views: Sequence[PlanView]) -> list[list[str]]:
    """How far the points of the case follow the motions of its bones, in each view."""
    followed = [
        follow_points(case, view.skin, view.motions.__getitem__)
        for view in views
        if isinstance(view.surgery, MotionPlan)
    ]
    rows = [["Points"]] if followed and followed[0] else []
    for row, point in enumerate(followed[0] if followed else ()):
        moved = [number(points[row].distance) for points in followed]
        rows.append([f"{point.name} moves by [mm]", MISSING, *moved])
        if point.ratio is not None:
            ratios = [MISSING if (share := points[row].ratio) is None else f"{share:.2f}" for points in followed]
            rows.append([f"{point.name}, ratio to bone", MISSING, *ratios])
    return rows


def _rotation(
    table: MeasureTable, states: Sequence[str]
) -> tuple[list[tuple[str, str]], dict[str, str], list[tuple[Any, ...]]]:
    """Levels with the rotation of the plan, the colour of each state that is known, and bars from the middle to
    the side that stands further back: x, y, width, height and colour of each."""
    columns = {state: table.values(state, "bsr_deg") for state in states}
    colours = {state: colour for state, colour in zip(states, _COLOURS, strict=False) if columns[state]}
    angles = [a for column in columns.values() for at, a in column.items() if a is not None and at in JUDGED]
    scale, thick = _HALF / max([5.0, *map(abs, angles)]), (_ROW - 4.0) / max(len(colours), 1)
    shown = table.column([*colours][min(1, len(colours) - 1)], "bsr_deg") if colours else {}
    levels, bars = [], []
    for row, (level, was) in enumerate(columns[BEFORE].items()):
        turn = shown.get(level)
        missing = turn is None or turn.value is None
        sure = missing or is_known(QUANTITIES["bsr_deg"], turn, was)
        levels.append((level, sided(None if turn is None else turn.value) if sure else NOT_KNOWN))
        for place, (state, colour) in enumerate(colours.items()):
            if (angle := columns[state].get(level)) is not None:
                size = min(abs(angle) * scale, _HALF)  # T1 and T2 set no scale
                x, y = _MIDDLE - (size if angle < 0.0 else 0.0), _ROW * row + 2.0 + place * thick
                bars.append((x, y, size, thick, colour))
    return levels, colours, bars
