"""The result of a simulation: in memory, written to a folder, and read back without the case it came from."""

from __future__ import annotations

import os
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from warp_trunk.case.case_writer import refuse_case
from warp_trunk.case.landmarks import NO_LANDMARKS, Landmarks, read_landmarks, write_landmarks
from warp_trunk.case.motions import FILE as MOTIONS
from warp_trunk.engine.relaxation import RelaxStatus
from warp_trunk.engine.trunk_mesh import TrunkMesh
from warp_trunk.errors import InputError
from warp_trunk.geometry.surface import Surface
from warp_trunk.io.atomic_write import complete, partial
from warp_trunk.io.file_access import read_text
from warp_trunk.io.folders import locked, make_writable
from warp_trunk.io.result_files import (
    ACTUAL_SKIN,
    LANDMARKS_AFTER,
    LANDMARKS_BEFORE,
    MEASURES,
    PAGE,
    PICTURES,
    PLAN,
    PREDICTED_SKIN,
    RECORDING,
    SKIN_BEFORE,
    SKIN_SD,
    SUMMARY,
    TRUNK,
)
from warp_trunk.io.surface_files import read_surface, write_surface
from warp_trunk.io.trunk_file import read_trunk, write_trunk
from warp_trunk.measures import TrunkMeasures, measure
from warp_trunk.measures.skin_quality import SkinQuality, skin_quality

from .bands import Bands, FoundBands, read_skin_sd, write_skin_sd
from .summarize import summarize
from .summary import Summary, as_read, parse_summary, write_summary

if TYPE_CHECKING:
    from warp_trunk.case import Case
    from warp_trunk.engine.model import Model
    from warp_trunk.engine.simulation import Increment

LEAST_SPACE = 200e6
"""Free space that a result folder needs [bytes]; the largest results seen take a third of it."""
AGAIN = "simulate the case again"
_MOST_PLAN = 1_000_000
"""No plan is longer than this [bytes]."""


@dataclass(eq=False, kw_only=True)
class Result:
    """The trunk predicted by a simulation, with everything that its report needs.

    `simulate` returns one, and `read_result` reads one from its folder. A notebook shows it as a picture of the
    back before surgery and as predicted.

    >>> result.converged  # of wt.simulate(case)
    True
    >>> bool(abs(result.measures.max_thoracic_bsr) < abs(result.measures_before.max_thoracic_bsr))
    True
    >>> result.save(folder / "demo").folder.name
    'demo'
    >>> result.report().name
    'report.html'
    """

    skin_before: Surface
    """The skin before surgery [mm]."""
    skin: Surface
    """The predicted skin [mm], same vertices and faces."""
    actual_skin: Surface | None
    """The actual skin after surgery [mm], with triangles of its own; None where it is not known."""
    landmarks_before: Landmarks
    """Points on the bones before surgery [mm]."""
    landmarks_after: Landmarks
    """The same points after surgery [mm], same names in the same order."""
    summary: Summary
    """How the simulation ended, its options and its numbers: the contents of summary.json."""
    skin_sd: np.ndarray | None = None
    """Standard deviation of the place of each vertex of the predicted skin along its normal [mm], shape
    (vertices,); None without bands."""
    plan: str | None = None
    """The text of the plan, or of the motions of bones, that made it; None where there was none."""
    saved_in: Path | None = None
    """Its result folder; None before `save`."""
    recording: Path | None = None
    """Rerun's recording of the simulation; None where none was made."""

    @property
    def folder(self) -> Path:
        """Its result folder.

        Raises:
            InputError: it is not saved yet.
        """
        if self.saved_in is None:
            raise InputError("result: is not saved yet; call result.save(folder) first")
        return self.saved_in

    @property
    def status(self) -> RelaxStatus:
        """Why the last relaxation ended."""
        return self.summary.ending

    @property
    def converged(self) -> bool:
        """Whether every node is within the tolerance of its equilibrium."""
        return self.status is RelaxStatus.CONVERGED

    @property
    def bands(self) -> Bands | None:
        """95 % intervals of the numbers; None unless the simulation was asked for them (`bands=True`)."""
        return self.summary.bands

    @cached_property
    def measures(self) -> TrunkMeasures:
        """The measures of the predicted skin."""
        return measure(self.skin, self.landmarks_after, self.skin_before)

    @cached_property
    def measures_before(self) -> TrunkMeasures:
        """The measures of the skin before surgery."""
        return measure(self.skin_before, self.landmarks_before)

    @cached_property
    def tissue(self) -> tuple[TrunkMesh, np.ndarray]:
        """The mesh before surgery, and the displacement of its nodes [mm], shape (nodes, 3)."""
        return read_trunk(self.folder / TRUNK)

    def save(self, folder: str | Path) -> Result:
        """Write the result folder, with everything of the case that its report needs.

        It holds `skin_before.ply` and `predicted_skin.ply` (the same vertices and faces), `actual_skin.ply` where
        the case has one, `landmarks_before.csv`, `landmarks_after.csv`, `trunk.vtu`, `summary.json`, the
        recording, `skin_sd.csv` where there are bands, and `plan.toml` where a plan made the case.

        Every file is written under another name and moved when all are complete, summary.json last: a folder that
        has a summary is complete. What an earlier simulation left in the same folder is removed, also the report
        and the measures, which would describe another prediction.

        Returns:
            The result itself, with its `folder`.

        Raises:
            InputError: the folder cannot be written to, is or lies in a case folder, or another process writes
                into it.
        """
        folder = prepare_folder(folder)
        if self.saved_in is None or self.saved_in.resolve() != folder.resolve():
            with locked(folder):
                write_result(folder, self)
        return self

    def report(self, out: str | Path | None = None) -> Path:
        """Write the report, a page for the browser, into the result folder or another; returns the page.

        Raises:
            InputError: the result is not saved yet, or the folder cannot be written to.
        """
        from warp_trunk.report.writing import write_report  # draws pictures

        return write_report(self, out)

    def view(self, *, web: bool = False) -> int:
        """Open the recording in the viewer, or in the browser, and wait for its end; returns its exit status.

        Raises:
            InputError: the result is not saved yet or has no recording, or there is no display.
        """
        from warp_trunk.recording import view, view_in_browser

        return (view_in_browser if web else view)(find_recording(self.folder))

    def _repr_html_(self) -> str:
        from warp_trunk.report.writing import notebook_html  # draws a picture

        return notebook_html(self)


