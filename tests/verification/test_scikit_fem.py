"""The independent solver itself: its linear solvers solve, its Newton's method ends where it says."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.sparse import csr_array

from support.finite_elements.linear import jacobi, superlu
from support.finite_elements.neo_hookean import NeoHookean
from support.finite_elements.newton import NotConvergedError, equilibrium
from support.finite_elements.solid import Solid
from support.meshes import block
from support.small_trunk import small_case
from warp_trunk.bone_motion.bone_path import spline_path


@pytest.mark.parametrize("factorise", [superlu, jacobi])
def test_linear_solver(factorise: Callable[[csr_array], Any]) -> None:
    trunk = block((4, 4, 4))
    free = np.flatnonzero(~trunk.prescribed)
    unknown = np.concatenate([free + component * len(trunk.nodes) for component in range(3)])
    solid = Solid(trunk.nodes, trunk.tets, NeoHookean(3.0, 0.45))
    matrix = solid.stiffness(np.zeros_like(trunk.nodes))[unknown][:, unknown]
    wanted = np.random.default_rng(0).normal(size=len(unknown))
    found = factorise(matrix)(matrix @ wanted)
    assert np.abs(found - wanted).max() < 1e-3  # conjugate gradients end at a residual of 1e-6


def test_says_when_no_step_helps() -> None:
    trunk = block((2, 2, 2))
    solid = Solid(trunk.nodes, trunk.tets, NeoHookean(1.0, 0.45))
    start = np.zeros_like(trunk.nodes)
    start[~trunk.prescribed] = 2.0
    with pytest.raises(NotConvergedError, match="no step lowers the energy in step 1"):
        equilibrium(solid, start, trunk.prescribed, lambda matrix: lambda b: -superlu(matrix)(b))


def test_stays_at_rest() -> None:
    trunk = block((2, 2, 2))
    solid = Solid(trunk.nodes, trunk.tets, NeoHookean(1.0, 0.45))
    found = equilibrium(solid, np.zeros_like(trunk.nodes), trunk.prescribed, superlu)
    assert found.steps == 1
    np.testing.assert_allclose(found.displacement, 0.0, atol=1e-12)


def test_kept_factors_spare_factorisations_and_take_more_steps() -> None:
    case, trunk = small_case()
    start = spline_path(trunk.nodes, case.landmarks_before, case.planned_landmarks).displacement
    solid = Solid(trunk.nodes, trunk.tets, NeoHookean(1e-3 * case.tissue.youngs_modulus, 0.45))
    newton, kept = (equilibrium(solid, start, trunk.prescribed, superlu, keep=keep) for keep in (0.0, 0.7))
    assert kept.factorisations < newton.factorisations == newton.steps < kept.steps
    assert np.abs(newton.displacement - kept.displacement).max() < 1e-6
