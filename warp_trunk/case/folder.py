"""The folder that holds a case: reading and writing it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from warp_trunk.errors import InputError
from warp_trunk.geometry.surface import Surface
from warp_trunk.io.atomic_write import atomic_write
from warp_trunk.io.file_access import check_within
from warp_trunk.io.surface_files import read_surface, surface_files, write_surface

from .axes import MILLIMETRES, Axes
from .checks import CaseSource, CheckOptions, check_case, check_names
from .frame_checks import align_pelvis
from .header import CaseHeader, header_text, read_header
from .landmarks import Landmarks, landmark_file, read_landmarks, write_landmarks
from .layer_table import read_layers, write_layers
from .record import Case


def read_case(folder: str | Path, checks: CheckOptions | None = None) -> Case:
    """Read and check a case folder; `read_checked_case` also tells what is doubtful in it."""
    return read_checked_case(folder, checks)[0]


def read_checked_case(
    folder: str | Path, checks: CheckOptions | None = None, *, align: bool = False
) -> tuple[Case, tuple[str, ...]]:
    """Read and check a case folder; everything that comes back is in LPS axes and mm.

    The folder holds `case.toml` (see `CaseHeader`; every key may be left out), `skin.ply`, `bones/*.ply`,
    `landmarks_before.csv` and perhaps `landmarks_after.csv`, `landmarks_bending_left.csv`,
    `landmarks_bending_right.csv`, `actual_skin.ply` and `bones_after/*.ply`.
    Surfaces may be in any format of `read_surface`, landmarks also in those of 3D Slicer. A bone is named after
    its file. No file is read that lies elsewhere, also where case.toml names it or a link leads to it.

    Args:
        folder: the case folder.
        checks: limits of the checks (`check_case`); the defaults when left out.
        align: bring what is known after surgery back onto the pelvis before surgery (`align_pelvis`).

    Returns:
        The case, and a sentence for each thing in it that can be, but seldom is.

    Raises:
        InputError: a file is missing, cannot be read or breaks a rule; the text names file, rule, value and
            cure.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise InputError(f"{folder}: there is no such folder; a case folder with case.toml was expected")
    check_within(folder, folder / "case.toml")
    header = read_header(folder / "case.toml")
    files = {"case": folder / "case.toml"}

    def read(key: str, path: Path) -> Surface:
        files[key] = path
        check_within(folder, path)
        return header.axes.surface_to_lps(read_surface(path), header.units)

    def points(key: str) -> Landmarks:
        files[key] = landmark_file(folder, key)
        check_within(folder, files[key])
        return read_landmarks(files[key], header.axes, header.units, header.landmark_columns)

    def points_if_there(key: str) -> Landmarks | None:
        path = landmark_file(folder, key)
        return points(key) if path.exists() or path.is_symlink() else None

    before, after = points("landmarks_before"), points_if_there("landmarks_after")
    source = CaseSource(files, header.units, header.axes.code)
    if after is not None:
        check_names(before, after, source)
        after = Landmarks(before.names, after.points[[after.index(name) for name in before.names]])

    skin_file, actual_file = (surface_files(folder, stem).get(stem) for stem in ("skin", "actual_skin"))
    bone_files = surface_files(folder / "bones")
    if skin_file is None:
        raise InputError(
            f"{folder / 'skin.ply'}: there is no such file, nor one of another surface format; add it"
        )
    for former in surface_files(folder, "skin_after").values():
        raise InputError(
            f"{former}: a scan after surgery has another name; rename it to actual_skin{former.suffix}, or "
            "remove it if it was not scanned"
        )
    if not bone_files:
        raise InputError(f"{folder / 'bones'}: there is no surface in it; give each bone as bones/<name>.ply")
    case = Case(
        name=header.name,
        skin=read("skin", skin_file),
        bones={name: read(name, path) for name, path in bone_files.items()},
        landmarks_before=before,
        landmarks_after=after,
        actual_skin=None if actual_file is None else read("actual_skin", actual_file),
        tissue=header.tissue,
        bones_after={
            name: read(f"bones_after/{name}", path) for name, path in surface_files(folder / "bones_after").items()
        },
        bending_left=points_if_there("landmarks_bending_left"),
        bending_right=points_if_there("landmarks_bending_right"),
    )
    if header.layers is not None:
        layers = read_layers(folder, header.layers, MILLIMETRES[header.units], len(case.skin.vertices))
        case = replace(case, layers=layers)
    if align:
        case = align_pelvis(case)
    return case, check_case(case, checks, source)


def write_case(folder: str | Path, case: Case) -> None:
    """Write a complete case folder, in LPS and mm, which `read_case` reads back to the last bit.

    Bones come back in the order of their names. `case.toml` is written last and an earlier one removed first, so
    that a folder with one is whole.

    Raises:
        InputError: the folder holds surfaces that are not part of the case and would be read with it, or a
            bone's name cannot be a file's.
    """
    folder = Path(folder)
    surfaces = {folder / "skin.ply": case.skin}
    if case.actual_skin is not None:
        surfaces[folder / "actual_skin.ply"] = case.actual_skin
    for name, surface in case.bones.items():
        if Path(name).name != name or name.startswith(".") or Path(f"{name}.ply").stem != name:
            raise InputError(f"write_case: '{name}' names a bone and must serve as a file name; rename the bone")
        surfaces[folder / "bones" / f"{name}.ply"] = surface
    for name, surface in case.bones_after.items():
        surfaces[folder / "bones_after" / f"{name}.ply"] = surface
    for found in (
        surface_files(folder, "skin"),
        surface_files(folder, "actual_skin"),
        surface_files(folder / "bones"),
        surface_files(folder / "bones_after"),
    ):
        for path in found.values():
            if path not in surfaces:
                raise InputError(
                    f"{path}: stands where case {case.name!r} goes and would be read as part of it; "
                    "remove it or write to another folder"
                )
    (folder / "case.toml").unlink(missing_ok=True)
    for path, surface in surfaces.items():
        path.parent.mkdir(parents=True, exist_ok=True)
        write_surface(path, surface)
    landmarks = {
        "landmarks_before.csv": case.landmarks_before,
        "landmarks_after.csv": case.landmarks_after,
        "landmarks_bending_left.csv": case.bending_left,
        "landmarks_bending_right.csv": case.bending_right,
    }
    for file, points in landmarks.items():
        if points is None:
            (folder / file).unlink(missing_ok=True)
            continue
        with atomic_write(folder / file) as unfinished:
            write_landmarks(unfinished, points)
    header = CaseHeader(
        name=case.name,
        axes=Axes("LPS"),
        tissue=case.tissue,
        layers=None if case.layers is None else write_layers(folder, case.layers),
    )
    with atomic_write(folder / "case.toml") as unfinished:
        unfinished.write_text(header_text(header), encoding="utf-8")