def predicted_skin(case: Case, trunk: TrunkMesh, displacement: np.ndarray) -> Surface:
    """The skin of a case, same vertices and faces, moved with the nodes' displacement (nodes, 3) [mm]."""
    return Surface(case.skin.vertices + displacement[trunk.skin_nodes], case.skin.faces)


def result_of(
    case: Case,
    trunk: TrunkMesh,
    model: Model,
    increments: Sequence[Increment],
    *,
    before: TrunkMeasures | None = None,
    after: TrunkMeasures | None = None,
    quality: SkinQuality | None = None,
    parameters: Mapping[str, Any] | None = None,
    seconds: Mapping[str, float] | None = None,
    warnings: Sequence[str] = (),
    found: FoundBands | None = None,
    recording: Path | None = None,
    plan: str | None = None,
) -> Result:
    """The result of a simulation that was run increment by increment.

    Args:
        case: the case that was simulated.
        trunk: its mesh.
        model: its model.
        increments: everything that the engine's `simulate` yielded.
        before: the measures of the skin before surgery, where they are known; measured when left out.
        after: the measures of the predicted skin, likewise.
        quality: how far the predicted skin is stretched and folded, likewise.
        parameters: options of the run for the summary, beside those the model knows.
        seconds: times by stage, see `STAGES`; the time of relaxation is known from the increments.
        warnings: what makes the result doubtful; faults of the predicted skin are added.
        found: the bands of the numbers and of the skin, where they are known.
        recording: a finished recording.
        plan: the text of the plan that made the case, where one did.

    Raises:
        InputError: there is no increment.
    """
    if not increments:
        raise InputError("result_of: 'increments' is empty; give everything that simulate() yielded")
    displacement = increments[-1].displacement
    skin = predicted_skin(case, trunk, displacement)
    before = before or measure(case.skin, case.landmarks_before)
    after = after or measure(skin, case.planned_landmarks, case.skin)
    actual = None if case.actual_skin is None else measure(case.actual_skin, case.planned_landmarks)
    summary = summarize(
        case,
        trunk,
        model,
        increments,
        measures=(before, after, actual),
        quality=quality or skin_quality(case.skin, skin, case.landmarks_before, case.bones),
        parameters=parameters,
        seconds=seconds,
        warnings=warnings,
        bands=None if found is None else found.bands,
    )
    result = Result(
        skin_before=case.skin,
        skin=skin,
        actual_skin=case.actual_skin,
        landmarks_before=case.landmarks_before,
        landmarks_after=case.planned_landmarks,
        summary=as_read(summary),
        skin_sd=None if found is None else found.skin_sd,
        plan=plan,
        recording=recording,
    )
    result.measures_before, result.measures, result.tissue = before, after, (trunk, displacement)
    return result


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


