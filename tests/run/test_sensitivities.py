"""Sensitivities of a prediction, against central differences of whole simulations."""

from dataclasses import replace
from typing import Literal

import numpy as np
import pytest

from support.anatomy import anatomy
from support.phantoms import coarse_mesh, coarse_phantom, whole_phantom
from support.small_trunk import LEVELS, boned_case
from warp_trunk.case import Case
from warp_trunk.case.layers import FAT_THICKNESS, SKIN_THICKNESS, Layers
from warp_trunk.engine.energies.by_name import EnergyName
from warp_trunk.engine.relaxation import RelaxOptions
from warp_trunk.engine.simulation import SimulationOptions
from warp_trunk.engine.tissue import Tissue
from warp_trunk.engine.trunk_mesh import TrunkMesh
from warp_trunk.geometry.coarsening import coarsen
from warp_trunk.measures import TrunkMeasures
from warp_trunk.measures.derivatives import WAIST
from warp_trunk.measures.quantities import QUANTITIES
from warp_trunk.meshing import MeshOptions
from warp_trunk.preparation.deformity import SpineCurve, make_case
from warp_trunk.run.options import Execution, RunOptions
from warp_trunk.run.prediction import Prediction, prepare, prepare_plan
from warp_trunk.run.sensitivities import Sensitivity, sensitivities
from warp_trunk.run.sources import sources_of

WITHIN = 0.03
"""Part of the largest change of a number of its kind by which a derivative may miss the difference."""
DIFFERENCE = 1e-3
"""Length of a direction of all landmarks [mm]: no point of contact jumps on the way."""


ON_CPU = Execution(device="cpu")


def options_of(
    energy: EnergyName, bones: Literal["spline", "follow"] = "spline", mesh: MeshOptions | None = None
) -> RunOptions:
    return RunOptions(
        energy=energy,
        bones=bones,
        mesh=mesh or coarse_mesh(),
        simulation=SimulationOptions(increments=1, relax=RelaxOptions(tolerance=1e-7)),
        precision="float64",
    )


class Simulated:
    """A case that was simulated, and can be simulated again with other landmarks or constants."""

    def __init__(self, case: Case, options: RunOptions, trunk: TrunkMesh | None = None) -> None:
        self.case, self.options = case, options
        self.prediction = self.relaxed(prepare(case, options, trunk, execution=ON_CPU))
        self.sensitivities = sensitivities(self.prediction)

    def relaxed(self, prediction: Prediction) -> Prediction:
        assert prediction.relax().converged
        return prediction

    def with_landmarks(self, before: np.ndarray, after: np.ndarray) -> np.ndarray:
        """The numbers where landmarks have moved."""
        marks, planned = self.case.landmarks_before, self.case.planned_landmarks
        case = replace(
            self.case,
            landmarks_before=replace(marks, points=marks.points + before),
            landmarks_after=replace(marks, points=planned.points + after),
        )
        return self.numbers(self.relaxed(prepare_plan(self.prediction.patient, case)))

    def with_tissue(self, tissue: Tissue) -> np.ndarray:
        """The numbers of another tissue."""
        case = replace(self.case, tissue=tissue)
        return self.numbers(self.relaxed(prepare(case, self.options, self.prediction.trunk, execution=ON_CPU)))

    def numbers(self, prediction: Prediction) -> np.ndarray:
        """Those of `sensitivities`, measured again."""
        measured = prediction.measures_at(prediction.last)
        return np.array([self.number(s, measured) for s in self.sensitivities], dtype=np.float64)

    def number(self, s: Sensitivity, measured: TrunkMeasures) -> float | None:
        return QUANTITIES[s.quantity].function(measured, measured)[s.level]


def agree(names: list[str], predicted: np.ndarray, wanted: np.ndarray) -> None:
    """Each within 2 % of the largest change of its kind."""
    for kind in set(names):
        of_kind = [name == kind for name in names]
        worst = np.abs(predicted - wanted)[of_kind].max()
        assert worst <= WITHIN * np.abs(wanted)[of_kind].max(), (kind, predicted[of_kind], wanted[of_kind])


def check_landmarks(simulated: Simulated, directions: int) -> None:
    shape = simulated.case.landmarks_before.points.shape
    predicted, wanted = [], []
    for seed in range(directions):
        before, after = np.random.default_rng(seed).normal(size=(2, *shape))
        ends = [simulated.with_landmarks(s * DIFFERENCE * before, s * DIFFERENCE * after) for s in (1.0, -1.0)]
        wanted.append((ends[0] - ends[1]) / (2.0 * DIFFERENCE))
        predicted.append(
            [
                np.vdot(s.landmarks_before, before) + np.vdot(s.landmarks_after, after)
                for s in simulated.sensitivities
            ]
        )
    agree([s.quantity for s in simulated.sensitivities], np.array(predicted).T, np.array(wanted).T)


