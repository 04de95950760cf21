"""From a result folder to its report."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from warp_trunk.errors import InputError
from warp_trunk.io.atomic_write import atomic_write
from warp_trunk.measures import compare_skins, measure
from warp_trunk.results import read_result

from .back_pictures import back_picture, hump_picture
from .convergence_plot import convergence_plot
from .page import page
from .relief import relief, window
from .rotation_plot import rotation_plot
from .section_pictures import section_pictures
from .style import ACTUAL, BEFORE, PREDICTED, RC, Pose, file_of

if TYPE_CHECKING:
    from warp_trunk.results import Result

PAGE = "report.html"


def write_report(result: str | Path, out: str | Path | None = None) -> Path:
    """Write the report of a result: one page that needs no network, and its pictures as PNG.

    The page is `report.html`; the pictures lie in the folder `report` beside it: back, hump, rotation, sections
    and convergence. An earlier report is replaced, the page last.

    Args:
        result: a result folder.
        out: the folder to write to; the result folder when left out.

    Returns:
        The page.

    Raises:
        InputError: the result is missing, incomplete or damaged, or `out` cannot be written to.
    """
    out = Path(result) if out is None else Path(out)
    read = read_result(result)
    folder = _prepare(out)
    poses = poses_of(read)
    comparison = None
    if read.actual_skin is not None:
        comparison = compare_skins(read.predicted_skin, read.actual_skin, read.landmarks_after)
    seen = window([(pose.skin, pose.landmarks) for pose in poses])
    reliefs = [relief(pose.skin, pose.landmarks, seen) for pose in poses]

    from matplotlib import rc_context  # heavy

    with rc_context(RC):
        figures = {
            "back": back_picture(poses, reliefs, seen),
            "hump": hump_picture(poses, reliefs, seen),
            "rotation": rotation_plot(poses),
            "sections": section_pictures(poses),
            "convergence": convergence_plot(read.summary),
        }
        for name, figure in figures.items():
            _write(folder / f"{name}.png", file_of(figure, "png"))
        drawings = {name: file_of(figure, "svg") for name, figure in figures.items()}
    _write(out / PAGE, page(poses, comparison, read.summary, drawings).encode())
    return out / PAGE


def poses_of(result: Result) -> list[Pose]:
    """The skins of a result, measured: before surgery, predicted, and the actual one where it is known.

    Raises:
        InputError: a skin or landmarks that cannot be measured.
    """
    before, after, actual = result.skin_before, result.predicted_skin, result.actual_skin
    planned, reached = result.landmarks_before, result.landmarks_after
    poses = [
        Pose(BEFORE, before, planned, measure(before, planned)),
        Pose(PREDICTED, after, reached, measure(after, reached, before)),
    ]
    if actual is not None:
        poses.append(Pose(ACTUAL, actual, reached, measure(actual, reached)))
    return poses


def _prepare(out: Path) -> Path:
    """The folder of pictures, made; InputError where it cannot be written to."""
    folder = out / "report"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for place in (out, folder):
            probe = place / ".writable"
            probe.write_bytes(b"")
            probe.unlink()
    except OSError as error:
        raise InputError(
            f"{out}: a report cannot be written here ({error.strerror}); give --out a folder of your own"
        ) from error
    return folder


def _write(path: Path, content: bytes) -> None:
    with atomic_write(path) as unfinished:
        unfinished.write_bytes(content)
