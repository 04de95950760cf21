"""Writing a case folder."""

from __future__ import annotations

from pathlib import Path

from warp_trunk.checking import checked
from warp_trunk.errors import InputError
from warp_trunk.geometry.surface import Surface
from warp_trunk.io.atomic_write import partial, write_whole
from warp_trunk.io.file_names import check_file_names
from warp_trunk.io.folders import make_writable
from warp_trunk.io.result_files import MOTIONS
from warp_trunk.io.surface_files import surface_files, write_surface

from .case import Case
from .folders import HEADER
from .header import CaseHeader, header_text
from .landmarks import write_landmarks
from .layers import write_layers
from .motions import motions_text
from .points import FILE as POINTS
from .points import points_text
from .uncertainty import write_invented_skin


@checked
def write_case(folder: str | Path, case: Case) -> None:
    """Write a complete case folder, in LPS and mm, which `read_case` reads back to the last bit.

    Bones come back in the order of their names. `case.toml` is written last and an earlier one removed first, so
    that a folder with one is complete; until then `case.partial.toml` stands for it.

    >>> wt.write_case(folder / "written", case)
    >>> sorted(path.name for path in (folder / "written").iterdir())
    ['bones', 'case.toml', 'landmarks_after.csv', 'landmarks_before.csv', 'skin.ply']

    Raises:
        InputError: the folder holds surfaces that do not belong to the case and would be read with it, or a bone
            has a name that cannot be a file name.
    """
    folder = Path(folder)
    surfaces = _surfaces(folder, case)
    make_writable(folder, "a case")
    begin_case(folder)
    for path, surface in surfaces.items():
        path.parent.mkdir(parents=True, exist_ok=True)
        write_surface(path, surface)
    landmarks = {
        "landmarks_before.csv": case.landmarks_before if case.landmarks_before.names else None,
        "landmarks_after.csv": case.landmarks_after,
        "landmarks_bending_left.csv": case.bending_left,
        "landmarks_bending_right.csv": case.bending_right,
    }
    texts = {MOTIONS: motions_text(case.motions), POINTS: points_text(case.points)}
    for file in (*landmarks, *texts):
        (folder / file).unlink(missing_ok=True)
    for file, points in landmarks.items():
        if points is not None:
            write_landmarks(folder / file, points)
    for file, text in texts.items():
        if text:
            write_whole(folder / file, text)
    write_invented_skin(folder, case.unseen)
    header = CaseHeader(
        name=case.name,
        posture=case.posture,
        notes=case.notes,
        tissue=case.tissue,
        uncertainty=case.uncertainty,
        study=case.study,
        invented=case.invented,
        ribs=case.rib_coupling,
        layers=None if case.layers is None else write_layers(folder, case.layers),
    )
    write_whole(folder / HEADER, header_text(header))


def begin_case(folder: Path) -> None:
    """Marks a folder as a case that is not yet complete, which `read_case` refuses."""
    folder.mkdir(parents=True, exist_ok=True)
    partial(folder / HEADER).write_bytes(b"")
    (folder / HEADER).unlink(missing_ok=True)


def _surfaces(folder: Path, case: Case) -> dict[Path, Surface]:
    """Each surface of the case by its file; InputError for an invalid name, or a surface in the way."""
    surfaces = {folder / "skin.ply": case.skin}
    if case.actual_skin is not None:
        surfaces[folder / "actual_skin.ply"] = case.actual_skin
    for place, bones in (("bones", case.bones), ("bones_after", case.bones_after)):
        check_file_names(bones, f"write_case: {place}")
        for name, surface in bones.items():
            surfaces[folder / place / f"{name}.ply"] = surface
    skins = [path for stem in ("skin", "actual_skin") for path in surface_files(folder, stem).values()]
    bones = [path for place in ("bones", "bones_after") for path in surface_files(folder / place).values()]
    for path in (*skins, *bones):
        if path not in surfaces:
            raise InputError(f"{path}: would be read as part of case {case.name!r}; remove it")
    return surfaces
