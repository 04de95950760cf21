"""Claims of a relaxation at its end: no saddle, and the distance to the minimum of an energy written apart."""

import numpy as np
import pytest

from support.meshes import block, rotate, single_tet
from support.reference import Reference
from support.threads import split_launches
from warp_trunk.engine.build import build_model
from warp_trunk.engine.newton import Relaxer
from warp_trunk.engine.relaxation import Method, Relaxation, RelaxOptions, RelaxStatus
from warp_trunk.engine.tissue import Tissue
from warp_trunk.engine.trunk_mesh import TrunkMesh


def relaxed(
    trunk: TrunkMesh,
    tissue: Tissue,
    start: np.ndarray,
    precision: str,
    tolerance: float = 0.01,
    method: Method = "newton",
) -> tuple[Relaxation, np.ndarray]:
    model = build_model(
        trunk, tissue, precision=precision, device=split_launches(), energy="itmsm", skin_rigidity=0.0
    )
    relaxer = Relaxer(model, RelaxOptions(method=method, tolerance=tolerance, max_steps=300))
    relaxer.state.set_displacement(start)
    return relaxer.relax(), relaxer.state.host_displacement()


@pytest.mark.parametrize("method", ["newton", "conjugate", "gradient"])
@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_a_saddle_is_left_although_no_force_points_away_from_it(precision: str, method: Method) -> None:
    """A corner held by three edges lies in the plane of their ends: there it is pressed, but not out of it."""
    trunk, edges = single_tet(), Tissue(epsilon=0.0, theta=0.0)
    start = np.zeros_like(trunk.nodes)
    start[3] = [2.0, 2.0, -10.0]
    reference = Reference(trunk, edges)
    assert reference.gradient(start)[3, 2] == 0.0
    relaxation, found = relaxed(trunk, edges, start, precision, method=method)
    if method != "newton" and relaxation.status is RelaxStatus.STALLED:
        return  # it sees no way down, and claims nothing
    assert relaxation.status is RelaxStatus.CONVERGED
    assert abs(trunk.nodes[3, 2] + found[3, 2]) > 5.0
    assert np.linalg.eigvalsh(reference.hessian(found))[0] > 0.0
    assert reference.error(found) <= 2.0 * relaxation.estimated_error


@pytest.mark.parametrize("theta", [0.0, 10.0, 1000.0])
def test_rounding_is_part_of_the_distance(theta: float) -> None:
    """In float32 no tolerance is claimed below what rounding leaves; where one is claimed, it holds."""
    trunk = block((2, 2, 2))
    start = np.where(trunk.prescribed[:, None], rotate(trunk.nodes, 40.0, (1.0, 0.3, 1.0)) - trunk.nodes, 0.0)
    tissue = Tissue(theta=theta)
    for tolerance in (1e-3, 1e-4, 1e-7):
        relaxation, found = relaxed(trunk, tissue, start, "float32", tolerance)
        if tolerance in (1e-3, 1e-7):
            assert (relaxation.status is RelaxStatus.CONVERGED) == (tolerance == 1e-3)
        if relaxation.status is RelaxStatus.CONVERGED:
            assert Reference(trunk, tissue).error(found, 1e-9) <= 2.0 * relaxation.estimated_error


def test_what_is_on_the_way_is_not_claimed() -> None:
    trunk = block((2, 2, 2))
    start = np.where(trunk.prescribed[:, None], rotate(trunk.nodes, 20.0) - trunk.nodes, 0.0)
    relaxer = Relaxer(
        build_model(trunk, device=split_launches(), energy="itmsm", skin_rigidity=0.0),
        RelaxOptions(tolerance=1e-3),
    )
    relaxer.state.set_displacement(start)
    assert relaxer.relax(confirm=False).status is RelaxStatus.NEAR
    assert relaxer.relax(near=True).status is RelaxStatus.CONVERGED
    assert Reference(trunk).error(relaxer.state.host_displacement(), 1e-6) <= 2e-3