def write_result(folder: Path, result: Result) -> None:
    """Write a result into a folder that is prepared and kept from other processes; see `Result.save`."""
    surfaces = {SKIN_BEFORE: result.skin_before, PREDICTED_SKIN: result.skin, ACTUAL_SKIN: result.actual_skin}
    landmarks = {LANDMARKS_BEFORE: result.landmarks_before, LANDMARKS_AFTER: result.landmarks_after}
    names = [TRUNK]
    write_trunk(partial(folder / TRUNK), *result.tissue)
    for name, surface in surfaces.items():
        if surface is not None:
            write_surface(partial(folder / name), surface)
            names.append(name)
    for name, points in landmarks.items():
        if points.names:
            write_landmarks(partial(folder / name), points)
            names.append(name)
    if result.plan is not None:
        partial(folder / PLAN).write_text(result.plan, encoding="utf-8")
        names.append(PLAN)
    if result.skin_sd is not None:
        write_skin_sd(partial(folder / SKIN_SD), result.skin_sd)
        names.append(SKIN_SD)
    write_summary(partial(folder / SUMMARY), result.summary)
    recording, kept = result.recording, partial(folder / RECORDING)
    if recording is not None and recording != kept:
        shutil.copyfile(recording, kept)
    _complete(folder, [*names, SUMMARY], recorded=recording is not None)
    result.saved_in, result.recording = folder, None if recording is None else folder / RECORDING


def _complete(folder: Path, names: Sequence[str], *, recorded: bool) -> None:
    """Move every file to its own name, the summary last, after what an earlier simulation left is removed."""
    made_of_it = [PAGE, *(f"{MEASURES}.{ending}" for ending in ("json", "csv", "png"))]
    optional = (RECORDING, ACTUAL_SKIN, SKIN_SD, PLAN, MOTIONS, LANDMARKS_BEFORE, LANDMARKS_AFTER)
    for name in (SUMMARY, *optional, *made_of_it):  # SUMMARY first: it says that the folder is complete
        (folder / name).unlink(missing_ok=True)
    for picture in (folder / PICTURES).glob("*.png"):
        picture.unlink()
    if recorded:
        os.replace(partial(folder / RECORDING), folder / RECORDING)
    for name in names:
        complete(folder / name)


def read_result(folder: str | Path) -> Result:
    """Read and check a result folder.

    >>> _ = result.save(folder / "read")
    >>> wt.read_result(folder / "read").summary == result.summary
    True

    Raises:
        InputError: it is no result folder, a file is missing or damaged, or files do not belong together.
    """
    folder = Path(folder)
    summary = read_summary(folder)
    before, after = (read_surface(_present(folder / name)) for name in (SKIN_BEFORE, PREDICTED_SKIN))
    if not np.array_equal(before.faces, after.faces) or before.vertices.shape != after.vertices.shape:
        raise InputError(
            f"{folder / PREDICTED_SKIN}: {len(after.vertices)} vertices and {len(after.faces)} triangles are not "
            f"those of {SKIN_BEFORE} ({len(before.vertices)} and {len(before.faces)}); {AGAIN}"
        )
    planned = reached = NO_LANDMARKS
    if summary.bsr_deg.before or (folder / LANDMARKS_BEFORE).exists():
        names = LANDMARKS_BEFORE, LANDMARKS_AFTER
        planned, reached = (read_landmarks(_present(folder / name)) for name in names)
    if planned.names != reached.names:
        raise InputError(
            f"{folder / LANDMARKS_AFTER}: its {len(reached.names)} names are not the {len(planned.names)} of "
            f"{LANDMARKS_BEFORE} in their order; {AGAIN}"
        )
    plans = [folder / PLAN, folder / MOTIONS]
    actual = None if summary.bsr_deg.actual is None else read_surface(_present(folder / ACTUAL_SKIN))
    return Result(
        skin_before=before,
        skin=after,
        actual_skin=actual,
        landmarks_before=planned,
        landmarks_after=reached,
        summary=summary,
        skin_sd=None if summary.bands is None else read_skin_sd(folder / SKIN_SD, len(after.vertices)),
        plan=next((read_text(file, "the plan of a result", _MOST_PLAN) for file in plans if file.is_file()), None),
        saved_in=folder,
        recording=folder / RECORDING if (folder / RECORDING).is_file() else None,
    )


def read_summary(folder: str | Path) -> Summary:
    """The summary of a result folder.

    Raises:
        InputError: there is none, or none yet, or it is damaged or of another version of the program.
    """
    return parse_summary(Path(folder) / SUMMARY)


def find_recording(result: Path) -> Path:
    """The recording in a result folder, also one that was cut short, or a recording itself.

    Raises:
        InputError: there is no recording, or the file is none.
    """
    if result.is_file():
        with result.open("rb") as file:
            if file.read(3) != b"RRF":  # how a recording begins; Rerun's viewer would open many other files
                raise InputError(f"{result}: is no recording; give a result folder or the {RECORDING} in it")
        return result
    for path in (result / RECORDING, partial(result / RECORDING)):
        if path.is_file():
            return path
    raise InputError(f"{result}: holds no {RECORDING}; give a folder that was simulated with --record")


def _present(path: Path) -> Path:
    if not path.is_file():
        raise InputError(f"{path}: is missing, though {SUMMARY} says that the result is whole; {AGAIN}")
    return path
