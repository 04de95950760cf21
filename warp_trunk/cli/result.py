"""Commands about results: warp-trunk view, report and export."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from tyro.conf import Positional

from warp_trunk.case.folders import refuse_case
from warp_trunk.case.layers import NAMES
from warp_trunk.errors import InputError
from warp_trunk.io.atomic_write import atomic_write, write_whole
from warp_trunk.io.file_access import check_place
from warp_trunk.io.result_files import TRUNK
from warp_trunk.io.surface_files.morph import skin_glb
from warp_trunk.io.trunk_file import read_trunk
from warp_trunk.io.volume_writer import ENDINGS, write_volume
from warp_trunk.results import read_result, read_summary
from warp_trunk.run.progress import Progress

from .output import OK


@dataclass(frozen=True, kw_only=True)
class View:
    """Open the recording of a result in the viewer."""

    result: Positional[Path]
    """Result folder, or a recording."""
    web: bool = False
    """Show it in a browser on this machine instead of a window."""

    def run(self) -> int:
        """Starts the viewer, which other machines cannot reach, and waits for its end."""
        from warp_trunk.recording import view_result  # no other command of this file needs it

        return view_result(self.result, web=self.web)


@dataclass(frozen=True, kw_only=True)
class Report:
    """Write the report of a result, or compare plans: a page for browser or printer, and its pictures."""

    results: Positional[tuple[Path, ...]]
    """Result folder; several results of plans for one patient are compared on one page."""
    out: Path | None = None
    """Folder to write to; by default the result folder, or the folder of the first of several results."""

    views: Literal["dressed", "bare"] = "dressed"
    """Front and side are shown in a shirt; bare shows them without clothes too."""

    def run(self) -> int:
        """Writes the page and prints its place."""
        if not self.results:
            raise InputError("report: RESULTS is missing; give one folder that `simulate` wrote, or several")
        if self.out is not None:
            refuse_case(self.out)
        from warp_trunk.report.writing import write_comparison, write_report  # bring matplotlib

        with Progress() as progress, progress.stage("report", "measuring and drawing"):
            results = [read_result(folder) for folder in self.results]
            bare = self.views == "bare"
            if len(results) > 1:
                page = write_comparison(results, self.out, bare=bare)
            else:
                page = write_report(results[0], self.out, bare=bare)
        print(f"Open {page} in a browser; its pictures are in {page.with_suffix('')}")
        return OK


@dataclass(frozen=True, kw_only=True)
class Export:
    """Write the mesh of a result, with the motion of its bones, for another solver, or its skin for a viewer."""

    result: Positional[Path]
    """Result folder."""
    out: Path | None = None
    """File to write; its ending chooses the format: .vtu .vtk .xdmf .msh, .inp (Abaqus, CalculiX), .feb (FEBio),
    or .glb (the skin, see --glb)."""
    glb: bool = False
    """Write the skin as glTF, with the surgery as a morph target and its animation; by default to skin.glb in the
    result folder."""
    plain: bool = False
    """Write the skin without the colours of its scan."""

    def run(self) -> int:
        """Writes the file."""
        out = self.out or (self.result / "skin.glb" if self.glb else None)
        if out is None:
            raise InputError("export: give --out FILE, or --glb for the skin")
        ending = out.suffix.lower()
        if ending not in (*ENDINGS, ".glb") or (self.glb and ending != ".glb"):
            what = f"{'a skin' if self.glb else 'a mesh'} cannot be written as '{out.suffix}'"
            raise InputError(f"--out: {what}; end the name in one of {'.glb' if self.glb else ', '.join(ENDINGS)}")
        refuse_case(out)
        check_place(out)
        if ending == ".glb":
            result = read_result(self.result)
            names = result.summary.case, "predicted"
            write_whole(out, skin_glb(result.skin_before, result.skin, names, plain=self.plain))
            print(f"{len(result.skin.vertices)} vertices before surgery and predicted: {out}")
            return OK
        tissues = read_summary(self.result).tissues
        trunk, displacement = read_trunk(self.result / TRUNK)
        with atomic_write(out) as unfinished:
            write_volume(unfinished, trunk, displacement, tissues, NAMES)
        print(f"{len(trunk.tets)} tetrahedra, {int(trunk.prescribed.sum())} nodes on bone: {out}")
        return OK
