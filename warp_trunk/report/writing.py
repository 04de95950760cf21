"""From results to their report, as files or in a notebook. Imports matplotlib."""

from __future__ import annotations

import base64
import html
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure

from warp_trunk.bone_motion.plan import fused_levels
from warp_trunk.checking import checked
from warp_trunk.geometry.surface import Surface
from warp_trunk.io.atomic_write import write_whole
from warp_trunk.io.folders import make_writable
from warp_trunk.io.result_files import PAGE, PICTURES, picture_source
from warp_trunk.measures import compare_skins
from warp_trunk.measures.body_part import agreement
from warp_trunk.measures.quantities import LIKELY, QUANTITIES, Measured, MeasureTable, measured
from warp_trunk.measures.skin_quality import skin_change
from warp_trunk.measures.verdicts import is_known
from warp_trunk.results import Result
from warp_trunk.views.hump import hump_on_vertices, painted_difference
from warp_trunk.views.relief import BEHIND, FRONT, RIGHT, Viewpoint, in_pelvis

from . import skin_pictures as skins
from .page import page, part_page, skin_areas
from .part_pictures import change_sections, changed_views, frame_of
from .plans import check_plans, plan_poses, plans_page, plans_table
from .plots import convergence_plot, rotation_plot, section_plots
from .skin_pictures import hump_picture
from .spine_pictures import spine_picture
from .style import ACTUAL, BEFORE, BETTER, PREDICTED, RC, WORSE, TrunkState, dressed, embedded, file_of
from .turning import Turning, TurningState, turning

PLANS_PAGE, PLANS_PICTURES = "plans.html", "plans"


@checked
def write_report(result: Result, out: str | Path | None = None, *, bare: bool = False) -> Path:
    """Write the report of a result: one page that needs no network, and its pictures as PNG.

    The page is `report.html`; the pictures lie in the folder `report` beside it. An earlier report is replaced,
    the page last.

    >>> wt.write_report(result.save(folder / "demo")).name
    'report.html'

    Args:
        result: a saved result.
        out: the folder to write to; the result folder when left out.
        bare: whether the trunk is also shown without clothes from the front and the side.

    Returns:
        The page.

    Raises:
        InputError: the result is not saved, or `out` cannot be written to.
    """
    out = result.folder if out is None else Path(out)
    folder = _prepare(out, PICTURES)
    with rc_context(RC):
        text = _whole(result, folder, bare) if result.landmarks_before.names else _part(result, folder)
    write_whole(out / PAGE, text)
    return out / PAGE


def _whole(result: Result, folder: Path, bare: bool) -> str:
    """The page of a trunk; its pictures are written."""
    poses, summary, plan, comparison = poses_of(result), result.summary, result.plan, None
    if result.actual_skin is not None:
        rotations = result.measures.bsr, result.states[ACTUAL.state].bsr
        comparison = compare_skins(result.skin, result.actual_skin, result.landmarks_after, rotations)
    change, quality = skin_change(result.skin_before, result.skin), summary.skin_quality
    doubtful = None
    if quality is not None and quality.faults:
        doubtful = skins.at_vertices(result.skin, change.doubtful.astype(np.float64))
    more, hump = [], poses[1].main("main_hump_mm")
    was = None if hump is None else poses[0].number("main_hump_mm", hump.level)
    sure = hump is not None and is_known(QUANTITIES["main_hump_mm"], hump, was)
    if result.effects is not None and hump is not None and sure and result.converged:
        more = _likely(poses, result, result.effects.likely_worse, hump)
    every = dressed([*poses, *more])
    poses, more = every[: len(poses)], every[len(poses) :]
    figures, trunk, (seen, reliefs) = _backs(poses, doubtful, more, bare=bare)
    front = skins.looks(poses, FRONT, wear="shirt")
    views = {"behind": BEHIND} | ({"front": FRONT} if bare and result.unseen is None else {})
    stretched = {name: skins.stretch_picture(poses[1], change, view) for name, view in views.items()}
    visible = {name: seen for name, (_, seen) in stretched.items()}
    fused = [(), () if plan is None else fused_levels(plan)]
    figures |= {
        "front": skins.plain_picture(poses, FRONT, front)[0],
        "side": _seen_from(RIGHT, poses, "shirt"),
        "shoulders": skins.shoulders_picture(poses, front),
        "spine_behind": spine_picture(poses[:2], BEHIND, fused),
        "spine_side": spine_picture(poses[:2], RIGHT, fused),
        "rotation": rotation_plot(poses),
        "sure": skins.sure_picture(poses[1], seen, reliefs[1], result.skin_sd),
        **{f"stretch_{name}": figure for name, (figure, _) in stretched.items()},
        "sections": section_plots(poses),
        "convergence": convergence_plot(summary),
    }
    if result.skin.colours is not None:
        figures["own_behind"] = _seen_from(BEHIND, poses, "shorts")
    if bare:
        figures["bare_front"] = _seen_from(FRONT, poses, "nothing")
        figures["bare_side"] = _seen_from(RIGHT, poses, "nothing")
    return page(result, poses, comparison, _drawn(figures, folder), trunk, skin_areas(change, visible))


