"""A case folder, read and written."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from warp_trunk.checking import checked
from warp_trunk.errors import InputError, MissingFileError, closest_name
from warp_trunk.geometry.surface import Surface
from warp_trunk.geometry.surface_checks import LEAST_ANGLE, place_of, slivers
from warp_trunk.io.atomic_write import partial, write_whole
from warp_trunk.io.file_access import check_within, read_text
from warp_trunk.io.file_names import check_file_names
from warp_trunk.io.folders import make_writable
from warp_trunk.io.result_files import MOST_PLAN, MOTIONS, PLAN
from warp_trunk.io.surface_files import surface_files, write_surface

from .anatomy import check_bone_names
from .axes import MILLIMETRES
from .case import Case
from .checks import CaseSource, check_case, check_names
from .folders import HEADER, is_case, other_kind
from .header import CaseHeader, header_text, read_header
from .landmark_checks import align_pelvis
from .landmarks import NO_LANDMARKS, Landmarks, landmark_file, read_landmarks, write_landmarks
from .layers import read_layers, write_layers
from .motions import Motion, motions_text, read_motions
from .points import FILE as POINTS
from .points import Points, points_text, read_followed_points
from .uncertainty import read_invented_skin, write_invented_skin


@checked
def read_case(folder: str | Path, motions: str | Path | None = None) -> Case:
    """Read and check a case folder; `read_checked_case` also returns warnings.

    >>> wt.write_case(folder / "patient", case)
    >>> wt.read_case(folder / "patient").name == case.name
    True
    """
    return read_checked_case(folder, motions=motions)[0]


def read_checked_case(
    folder: str | Path, *, align: bool = False, motions: str | Path | None = None
) -> tuple[Case, tuple[str, ...]]:
    """Read and check a case folder, and convert it to LPS axes and mm.

    The folder holds `case.toml` (see `CaseHeader`; every key is optional), `skin.ply`, `bones/*.ply`,
    `landmarks_before.csv` and optionally `landmarks_after.csv`, `landmarks_bending_left.csv`,
    `landmarks_bending_right.csv`, `actual_skin.ply`, `bones_after/*.ply`, `motions.toml` (`read_motions`),
    `points.csv` (`read_points`) and the `plan.toml` that made the landmarks after surgery.
    With motions, or all bones after surgery, it needs no landmarks.
    Surfaces may be in any format of `read_surface`, landmarks also in those of 3D Slicer. A bone has the name of
    its file. No file outside the folder is read, even if case.toml names it or a link leads to it.

    Args:
        folder: the case folder.
        align: align the pelvis after surgery with the one before (`align_pelvis`).
        motions: a file to read instead of `motions.toml`; it may lie elsewhere.

    Returns:
        The case, and a warning for each unusual value.

    Raises:
        InputError: a file is missing, cannot be read or breaks a rule; the text names file, rule, value and
            cure.
    """
    files = _Files(Path(folder))
    header = files.header
    moved = files.motions(None if motions is None else Path(motions))
    bones, bones_after = surface_files(files.folder / "bones"), surface_files(files.folder / "bones_after")
    check_bone_names(bones)
    if not bones:
        place = files.folder / "bones"
        hint = "" if place.exists() else _called_nearly(place)
        raise InputError(f"{place}: there is no surface in it{hint}; add each bone as bones/<name>.ply")
    before, after = files.landmarks("landmarks_before"), files.landmarks("landmarks_after")
    source = CaseSource(files.names, header.units, header.axes)
    if before is None and not (moved or bones_after.keys() == bones.keys()):
        cure = f"add the landmarks of the spine, or {MOTIONS}, or every bone in bones_after/"
        path = files.names["landmarks_before"]
        raise MissingFileError(f"{path}: there is no such file{_called_nearly(path)}; {cure}")
    before = before or NO_LANDMARKS
    if after is not None:
        check_names(before, after, source)
        after = Landmarks(before.names, after.points[[after.index(name) for name in before.names]])
    from warp_trunk.geometry.coarsening import without_slivers  # brings Warp

    skin, actual = files.skin(), surface_files(files.folder, "actual_skin").get("actual_skin")
    scanned = files.surface("skin", skin)
    unseen = read_invented_skin(files.folder, len(scanned.vertices))
    case = Case(
        name=header.name,
        skin=without_slivers(scanned),
        bones={name: files.surface(name, path) for name, path in bones.items()},
        landmarks_before=before,
        landmarks_after=after,
        plan_text=files.plan() if after is not None and motions is None else None,
        actual_skin=None if actual is None else files.surface("actual_skin", actual),
        tissue=header.tissue,
        posture=header.posture,
        notes=header.notes,
        uncertainty=header.uncertainty,
        study=header.study,
        invented=header.invented,
        unseen=unseen,
        rib_coupling=header.ribs,
        bones_after={name: files.surface(f"bones_after/{name}", path) for name, path in bones_after.items()},
        motions=moved,
        points=files.followed(),
        bending_left=files.landmarks("landmarks_bending_left"),
        bending_right=files.landmarks("landmarks_bending_right"),
    )
    if header.layers is not None:
        layers = read_layers(files.folder, header.layers, MILLIMETRES[header.units], len(case.skin.vertices))
        case = replace(case, layers=layers)
    if align:
        case = align_pelvis(case)
    if case.skin is not scanned:
        if unseen is not None:
            case = replace(case, unseen=unseen[nearest_vertices(scanned.vertices, case.skin.vertices)])
        thin = slivers(scanned)
        place = f"the first number {thin[0]} near {place_of(scanned, thin)}"
        files.notes.insert(
            0,
            f"{source.name('skin')}: {len(thin)} triangles have an angle of less than {LEAST_ANGLE:g} degree, "
            f"{place}; they were merged with their neighbours.",
        )
    case = replace(case, notes=(*files.notes, *case.notes))
    return case, check_case(case, source)


def nearest_vertices(of: np.ndarray, points: np.ndarray) -> np.ndarray:
    """The row of the nearest of some vertices (n, 3) to each of other points (m, 3), shape (m,)."""
    from scipy.spatial import KDTree  # heavy

    return np.asarray(KDTree(of).query(points)[1])


def _instead(folder: Path) -> str:
    """The cure for a folder that is no case."""
    if other := other_kind(folder, "case"):
        return f"; {other}"
    present = {"skin.ply": surface_files(folder, "skin"), "bones": (folder / "bones").is_dir()}
    missing = " and no ".join(f"{name}{_called_nearly(folder / name)}" for name, ok in present.items() if not ok)
    return f", as it has no {missing}; add what is missing, in mm and LPS or with case.toml"


def _called_nearly(path: Path) -> str:
    """A question for what is called nearly so in the folder of a path, and is no other file of a case."""
    unrelated = [file.name for file in path.parent.iterdir() if not file.name.startswith((*_STEMS, "."))]
    return closest_name(path.name, unrelated)


_STEMS = ("landmarks_before.", "landmarks_after.", "landmarks_bending_", "actual_skin.", "skin.", "bones_")
"""How the names of a case's files begin."""


