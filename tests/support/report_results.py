"""Result folders for tests of pages: the small trunk, turned by known angles."""

from dataclasses import replace
from functools import cache
from pathlib import Path

from warp_trunk.engine.build import build_model
from warp_trunk.engine.model import Model
from warp_trunk.engine.parallel import Parallel
from warp_trunk.engine.physics import Physics
from warp_trunk.engine.relaxation import RelaxStatus
from warp_trunk.results import RunAccount, result_of

from .small_trunk import made_up_increments, small_case


@cache
def result_model() -> Model:
    """Options of these results."""
    _, trunk = small_case()
    return build_model(
        trunk,
        physics=Physics(energy="itmsm", skin_rigidity=0.0),
        device=Parallel("cpu", 1),
        precision="float64",
    )


def write_small_result(folder: Path, *, name: str = "small", status: RelaxStatus = RelaxStatus.CONVERGED) -> Path:
    """Write a result whose last relaxation ended so; the prediction is turned by 12 degrees at T4, evenly less
    towards 0 at the bottom."""
    case, trunk = small_case()
    increments = made_up_increments(trunk, status=status)
    run = RunAccount(parameters={"tolerance": 0.01}, seconds={"total": 1.0})
    result_of(replace(case, name=name), trunk, result_model(), increments, run).save(folder)
    return folder