def _seen_from(view: Viewpoint, poses: Sequence[TrunkState], wear: skins.Wear) -> Figure:
    """Every pose from one side, dressed."""
    return skins.plain_picture(poses, view, skins.looks(poses, view, wear=wear))[0]


def _likely(poses: Sequence[TrunkState], result: Result, worse: np.ndarray, hump: Measured) -> list[TrunkState]:
    """A likely better and a likely worse back than the predicted one, by the displacement to the latter.

    None where the hump does not change with it as it should: errors act unevenly there, and no picture is right.
    """
    (before, predicted, *_), likely = poses, []
    for look, sign in ((BETTER, -1.0), (WORSE, 1.0)):
        skin = predicted.skin.moved(predicted.skin.vertices + sign * worse)
        measures = result.states[look.title]
        table = MeasureTable(measured(look.state, measures, before.measures))
        likely.append(TrunkState(look, skin, predicted.landmarks, measures, table, predicted.unseen))
    better, own, worst = (
        abs(state.measures.hump_height.get(hump.level) or 0.0) for state in (likely[0], predicted, likely[1])
    )
    expected = LIKELY * hump.sd
    change = own - max(better, 0.0) if own > expected else expected, worst - own
    return likely if all(abs(size - expected) <= 0.5 * expected for size in change) else []


def _part(result: Result, folder: Path) -> str:
    """The page of a part of the body without a spine; its pictures are written."""
    frame = frame_of(result.skin_before)
    poses = [replace(pose, landmarks=frame) for pose in poses_of(result)]
    moved = np.linalg.norm(result.skin.vertices - result.skin_before.vertices, axis=1)
    views = changed_views(result.skin_before, moved)
    trunk, displacement = result.tissue
    bones = [Surface(nodes, trunk.bone_faces) for nodes in (trunk.nodes, trunk.nodes + displacement)]
    figures: dict[str, Figure | None] = {}
    for name, view in zip(("first", "second"), views, strict=True):
        figures[name] = _seen_from(view, poses, "shirt")
        figures[f"{name}_moved"] = skins.values_picture(poses[1], moved, view, "displacement [mm]")
    figures |= {"sections": change_sections(poses, bones), "convergence": convergence_plot(result.summary)}
    agreed = None
    if result.actual_skin is not None:
        agreed = agreement(result.skin, result.actual_skin)
        figures["error"] = skins.values_picture(poses[1], agreed.signed, views[0], "distance [mm]", signed=True)
    return part_page(result, poses, _drawn(figures, folder), agreed)


def write_comparison(results: Sequence[Result], out: str | Path | None = None, *, bare: bool = False) -> Path:
    """Write plans for one patient side by side: one page that needs no network, and its pictures as PNG.

    The page is `plans.html`; the pictures lie in the folder `plans` beside it. An earlier one is replaced.

    Args:
        results: saved results, plan A first.
        out: the folder to write to; that which holds the first result when left out.
        bare: whether the trunk to turn may be shown without clothes.

    Returns:
        The page.

    Raises:
        InputError: as `check_plans`, or `out` cannot be written to.
    """
    check_plans(results)
    out = results[0].folder.resolve().parent if out is None else Path(out)
    folder, poses = _prepare(out, PLANS_PICTURES), dressed(plan_poses(results))
    with rc_context(RC):
        figures, trunk, _ = _backs(poses, bare=bare)
        plans, table = [result.plan for result in results], plans_table(poses)
        fused = [(), *(() if plan is None else fused_levels(plan) for plan in plans)]
        figures |= {
            "spine_behind": spine_picture(poses, BEHIND, fused),
            "spine_side": spine_picture(poses, RIGHT, fused),
            "rotation": rotation_plot(poses, bands=False),
        }
        drawings = _drawn(figures, folder)
    write_whole(out / PLANS_PAGE, plans_page(table, poses, results, plans, drawings, trunk))
    return out / PLANS_PAGE


