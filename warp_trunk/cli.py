"""The command line. Its flags are the fields of the option dataclasses, which document them."""

from __future__ import annotations

import contextlib
import io
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro
import warp as wp
from tyro.conf import OmitArgPrefixes, Positional, subcommand

from .case import read_case, write_case
from .deformity import SpineCurve, make_case
from .errors import InputError
from .meshing import MeshOptions
from .phantom import phantom_case
from .progress import Progress
from .relaxation import RelaxStatus
from .results import RECORDING, partial
from .results.summary_text import plain
from .run import RunOptions, RunResult, run_case
from .simulation import SimulationOptions
from .surface import read_surface
from .tissue import Tissue

OK, NOT_CONVERGED, BAD_INPUT, INTERRUPTED = 0, 1, 2, 130
"""Exit statuses."""


@dataclass(frozen=True, kw_only=True)
class Demo:
    """Simulate the built-in case, a synthetic trunk with a thoracic scoliosis; needs no file."""

    out: Path = Path("results/demo")
    """Result folder."""
    options: Annotated[RunOptions, tyro.conf.arg(name="")] = field(
        default_factory=lambda: RunOptions(
            mesh=MeshOptions(tets=60_000), simulation=SimulationOptions(increments=5)
        )
    )
    """How the case is simulated."""

    def run(self, arguments: Sequence[str]) -> int:
        """Simulates the phantom and says how to look at the result."""
        with Progress() as progress:
            with progress.stage("load", "making the synthetic trunk"):
                case = phantom_case()
            result = run_case(case, self.out, self.options, progress)
        return tell(result)


@dataclass(frozen=True, kw_only=True)
class MakeCase:
    """Make a case from straight anatomy: impose a scoliosis and plan its correction."""

    skin: Path
    """The straight trunk, a closed surface in mm and LPS axes."""
    bones: Path
    """Folder with one surface for each bone, named after it: T7.ply, rib_left_01.ply, hip_left.ply."""
    out: Path
    """Case folder to write."""
    curve: Literal["thoracic", "thoracolumbar", "double_major"] = "thoracic"
    """Where the curve is."""
    cobb: float = 60.0
    """Cobb angle [degrees]."""
    rotation: float | None = None
    """Axial rotation of the apical vertebra [degrees]; 0.32 of the Cobb angle when left out."""
    direction: Literal["right", "left"] = "right"
    """The side to which the curve is convex; of a double major, its thoracic curve."""
    correction: float = 0.7
    """Fraction of Cobb angle and axial rotation that surgery takes away, 0 to 1."""
    placeholder: bool = False
    """Also write skin_after.ply, the spline's image of the skin; marked as a placeholder, no truth."""

    def run(self, arguments: Sequence[str]) -> int:
        """Writes the case folder."""
        curve = SpineCurve(
            kind=self.curve, cobb=self.cobb, apical_rotation=self.rotation, direction=self.direction
        )
        if not self.bones.is_dir():
            raise InputError(f"{self.bones}: there is no such folder; --bones is a folder of bone surfaces")
        files = sorted(
            path for path in self.bones.iterdir() if path.suffix.lower() in {".ply", ".stl", ".obj", ".off"}
        )
        with Progress() as progress:
            with progress.stage("load", f"reading {len(files)} bones and the skin"):
                bones = {path.stem: read_surface(path) for path in files}
                skin = read_surface(self.skin)
            with progress.stage("make", f"imposing a {self.curve} curve of {self.cobb:g} degrees"):
                case = make_case(skin, bones, curve, self.correction, placeholder=self.placeholder)
            with progress.stage("write", f"writing {self.out}"):
                write_case(self.out, case)
        print(f"Case '{case.name}' written to {self.out}")
        print(f"Simulate it: warp-trunk simulate {self.out}")
        return OK


@dataclass(frozen=True, kw_only=True)
class Simulate:
    """Predict the trunk after surgery for a case folder."""

    case: Positional[Path]
    """Case folder."""
    out: Path | None = None
    """Result folder; results/ and the name of the case folder when left out."""
    options: Annotated[RunOptions, tyro.conf.arg(name="")] = field(default_factory=RunOptions)
    """How the case is simulated."""
    tissue: Tissue = field(default_factory=Tissue)
    """What the soft tissue is made of; what is not given here is taken from case.toml."""

    def run(self, arguments: Sequence[str]) -> int:
        """Simulates the case and writes its result."""
        out = self.out or Path("results") / self.case.resolve().name
        with Progress() as progress:
            with progress.stage("load", f"reading {self.case}"):
                case = read_case(self.case)
            given = parse(Simulate, arguments, replace(self, tissue=case.tissue))
            result = run_case(replace(case, tissue=given.tissue), out, self.options, progress)
        return tell(result)


