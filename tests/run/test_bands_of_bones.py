"""Intervals where bones move rigidly, as they do by default, and of a hump on either side."""

from dataclasses import fields, replace
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from support.asserting import not_none
from support.known_patient import known_case, known_mesh
from support.meshes import nodes_of_bones
from support.small_trunk import boned_case
from warp_trunk.bone_motion.skeleton import Skeleton
from warp_trunk.case import Case
from warp_trunk.case.uncertainty import FACTORS, Uncertainty
from warp_trunk.engine.relaxation import RelaxOptions
from warp_trunk.engine.simulation import SimulationOptions
from warp_trunk.geometry.surface import vertex_normals
from warp_trunk.measures import measure
from warp_trunk.preparation.deformity import SpineCurve, correct, impose
from warp_trunk.preparation.phantom import straight_trunk
from warp_trunk.run.intervals import find_bands
from warp_trunk.run.options import Execution, RunOptions
from warp_trunk.run.prediction import Prediction, prepare, prepare_plan
from warp_trunk.run.sensitivities import landmark_derivative

CERTAIN = Uncertainty(**{field.name: float(field.name in FACTORS) for field in fields(Uncertainty)})
SPREAD = replace(CERTAIN, landmark_error=1.0, landmark_error_sd=0.7)
ON_CPU = Execution(device="cpu", threads=1)


@cache
def relaxed() -> Prediction:
    case, trunk = boned_case()
    simulation = SimulationOptions(increments=1, relax=RelaxOptions(tolerance=0.02))
    options = RunOptions(precision="float64", simulation=simulation)
    return prepare(replace(case, uncertainty=SPREAD), options, trunk, execution=ON_CPU).relax()


def test_rigid_bones_have_the_intervals_of_whole_simulations() -> None:
    """24 simulations with drawn landmarks: so few have standard deviations of their own that are 15 % off."""
    bands, case, random = find_bands(relaxed()), relaxed().case, np.random.default_rng(3)
    names, normals = case.landmarks_before.names, vertex_normals(relaxed().skin)
    rotations, along = [], []
    for _ in range(24):
        before, after = SPREAD.landmark_sd * random.standard_normal((2, len(names), 3))
        moved = replace(
            case,
            landmarks_before=replace(case.landmarks_before, points=case.landmarks_before.points + before),
            landmarks_after=replace(case.landmarks_before, points=case.planned_landmarks.points + after),
        )
        skin = prepare_plan(relaxed().patient, moved).relax().skin
        rotations.append([*measure(skin, moved.planned_landmarks).bsr.values()])
        along.append(np.einsum("vi,vi->v", skin.vertices - relaxed().skin.vertices, normals))
    drawn = np.std(np.array(rotations, dtype=float), axis=0)
    sds = np.array([row.sd for row in bands.table.column("predicted", "bsr_deg").values()])
    assert 0.6 < np.median(sds / drawn) < 1.6
    spread = np.std(along, axis=0)
    assert 0.6 < np.sqrt(np.square(bands.skin_sd).mean() / np.square(spread).mean()) < 1.6


@pytest.mark.parametrize(
    "mirrored", [pytest.param(False, marks=pytest.mark.slow), True], ids=["on the right", "on the left"]
)
def test_a_likely_worse_back_has_the_larger_hump_on_either_side(mirrored: bool) -> None:
    case, _, _ = known_case(mirrored=mirrored)
    case = replace(case, uncertainty=SPREAD)
    trunk, _ = known_mesh(mirrored=mirrored)
    options = RunOptions(
        bones="spline", simulation=SimulationOptions(increments=1, relax=RelaxOptions(tolerance=0.1))
    )
    prediction = prepare(case, options, trunk, execution=ON_CPU).relax()
    effects = find_bands(prediction, draws=4).effects
    level = not_none(prediction.measures_before.hump_level)
    own = not_none(measure(prediction.skin, case.planned_landmarks).hump_height[level])
    assert (own > 0.0) == (not mirrored)
    for sign in (1.0, -1.0):
        skin = replace(prediction.skin, vertices=prediction.skin.vertices + sign * effects.likely_worse)
        other = not_none(measure(skin, case.planned_landmarks).hump_height[level])
        assert sign * (abs(other) - abs(own)) > 0.5


def test_errors_against_which_endplates_are_smoothed_turn_ribs_less_and_vertebrae_as_much() -> None:
    """Ribs turn with the curves, and a smooth line holds less of the error of each endplate."""
    skin, straight, marks = straight_trunk()
    skin, bones, before = impose(skin, straight, marks, SpineCurve(cobb=50.0))
    case = Case("errors", skin, bones, before, correct(marks, SpineCurve(cobb=20.0), 0.0))
    trunk = nodes_of_bones(bones, 20)
    prediction: Any = SimpleNamespace(
        case=case,
        trunk=trunk,
        options=SimpleNamespace(bones="follow"),
        patient=SimpleNamespace(skeleton=Skeleton(bones, before)),
    )
    names = ("rib_left_06", "rib_left_07", "rib_left_08", "T7")
    weights = np.zeros((len(names), *trunk.nodes.shape))
    for row, name in enumerate(names):
        weights[row, trunk.bone == list(bones).index(name), 1] = 1.0 / 20.0

    def deviations(error: float) -> np.ndarray:
        """Of where each bone goes to the back [mm], for errors of 1 mm."""
        by_before, by_after = landmark_derivative(prediction, error)(weights)
        return np.sqrt((by_before**2 + by_after**2).sum(axis=(1, 2)))

    smooth, rough = deviations(1.7), deviations(0.0)
    assert (smooth[:3] < 0.97 * rough[:3]).all()
    assert smooth[3] == pytest.approx(rough[3], rel=1e-9)
