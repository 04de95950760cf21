"""Options of every command that simulates cases."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar

import tyro

from warp_trunk.engine.tissue import Tissue
from warp_trunk.errors import InputError
from warp_trunk.io.surface_files import write_surface
from warp_trunk.meshing import CrossingError
from warp_trunk.results import Result
from warp_trunk.results.summary_text import plain
from warp_trunk.run.options import RunOptions

from .arguments import parse
from .output import NOT_CONVERGED, OK, next_command

if TYPE_CHECKING:
    from warp_trunk.case import Case


COMMON = frozenset({"bands", "device", "from_mesh", "gravity", "increments", "layers", "live", "tets", "threads"})
"""The simulation options that `--help` shows."""


@dataclass(frozen=True, kw_only=True)
class SimulationArguments:
    """How cases are simulated."""

    common: ClassVar[frozenset[str]] = COMMON
    options: Annotated[RunOptions, tyro.conf.arg(name="")] = field(default_factory=RunOptions)
    """How the case is simulated."""
    align_pelvis: bool = False
    """Move the data after surgery onto the pelvis before it, if they are in another frame."""
    tissue_file: Path | None = None
    """Constants of tissue and ribs that override those of case.toml, as `calibrate` writes them (tissue.toml)."""
    tissue: Tissue = field(default_factory=Tissue)
    """Material of the soft tissue; values that are not given come from the tissue file, then from case.toml."""

    def refined(self, case: Case, arguments: Sequence[str]) -> Case:
        """A case with the constants of the tissue file, and over them those that the words of the command give."""
        if self.tissue_file is not None:
            from warp_trunk.case.tissue_file import read_tissue_file, with_constants

            case = with_constants(case, read_tissue_file(self.tissue_file))
        options = {word.partition("=")[0].removeprefix("--").replace("-", "_") for word in arguments}
        if options.isdisjoint(constant.name for constant in fields(Tissue)):
            return case
        given = parse(type(self), arguments, replace(self, tissue=case.tissue))
        return replace(case, tissue=given.tissue)


def report_ending(result: Result, name: str = "") -> int:
    """Print how a run ended, with its name among several, and two commands to paste; return the exit status."""
    print(plain(result, name))
    print("The report, for the browser and the printer, and the viewer:")
    print(next_command("report", result.folder))
    if result.recording is not None:
        print(next_command("view", result.folder))
    return OK if result.converged else NOT_CONVERGED


CROSSINGS = "crossings.ply"


@contextmanager
def crossings_written(folder: Path) -> Iterator[None]:
    """Writes the triangles of a CrossingError to `crossings.ply` in a folder, and says so in its text.

    Raises:
        InputError: in place of the CrossingError.
    """
    try:
        yield
    except CrossingError as error:
        path = folder / CROSSINGS
        try:
            folder.mkdir(parents=True, exist_ok=True)
            write_surface(path, error.triangles)
        except OSError:
            raise error from None
        raise InputError(f"{error}; look at the triangles that cross in {path}") from error
