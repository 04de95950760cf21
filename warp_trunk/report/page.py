"""The report as one HTML file, which needs nothing else and reaches for nothing."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from functools import cache
from importlib.resources import files
from typing import TYPE_CHECKING, Any

import numpy as np

from warp_trunk.bone_motion.plan import Plan, fixed_numbers, plan_words, planned_curves
from warp_trunk.case.anatomy import VERTEBRAE, rank
from warp_trunk.engine.relaxation import ON_THE_WAY
from warp_trunk.geometry.surface import Surface, corner_areas
from warp_trunk.geometry.surface_checks import crossings
from warp_trunk.measures import SkinComparison
from warp_trunk.measures.body_part import Agreement, FollowedPoint, profile, swept_volumes
from warp_trunk.measures.levels import JUDGED
from warp_trunk.measures.number_text import MISSING, interval_text, number, value_text
from warp_trunk.measures.quantities import ACTUAL, BEFORE, DETECTABLE, EXACT, PREDICTED, QUANTITIES, MeasureTable
from warp_trunk.measures.rows import MeasureRow, curve_heading, measure_rows, rotation_table, under_headings
from warp_trunk.measures.skin_quality import LOOK, STRETCH, SkinChange
from warp_trunk.measures.verdicts import NOT_KNOWN, is_known
from warp_trunk.results import Result
from warp_trunk.results.bands import Bands
from warp_trunk.results.summary_text import spring_lines

from .headlines import Headline, headlines
from .sentences import bent, joined_sentence, option_rows, planned, questions, sentences
from .style import TrunkState
from .turning import Turning, script

if TYPE_CHECKING:
    from jinja2 import Environment


STATES = (BEFORE, PREDICTED, ACTUAL)
"""States of a result that its page compares, as far as they are known."""


def page(
    result: Result,
    poses: Sequence[TrunkState],
    comparison: SkinComparison | None,
    drawings: Mapping[str, bytes],
    trunk: Turning,
    areas: Mapping[str, str],
) -> str:
    """The text of the page; all that comes from files is escaped.

    Args:
        result: the result.
        poses: before surgery, predicted, and the actual one where it is known.
        comparison: of the predicted skin with the actual one, where that is known.
        drawings: by name the pictures that the page shows, as SVG or WebP.
        trunk: the trunk to turn.
        areas: of the skin that is stretched and folded, in words (`skin_areas`).
    """
    summary, table, plan = result.summary, result.table, result.plan
    quality, curves, states = summary.skin_quality, summary.curves[BEFORE], STATES[: len(poses)]
    fixed = {} if plan is None else fixed_numbers(plan)
    shown = headlines(table, curves, fixed)
    imposed = [warning for warning in summary.warnings if "imposed on straight anatomy" in warning]
    anatomy = [warning for warning in summary.warnings if warning.startswith("Anatomy: ")]
    return rendered(
        "page.html",
        drawings,
        trunk=trunk,
        areas=areas,
        hatched=quality is not None and bool(quality.faults) and bool(areas["hatched"]),
        stretch=f"{LOOK:g}",
        implausible=f"{STRETCH:g}",
        glance=shown,
        in_numbers=in_numbers(shown),
        joined=joined_sentence(plan),
        plan_words="" if plan is None else plan_words(plan),
        planned=planned(table, curves, list(table.column(BEFORE, "bsr_deg")), plan, summary.lenke),
        bent=bent(table),
        fingerprint=result.fingerprint,
        first_warnings=anatomy if summary.synthetic else [*imposed, *anatomy],  # "no patient" is said once
        more_warnings=any(warning not in (*imposed, *anatomy) for warning in summary.warnings),
        sentences=sentences(table, shown, comparison, summary.bands, plan),
        questions=questions(shown, plan),
        measure_head=measure_head(poses, summary.bands),
        measure_rows=measure_table(result, states, plan),
        rotation_head=head(poses, "level") + (["19 of 20"] if summary.bands else []),
        rotation_rows=rotation_table(table, states, MeasureRow.compared_cells, bands=summary.bands is not None),
        left_out=left_out(*(pose.measures.missing for pose in poses)),
        bands=summary.bands,
        band_head=BAND_HEAD,
        band_rows=band_table(table, summary.bands, fixed) if summary.bands else [],
        source_head=SOURCE_HEAD,
        source_rows=source_table(summary.bands, table.place("main_hump_mm") or "") if summary.bands else [],
        comparison=comparison,
        detectable=DETECTABLE,
        **_of_run(result, poses),
    )


def part_page(
    result: Result,
    poses: Sequence[TrunkState],
    drawings: Mapping[str, bytes],
    agreed: Agreement | None,
) -> str:
    """The text of the page of a part of the body without a spine; the arguments are those of `page`, and how far
    the prediction is from the actual skin where that is known."""
    return rendered(
        "part.html",
        drawings,
        change_rows=[*change_table(poses[0].skin, poses[1].skin), *profile_table(result.summary.points)],
        error_rows=[] if agreed is None else agreed.rows(),
        **_of_run(result, poses),
    )


def _of_run(result: Result, poses: Sequence[TrunkState]) -> dict[str, Any]:
    """The data of the run on every page."""
    summary, status = result.summary, result.status
    return {
        "summary": summary,
        "plan": result.plan_text,
        "motions": result.motions_text if result.motions else "",
        "sheet": sheet_of(result),
        "converged": result.converged,
        "reason": status.sentence[:1].upper() + status.sentence[1:],
        "poses": len(poses),
        "many": "many" if len(poses) > 2 else "",
        "titles": ", ".join(pose.look.title for pose in poses),
        "on_the_way": ON_THE_WAY,
        "springs": [] if summary.springs is None else spring_lines(summary.springs),
        "options": option_rows(summary.parameters),
    }


@cache
def environment(*packages: str) -> Environment:
    """The templates of some packages; all that they are given is escaped. Their filter `number` takes a format."""
    from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined

    templates = Environment(
        loader=ChoiceLoader([PackageLoader("warp_trunk", package) for package in packages]),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    templates.filters["number"] = lambda value, form: MISSING if value is None else format(value, form)
    return templates


def rendered(template: str, drawings: Mapping[str, bytes], **values: Any) -> str:
    """A page from its template, with the pictures that are drawn as `pictures` and the style."""
    style = files("warp_trunk.report").joinpath("style.css").read_text(encoding="utf-8")
    pictures = {name: _address(drawing) for name, drawing in drawings.items()}
    viewer, source = script()
    values |= {"style": style, "pictures": pictures, "viewer": viewer, "script_source": source}
    return environment("report").get_template(template).render(values).lstrip()


def _address(picture: bytes) -> str:
    kind = "webp" if picture.startswith(b"RIFF") else "svg+xml"
    return f"data:image/{kind};base64,{b64encode(picture).decode()}"


BAND_HEAD = (
    "measure",
    "predicted",
    "± deviation",
    "19 of 20",
    "plan met exactly: ±",
    "in proportion",
)
SOURCE_HEAD = ("what is uncertain", "by", "rotation, most [°]", "hump [mm]", "where that comes from")


def head(poses: Sequence[TrunkState], name: str) -> list[str]:
    """The head of a table whose first column is called `name`."""
    titles = [pose.look.title for pose in poses]
    return [name, *titles[:2], "change", *([*titles[2:], "error"] if len(poses) > 2 else [])]


def measure_head(poses: Sequence[TrunkState], bands: Bands | None) -> list[str]:
    """The head of `measure_table`."""
    titles = head(poses, "measure")
    return [*titles[:3], *([] if bands is None else ["19 of 20"]), *titles[3:]]


def measure_table(result: Result, states: Sequence[str], plan: Plan | None) -> list[list[str]]:
    """The back, then every curve of the spine and the spine as a whole; each number with its interval.

    What the plan fixes says that in place of an interval; a maximum that is larger elsewhere afterwards says so.
    """
    table, before, banded = result.table, result.measures_before, result.summary.bands is not None
    fixed = {} if plan is None else fixed_numbers(plan)
    asked = set() if plan is None else planned_curves(plan, before.cobb, before.spine.levels)
    groups = measure_rows(table, before, states)
    for curve, apex in zip(before.cobb, before.apices, strict=True) if plan else ():
        heading = curve_heading(curve, apex)
        if heading in groups:
            words = "as planned" if curve in asked else "follows the others"
            groups = {f"{name}, {words}" if name == heading else name: rows for name, rows in groups.items()}

    def cells(row: MeasureRow) -> list[str]:
        row = replace(row, fixed=fixed.get((row.quantity.key, row.level), ""))
        title, was, will, *rest = row.compared_cells()
        if row.quantity.largest_of and (larger := table.elsewhere(PREDICTED, row.quantity.key)):
            title += f"; predicted largest at {larger.level}, {row.text(larger.value)}"
        return [title, was, will, *([row.interval] if banded else []), *rest]

    return under_headings(groups, cells)


def skin_areas(change: SkinChange, visible: Mapping[str, np.ndarray]) -> dict[str, str]:
    """The areas of the skin that are coloured and hatched, and how much of each is seen in the pictures, in words.

    Args:
        change: how the skin is stretched and folded.
        visible: which triangles the picture from behind, and that from the front where there is one, show.

    Returns:
        The words for `shown`, `stretched` and `folded` skin; `hatched` is empty where no hatch is seen from
        behind.
    """
    seen = np.any([*visible.values()], axis=0)

    def words(part: np.ndarray) -> str:
        whole, visible_part = (float(change.area @ each) / 100.0 for each in (part, part * seen))
        if round(visible_part) == round(whole):
            return f"{whole:.0f} cm2"
        return f"{whole:.0f} cm2, of which {visible_part:.0f} are seen here"

    parts = {"shown": change.stretch > LOOK, "stretched": change.stretch > STRETCH, "folded": change.folded}
    behind = bool((change.doubtful & visible["behind"]).any())
    return {name: words(part) for name, part in parts.items()} | {"hatched": "yes" if behind else ""}


def left_out(*missing: Mapping[str, str]) -> list[str]:
    """A sentence for each reason for which levels have no rotation or no hump, from `missing` of every state."""
    levels_by_reason: dict[tuple[str, str], set[str]] = {}
    for what, reason in (item for reasons in missing for item in reasons.items()):
        level = what.removeprefix("hump ")
        quantity = "rotation" if level == what else "hump"
        if level in VERTEBRAE:
            levels_by_reason.setdefault((quantity, reason), set()).add(level)
    return [
        f"No {quantity} at {', '.join(sorted(levels, key=rank))}: {reason}."
        for (quantity, reason), levels in levels_by_reason.items()
    ]


def in_numbers(shown: Sequence[Headline]) -> str:
    """The headlines in one line, for readers who cannot see the pictures."""
    return "; ".join(f"{line.name}: {line.text}" + (f", {line.word}" if line.word else "") for line in shown)


def sheet_of(result: Result) -> str:
    """The line at the foot of every printed sheet of a result: its name, day and fingerprint."""
    return sheet_line(result.summary.case, result.summary.day, result.fingerprint)


def sheet_line(*words: str) -> str:
    """The line at the foot of every printed sheet, as a string of CSS; empty words are left out."""
    line = " · ".join(filter(None, words))
    return "".join(c if c.isalnum() or c in " .,·-" else f"\\{ord(c):x} " for c in line)


def band_table(table: MeasureTable, bands: Bands, fixed: Collection[tuple[str, str]] = ()) -> list[list[str]]:
    """Every number that has an interval, but for those that the plan fixes: of the skin, then of the spine."""
    rows = []
    for quantity in QUANTITIES.values():
        for level, row in table.column(PREDICTED, quantity.key).items():
            if row.low is None or (quantity.key, level) in fixed:
                continue
            met = table.column(EXACT, quantity.key).get(level)
            is_sure = is_known(quantity, row, table.value(BEFORE, quantity.key, level))
            value = value_text(quantity, row.value) if is_sure else NOT_KNOWN
            linear = "no" if (quantity.key, level) in bands.nonlinear else "yes" if quantity.of_skin else ""
            title = f"{quantity.label_at(level)} [{quantity.unit}]"
            ends = interval_text(row, sided=quantity.side)
            rows.append([title, value, number(row.sd), ends, number(met and met.sd), linear])
    return rows


def source_table(bands: Bands, place: str) -> list[list[str]]:
    """Every source of error, the largest first: what it alone does, to rotations and to the hump at a place."""
    return [
        [
            source.name,
            source.spread,
            number(max((sd for at, sd in source.sd.get("bsr_deg", {}).items() if at in JUDGED), default=None)),
            number(source.sd.get("hump_mm", {}).get(place)),
            source.reference,
        ]
        for source in bands.sources
    ]


def change_table(before: Surface, predicted: Surface) -> list[list[str]]:
    """How far the skin moves, and the volumes between the skins before and predicted."""
    way = np.linalg.norm(predicted.vertices - before.vertices, axis=1)
    place = "({:.0f}, {:.0f}, {:.0f})".format(*before.vertices[way.argmax()])
    outward, inward = swept_volumes(before, predicted)
    return [
        ["Largest displacement of the skin [mm]", f"{way.max():.1f}"],
        ["Where that is before surgery: x, y, z [mm]", place],
        ["Skin that moves by more than 1 mm [cm2]", f"{corner_areas(before)[way > 1.0].sum() / 100.0:.0f}"],
        ["Volume gained outside the skin before [cm3]", f"{outward:z.1f}"],
        ["Volume lost inside it [cm3]", f"{inward:z.1f}"],
        ["Pairs of triangles of the predicted skin that cross", f"{len(crossings(predicted))}"],
    ]


def profile_table(points: Sequence[FollowedPoint]) -> list[list[str]]:
    """The profile of a face before and as predicted, where its points are among those that are followed."""
    was, will = (
        profile({point.name: np.array(getattr(point, when)) for point in points}) for when in ("before", "after")
    )
    return [[name, f"{was[name]:.1f} → {will[name]:.1f}"] for name in was]
