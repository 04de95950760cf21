"""How time, work and memory grow with the mesh, and how the answer depends on mesh and increments."""

import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from warp_trunk import InputError, Landmarks, Surface
from warp_trunk.engine.relaxation import RelaxOptions

from .prepare import load_case, mesh_case
from .problem import compare_skins, read_problem, write_problem
from .process import fresh
from .record import Setting, peak_memory
from .tables import markdown, number
from .timing import make_model, run, run_least, warm_up

REFERENCE_TOLERANCE = 1e-3
"""Tolerance of solutions that are compared over meshes or increments [mm]."""


@dataclass(frozen=True, eq=False)
class Size:
    """A simulation of one mesh, with the default tolerance and increments."""

    name: str
    """The problem's."""
    tets: int
    """Tetrahedra."""
    nodes: int
    """Nodes."""
    seconds: float
    """All increments, after set-up."""
    setup_seconds: float
    """Model, preconditioner and recorded launches."""
    linear_iterations: int
    """All increments."""
    steps: int
    """All increments."""
    peak_memory_mb: float
    """Of a process for this mesh alone, or of the device's pool."""
    converged: bool
    """Whether every increment came to its tolerance."""
    skin: Surface
    """The skin after surgery, relaxed to REFERENCE_TOLERANCE."""
    landmarks: Landmarks
    """Those after surgery."""


def sizes(what: Sequence[str], tets: Sequence[int], setting: Setting) -> list[Size]:
    """Measures every problem file of `what`, and every case of it (or the phantom) at each number of tets."""
    measured = []
    with tempfile.TemporaryDirectory() as folder:
        for file in _files(what, tets, Path(folder)):
            size = fresh(measure_size, file, setting)
            measured.append(size)
            print(f"{size.name}, {size.tets} tets: {number(size.seconds)} s", flush=True)
    return sorted(measured, key=lambda size: (size.name, size.tets))


def _files(what: Sequence[str], tets: Sequence[int], folder: Path) -> Iterator[Path]:
    for name in what:
        if name.endswith(".npz"):
            yield Path(name)
            continue
        case = load_case(name)
        for count in tets:
            try:
                problem = mesh_case(case, count)
            except InputError as error:
                print(f"{case.name}: {count} tets could not be made: {error}", flush=True)
                continue
            write_problem(folder / "problem.npz", problem)
            yield folder / "problem.npz"


def measure_size(file: str | Path, setting: Setting) -> Size:
    """One mesh, in a process of its own."""
    problem = read_problem(file)
    path = problem.bone_path()
    warm_up(make_model(problem, setting), path, RelaxOptions())  # compiles and loads the kernels
    start = time.perf_counter()
    model = make_model(problem, setting)
    model_seconds = time.perf_counter() - start
    timed = run_least(model, path, RelaxOptions())
    memory = peak_memory(setting.device)
    end = run(model, path, RelaxOptions(tolerance=REFERENCE_TOLERANCE))
    return Size(
        name=problem.name,
        tets=len(problem.trunk.tets),
        nodes=len(problem.trunk.nodes),
        seconds=timed.seconds,
        setup_seconds=model_seconds + timed.setup_seconds,
        linear_iterations=sum(relaxation.linear_iterations for relaxation in timed.relaxations),
        steps=sum(relaxation.steps for relaxation in timed.relaxations),
        peak_memory_mb=memory,
        converged=timed.converged,
        skin=problem.skin(end.displacement),
        landmarks=problem.landmarks_after,
    )


def size_table(measured: Sequence[Size]) -> str:
    """One row for each mesh of one case, the finest last; skins against that one's."""
    finest = measured[-1]
    rows = []
    for size in measured:
        away = compare_skins(size.skin, finest.skin, finest.landmarks)
        values = (away.max_error_mm, away.mean_skin_error_mm, away.bsr_error_deg)
        rows.append(
            [
                f"{size.tets}" + ("" if size.converged else " (not converged)"),
                str(size.nodes),
                number(size.seconds),
                number(size.setup_seconds),
                str(size.steps),
                str(size.linear_iterations),
                f"{size.peak_memory_mb:.0f}",
                *(["0"] * 3 if size is finest else map(number, values)),
            ]
        )
    header = ["tets", "nodes", "seconds", "set-up [s]", "steps", "linear iterations", "MB"]
    return markdown([*header, "skin max [mm]", "skin mean [mm]", "BSR [degrees]"], rows)
