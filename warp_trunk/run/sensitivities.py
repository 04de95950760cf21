"""Sensitivities of the measures of a prediction: landmarks, bones and constants."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from warp_trunk.bone_motion.articulation import spine_features
from warp_trunk.bone_motion.prescribed_motion import (
    PathDerivative,
    rigid_derivative,
    sets_around,
    spline_derivative,
)
from warp_trunk.case.anatomy import LUMBAR, THORACIC
from warp_trunk.case.layers import NAMES, Layers
from warp_trunk.engine.constants import Constant, constants_of, parts_derivative, weight_derivative
from warp_trunk.engine.linearization import Adjoints, Linearization
from warp_trunk.engine.model import Model
from warp_trunk.engine.trunk_mesh import TrunkMesh
from warp_trunk.geometry.spline import spline_response
from warp_trunk.measures.derivatives import (
    Derivative,
    hump_derivative,
    rotation_derivative,
    shoulder_derivatives,
    slope_derivative,
    waist_derivatives,
)
from warp_trunk.meshing.layers import thickness_derivatives

from .options import layers_from
from .patient import motions_of_sets
from .prediction import Prediction

SCOLIOMETER = (*THORACIC[5:], *LUMBAR[:3])
"""The levels whose slope has an interval."""


@dataclass(frozen=True, eq=False)
class Sensitivity:
    """A number of the predicted trunk, and its derivative in everything it depends on."""

    quantity: str
    """The measured quantity: a key of `QUANTITIES`, with its unit."""
    level: str
    """Where; empty for the whole trunk."""
    value: float
    """The number."""
    landmarks_before: np.ndarray
    """In the place of each landmark before surgery [unit/mm], shape (landmarks, 3): through the path of the
    bones. The bones before surgery stay, and with them the mesh."""
    landmarks_after: np.ndarray
    """In the place of each landmark after surgery, likewise: through the bones, and through the measure, whose
    levels and pelvis are those of these landmarks."""
    bones: np.ndarray
    """In the place of each node on bone after surgery [unit/mm], shape (nodes, 3); 0 on all other nodes."""
    constants: dict[str, float]
    """In each constant of the tissue and gravity [unit per its unit]; in layers `fat.youngs_modulus` and so on,
    and in layers by depth `skin.thickness` and `fat.thickness` [unit/mm]. A rest state that was found for them
    under gravity (`sag_free`) moves along."""


def sensitivities(
    prediction: Prediction, *, all_humps: bool = False, linear: Linearization | None = None
) -> tuple[Sensitivity, ...]:
    """Sensitivities of the back surface rotation of each level, the main hump, the shoulders and the waist.

    One linear solve with the true curvature of the energy gives the derivative of one number in everything (its
    adjoint, see `Linearization`); no simulation is repeated. Derivatives hold for small changes; beyond some mm a
    point of contact of the dual tangent may jump to another fold of the skin.

    Args:
        prediction: of a case, relaxed.
        all_humps: whether the hump of each level is asked for, and not only where it is largest before surgery or
            predicted.
        linear: the trunk linearised at the increment, where there is one; made when left out.

    Raises:
        InputError: the last relaxation did not converge.
    """
    trunk, numbers = prediction.trunk, numbers_of(prediction, all_humps=all_humps)
    linear = linear or Linearization(prediction.model, prediction.last)
    adjoints = linear.adjoints(on_nodes(trunk, numbers))
    solved = numbers, adjoints, linear.position_derivatives(adjoints)
    response = spline_response(prediction.case.landmarks_before.points, trunk.nodes)
    return from_adjoints(
        prediction,
        response,
        solved=solved,
        by_landmarks=landmark_derivative(prediction),
        force_derivatives=force_derivatives_of(prediction, linear),
    )


def numbers_of(prediction: Prediction, *, all_humps: bool = False) -> dict[tuple[str, str], Derivative]:
    """The numbers of a predicted skin, each with its derivative in the skin and in the landmarks after.

    Returns:
        By quantity and level.
    """
    skin, landmarks = prediction.skin, prediction.case.planned_landmarks
    measured = prediction.measures_at(prediction.last)
    humps = {prediction.measures_before.hump_level, measured.hump_level}
    tangents = {level: tangent for level, tangent in measured.tangents.items() if tangent is not None}
    derivatives: dict[tuple[str, str], Derivative | None] = {
        ("bsr_deg", level): rotation_derivative(skin, landmarks, level, tangent)
        for level, tangent in tangents.items()
    }
    for level, tangent in tangents.items():
        if (all_humps or level in humps) and measured.hump_height[level] is not None:
            derivatives["hump_mm", level] = hump_derivative(skin, landmarks, level, tangent)
    for level in SCOLIOMETER:
        if level in tangents and (slope := measured.slopes.get(level)) is not None:
            derivatives["atr_deg", level] = slope_derivative(skin, landmarks, level, slope)
    whole = {} if measured.waist is None else waist_derivatives(skin, landmarks)
    if measured.shoulders is not None:
        whole |= shoulder_derivatives(skin, landmarks, measured.shoulders)
    derivatives |= {(name, ""): number for name, number in whole.items()}
    return {name: number for name, number in derivatives.items() if number is not None}


def on_nodes(trunk: TrunkMesh, numbers: Mapping[tuple[str, str], Derivative]) -> np.ndarray:
    """Derivatives of numbers in the vertices of the skin as those in the nodes, (numbers, nodes, 3)."""
    by_node = np.zeros((len(numbers), *trunk.nodes.shape))
    for row, number in enumerate(numbers.values()):
        by_node[row, trunk.skin_nodes] = number.vertices
    return by_node


def from_adjoints(
    prediction: Prediction,
    response: np.ndarray,
    *,
    solved: tuple[Mapping[tuple[str, str], Derivative], Adjoints, np.ndarray],
    by_landmarks: PathDerivative,
    force_derivatives: Mapping[str, np.ndarray],
) -> tuple[Sensitivity, ...]:
    """Sensitivities of numbers.

    What the adjoints left is multiplied with the motion of tissue that the spline of the landmarks carries; there
    an error before surgery is taken to be the opposite of one after it.

    Args:
        prediction: of a case, relaxed.
        response: what each landmark adds to the displacement of each node by the spline (`spline_response`).
        solved: the numbers, their adjoints, and their `Linearization.position_derivatives`.
        by_landmarks: how the nodes on bone follow the landmarks (`landmark_derivative`).
        force_derivatives: what constants add to forces (`force_derivatives_of`).
    """
    numbers, adjoints, places = solved
    held = prediction.trunk.prescribed
    before, after = by_landmarks(places[:, held])
    carried = np.tensordot(places[:, ~held], response[~held], axes=(1, 0)).transpose(0, 2, 1)
    by_bones = np.where(held[:, None], places, 0.0)
    return tuple(
        Sensitivity(
            quantity=quantity,
            level=level,
            value=number.value,
            landmarks_before=before[i] - carried[i],
            landmarks_after=after[i] + carried[i] + number.landmarks,
            bones=by_bones[i],
            constants={
                constant: -float(np.vdot(adjoints.fields[i], pull)) for constant, pull in force_derivatives.items()
            },
        )
        for i, ((quantity, level), number) in enumerate(numbers.items())
    )


def landmark_derivative(prediction: Prediction, expected_error: float = 0.0) -> PathDerivative:
    """How the nodes on bone follow the landmarks on the path that these options choose.

    Args:
        prediction: of a case.
        expected_error: of landmarks that have none yet, see `endplate_smoothing` [mm].
    """
    case, trunk = prediction.case, prediction.trunk
    before, after = case.landmarks_before.points, case.planned_landmarks.points
    if prediction.options.bones == "spline":
        return spline_derivative(trunk.nodes[trunk.prescribed], before, after)
    skeleton = prediction.patient.skeleton
    features = spine_features(skeleton, before, after, expected_error)
    return rigid_derivative(trunk, motions_of_sets(case, *sets_around(before, after), skeleton, features))


def constant_names(model: Model) -> dict[str, Constant]:
    """The constants of a model by the names that a case has for them."""
    several = len(model.tissues) > 1
    return {
        f"{NAMES[constant.tissue]}.{constant.name}" if several and constant.tissue is not None else constant.name:
        constant
        for constant in constants_of(model)
    }  # fmt: skip


def force_derivatives_of(prediction: Prediction, linear: Linearization) -> dict[str, np.ndarray]:
    """dF/dc by the name of each constant, see `Linearization.force_derivative`, shape (nodes, 3).

    Layers by depth have their thickness in mm too, of skin and of fat, everywhere alike.
    """
    model, trunk, layers = prediction.model, prediction.trunk, prediction.case.layers
    changes = {name: weight_derivative(model, constant) for name, constant in constant_names(model).items()}
    if layers_from(prediction.case, prediction.options) == "depth":
        for name, change in thickness_derivatives(trunk, layers or Layers()).items():
            changes[name.replace("_", ".")] = parts_derivative(model, change)
    return dict(zip(changes, linear.force_derivatives(list(changes.values())), strict=True))
