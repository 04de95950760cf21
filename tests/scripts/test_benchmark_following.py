"""The benchmark of bones that follow is of what `simulate` does with them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from benchmarking.curves import curve
from benchmarking.prepare import as_simulated
from benchmarking.problem import Problem, read_problem, solve_truth, write_problem
from benchmarking.record import Setting
from benchmarking.tables import short_table

from support.small_trunk import small_case
from warp_trunk import RunOptions
from warp_trunk.run.options import SKIN_RIGIDITY
from warp_trunk.run.prediction import prepare


@pytest.mark.slow
def test_a_problem_of_bones_that_follow(tmp_path: Path) -> None:
    """It comes back with their path and the skin, and ends where the simulation of the case does."""
    case, trunk = small_case()
    options = RunOptions(device="cpu", precision="float64", threads=1)
    made = Problem(case.name, trunk, case.tissue, case.landmarks_before, case.planned_landmarks)
    made = as_simulated(made, case, options)
    assert (made.energy, made.skin_rigidity) == ("neo-hookean", SKIN_RIGIDITY)
    write_problem(tmp_path / "problem.npz", replace(made, truth=solve_truth(made)))
    back = read_problem(tmp_path / "problem.npz")
    assert back.bone_path().rigid_bones is not None
    for load_factor in (0.3, 1.0):
        np.testing.assert_array_equal(back.bone_path().at(load_factor), made.bone_path().at(load_factor))
    last = prepare(case, options, trunk).relax().last
    assert back.errors(last.displacement).max_error_mm < 0.01
    setting = Setting(
        method="newton", threads=1, precision="float64", device="cpu", energy=back.energy, bones="follow"
    )
    records = list(curve(back, setting, limit=100.0, repeats=1))
    assert records[-1].max_error_mm < 1e-3
    assert "| newton | follow | neo-Hookean |" in short_table(records)
