"""Cases that break solvers: each ends with finite numbers and the status it is known to end in, or is refused.

A claim of CONVERGED is checked against an equilibrium of an energy written apart (tests/support/reference.py).
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from support.hard_cases import (
    Case,
    Ending,
    crushed,
    end,
    far_away,
    flat_tet_on_top,
    graded,
    mirrored,
    no_free_node,
    noisy,
    reference,
    single_free_node,
    straightened,
    true_error,
    turned_block,
    turned_bone,
    twisted,
)
from support.meshes import block, trunk
from support.reference import volumes
from warp_trunk.engine.build import build_model
from warp_trunk.engine.relaxation import RelaxStatus
from warp_trunk.engine.tissue import Tissue
from warp_trunk.engine.trunk_mesh import TrunkMesh
from warp_trunk.errors import InputError

CASES: dict[str, Callable[[], Case]] = {
    "start with 10 % inverted": lambda: noisy(0.1),
    "start with all inverted (mirrored)": mirrored,
    "sliver, 0.1 degree": lambda: flat_tet_on_top(sliver=True),
    "nearly flat tetrahedron, 0.1 degree": lambda: flat_tet_on_top(sliver=False),
    "edge lengths 1 : 1e4": graded,
    "theta 0": lambda: turned_block(Tissue(theta=0.0)),
    "theta 1e3": lambda: turned_block(Tissue(theta=1e3)),
    "theta 1e5": lambda: turned_block(Tissue(theta=1e5)),
    "theta 1e5, float64": lambda: turned_block(Tissue(theta=1e5), precision="float64"),
    "epsilon 0": lambda: turned_block(Tissue(epsilon=0.0)),
    "epsilon 0 and theta 0": lambda: turned_block(Tissue(epsilon=0.0, theta=0.0)),
    "gravity 1e3 m/s^2": lambda: turned_block(gravity=1e3),
    "gravity 1e5 m/s^2, collapse": lambda: turned_block(gravity=1e5),
    "end turned 90 degrees, 1 increment": lambda: twisted(1),
    "end turned 90 degrees, 20 increments": lambda: twisted(20),
    "bone turned 90 degrees, 1 increment": lambda: turned_bone(1),
    "bone turned 90 degrees, 20 increments": lambda: turned_bone(20),
    "bones crush the tissue, 1 increment": lambda: crushed(1),
    "bones crush the tissue, 10 increments": lambda: crushed(10),
    "110 degree curve, 10 increments": straightened,
    "a single free node": single_free_node,
    "no free node": no_free_node,
    "metres taken for millimetres": lambda: turned_block(scale=1e-3, tolerance=1e-5),
    "micrometres taken for millimetres": lambda: turned_block(scale=1e3, tolerance=10.0),
    "float32, 10 m from the origin": far_away,
}


def two_pieces() -> TrunkMesh:
    one = block((2, 2, 2))
    nodes = np.vstack([one.nodes, one.nodes + 100.0])
    return trunk(nodes, np.vstack([one.tets, one.tets + len(one.nodes)]), np.flatnonzero(one.prescribed))


def not_a_number() -> TrunkMesh:
    mesh = block((2, 2, 2))
    mesh.nodes[5, 1] = np.nan
    return mesh


REFUSED: dict[str, Callable[[], TrunkMesh]] = {
    "no prescribed node": lambda: replace(block((2, 2, 2)), bone=np.full(27, -1, dtype=np.int32)),
    "a piece of tissue without bone": two_pieces,
    "NaN in one coordinate": not_a_number,
}


NOT_CONVERGED = {
    "start with all inverted (mirrored)": RelaxStatus.STALLED,  # itmsm knows no inside
    "edge lengths 1 : 1e4": RelaxStatus.STEP_LIMIT,
    "gravity 1e5 m/s^2, collapse": RelaxStatus.STALLED,
    "bones crush the tissue, 1 increment": RelaxStatus.STALLED,
    "bones crush the tissue, 10 increments": RelaxStatus.STALLED,
}
"""How the cases end that have no equilibrium within reach; all others converge."""


@pytest.mark.parametrize("name", CASES)
def test_ends_in_a_true_way(name: str) -> None:
    ending = check_ending(CASES[name]())
    assert ending.relaxation.status is NOT_CONVERGED.get(name, RelaxStatus.CONVERGED)


CONTINUUM_CASES: dict[str, Callable[[], Case]] = {
    **{
        name: CASES[name]
        for name in CASES
        if not any(word in name for word in ("theta", "epsilon", "crush the tissue, 10", "degrees, 20"))
    },
    "nu 0": lambda: turned_block(Tissue(poisson_ratio=0.0)),
    "nu 0.49": lambda: turned_block(Tissue(poisson_ratio=0.49)),
    "nu 0.499": lambda: turned_block(Tissue(poisson_ratio=0.499)),
    "nu 0.49, 10 % inverted": lambda: replace(noisy(0.1), tissue=Tissue(poisson_ratio=0.49)),
    "nu 0.49, end turned 90 degrees": lambda: replace(twisted(1), tissue=Tissue(poisson_ratio=0.49)),
    "nu 0.49, gravity": lambda: turned_block(Tissue(poisson_ratio=0.49), gravity=9.81),
}


INVERTED = {
    "bones crush the tissue, 1 increment": 18,  # 30 at the start
}
"""Tetrahedra that have no room between bones, at most: several equilibria are near each other."""


@pytest.mark.parametrize("name", CONTINUUM_CASES)
def test_a_continuum_ends_in_a_true_way(name: str) -> None:
    """Also from the mirror image of the trunk, which the energy itmsm cannot leave."""
    ending = check_ending(replace(CONTINUUM_CASES[name](), energy="neo-hookean"))
    if "collapse" in name:  # its end depends on last bits
        return
    if "1e4" in name:  # at its step limit or just before it
        assert ending.relaxation.status in (RelaxStatus.CONVERGED, RelaxStatus.STEP_LIMIT)
        return
    assert ending.relaxation.status is RelaxStatus.CONVERGED
    assert ending.relaxation.inverted_tets <= INVERTED.get(name, 0)


@pytest.mark.parametrize(("tolerance", "threads", "seed"), [(0.1, 1, 0), (0.03, 2, 1)])
def test_nothing_is_claimed_of_a_collapse_that_is_not_so(tolerance: float, threads: int, seed: int) -> None:
    """6 m down the softest direction is 1e9 times as soft as the stiffest, and rounding moves it by 0.2 mm."""
    case = turned_block(gravity=1e5, tolerance=tolerance, threads=threads, energy="neo-hookean")
    noise = 0.1 * np.random.default_rng(seed).normal(size=case.displacement.shape)
    moved = np.where(case.trunk.prescribed[:, None], 0.0, noise)
    check_ending(replace(case, displacement=case.displacement + moved))


def check_ending(case: Case) -> Ending:
    """Ends finite and within its steps, claims nothing false, and the energy itmsm inverts nothing."""
    ending = end(case)
    relaxation = ending.relaxation
    assert np.isfinite(ending.displacement).all()
    assert np.isfinite(relaxation.energy.total)
    assert relaxation.steps <= case.most_steps
    assert case.energy != "itmsm" or ending.new_inversions == 0
    assert relaxation.inverted_tets == pytest.approx(
        (volumes(case.trunk.nodes + ending.displacement, case.trunk.tets) <= 0.0).sum(), abs=2
    )
    energies = [reference(case).energy(case.displacement), *(step.energy.total for step in relaxation.history)]
    assert (np.diff(energies[1:]) <= 1e-6 * np.abs(energies).max()).all()
    if relaxation.status is RelaxStatus.CONVERGED:
        assert relaxation.estimated_error <= case.tolerance
        rounding = 1e-6 * np.abs(ending.displacement).max()
        assert true_error(case, ending) <= 2.0 * relaxation.estimated_error + rounding
    return ending


@pytest.mark.parametrize("name", REFUSED)
def test_is_refused_in_one_line(name: str) -> None:
    with pytest.raises(InputError) as caught:
        build_model(REFUSED[name](), device="cpu", energy="itmsm", skin_rigidity=0.0)
    assert 20 < len(str(caught.value)) < 300
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["start with 10 % inverted", "bone turned 90 degrees, 1 increment", "theta 1e5"])
@pytest.mark.parametrize("threads", [1, 2])
def test_runs_are_equal_to_the_last_bit(name: str, threads: int) -> None:
    one, two = (end(replace(CASES[name](), threads=threads)) for _ in range(2))
    assert (one.displacement == two.displacement).all()
    assert one.relaxation == two.relaxation


@pytest.mark.parametrize("name", ["theta 1e3", "gravity 1e3 m/s^2", "end turned 90 degrees, 20 increments"])
def test_threads_end_at_the_same_place(name: str) -> None:
    one, two = (end(replace(CASES[name](), threads=threads)) for threads in (1, 2))
    assert one.relaxation.status is two.relaxation.status
    assert np.linalg.norm(one.displacement - two.displacement, axis=1).max() <= 4.0 * CASES[name]().tolerance


def test_scale_changes_nothing_but_the_unit() -> None:
    """The same steps in metres, in millimetres and in micrometres."""
    endings = {scale: end(turned_block(scale=scale, tolerance=0.01 * scale)) for scale in (1e-3, 1.0, 1e3)}
    for scale, ending in endings.items():
        assert ending.relaxation.status is RelaxStatus.CONVERGED
        np.testing.assert_allclose(ending.displacement / scale, endings[1.0].displacement, atol=0.02)


def test_distance_from_the_origin_changes_nothing() -> None:
    near, far = end(turned_block()), end(far_away())
    assert np.linalg.norm(near.displacement - far.displacement, axis=1).max() < 1e-4
