"""No option without effect: the table of readers against the forces of the tissue in every scene."""

from dataclasses import fields, replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from support.asserting import refuses
from support.small_trunk import small_case
from warp_trunk.case.rib_coupling import RibCoupling
from warp_trunk.engine.state import State
from warp_trunk.engine.tissue import Tissue
from warp_trunk.run.options import RunOptions, with_changes
from warp_trunk.run.patient import patient_of
from warp_trunk.run.simulate import simulate
from warp_trunk.run.unread_options import READERS, Scene, refuse_unread

CASE, TRUNK = small_case()
MOVED = np.random.default_rng(2).normal(scale=3.0, size=TRUNK.nodes.shape)
OTHER = {
    "epsilon": 3.0, "theta": 40.0, "poisson_ratio": 0.2, "density": 700.0, "youngs_modulus": 50.0,
    "weights": "volume", "alpha": 0.02, "gravity": 5.0, "rest": "scan",
}  # fmt: skip
SCENES: list[dict[str, Any]] = [
    {"energy": energy, "skin_rigidity": skin, **heavy}
    for energy, skin, heavy in product(
        ("itmsm", "neo-hookean"), (0.0, 400.0), ({}, {"gravity": 9.81}, {"alpha": 0.01})
    )
    if not (energy == "neo-hookean" and "alpha" in heavy)
]


def pull(scene: dict[str, Any], **constants: float) -> np.ndarray:
    """The direction of all forces on the free nodes of the moved box, float64."""
    options = RunOptions(bones="spline", device="cpu", threads=1, precision="float64", **scene)
    model = patient_of(replace(CASE, tissue=Tissue(**constants)), options, TRUNK).model
    state = State(model)
    state.set_displacement(MOVED)
    state.evaluate()
    gradient = state.gradient.numpy()[model.free]
    return gradient / np.linalg.norm(gradient)


@pytest.mark.parametrize("scene", SCENES, ids=lambda scene: " ".join(map(str, scene.values())))
def test_what_the_table_calls_read_moves_the_tissue_and_nothing_else_does(scene: dict[str, Any]) -> None:
    usual = pull(scene)
    constants = {field.name for field in fields(Tissue)}
    for name, value in OTHER.items():
        options = RunOptions(bones="spline", **scene)
        reads = READERS[name].reads(Scene(options, layered=False))
        if (not reads and name in ("alpha", "weights", "gravity")) or (name == "alpha" and "gravity" in scene):
            continue  # refused by the model itself
        found = pull(scene, **{name: float(value)}) if name in constants else pull({**scene, name: value})
        assert (np.abs(found - usual).max() > 1e-9) == reads, name


REFUSED = [
    ({}, "--theta", "--theta: used by --energy itmsm; add it, or leave --theta out"),
    ({"energy": "itmsm"}, "--poisson-ratio", "--poisson-ratio: used by --energy neo-hookean; add it"),
    (
        {"alpha": 0.3, "energy": "itmsm"},
        "--youngs-modulus",
        "--youngs-modulus: is not used with --alpha; leave one",
    ),
    ({"alpha": 0.3, "energy": "itmsm"}, "--gravity", "--gravity: is not used with --alpha"),
    ({}, "--rest", "--rest: used by --gravity 9.81"),
    ({"from_mesh": Path("a.vtu")}, "--bone-voxel", "--bone-voxel: is not used with --from-mesh"),
    ({"bones": "spline"}, "[ribs] axial_rotation", "[ribs] axial_rotation: used by --bones follow"),
    ({"method": "gradient"}, "bands", "bands: used by method newton; add it, or leave bands out"),
]


@pytest.mark.parametrize(("options", "called", "said"), REFUSED)
def test_the_refusal_names_what_makes_an_option_count(options: dict[str, Any], called: str, said: str) -> None:
    name = "ribs" if "ribs" in called else called.removeprefix("--").replace("-", "_")
    with refuses(begins=said):
        refuse_unread({name: called}, with_changes(RunOptions(), options), layered=False)


@pytest.mark.parametrize(
    ("change", "options", "said"),
    [
        ({"tissue": Tissue(theta=50.0)}, {}, "[tissue] theta"),
        ({"rib_coupling": RibCoupling(reversible_part=0.5)}, {"bones": "spline"}, "[ribs] reversible_part"),
        ({}, {"weights": "volume", "energy": "neo-hookean"}, "weights"),
    ],
)
def test_python_and_case_files_are_judged_by_the_same_table(
    change: dict[str, Any], options: dict[str, Any], said: str
) -> None:
    with refuses(begins=said):
        simulate(replace(CASE, **change), **options)


def test_the_papers_are_five_options_that_each_can_be_changed() -> None:
    papers = RunOptions.of_papers(alpha=0.3)
    assert (papers.bones, papers.energy_of_tissue, papers.rest, papers.weights) == (
        "spline",
        "itmsm",
        "scan",
        "count",
    )
    assert (papers.rigidity_of_skin, papers.alpha) == (0.0, 0.3)
    assert RunOptions.of_papers(bones="follow") == replace(RunOptions.of_papers(), bones="follow")