def check_constants(simulated: Simulated, tissue: Tissue) -> None:
    for name in simulated.sensitivities[0].constants:
        value = getattr(tissue, name)
        step = 1e-3 * value
        ends = [simulated.with_tissue(replace(tissue, **{name: value + s * step})) for s in (1.0, -1.0)]
        wanted = (ends[0] - ends[1]) / (2.0 * step)
        agree(
            [s.quantity for s in simulated.sensitivities],
            np.array([s.constants[name] for s in simulated.sensitivities]),
            wanted,
        )


BOX = boned_case()


@pytest.mark.parametrize(
    ("energy", "bones"), [("itmsm", "spline"), ("neo-hookean", "spline"), ("itmsm", "follow")]
)
def test_a_box_of_tissue_in_eight_directions(energy: EnergyName, bones: Literal["spline", "follow"]) -> None:
    case, trunk = BOX
    box = Simulated(case, options_of(energy, bones), trunk)
    assert [s.level for s in box.sensitivities if s.quantity == "bsr_deg"] == [*LEVELS]
    check_landmarks(box, 8)
    if bones == "follow":  # all that moves is one bone, and the box with it: whatever it is made of
        np.testing.assert_allclose([list(s.constants.values()) for s in box.sensitivities], 0.0, atol=1e-7)
    else:
        check_constants(box, case.tissue)


def test_layers_gravity_and_a_skin_that_resists_bending() -> None:
    case, trunk = BOX
    labelled = replace(trunk, tissue=np.arange(len(trunk.tets), dtype=np.int8) % 3)
    options = replace(options_of("neo-hookean"), layers="mesh", gravity=9.81, rest="scan", skin_rigidity=100.0)
    box = Simulated(replace(case, tissue=Tissue(youngs_modulus=200.0)), options, labelled)
    constants = {"fat.youngs_modulus", "muscle.poisson_ratio", "skin.density", "gravity", "skin_rigidity"}
    assert constants <= set(box.sensitivities[0].constants)
    assert "skin rigidity" in {source.name for source in sources_of(box.prediction)}
    hung = Simulated(box.case, replace(options, rest="sag-free"), labelled)
    assert hung.sensitivities[0].constants.keys() == box.sensitivities[0].constants.keys()
    at_scan = [list(s.constants.values()) for s in box.sensitivities]
    assert np.abs(np.subtract([list(s.constants.values()) for s in hung.sensitivities], at_scan)).max() > 1e-3
    check_landmarks(hung, 3)


@pytest.fixture(scope="module", params=["itmsm", "neo-hookean"])
def phantom(request: pytest.FixtureRequest) -> Simulated:
    return Simulated(coarse_phantom(), options_of(request.param))


@pytest.mark.slow
def test_a_phantom(phantom: Simulated) -> None:
    names = {(s.quantity, s.level) for s in phantom.sensitivities}
    assert {("bsr_deg", "T1"), ("bsr_deg", "T8"), ("bsr_deg", "L4"), ("shoulder_difference_mm", "")} <= names
    assert {("clavicle_angle_deg", ""), *((quantity, "") for quantity in WAIST)} <= names
    assert ("hump_mm", phantom.prediction.measures_before.hump_level) in names
    np.testing.assert_allclose(
        [s.value for s in phantom.sensitivities], phantom.numbers(phantom.prediction), rtol=0.0, atol=1e-9
    )
    wanted = {"epsilon", "theta"} if phantom.options.energy == "itmsm" else {"poisson_ratio"}
    assert set(phantom.sensitivities[0].constants) == wanted
    check_landmarks(phantom, 1)
    check_constants(phantom, phantom.case.tissue)


@pytest.mark.slow
@pytest.mark.parametrize("energy", ["itmsm", "neo-hookean"])
def test_thickness_of_layers(energy: EnergyName) -> None:
    """Against a step of a hundredth of a mm of the whole layer, assigned by depth again."""
    case = replace(whole_phantom(), layers=Layers())
    mesh = MeshOptions(tets=42_000, bone_voxel=6.0)
    layered = Simulated(case, replace(options_of(energy, mesh=mesh), layers="depth"))
    for layer, value in (("skin", SKIN_THICKNESS), ("fat", FAT_THICKNESS)):
        ends = []
        for step in (0.01, -0.01):
            thicker = replace(case, layers=replace(Layers(), **{f"{layer}_thickness": value + step}))
            trunk = replace(layered.prediction.trunk, tissue=None)
            ends.append(
                layered.numbers(layered.relaxed(prepare(thicker, layered.options, trunk, execution=ON_CPU)))
            )
        predicted = np.array([s.constants[f"{layer}.thickness"] for s in layered.sensitivities])
        agree([s.quantity for s in layered.sensitivities], predicted, (ends[0] - ends[1]) / 0.02)


@pytest.mark.parametrize("energy", [pytest.param("itmsm", marks=pytest.mark.slow), "neo-hookean"])
def test_real_anatomy(energy: EnergyName) -> None:
    skin, bones = anatomy()
    case = make_case(coarsen(skin, 16.0, 2.0), bones, SpineCurve(cobb=60.0), 0.7)
    mesh = MeshOptions(tets=75_000, bone_voxel=6.0, bone_tolerance=2.0)
    real = Simulated(case, options_of(energy, mesh=mesh))
    check_landmarks(real, 2)
    check_constants(real, real.case.tissue)