class _Files:
    """The files of a case folder, read into LPS and mm."""

    def __init__(self, folder: Path) -> None:
        if not folder.is_dir():
            kind, what = (
                (InputError, "is a file") if folder.exists() else (MissingFileError, "there is no such folder")
            )
            raise kind(f"{folder}: {what}; a case folder with skin.ply and bones/ was expected")
        check_within(folder, folder / HEADER)
        self.folder, self.header = folder, read_header(folder / HEADER)
        if not is_case(folder):
            raise InputError(f"{folder}: is no case folder{_instead(folder)}")
        self.notes: list[str] = []
        self.names = {"case": folder / HEADER}
        """The files that were read, for messages."""

    def surface(self, key: str, path: Path) -> Surface:
        self.names[key] = path
        check_within(self.folder, path)
        surface, note = self.header.surface(path)
        self.notes += [] if note is None else [note]
        return surface

    def is_present(self, key: str, path: Path) -> bool:
        """Whether a file is there, also as a link, and lies in the folder."""
        self.names[key] = path
        if not (path.exists() or path.is_symlink()):
            return False
        check_within(self.folder, path)
        return True

    def landmarks(self, key: str) -> Landmarks | None:
        path, header = landmark_file(self.folder, key), self.header
        if not self.is_present(key, path):
            return None
        return read_landmarks(path, header.frame, header.units, header.landmark_columns)

    def motions(self, stated: Path | None) -> dict[str, Motion]:
        path = stated or self.folder / MOTIONS
        self.names["motions"] = path
        if stated is None and not self.is_present("motions", path):
            return {}
        motions = read_motions(path, self.header.frame, None if stated else self.folder)
        if not motions:
            raise InputError(f"{path}: names no bone; add a table for each bone that moves, or remove the file")
        return motions

    def plan(self) -> str | None:
        path = self.folder / PLAN
        return read_text(path, "the plan of a case", MOST_PLAN) if self.is_present("plan", path) else None

    def followed(self) -> Points:
        path = self.folder / POINTS
        if not self.is_present("points", path):
            return Points()
        return read_followed_points(path, self.header.frame, self.header.units)

    def skin(self) -> Path:
        file = surface_files(self.folder, "skin").get("skin")
        if file is None:
            path = self.folder / "skin.ply"
            what = "is a folder" if path.is_dir() else "there is no such file, nor one in another surface format"
            raise MissingFileError(f"{path}: {what}{_called_nearly(path)}; add it")
        return file


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
