"""The result folder: what a simulation leaves behind for viewers, reports, ParaView and other programs."""

from __future__ import annotations

import os
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from warp_trunk.case.landmarks import write_landmarks
from warp_trunk.case.motions import FILE as MOTIONS
from warp_trunk.case.places import refuse_case
from warp_trunk.engine.trunk_mesh import TrunkMesh
from warp_trunk.errors import InputError
from warp_trunk.geometry.surface import Surface
from warp_trunk.io.atomic_write import complete, partial
from warp_trunk.io.folders import make_writable
from warp_trunk.io.surface_files import write_surface
from warp_trunk.io.trunk_file import write_trunk

from .bands import SKIN_SD, FoundBands, write_skin_sd
from .measured import Measured, measure_result
from .summarize import summarize
from .summary import SUMMARY, Summary, write_summary

if TYPE_CHECKING:
    from warp_trunk.case import Case
    from warp_trunk.engine.model import Model
    from warp_trunk.engine.simulation import Increment

RECORDING = "recording.rrd"
SKIN_BEFORE, PREDICTED_SKIN, ACTUAL_SKIN = "skin_before.ply", "predicted_skin.ply", "actual_skin.ply"
LANDMARKS_BEFORE, LANDMARKS_AFTER = "landmarks_before.csv", "landmarks_after.csv"
TRUNK = "trunk.vtu"
PLAN = "plan.toml"
"""The plan by which a result was made, where a plan made it; `--plan` takes the folder for it."""
PAGE, PICTURES = "report.html", "report"
"""What `report` writes into a result folder: a page, and a folder of pictures."""
MEASURES = f"{Path(PREDICTED_SKIN).stem}_measures"
"""What `measure` writes into a result folder, without the endings .json and .csv."""
LEAST_SPACE = 200e6
"""A result folder needs this much free space [bytes]; the largest results seen take a third of it."""


def prepare_folder(folder: str | Path) -> Path:
    """Create a result folder and make sure, before any long work, that a result can be written to it.

    Raises:
        InputError: it is a case folder or lies in one, cannot be created or written to, or too little space is
            free.
    """
    folder = Path(folder)
    refuse_case(folder)
    make_writable(folder, "a result")
    free = shutil.disk_usage(folder).free
    if free < LEAST_SPACE:
        raise InputError(
            f"{folder}: {free / 1e6:.0f} MB are free on this disk; a result needs {LEAST_SPACE / 1e6:.0f} MB"
        )
    return folder


def predicted_skin(case: Case, trunk: TrunkMesh, displacement: np.ndarray) -> Surface:
    """The skin of a case, same vertices and faces, carried by the nodes' displacement (nodes, 3) [mm]."""
    return Surface(case.skin.vertices + displacement[trunk.skin_nodes], case.skin.faces)


def write_result(
    folder: str | Path,
    case: Case,
    trunk: TrunkMesh,
    model: Model,
    increments: Sequence[Increment],
    *,
    measured: Measured | None = None,
    parameters: Mapping[str, Any] | None = None,
    seconds: Mapping[str, float] | None = None,
    warnings: Sequence[str] = (),
    recording: Path | None = None,
    found: FoundBands | None = None,
    plan: str | None = None,
) -> Summary:
    """Write the result of a simulation, with all of the case that its report needs.

    That is `skin_before.ply` and `predicted_skin.ply` (the same vertices and faces), `actual_skin.ply` where the
    case has one, `landmarks_before.csv`, `landmarks_after.csv`, `trunk.vtu`, `summary.json`, the recording,
    `skin_sd.csv` where there are bands, and `plan.toml` where a plan made the case.

    Every file is written under another name and moved when all are complete, summary.json last; a folder that
    has one is whole. What an earlier simulation left in the same folder is removed, also the report and the
    measures made of it, which would tell of another prediction than the one beside them.

    Args:
        folder: where to; made if it does not exist.
        case: the case that was simulated.
        trunk: its mesh.
        model: its model.
        increments: all that `simulate` yielded.
        measured: the measures of the skins; found here when left out.
        parameters: options of the run for the summary, beside those the model knows.
        seconds: times by stage, see `STAGES`; the time of relaxation is known from the increments.
        warnings: what makes the result doubtful; faults of the predicted skin are added.
        recording: a finished recording, which is moved into the folder.
        found: how sure the numbers and the skin are, where that is known.
        plan: the text of the plan that made the case, where one did.

    Returns:
        The summary as written.

    Raises:
        InputError: the folder cannot be written to, or there is no increment.
    """
    if not increments:
        raise InputError("write_result: 'increments' is empty; give all that simulate() yielded")
    folder = prepare_folder(folder)
    skin = predicted_skin(case, trunk, increments[-1].displacement)
    told = {"parameters": parameters, "seconds": seconds, "warnings": warnings}
    bands = None if found is None else found.bands
    summary = summarize(
        case, trunk, model, increments, measured or measure_result(case, skin), bands=bands, **told
    )
    names = [*_write_case(folder, case, skin, plan), *_write_found(folder, trunk, increments[-1], found)]
    written = write_summary(partial(folder / SUMMARY), summary)
    _complete(folder, [*names, SUMMARY], recording)
    return written


def _write_case(folder: Path, case: Case, skin: Surface, plan: str | None) -> list[str]:
    """Write skins, landmarks and the plan, if any, still under other names; gives the names they will have."""
    surfaces = {SKIN_BEFORE: case.skin, PREDICTED_SKIN: skin}
    if case.actual_skin is not None:
        surfaces[ACTUAL_SKIN] = case.actual_skin
    landmarks = {LANDMARKS_BEFORE: case.landmarks_before, LANDMARKS_AFTER: case.planned_landmarks}
    for name, surface in surfaces.items():
        write_surface(partial(folder / name), surface)
    landmarks = {name: points for name, points in landmarks.items() if points.names}
    for name, points in landmarks.items():
        write_landmarks(partial(folder / name), points)
    if plan is None:
        return [*surfaces, *landmarks]
    partial(folder / PLAN).write_text(plan, encoding="utf-8")
    return [*surfaces, *landmarks, PLAN]


def _write_found(folder: Path, trunk: TrunkMesh, last: Increment, found: FoundBands | None) -> list[str]:
    """Write the moved tissue, and how sure the skin is where that is known, likewise."""
    write_trunk(partial(folder / TRUNK), trunk, last.displacement)
    if found is None:
        return [TRUNK]
    write_skin_sd(partial(folder / SKIN_SD), found.skin_sd)
    return [TRUNK, SKIN_SD]


def _complete(folder: Path, names: Sequence[str], recording: Path | None) -> None:
    """Gives every file its own name, the summary last, after what an earlier simulation left is gone."""
    made_of_it = [PAGE, *(f"{MEASURES}.{ending}" for ending in ("json", "csv", "png"))]
    optional = (RECORDING, ACTUAL_SKIN, SKIN_SD, PLAN, MOTIONS, LANDMARKS_BEFORE, LANDMARKS_AFTER)
    for name in (SUMMARY, *optional, *made_of_it):  # SUMMARY first: it says "whole"
        (folder / name).unlink(missing_ok=True)
    for picture in (folder / PICTURES).glob("*.png"):
        picture.unlink()
    if recording is not None:
        os.replace(recording, folder / RECORDING)
    for name in names:
        complete(folder / name)
