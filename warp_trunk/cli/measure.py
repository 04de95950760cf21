"""warp-trunk measure"""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from tyro.conf import Positional

from warp_trunk.case import Case, read_case
from warp_trunk.case.axes import MILLIMETRES
from warp_trunk.case.folders import HEADER, is_case, refuse_case
from warp_trunk.case.header import read_header
from warp_trunk.case.landmarks import Landmarks, read_landmarks
from warp_trunk.case.skin_checks import arm_warnings, check_second_skin
from warp_trunk.errors import InputError, MissingFileError
from warp_trunk.geometry.surface import Surface
from warp_trunk.geometry.surface_checks import enclosed_volume, manifold_fault
from warp_trunk.io.atomic_write import write_whole
from warp_trunk.io.file_access import read_text
from warp_trunk.io.folders import make_writable
from warp_trunk.io.point_files import read_points
from warp_trunk.io.result_files import PREDICTED_SKIN, SUMMARY
from warp_trunk.io.surface_files import in_lps, read_stated, read_surface, surface_files
from warp_trunk.measures.back import measure_back
from warp_trunk.results import Result, read_result, read_summary
from warp_trunk.results.judgement import judged, write_measures
from warp_trunk.run.progress import Progress

from .output import OK, next_command


@dataclass(frozen=True, kw_only=True)
class Measure:
    """Measure a simulated or scanned skin, and compare it with the actual one; with --spine, a back alone."""

    skin: Positional[Path]
    """A closed surface in mm and LPS axes (in those of the case if it lies in its folder), or a result folder;
    with --spine an open surface, or points, of the back."""
    case: Path | None = None
    """Case folder with the landmarks. A result has its own landmarks and needs no case."""
    against: Path | None = None
    """The actual skin after surgery, closed; it may have other triangles."""
    when: Literal["before", "after"] | None = None
    """Landmarks of the skin; by default before surgery for the case's own skin, otherwise after."""
    spine: Path | None = None
    """The spine of a back that was scanned alone: landmarks (name,x,y,z), or a line of spinous processes or of
    vertebral bodies (x,y,z). Levels along a line are at their usual heights between C7 and the pelvis."""
    markers: Path | None = None
    """Its markers (name,x,y,z): ASIS_left and ASIS_right, or PSIS; C7, and `lower`, the spinous process of L5."""
    units: Literal["mm", "cm", "m", "in"] = "mm"
    """Of a back, its spine and its markers."""
    out: Path | None = None
    """Folder for measures.json and measures.csv, or their name without ending; by default beside the skin."""

    def run(self) -> int:
        """Prints the measures and writes them."""
        file = skin_file(self.skin, finished=self.case is None and self.spine is None)
        stem = self.out or file.with_name(f"{file.stem}_measures")
        stem = stem / "measures" if stem.is_dir() else stem
        if self.out is not None:
            refuse_case(self.out)
        make_writable(stem.parent, "measures")
        if self.spine is not None:
            return self._back(file, self.spine, stem)
        with Progress() as progress:
            with progress.stage("load", f"reading {file}"):
                case, result = case_of_skin(file, self.case)
                skin = read_skin(file, self.case, case)
                actual = None if self.against is None else read_skin(self.against, self.case, case)
            with progress.stage("measure", "measuring"):
                predicted = result if file.name == PREDICTED_SKIN else None
                judgement = judged(case, skin, actual, self.when, predicted)
        print(judgement.text)
        write_measures(stem, judgement.words, judgement.table.rows)
        if actual is not None and not case.landmarks_before.names:
            from warp_trunk.report.part_pictures import write_distances  # brings matplotlib

            print(f"\nMap of distances: {write_distances(stem.with_name(f'{stem.name}.png'), skin, actual)}")
        print(f"\nWritten to {stem}.json and {stem}.csv")
        return OK

    def _back(self, file: Path, spine: Path, stem: Path) -> int:
        for name in ("case", "against", "when"):
            if getattr(self, name) is not None:
                raise InputError(f"--{name}: does not go with --spine, which measures a back alone; leave one out")
        size = MILLIMETRES[self.units]
        with Progress() as progress, progress.stage("measure", f"measuring {file}"):
            back, line = _read_back(file, size), _read_spine(spine, size)
            markers = None if self.markers is None else read_landmarks(self.markers, units=self.units)
            measures = measure_back(back, line, markers)
        print(measures.text())
        words = {"back": file.name, "pelvis": measures.pelvis, "spine": measures.spine}
        words |= {"notes": list(measures.notes), "missing": measures.missing}
        write_measures(stem, words, measures.measured())
        print(f"\nWritten to {stem}.json and {stem}.csv")
        if measures.scan is not None and measures.scan.left_out:
            from warp_trunk.report.scan_pictures import scan_picture  # brings matplotlib

            write_whole(stem.with_name(f"{stem.name}.png"), scan_picture(measures, measures.scan))
            print(f"What was left out is shown in {stem}.png")
        return OK