@dataclass(frozen=True, kw_only=True)
class View:
    """Open the recording of a result in the viewer."""

    result: Positional[Path]
    """Result folder, or a recording."""

    def run(self, arguments: Sequence[str]) -> int:
        """Starts the native viewer, which other machines cannot reach, and waits for its end."""
        recording = find_recording(self.result)
        command = [sys.executable, "-m", "rerun", "--bind", "127.0.0.1", str(recording)]
        return subprocess.run(command, check=False).returncode


Command = (
    Annotated[Demo, subcommand("demo")]
    | Annotated[MakeCase, subcommand("make-case")]
    | Annotated[Simulate, subcommand("simulate")]
    | Annotated[View, subcommand("view")]
)


def tell(result: RunResult) -> int:
    """Prints how a run ended and what to do next; returns the exit status."""
    print(plain(result))
    if (result.folder / RECORDING).is_file():
        print(f"See it: warp-trunk view {result.folder}")
    return OK if result.status is RelaxStatus.CONVERGED else NOT_CONVERGED


def find_recording(result: Path) -> Path:
    """The recording in a result folder, also one that was cut short; InputError where there is none."""
    if result.is_file():
        return result
    for path in (result / RECORDING, partial(result / RECORDING)):
        if path.is_file():
            return path
    raise InputError(f"{result}: holds no {RECORDING}; give a folder that was simulated with --record")


def parse(command: Any, arguments: Sequence[str], default: Any = None) -> Any:
    """The command that the arguments ask for.

    Raises:
        InputError: arguments that do not fit; SystemExit where they ask for help.
    """
    said = io.StringIO()
    options = {} if default is None else {"default": default}
    try:
        with contextlib.redirect_stderr(said):
            return tyro.cli(
                OmitArgPrefixes[command],
                prog="warp-trunk",
                description="Predict how the trunk of a scoliosis patient looks after spine surgery.",
                args=list(arguments),
                **options,
            )
    except SystemExit as end:
        if not end.code:
            raise
        raise InputError(one_line(said.getvalue())) from None


def one_line(box: str) -> str:
    """The message in the box that tyro draws around it, in one line, without its title and the hint for help."""
    plain_box = re.sub(r"\x1b\[[0-9;]*m", "", box)  # colours, on a terminal
    rows = [row.strip(" │") for row in plain_box.splitlines()]
    rows = [row for row in rows if row and row[0] not in "╭╰"]
    if len(rows) > 1 and _is_rule(rows[1]):
        rows = rows[2:]  # where the terminal has no box characters, the title stands over a rule
    end = next((i for i, row in enumerate(rows) if _is_rule(row)), len(rows))
    hint = [f"({row})" for row in rows[end:] if row.startswith("Available subcommands")]
    text = " ".join(" ".join([*rows[:end], *hint]).split())
    return re.sub(r"^Error parsing __tyro-dummy-inner__[\w.-]*: ", "", text) or "the arguments do not fit"


def _is_rule(row: str) -> bool:
    return set(row) <= {"─", "-"}


def start_warp() -> None:
    """Starts Warp without the line that its native part prints on every machine without CUDA.

    It writes past Python's streams, so the file descriptor is turned aside; anything else it says is passed on.
    """
    sys.stderr.flush()
    kept = os.dup(2)
    with tempfile.TemporaryFile() as aside:
        os.dup2(aside.fileno(), 2)
        try:
            wp.init()
        finally:
            os.dup2(kept, 2)
            os.close(kept)
        aside.seek(0)
        for line in aside.read().decode(errors="replace").splitlines():
            if "Could not find or load the NVIDIA CUDA driver" not in line:
                print(line, file=sys.stderr)


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs a command; returns its exit status, 0 only for a simulation that converged."""
    wp.config.log_level = wp.LOG_WARNING  # not a line for each kernel
    arguments = sys.argv[1:] if arguments is None else list(arguments)
    try:
        command = parse(Command, arguments)
        start_warp()
        return command.run(arguments[1:])
    except InputError as error:
        print(f"warp-trunk: {error}", file=sys.stderr)
        return BAD_INPUT
    except OSError as error:
        print(f"warp-trunk: {error}", file=sys.stderr)
        return NOT_CONVERGED
    except KeyboardInterrupt:
        print("warp-trunk: interrupted", file=sys.stderr)
        return INTERRUPTED


if __name__ == "__main__":
    sys.exit(main())
