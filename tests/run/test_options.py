"""Defaults of options."""

from typing import Any

import pytest

import warp_trunk as wt
from support.asserting import refuses
from support.small_case import small_case
from warp_trunk.run.options import SKIN_RIGIDITY, RunOptions, parameters


@pytest.mark.parametrize(
    ("given", "energy", "rigidity"),
    [
        ({"bones": "spline"}, "itmsm", 0.0),
        ({"bones": "follow"}, "neo-hookean", SKIN_RIGIDITY),
        ({"bones": "follow", "weights": "volume"}, "itmsm", SKIN_RIGIDITY),
        ({"bones": "follow", "skin_rigidity": 0.0}, "neo-hookean", 0.0),
        ({"bones": "spline", "skin_rigidity": 0.2}, "itmsm", 0.2),
    ],
)
def test_energy_and_stiff_skin_go_by_how_bones_move(given, energy, rigidity) -> None:
    options = RunOptions(**given)
    taken = parameters(options)
    assert options.energy_of_tissue == taken["energy"] == energy
    assert options.rigidity_of_skin == taken["skin_rigidity"] == rigidity


def test_the_rigidity_is_that_of_skin_2_mm_thick_by_torsion() -> None:
    """E h^3 / (12 (1 - nu^2)) of 0.42 N/mm^2, 2 mm, and a volume that does not change, to a tenth."""
    assert pytest.approx(0.42 * 2.0**3 / (12.0 * 0.75), rel=0.1) == SKIN_RIGIDITY


ANY: Any = wt


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda case: ANY.simulate("patient"), "simulate: 'case' must be of type Case, not str; read it with"),
        (lambda case: ANY.simulate(case, "T4"), "a plan must be of type Plan, not str; give wt.Plan"),
        (lambda case: ANY.simulate(case, ["T4"]), "a plan must be of type Plan, not str"),
        (lambda case: ANY.simulate(case, tets="many"), "mesh: 'tets' must be a number from 4"),
        (lambda case: ANY.Plan(uiv="T4", liv="L1", curves="T8"), "'curves' must be of type list | tuple, not str"),
        (
            lambda case: ANY.Plan(uiv="T4", liv="L1", curves=ANY.CurvePlan("T8")),
            "give a list such as [wt.CurvePlan(",
        ),
        (lambda case: ANY.Plan(uiv="T4"), "plan: 'liv' is missing"),
        (
            lambda case: ANY.read_case(None),
            "read_case: 'folder' must be a path, as text or pathlib.Path",
        ),
        (lambda case: ANY.read_surface(5), "read_surface: 'path' must be a path"),
        (lambda case: ANY.read_result(b"r"), "read_result: 'folder' must be a path"),
        (lambda case: ANY.read_plan(None), "read_plan: 'path' must be a path"),
        (lambda case: ANY.read_motions(None), "read_motions: 'path' must be a path"),
        (lambda case: ANY.write_surface(None, case.skin), "write_surface: 'path' must be a path"),
        (lambda case: ANY.write_surface("a.ply", None), "write_surface: 'surface' must be of type Surface"),
        (lambda case: ANY.write_plan("a.toml", None), "write_plan: 'plan' must be of type Plan"),
        (lambda case: ANY.Plan(uiv="T4", liv="L1", curves=[{}]), "a curve must be of type CurvePlan, not dict"),
        (lambda case: ANY.RunOptions(bones="ribs"), "options: 'bones' must be follow or spline, not 'ribs'"),
        (lambda case: ANY.RunOptions(precision="double"), "'precision' must be float32 or float64"),
        (lambda case: ANY.RunOptions(energy="springs"), "'energy' must be "),
        (lambda case: ANY.write_case("a", 5), "write_case: 'case' must be of type Case, not int"),
    ],
)
def test_another_kind_is_refused_in_one_line(call, said):
    with refuses(said):
        call(small_case())
