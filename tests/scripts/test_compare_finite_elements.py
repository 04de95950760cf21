"""The comparison with scikit-fem: its solvers solve, its records are right. No time is tested."""

import importlib.util
import json
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import compare_finite_elements
import numpy as np
import pytest
from benchmarking.problem import Problem
from finite_elements.compare import Comparison
from finite_elements.linear import Pardiso, cholmod, jacobi, multigrid, superlu
from finite_elements.motions import rigid_motions
from finite_elements.neo_hookean import NeoHookean
from finite_elements.newton import NotConvergedError, equilibrium
from finite_elements.solid import Solid

from support.meshes import block
from support.small_trunk import small_case

PACKAGES = {Pardiso: "pypardiso", cholmod: "cvxopt", multigrid: "pyamg"}


@cache
def problem() -> Problem:
    """A box of tissue around a column whose T8 moves by 12 mm."""
    case, trunk = small_case()
    return Problem(case.name, trunk, case.tissue, case.landmarks_before, case.planned_landmarks)


@pytest.mark.parametrize("factorise", [superlu, jacobi, *PACKAGES], ids=lambda solver: solver.__name__)
def test_linear_solver(factorise: Callable[..., Any]) -> None:
    package = PACKAGES.get(factorise)
    if package and importlib.util.find_spec(package) is None:
        pytest.skip(f"{package} is not installed; uv sync --group fem")
    solver = Pardiso() if factorise is Pardiso else factorise
    for cells, modulus in ((4, 1.0), (4, 3.0), (3, 3.0)):  # the same places of entries, and others
        trunk = block((cells, cells, cells))
        free = np.flatnonzero(~trunk.prescribed)
        unknown = np.concatenate([free + component * len(trunk.nodes) for component in range(3)])
        solid = Solid(trunk.nodes, trunk.tets, NeoHookean(modulus, 0.45))
        matrix = solid.stiffness(np.zeros_like(trunk.nodes))[unknown][:, unknown]
        wanted = np.random.default_rng(0).normal(size=len(unknown))
        found = solver(matrix, trunk.nodes[free])(matrix @ wanted)
        assert np.abs(found - wanted).max() < 1e-3  # conjugate gradients end at a residual of 1e-6


def test_no_force_resists_a_rigid_motion_at_rest() -> None:
    """Which smoothed aggregation is told of."""
    trunk = block((3, 3, 3))
    stiffness = Solid(trunk.nodes, trunk.tets, NeoHookean(1.0, 0.45)).stiffness(np.zeros_like(trunk.nodes))
    motions = rigid_motions(trunk.nodes)
    assert np.linalg.matrix_rank(motions) == 6
    by_component = motions.reshape(-1, 3, 6).transpose(1, 0, 2).reshape(-1, 6)
    np.testing.assert_allclose(stiffness @ by_component, 0.0, atol=1e-10)


def test_says_when_no_step_helps() -> None:
    trunk = block((2, 2, 2))
    solid = Solid(trunk.nodes, trunk.tets, NeoHookean(1.0, 0.45))
    start = np.zeros_like(trunk.nodes)
    start[~trunk.prescribed] = 2.0
    with pytest.raises(NotConvergedError, match="no step lowers the energy in step 1"):
        equilibrium(solid, start, trunk.prescribed, lambda matrix, _: lambda b: -superlu(matrix, _)(b))


def test_stays_at_rest() -> None:
    trunk = block((2, 2, 2))
    solid = Solid(trunk.nodes, trunk.tets, NeoHookean(1.0, 0.45))
    found = equilibrium(solid, np.zeros_like(trunk.nodes), trunk.prescribed, superlu)
    assert found.steps == 1
    np.testing.assert_allclose(found.displacement, 0.0, atol=1e-12)


def test_both_ends_are_the_same() -> None:
    comparison = Comparison(problem(), gravity=3.0, factorise=superlu)
    assert np.linalg.norm(comparison.truth - comparison.path.displacement, axis=1).max() > 1.0
    assert comparison.distances(comparison.simulated("float64", 1e-6)).max() < 1e-5


def test_kept_factors_spare_factorisations_and_take_more_steps() -> None:
    comparison = Comparison(problem(), gravity=3.0, factorise=superlu)
    held, start = problem().trunk.prescribed, comparison.path.displacement
    newton, kept = (equilibrium(comparison.solid, start, held, superlu, keep=keep) for keep in (0.0, 0.7))
    assert kept.factorisations < newton.factorisations == newton.steps < kept.steps
    assert max(comparison.distances(found.displacement).max() for found in (newton, kept)) < 1e-6


def test_script(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A record takes the place of one of the same problem; the solution is kept with its mesh."""
    solvers = {"LU": superlu, "CG": jacobi}
    arguments = ["phantom", "--solvers", "--json", str(tmp_path / "a" / "records.json")]
    for nu in ("0.3", "0.4", "0.4"):
        flags = [*arguments, "--nu", nu, "--out", str(tmp_path / "b" / "kept.npz")]
        compare_finite_elements.main(flags, problem(), solvers)
    records = json.loads((tmp_path / "a" / "records.json").read_text())
    assert [record["poisson_ratio"] for record in records] == [0.3, 0.4]
    assert records[1]["distance_mm"]["float64"]["max"] < 1e-5
    assert [run["solver"] for run in records[1]["linear"]] == ["LU", "CG"]
    kept = np.load(tmp_path / "b" / "kept.npz")
    solid = Solid(kept["nodes"], kept["tets"], NeoHookean(1e-2, float(kept["poisson_ratio"])))
    forces = solid.forces(kept["displacement"])
    free = kept["bone"] < 0
    assert np.abs(forces[free]).max() < 1e-9 * np.abs(forces).max()
    np.testing.assert_array_equal(kept["displacement"][~free], kept["bone_displacement"][~free])
    assert "LU" in capsys.readouterr().out
