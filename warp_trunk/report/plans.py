"""Plans for one patient side by side, on one page."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from warp_trunk.bone_motion.plan import Plan, fixed_numbers, plan_words
from warp_trunk.errors import InputError
from warp_trunk.measures.number_text import MISSING, interval_text, number
from warp_trunk.measures.quantities import DETECTABLE, LENGTH, SPINE_ANGLE, WIDTH, MeasureTable
from warp_trunk.measures.rows import MeasureRow, measure_rows, under_headings
from warp_trunk.measures.verdicts import difference_word
from warp_trunk.results import Result
from warp_trunk.results.bands import Effects
from warp_trunk.spine import CobbAngle

from .headlines import headlines
from .page import rendered, sheet_of
from .sentences import listed
from .style import BEFORE, PLANS, TrunkState
from .turning import Turning

SAME_POINT = 1e-3
"""Points of one patient before surgery differ by no more than files round [mm]."""


def check_plans(results: Sequence[Result]) -> None:
    """Check that results are of several plans for one patient.

    Raises:
        InputError: too many of them, one given twice, or one of another trunk before surgery.
    """
    folders = [result.folder for result in results]
    if not 2 <= len(folders) <= len(PLANS):
        raise InputError(f"report: from 2 to {len(PLANS)} results can be compared on one page, not {len(folders)}")
    places = [folder.resolve() for folder in folders]
    twice = [folder for number, folder in enumerate(folders) if places[number] in places[:number]]
    if twice:
        raise InputError(f"{twice[0]}: is given twice; give every plan once")
    first = results[0]
    for folder, result in zip(folders, results, strict=True):
        ours, its = first.landmarks_before, result.landmarks_before
        if not its.names:
            raise InputError(
                f"{folder}: has no landmarks of a spine to compare; write a report of each result alone"
            )
        pairs = (first.skin_before.vertices, result.skin_before.vertices), (ours.points, its.points)
        same = ours.names == its.names and all(
            a.shape == other.shape and np.abs(a - other).max() <= SAME_POINT for a, other in pairs
        )
        if not same:
            raise InputError(
                f"{folder}: skin and landmarks before surgery must be those of {folders[0]}, but they differ; "
                "compare plans for one patient, from cases that share the trunk before surgery"
            )


def plan_poses(results: Sequence[Result]) -> list[TrunkState]:
    """The trunk before surgery, then that of every plan, measured."""
    first = results[0]
    predicted = [
        TrunkState(look, result.skin, result.landmarks_after, result.measures, result.table)
        for look, result in zip(PLANS, results, strict=False)
    ]
    return [
        TrunkState(BEFORE, first.skin_before, first.landmarks_before, first.measures_before, first.table),
        *predicted,
    ]


def plans_table(poses: Sequence[TrunkState]) -> MeasureTable:
    """The numbers before surgery and predicted with each plan; states are called as the poses are."""
    return MeasureTable(
        replace(row, state=pose.look.title)
        for pose in poses
        for row in pose.table.rows
        if row.state == pose.look.state
    )


def plans_page(
    table: MeasureTable,
    poses: Sequence[TrunkState],
    results: Sequence[Result],
    plans: Sequence[Plan | None],
    drawings: Mapping[str, bytes],
    trunk: Turning,
) -> str:
    """The text of the page; all that comes from files is escaped."""
    words = [plan and plan_words(plan) for plan in plans]
    named = list(zip([pose.look.heading for pose in poses[1:]], words, results, strict=True))
    states = [pose.look.title for pose in poses]
    groups = measure_rows(table, results[0].measures_before, states)
    fixed = [{}, *({} if plan is None else fixed_numbers(plan) for plan in plans)]
    apart = apart_of(groups, states, [result.effects for result in results])
    return rendered(
        "plans.html",
        drawings,
        trunk=trunk,
        panels=len(poses),
        titles=", ".join(states),
        results=results,
        plans=named,
        warnings=warnings_of({title: result.summary.warnings for title, _, result in named}),
        differs=differences(poses, apart),
        unbanded=listed([title for title, _, result in named if result.effects is None]),
        numbers_head=["measure", *states],
        numbers_rows=numbers_table(groups, table, states, fixed),
        glance_head=["measure", *states[1:]],
        glance_rows=glance_table(table, results[0].measures_before.cobb, states, fixed),
        sheet=" and ".join(dict.fromkeys(map(sheet_of, results))),
        joined=any(plans),
        apart_head=["measure", *dict.fromkeys(gap.title for gap in apart)],
        apart_rows=apart_table(apart),
    )


def warnings_of(plans: Mapping[str, Sequence[str]]) -> list[str]:
    """The warnings of every plan by its title: each once, with the plans that it is of where these are not all."""
    titles: dict[str, list[str]] = {}
    for title, lines in plans.items():
        for line in dict.fromkeys(lines):
            titles.setdefault(line, []).append(title)
    return [line if len(of) == len(plans) else f"{listed(of)}: {line}" for line, of in titles.items()]


@dataclass(frozen=True)
class Apart:
    """The difference of a measure between two plans, at one place."""

    row: MeasureRow
    """The measure, in every state."""
    title: str
    """The two plans, such as A against B."""
    value: float
    """The first less the second, with the sign of the measure [its unit]."""
    values: tuple[float, float]
    """The measure with the first and with the second plan."""
    low: float | None
    """Where the interval begins that holds the difference in 19 of 20 cases; None where it was not computed ..."""
    high: float | None
    """... and where it ends."""

    @property
    def is_visible(self) -> bool:
        """Whether it can be seen."""
        return abs(self.value) >= self.row.quantity.detectable

    @property
    def differs(self) -> bool:
        """Whether plans differ by it: zero lies outside its interval, where there is one, and it can be seen."""
        return self.is_visible and (self.low is None or self.high is None or self.low * self.high > 0.0)


def apart_of(
    groups: Mapping[str, Sequence[MeasureRow]], states: Sequence[str], effects: Sequence[Effects | None]
) -> list[Apart]:
    """The difference of every measure by which plans are chosen between each two plans.

    The plans are of one patient, so that they share the errors of landmarks, of the model and of the surgery: the
    interval of a difference comes from the difference of the effects of each (`Effects.difference_sd`).
    """
    rows = [row for group in groups.values() for row in group if row.short]
    gaps = []
    for i, other in combinations(range(len(effects)), 2):
        a, b = effects[i], effects[other]
        sds = {} if a is None or b is None else a.difference_sd(b)
        title = " against ".join(states[1 + number].removeprefix("plan ") for number in (i, other))
        for row in rows:
            first, second = row.values[1 + i], row.values[1 + other]
            if first is not None and second is not None:
                value, sd = first - second, sds.get((row.quantity.key, row.level))
                ends = (None, None) if sd is None else (value - WIDTH * sd, value + WIDTH * sd)
                gaps.append(Apart(row, title, value, (first, second), *ends))
    return gaps


def apart_table(apart: Sequence[Apart]) -> list[list[str]]:
    """Each difference with its interval; what cannot be seen is alike, what is not certain is not known."""
    titles, table = [*dict.fromkeys(gap.title for gap in apart)], dict[str, dict[str, str]]()
    for gap in apart:
        table.setdefault(gap.row.title, {})[gap.title] = apart_text(gap)
    return [[name, *(cells.get(title, MISSING) for title in titles)] for name, cells in table.items()]


def apart_text(apart: Apart) -> str:
    """A difference as a size with a word for the first plan, and the interval of that size.

    The difference of two numbers on the same side, or of numbers without one, is that of their sizes; on
    different sides it is the whole way between them.
    """
    quantity, (first, second) = apart.row.quantity, apart.values
    sides = quantity.should_be_small and first * second < 0.0
    sign = 1.0  # towards the larger size, or from the second plan to the first
    if quantity.should_be_small:
        sign = math.copysign(1.0, apart.value if sides else first + second)

    def words(value: float) -> str:
        size = number(abs(value))
        if sides:
            return f"{size}, other side" if value >= 0.0 else f"{size} the other way"
        return f"{size} {difference_word(quantity, value)}" if size != "0.0" else size

    value = sign * apart.value
    text = words(value) if apart.differs else "not known" if apart.is_visible else "alike"
    if apart.low is None or apart.high is None:
        return text
    low, high = sorted((sign * apart.low, sign * apart.high))
    if number(low) == number(high) == "0.0":
        return text
    if low * high > 0.0:
        least, most = sorted((low, high), key=abs)
        return f"{text} ({number(abs(least))} to {words(most)})"
    return f"{text} ({words(low)} to {words(high)})"


def numbers_table(
    groups: Mapping[str, Sequence[MeasureRow]],
    table: MeasureTable,
    states: Sequence[str],
    plans: Sequence[Mapping[tuple[str, str], str]],
) -> list[list[str]]:
    """Every measure before surgery and with each plan, with its interval where that was computed.

    Args:
        groups: the measures by heading.
        table: the numbers.
        states: their names, before surgery first.
        plans: the words for numbers that each plan fixes, by quantity and level, as of the states.
    """

    def cells(row: MeasureRow) -> list[str]:
        words = [plan.get((row.quantity.key, row.level), "") for plan in plans]
        title, *texts = replace(row, fixed=words[-1]).cells()
        for place, change in enumerate(row.numbers):
            text = words[place] or (interval_text(change, sided=row.quantity.side) if row.is_known(place) else "")
            larger = table.elsewhere(states[place], row.quantity.key) if row.quantity.largest_of else None
            more = "" if larger is None else f"; largest at {larger.level}, {row.text(larger.value)}"
            texts[place] += (f" ({text})" if text else "") + more
        return [title, *texts]

    return under_headings(groups, cells)


def glance_table(
    table: MeasureTable,
    curves: Sequence[CobbAngle],
    states: Sequence[str],
    plans: Sequence[Mapping[tuple[str, str], str]],
) -> list[list[str]]:
    """The numbers that a patient asks for first with each plan, each with the word for its change."""
    by_plan = [
        headlines(table, curves, fixed, (states[0], state))
        for state, fixed in zip(states[1:], plans[1:], strict=True)
    ]
    lines: dict[tuple[str, str], list[str]] = {}
    for place, shown in enumerate(by_plan):
        for line in shown:
            row = lines.setdefault((line.key, line.level), [line.subject, *[MISSING] * len(by_plan)])
            parts = [
                ", ".join(filter(None, (line.text, line.side if line.is_known else ""))),
                line.word,
                line.note,
                f"19 of 20: {line.interval}" if line.interval else "",
            ]
            row[1 + place] = "; ".join(dict.fromkeys(filter(None, parts)))
    return [*lines.values()]


def differences(poses: Sequence[TrunkState], apart: Sequence[Apart]) -> list[str]:
    """A sentence for each measure by which plans differ, and a last one on what is alike."""
    rows = {gap.row.title: gap.row for gap in apart}
    different = {gap.row.title for gap in apart if gap.differs}
    lines = [f"{row.name}: {_listed(row, poses[1:])}." for title, row in rows.items() if title in different]
    first = poses[1]
    for plan in poses[2:]:
        distance = np.linalg.norm(plan.skin.vertices - first.skin.vertices, axis=1)
        lines.append(
            f"The predicted skins of {first.look.title} and {plan.look.title} are up to "
            f"{number(distance.max())} mm apart, {number(distance.mean())} mm on average."
        )
    alike = [row.short for title, row in rows.items() if title not in different]
    if alike:
        limits = f"{SPINE_ANGLE:g}° of the spine, {DETECTABLE:g}° of the back and {LENGTH:g} mm"
        lines.append(f"Too alike to choose by, within {limits} or within their interval: {', '.join(alike)}.")
    return lines


def _listed(row: MeasureRow, plans: Sequence[TrunkState]) -> str:
    """The value of a measure in each plan, with its unit."""
    unit = "°" if row.quantity.unit == "°" else f" {row.quantity.unit}"
    values = zip(plans, row.values[1:], strict=True)
    return listed([f"{row.text(value, unit)} with {plan.look.title}" for plan, value in values])
