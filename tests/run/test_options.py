"""Defaults of options, and no option without effect: the table of readers against the forces of the tissue."""

import re
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from support import small_trunk
from support.asserting import refuses
from warp_trunk.case.rib_coupling import RibCoupling
from warp_trunk.cli.arguments import parse_command
from warp_trunk.cli.simulate import Simulate
from warp_trunk.engine.relaxation import RelaxOptions
from warp_trunk.engine.simulation import SimulationOptions
from warp_trunk.engine.state import State
from warp_trunk.engine.tissue import Tissue
from warp_trunk.meshing import MeshOptions
from warp_trunk.run.options import SKIN_RIGIDITY, Execution, RunOptions, parameters
from warp_trunk.run.patient import MeshedPatient
from warp_trunk.run.simulate import simulate
from warp_trunk.run.unread_options import READERS, RunChoices, refuse_unread


@pytest.mark.parametrize(
    ("changes", "energy", "rigidity"),
    [
        ({"bones": "spline"}, "itmsm", 0.0),
        ({"bones": "follow"}, "neo-hookean", SKIN_RIGIDITY),
        ({"bones": "follow", "weights": "volume"}, "itmsm", SKIN_RIGIDITY),
        ({"bones": "follow", "skin_rigidity": 0.0}, "neo-hookean", 0.0),
        ({"bones": "spline", "skin_rigidity": 0.2}, "itmsm", 0.2),
    ],
)
def test_energy_and_stiff_skin_go_by_how_bones_move(changes, energy, rigidity) -> None:
    options = RunOptions(**changes)
    taken = parameters(options)
    assert options.energy_of_tissue == taken["energy"] == energy
    assert options.rigidity_of_skin == taken["skin_rigidity"] == rigidity


def test_the_rigidity_is_that_of_skin_2_mm_thick_by_torsion() -> None:
    """E h^3 / (12 (1 - nu^2)) of 0.42 N/mm^2, 2 mm, and a volume that does not change, to a tenth."""
    assert pytest.approx(0.42 * 2.0**3 / (12.0 * 0.75), rel=0.1) == SKIN_RIGIDITY


CASE, TRUNK = small_trunk.small_case()
MOVED = np.random.default_rng(2).normal(scale=3.0, size=TRUNK.nodes.shape)
OTHER_VALUES = {
    "epsilon": 3.0, "theta": 40.0, "poisson_ratio": 0.2, "density": 700.0, "youngs_modulus": 50.0,
    "weights": "volume", "alpha": 0.02, "gravity": 5.0, "rest": "scan",
}  # fmt: skip
SCENES: list[dict[str, Any]] = [
    {"energy": energy, "skin_rigidity": skin, **heavy}
    for energy, skin, heavy in (
        ("itmsm", 0.0, {}), ("itmsm", 400.0, {}), ("itmsm", 400.0, {"gravity": 9.81}),
        ("itmsm", 0.0, {"alpha": 0.01}), ("itmsm", 400.0, {"alpha": 0.01}), ("neo-hookean", 0.0, {}),
        ("neo-hookean", 0.0, {"gravity": 9.81}), ("neo-hookean", 400.0, {}),
    )
]  # fmt: skip


def pull(scene: dict[str, Any], **constants: float) -> np.ndarray:
    """The direction of all forces on the free nodes of the moved box, float64."""
    options = RunOptions(bones="spline", precision="float64", **scene)
    case = replace(CASE, tissue=Tissue(**constants))
    model = MeshedPatient(case, options, Execution(device="cpu", threads=1), TRUNK, None).modelled().model
    state = State(model)
    state.set_displacement(MOVED)
    state.evaluate()
    gradient = state.gradient.numpy()[model.free]
    return gradient / np.linalg.norm(gradient)


@pytest.mark.parametrize("scene", SCENES, ids=lambda scene: " ".join(map(str, scene.values())))
def test_what_the_table_calls_read_moves_the_tissue_and_nothing_else_does(scene: dict[str, Any]) -> None:
    usual = pull(scene)
    constants = {field.name for field in fields(Tissue)}
    for name, value in OTHER_VALUES.items():
        options = RunOptions(bones="spline", **scene)
        reads = READERS[name].reads(RunChoices(options, layered=False))
        if (not reads and name in ("alpha", "weights", "gravity")) or (name == "alpha" and "gravity" in scene):
            continue  # refused by the model itself
        pulled = pull(scene, **{name: float(value)}) if name in constants else pull({**scene, name: value})
        assert (np.abs(pulled - usual).max() > 1e-9) == reads, name


