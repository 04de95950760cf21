"""From results to their report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from warp_trunk.geometry.surface import Surface
from warp_trunk.io.atomic_write import atomic_write
from warp_trunk.io.folders import make_writable
from warp_trunk.io.result_files import PAGE, PICTURES
from warp_trunk.measures import compare_skins, measure
from warp_trunk.measures.part import agreement
from warp_trunk.measures.skin_quality import skin_change

from .hump_picture import hump_picture
from .page import page, part_page
from .part_pictures import change_sections, changed_views, frame_of, values_picture
from .plans import check_plans, plan_poses, plans_page
from .plots import convergence_plot, rotation_plot
from .relief import BEHIND, FRONT, RIGHT, relief, window
from .section_pictures import section_pictures
from .skin_pictures import (
    at_vertices,
    back_picture,
    front_picture,
    plain_picture,
    shoulders_picture,
    side_picture,
    stretch_picture,
    sure_picture,
)
from .spine_pictures import spine_picture
from .style import ACTUAL, BEFORE, PREDICTED, RC, Pose, file_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from warp_trunk.results import Result

PLANS_PAGE, PLANS_PICTURES = "plans.html", "plans"


def write_report(result: Result, out: str | Path | None = None) -> Path:
    """Write the report of a result: one page that needs no network, and its pictures as PNG.

    The page is `report.html`; the pictures lie in the folder `report` beside it. An earlier report is replaced,
    the page last.

    Args:
        result: a saved result.
        out: the folder to write to; the result folder when left out.

    Returns:
        The page.

    Raises:
        InputError: the result is not saved, or `out` cannot be written to.
    """
    out = result.folder if out is None else Path(out)
    folder = _prepare(out, PICTURES)
    poses = poses_of(result)
    if not result.landmarks_before.names:
        return _write_part(out, result, poses)
    comparison = None
    if result.actual_skin is not None:
        comparison = compare_skins(result.skin, result.actual_skin, result.landmarks_after)

    change, quality = skin_change(result.skin_before, result.skin), result.summary.skin_quality
    doubtful = None
    if quality is not None and quality.faults:
        doubtful = at_vertices(result.skin, change.doubtful.astype(np.float64))

    from matplotlib import rc_context  # heavy

    with rc_context(RC):
        figures = _backs(poses, doubtful) | {
            "front": front_picture(poses),
            "side": side_picture(poses),
            "shoulders": shoulders_picture(poses),
            "spine_behind": spine_picture(poses[:2], BEHIND),
            "spine_side": spine_picture(poses[:2], RIGHT),
            "rotation": rotation_plot(
                poses, None if result.summary.bands is None else result.summary.bands.bsr_deg
            ),
            "sure": _sure(poses[1], result.skin_sd),
            "stretch_behind": stretch_picture(poses[1], change, BEHIND),
            "stretch_front": stretch_picture(poses[1], change, FRONT),
            "sections": section_pictures(poses),
            "convergence": convergence_plot(result.summary),
        }
        drawings = _drawn(figures, folder)
    _write(out / PAGE, page(poses, comparison, result.summary, drawings, result.plan).encode())
    return out / PAGE


def _write_part(out: Path, result: Result, poses: list[Pose]) -> Path:
    """Write the report of a part of the body without a spine."""
    from matplotlib import rc_context  # heavy

    frame = frame_of(result.skin_before)
    poses = [replace(pose, landmarks=frame) for pose in poses]
    moved = np.linalg.norm(result.skin.vertices - result.skin_before.vertices, axis=1)
    views = changed_views(result.skin_before, moved)
    trunk, displacement = result.tissue
    bones = [Surface(nodes, trunk.bone_faces) for nodes in (trunk.nodes, trunk.nodes + displacement)]
    agreed, distance = (None, None) if result.actual_skin is None else agreement(result.skin, result.actual_skin)
    with rc_context(RC):
        figures: dict[str, Figure | None] = {}
        for name, view in zip(("first", "second"), views, strict=True):
            figures[name] = plain_picture(poses, view)
            figures[f"{name}_moved"] = values_picture(poses[1], moved, view, "displacement [mm]")
        figures["sections"] = change_sections(poses, bones)
        figures["convergence"] = convergence_plot(result.summary)
        if distance is not None:
            figures["error"] = values_picture(poses[1], distance, views[0], "distance [mm]", signed=True)
        drawings = _drawn(figures, _prepare(out, PICTURES))
    _write(out / PAGE, part_page(poses, result.summary, drawings, agreed, result.plan).encode())
    return out / PAGE


def write_comparison(results: Sequence[Result], out: str | Path | None = None) -> Path:
    """Write plans for one patient side by side: one page that needs no network, and its pictures as PNG.

    The page is `plans.html`; the pictures lie in the folder `plans` beside it. An earlier one is replaced.

    Args:
        results: saved results, plan A first.
        out: the folder to write to; that which holds the first result when left out.

    Returns:
        The page.

    Raises:
        InputError: as `check_plans`, or `out` cannot be written to.
    """
    check_plans(results)
    out = results[0].folder.resolve().parent if out is None else Path(out)
    folder = _prepare(out, PLANS_PICTURES)
    poses = plan_poses(results)

    from matplotlib import rc_context  # heavy

    with rc_context(RC):
        figures = _backs(poses) | {
            "spine_behind": spine_picture(poses, BEHIND),
            "spine_side": spine_picture(poses, RIGHT),
            "rotation": rotation_plot(poses),
        }
        drawings = _drawn(figures, folder)
    _write(out / PLANS_PAGE, plans_page(poses, results, drawings).encode())
    return out / PLANS_PAGE


def poses_of(result: Result) -> list[Pose]:
    """The skins of a result, measured: before surgery, predicted, and the actual one where it is known.

    Raises:
        InputError: a skin or landmarks that cannot be measured.
    """
    before, predicted, actual = result.skin_before, result.skin, result.actual_skin
    planned, reached = result.landmarks_before, result.landmarks_after
    poses = [
        Pose(BEFORE, before, planned, measure(before, planned)),
        Pose(PREDICTED, predicted, reached, measure(predicted, reached, before)),
    ]
    if actual is not None:
        poses.append(Pose(ACTUAL, actual, reached, measure(actual, reached)))
    return poses


def _backs(poses: Sequence[Pose], doubtful: np.ndarray | None = None) -> dict[str, Figure | None]:
    seen = window([(pose.skin, pose.landmarks) for pose in poses])
    reliefs = [relief(pose.skin, pose.landmarks, seen) for pose in poses]
    return {"back": back_picture(poses, reliefs, seen, doubtful), "hump": hump_picture(poses, reliefs, seen)}


def _sure(pose: Pose, skin_sd: np.ndarray | None) -> Figure | None:
    if skin_sd is None:
        return None
    seen = window([(pose.skin, pose.landmarks)])
    return sure_picture(pose, relief(pose.skin, pose.landmarks, seen), seen, skin_sd)


def _drawn(figures: Mapping[str, Figure | None], folder: Path) -> dict[str, bytes]:
    """The figures as SVG, by name, each written as PNG too; those that are None are left out."""
    drawings = {}
    for name, figure in figures.items():
        if figure is not None:
            _write(folder / f"{name}.png", file_of(figure, "png"))
            drawings[name] = file_of(figure, "svg")
    return drawings


def _prepare(out: Path, pictures: str) -> Path:
    """The folder of pictures, made; InputError where it cannot be written to."""
    folder = out / pictures
    for place in (out, folder):
        make_writable(place, "a report")
    return folder


def _write(path: Path, content: bytes) -> None:
    with atomic_write(path) as unfinished:
        unfinished.write_bytes(content)