def _read_back(file: Path, size: float) -> Surface | np.ndarray:
    """An open surface [mm], or points where the file has no triangles, of a file in units of so many mm."""
    try:
        surface = in_lps(*read_stated(file, size))
        return surface.moved(size * surface.vertices)
    except InputError:
        return read_points(file, size)  # its error names the fault where there are no points


def _read_spine(path: Path, size: float) -> Landmarks | np.ndarray:
    """Landmarks where the points have names, else the points of a line [mm], of a file in units of so many mm."""
    titles = read_text(path, "a line (x,y,z) or landmarks (name,x,y,z) of the spine were expected").split("\n")[0]
    named = path.suffix.lower() in (".json", ".fcsv") or "name" in titles.lower()
    if not named:
        return read_points(path, size)
    marks = read_landmarks(path)
    return Landmarks(marks.names, size * marks.points)


def skin_file(path: Path, *, finished: bool) -> Path:
    """The file of a skin, the predicted one of a result folder; InputError where there is none."""
    if path.is_dir():
        if is_case(path):
            skin = next(iter(surface_files(path, "skin").values()), path / "skin.ply")
            command = next_command("measure", skin, "--case", path)
            raise InputError(f"{path}: is a case; give its skin, as {command}")
        if finished:
            read_summary(path)
        return path / PREDICTED_SKIN
    if not path.exists():
        raise MissingFileError(f"{path}: there is no such file; give a closed surface or a result folder")
    return path


def case_of_skin(file: Path, folder: Path | None) -> tuple[Case, Result | None]:
    """The case whose landmarks go with a skin, and the result it lies in: that of the result, else of a folder.

    Raises:
        InputError: neither is there, or the folder is of another patient than the result.
    """
    case = None if folder is None else read_case(folder)
    if not (file.parent / SUMMARY).is_file():
        if case is None:
            raise InputError(f"{file}: does not lie in a result, which holds its landmarks; give --case CASE")
        return case, None
    result = read_result(file.parent)
    before, after = result.landmarks_before, result.landmarks_after
    if case is not None:
        its = case.landmarks_before
        if before.names != its.names or np.abs(before.points - its.points).max() > 1e-3:
            other = f"is not the case of the result {file.parent}, whose landmarks before surgery differ"
            raise InputError(f"{folder}: {other}; leave --case out, the result holds its own landmarks")
    unseen = None if result.unseen is None else result.unseen > 0.5
    return Case(result.summary.case, result.skin_before, {}, before, after, unseen=unseen), result


def read_skin(path: Path, case_folder: Path | None, case: Case) -> Surface:
    """A skin of the patient in LPS and mm.

    Raises:
        InputError: it cannot be read, is open or inside out, lies elsewhere than the skin of the case, is of
            another size, turned, or does not hold the bones.
    """
    if case_folder is not None and case_folder.resolve() in path.resolve().parents:
        surface, _ = read_header(case_folder / HEADER).surface(path)
    else:
        surface = read_surface(path)
    fault = manifold_fault(surface)
    if fault is None and (volume := enclosed_volume(surface)) <= 0.0:
        fault = f"it encloses {volume / 1000.0:.3g} cm3"
    if fault is not None:
        rule = "a skin must be closed, and its triangles counterclockwise seen from outside"
        raise InputError(f"{path}: {rule}, but {fault}; close it with warp-trunk close, or flip its triangles")
    (low, high), (own_low, own_high) = (
        (surface_.vertices.min(axis=0), surface_.vertices.max(axis=0)) for surface_ in (surface, case.skin)
    )
    apart = np.flatnonzero((low > own_high) | (high < own_low))
    if apart.size or not 0.5 < (high[2] - low[2]) / (own_high[2] - own_low[2]) < 2.0:
        axis = apart[0] if apart.size else 2
        place = f"{'xyz'[axis]} {own_low[axis]:.0f} to {own_high[axis]:.0f} mm"
        raise InputError(
            f"{path}: must lie where the skin of the case is, {place}, but has {low[axis]:.0f} to "
            f"{high[axis]:.0f}; give it in mm and LPS axes, registered to the case"
        )
    if case.landmarks_before.names:
        warnings = check_second_skin(case, surface, str(path))
        for warning in warnings + arm_warnings(surface, case.landmarks_before, str(path)):
            print(f"warp-trunk: warning: {warning}", file=sys.stderr)
    return surface
