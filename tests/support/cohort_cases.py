"""Small cases for a cohort: a coarse trunk with a few bones, whose actual skin is known."""

from dataclasses import replace
from functools import cache
from pathlib import Path

from warp_trunk.case import Case, write_case
from warp_trunk.case.case import Study
from warp_trunk.cohort.one_case import CohortOptions
from warp_trunk.engine.simulation import SimulationOptions
from warp_trunk.geometry.coarsening import coarsen
from warp_trunk.meshing import MeshOptions
from warp_trunk.run.options import Execution, RunOptions

from .meshes import turned_about_z
from .small_case import small_case


def cohort_options() -> CohortOptions:
    """With these such a case takes some seconds, on one thread."""
    return CohortOptions(
        run=RunOptions(
            mesh=MeshOptions(tets=8000, bone_voxel=8.0),
            simulation=SimulationOptions(increments=1),
        ),
        execution=Execution(device="cpu", threads=1, record=False),
    )


@cache
def coarse_case() -> Case:
    """The small case with a coarse skin."""
    case = small_case()
    return replace(case, name="coarse", skin=coarsen(case.skin, 30.0, 6.0))


def turned_case(name: str, degrees: float, study: Study | None = None) -> Case:
    """The coarse case whose actual skin is that before surgery, turned about the vertical by an angle."""
    case = coarse_case()
    actual = case.skin.moved(turned_about_z(case.skin.vertices, degrees))
    return replace(case, name=name, actual_skin=actual, study=study or Study())


def write_cohort_cases(folder: Path) -> Path:
    """Three good cases of two patients and one that is broken."""
    write_case(folder / "a", turned_case("first", 1.0, Study(patient="P1", months_after=6.0, synthetic=True)))
    write_case(folder / "b", turned_case("second", -2.0, Study(patient="P1", months_after=12.0, synthetic=True)))
    write_case(folder / "c", turned_case("third", 3.0, Study(patient="P2", months_after=24.0, synthetic=True)))
    write_case(folder / "d", turned_case("broken", 0.0))
    (folder / "d" / "landmarks_before.csv").unlink()
    return folder


SAME_IN_ALL = ("predicted_skin.ply", "trunk.vtu", "landmarks_after.csv", "actual_skin.ply")
"""Files of a result that hold no time."""


def contents(out: Path, names: str) -> dict[str, bytes]:
    """Bytes of the results of some cases, which are named by one letter each."""
    return {f"{name}/{file}": (out / name / file).read_bytes() for name in names for file in SAME_IN_ALL}
