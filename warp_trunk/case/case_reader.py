"""Reading a case folder."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from warp_trunk.errors import InputError
from warp_trunk.geometry.coarsening import without_slivers
from warp_trunk.geometry.surface import Surface
from warp_trunk.geometry.surface_checks import LEAST_ANGLE, place_of, slivers
from warp_trunk.io.file_access import check_within
from warp_trunk.io.surface_files import read_surface, surface_files

from .axes import MILLIMETRES
from .case import Case
from .checks import CaseSource, CheckOptions, check_case, check_names
from .frame_checks import align_pelvis
from .header import read_header
from .landmarks import Landmarks, landmark_file, read_landmarks
from .layer_table import read_layers


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
    files = _Files(Path(folder))
    header = files.header
    before, after = files.points("landmarks_before"), files.points_if_there("landmarks_after")
    source = CaseSource(files.names, header.units, header.axes.code)
    if after is not None:
        check_names(before, after, source)
        after = Landmarks(before.names, after.points[[after.index(name) for name in before.names]])
    skin, bones, actual = files.skin(), files.bones(), files.stem("actual_skin")
    scanned = files.surface("skin", skin)
    case = Case(
        name=header.name,
        skin=without_slivers(scanned),
        bones={name: files.surface(name, path) for name, path in bones.items()},
        landmarks_before=before,
        landmarks_after=after,
        actual_skin=None if actual is None else files.surface("actual_skin", actual),
        tissue=header.tissue,
        posture=header.posture,
        uncertainty=header.uncertainty,
        study=header.study,
        rib_shares=header.ribs,
        bones_after={
            name: files.surface(f"bones_after/{name}", path)
            for name, path in surface_files(files.folder / "bones_after").items()
        },
        bending_left=files.points_if_there("landmarks_bending_left"),
        bending_right=files.points_if_there("landmarks_bending_right"),
    )
    if header.layers is not None:
        layers = read_layers(files.folder, header.layers, MILLIMETRES[header.units], len(case.skin.vertices))
        case = replace(case, layers=layers)
    if align:
        case = align_pelvis(case)
    return case, (*_mended(scanned, case.skin, source.name("skin")), *check_case(case, checks, source))


def _mended(scanned: Surface, skin: Surface, where: str) -> list[str]:
    """What is to be said of a skin that was mended."""
    if skin is scanned:
        return []
    thin = slivers(scanned)
    return [
        f"{where}: {len(thin)} triangles have an angle of less than {LEAST_ANGLE:g} degree, the first number "
        f"{thin[0]} near {place_of(scanned, thin)}; they were merged with their neighbours."
    ]


class _Files:
    """The files of a case folder, read into LPS and mm."""

    def __init__(self, folder: Path) -> None:
        if not folder.is_dir():
            what = "is a file" if folder.exists() else "there is no such folder"
            raise InputError(f"{folder}: {what}; a case folder with case.toml was expected")
        check_within(folder, folder / "case.toml")
        self.folder, self.header = folder, read_header(folder / "case.toml")
        self.names = {"case": folder / "case.toml"}
        """Where what was read came from, for messages."""

    def surface(self, key: str, path: Path) -> Surface:
        self.names[key] = path
        check_within(self.folder, path)
        return self.header.axes.surface_to_lps(read_surface(path), self.header.units)

    def points(self, key: str) -> Landmarks:
        self.names[key] = landmark_file(self.folder, key)
        check_within(self.folder, self.names[key])
        return read_landmarks(self.names[key], self.header.axes, self.header.units, self.header.landmark_columns)

    def points_if_there(self, key: str) -> Landmarks | None:
        path = landmark_file(self.folder, key)
        return self.points(key) if path.exists() or path.is_symlink() else None

    def stem(self, stem: str) -> Path | None:
        return surface_files(self.folder, stem).get(stem)

    def skin(self) -> Path:
        for former in surface_files(self.folder, "skin_after").values():
            raise InputError(
                f"{former}: a scan after surgery has another name; rename it to actual_skin{former.suffix}, or "
                "remove it if it was not scanned"
            )
        found = self.stem("skin")
        if found is None:
            raise InputError(
                f"{self.folder / 'skin.ply'}: there is no such file, nor one of another surface format; add it"
            )
        return found

    def bones(self) -> dict[str, Path]:
        found = surface_files(self.folder / "bones")
        if not found:
            raise InputError(
                f"{self.folder / 'bones'}: there is no surface in it; give each bone as bones/<name>.ply"
            )
        return found