def notebook_html(result: Result) -> str:
    """How the simulation ended, and the back before surgery and as predicted; only the words without a spine."""
    words = f"<p><b>{html.escape(result.summary.case)}</b>: {result.status.name}, {result.status.sentence}</p>"
    if not result.landmarks_before.names:
        return words
    poses = dressed(poses_of(result))
    seen, reliefs = skins.looks(poses, pixel=skins.FINE)
    with rc_context(RC):
        picture = base64.b64encode(file_of(skins.back_picture(poses, reliefs, seen), "png")).decode()
    return f'{words}<img src="data:image/png;base64,{picture}" alt="The back before and after" width="800">'


def poses_of(result: Result) -> list[TrunkState]:
    """The skins of a result, measured: before surgery, predicted, and the actual one where it is known.

    Raises:
        InputError: a skin or landmarks that cannot be measured.
    """
    planned, reached, table, unseen = result.landmarks_before, result.landmarks_after, result.table, result.unseen
    poses = [
        TrunkState(BEFORE, result.skin_before, planned, result.measures_before, table, unseen),
        TrunkState(PREDICTED, result.skin, reached, result.measures, table, unseen),
    ]
    if (actual := result.actual_skin) is not None:
        poses.append(TrunkState(ACTUAL, actual, reached, result.states[ACTUAL.state], table))
    return poses


def _backs(
    poses: Sequence[TrunkState],
    doubtful: np.ndarray | None = None,
    likely: Sequence[TrunkState] = (),
    *,
    bare: bool = False,
) -> tuple[dict[str, Figure | None], Turning, skins.Looks]:
    """The pictures of the back, the trunk to turn: its states with the triangles of the first, and a likely better
    and a likely worse one; and the reliefs of all from behind."""
    every, first = [*poses, *likely], poses[0].skin
    seen, reliefs = skins.looks(every, pixel=skins.FINE)
    painted = [painted_difference(back, seen) for back in reliefs]
    states = []
    for pose, back, values in zip(every, reliefs, painted, strict=True):
        if pose.worn is not None and np.array_equal(pose.skin.faces, first.faces):
            skin, cloth = pose.worn.skin, in_pelvis(pose.worn.cloth.reshape(-1, 3), pose.landmarks)
            hump = hump_on_vertices(skin, pose.landmarks, back, seen, values)
            places = in_pelvis(skin.vertices, pose.landmarks)
            states.append(TurningState(pose.look.heading, places, cloth.reshape(pose.worn.cloth.shape), *hump))
    trunk = turning(
        states,
        first.faces,
        colours=first.colours,
        unseen=poses[0].unseen,
        bare=bare,
    )

    def humps(rows: Sequence[int]) -> Figure:
        shown = [every[row] for row in rows]
        return hump_picture(shown, [reliefs[row] for row in rows], [painted[row] for row in rows], seen)

    own = len(poses)
    figures: dict[str, Figure | None] = {
        "back": skins.back_picture(every[:own], reliefs[:own], seen, doubtful),
        "hump": humps(range(own)),
        "likely": humps([own, 1, own + 1]) if likely else None,
    }
    return figures, trunk, (seen, reliefs)


def _drawn(figures: Mapping[str, Figure | None], folder: Path) -> dict[str, bytes]:
    """The figures as pages hold them, by name, each written as PNG too; those that are None are left out."""
    drawn = {name: figure for name, figure in figures.items() if figure is not None}
    pngs = {name: file_of(figure, "png", picture_source(name)) for name, figure in drawn.items()}
    for name, png in pngs.items():
        write_whole(folder / f"{name}.png", png)
    return {name: embedded(figure, pngs[name]) for name, figure in drawn.items()}


def _prepare(out: Path, pictures: str) -> Path:
    """The folder of pictures, made; InputError where it cannot be written to."""
    for place in (out, out / pictures):
        make_writable(place, "a report")
    return out / pictures
