"""A result folder read back, without the case it came from."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from warp_trunk.case.landmarks import NO_LANDMARKS, Landmarks, read_landmarks
from warp_trunk.errors import InputError
from warp_trunk.geometry.surface import Surface
from warp_trunk.io.file_access import read_text
from warp_trunk.io.surface_files import read_surface

from .bands import SKIN_SD, read_skin_sd
from .folder import ACTUAL_SKIN, LANDMARKS_AFTER, LANDMARKS_BEFORE, MOTIONS, PLAN, PREDICTED_SKIN, SKIN_BEFORE
from .summary import SUMMARY, Summary, parse_summary

AGAIN = "simulate the case again"
_MOST_PLAN = 1_000_000
"""No plan is longer than this [bytes]."""


@dataclass(frozen=True, eq=False)
class Result:
    """What a simulation left in its folder."""

    skin_before: Surface
    """The skin before surgery."""
    predicted_skin: Surface
    """The predicted skin, same vertices and faces."""
    actual_skin: Surface | None
    """The actual skin after surgery, with triangles of its own, where it is known."""
    landmarks_before: Landmarks
    """Points on the bones before surgery."""
    landmarks_after: Landmarks
    """The same points after surgery, same names in the same order."""
    summary: Summary
    """The contents of summary.json."""
    skin_sd: np.ndarray | None = None
    """Standard deviation of the place of each vertex of the predicted skin along its normal [mm], shape
    (vertices,); None without bands."""
    plan: str | None = None
    """The text of the plan, or of the motions of bones, by which it was made; None where neither was."""


def read_result(folder: str | Path) -> Result:
    """Read and check a result folder.

    Raises:
        InputError: it is no result folder, a file is missing or damaged, or files do not belong together.
    """
    folder = Path(folder)
    summary = read_summary(folder)
    before, after = (_surface(folder / name) for name in (SKIN_BEFORE, PREDICTED_SKIN))
    if not np.array_equal(before.faces, after.faces) or before.vertices.shape != after.vertices.shape:
        raise InputError(
            f"{folder / PREDICTED_SKIN}: {len(after.vertices)} vertices and {len(after.faces)} triangles are not "
            f"those of {SKIN_BEFORE} ({len(before.vertices)} and {len(before.faces)}); {AGAIN}"
        )
    planned = reached = NO_LANDMARKS
    if summary.bsr_deg.before or (folder / LANDMARKS_BEFORE).exists():
        planned, reached = (_landmarks(folder / name) for name in (LANDMARKS_BEFORE, LANDMARKS_AFTER))
    if planned.names != reached.names:
        raise InputError(
            f"{folder / LANDMARKS_AFTER}: its {len(reached.names)} names are not the {len(planned.names)} of "
            f"{LANDMARKS_BEFORE} in their order; {AGAIN}"
        )
    plans = [folder / PLAN, folder / MOTIONS]
    known = summary.bsr_deg.actual is not None
    return Result(
        skin_before=before,
        predicted_skin=after,
        actual_skin=_surface(folder / ACTUAL_SKIN) if known else None,
        landmarks_before=planned,
        landmarks_after=reached,
        summary=summary,
        skin_sd=None if summary.bands is None else read_skin_sd(folder / SKIN_SD, len(after.vertices)),
        plan=next((read_text(file, "the plan of a result", _MOST_PLAN) for file in plans if file.is_file()), None),
    )


def read_summary(folder: str | Path) -> Summary:
    """The summary of a result folder.

    Raises:
        InputError: there is none, or none yet, or it is damaged or of another version of the program.
    """
    return parse_summary(Path(folder) / SUMMARY)


def _surface(path: Path) -> Surface:
    _expect(path)
    return read_surface(path)


def _landmarks(path: Path) -> Landmarks:
    _expect(path)
    return read_landmarks(path)


def _expect(path: Path) -> None:
    if not path.is_file():
        raise InputError(f"{path}: is missing, though {SUMMARY} says that the result is whole; {AGAIN}")