GRADIENT = SimulationOptions(relax=RelaxOptions(method="gradient"))
SPRINGS: dict[str, Any] = {"energy": "itmsm"}
REFUSED: list[tuple[dict[str, Any], str]] = [
    ({"constants": {"theta": 10.0}}, "--theta: used by --energy itmsm; add it, or leave --theta out"),
    ({**SPRINGS, "constants": {"poisson_ratio": 0.3}}, "--poisson-ratio: used by --energy neo-hookean; add it"),
    (
        {**SPRINGS, "alpha": 0.3, "constants": {"youngs_modulus": 5.0}},
        "--youngs-modulus: is not used with --alpha; leave one",
    ),
    ({**SPRINGS, "alpha": 0.3, "gravity": 5.0}, "--gravity: is not used with --alpha"),
    ({"rest": "scan"}, "--rest: used by --gravity 9.81"),
    (
        {"from_mesh": Path("a.vtu"), "mesh": MeshOptions(bone_voxel=3.0)},
        "--bone-voxel: is not used with --from-mesh",
    ),
    ({"bones": "spline", "constants": {"ribs.upper": 0.0}}, "constant 'ribs.upper': used by --bones follow"),
    ({"simulation": GRADIENT, "bands": True}, "--bands: used by --method newton; add it, or leave --bands out"),
]


@pytest.mark.parametrize(("options", "said"), REFUSED)
def test_the_refusal_names_what_makes_an_option_count(options: dict[str, Any], said: str) -> None:
    with refuses(begins=said):
        refuse_unread(RunOptions(**options))


def test_an_option_that_some_case_reads_is_refused_for_a_case_that_does_not() -> None:
    options = RunOptions(bones="spline", energy="neo-hookean", constants={"youngs_modulus": 5.0})
    refuse_unread(options)  # layers would weigh it
    with refuses(begins="--youngs-modulus: used by --gravity 9.81"):
        refuse_unread(options, CASE)


@pytest.mark.parametrize(
    ("change", "options", "said"),
    [
        ({"tissue": Tissue(theta=50.0)}, {}, "[tissue] theta"),
        ({"rib_coupling": RibCoupling(reversible_part=0.5)}, {"bones": "spline"}, "[ribs] reversible_part"),
        ({}, {"weights": "volume", "energy": "neo-hookean"}, "--weights"),
    ],
)
def test_python_and_case_files_are_judged_by_the_same_table(
    change: dict[str, Any], options: dict[str, Any], said: str
) -> None:
    with refuses(begins=said):
        simulate(replace(CASE, **change), options=RunOptions(**options))


def test_the_papers_are_five_options() -> None:
    papers = replace(RunOptions.of_papers(), alpha=0.3)
    assert (papers.bones, papers.energy_of_tissue, papers.rest, papers.weights) == (
        "spline",
        "itmsm",
        "scan",
        "count",
    )
    assert (papers.rigidity_of_skin, papers.alpha) == (0.0, 0.3)


BESIDE_PAPERS = [
    "", "--bones follow", "--bones spline", "--energy itmsm", "--energy neo-hookean", "--rest scan",
    "--rest sag-free", "--weights count", "--weights volume", "--skin-rigidity 0", "--skin-rigidity 0.4",
    "--alpha 0", "--alpha 0.3", "--epsilon 2", "--theta 5", "--youngs-modulus 12", "--density 900", "--gravity 0",
    "--gravity 9.81", "--increments 3", "--method gradient", "--method newton", "--max-steps 50",
    "--tolerance 0.01", "--tets 5000", "--bands",
]  # fmt: skip


@pytest.mark.parametrize("option", BESIDE_PAPERS)
def test_every_option_of_the_papers_page_goes_with_papers(option: str) -> None:
    """Nothing that only --papers set is refused, and no symbol that is reported."""
    command = parse_command(Simulate, ["simulate", "patient", "--papers", *option.split()])
    refuse_unread(command.chosen, CASE)


def test_the_table_holds_the_options_of_the_page() -> None:
    page = (Path(__file__).parents[2] / "docs" / "papers.md").read_text(encoding="utf-8")
    options = set(re.findall(r"`(--[a-z-]+)", page)) - {"--papers"}
    assert options <= {beside.split()[0] for beside in BESIDE_PAPERS if beside}
