"""What the measures of a prediction depend on: landmarks, bones and constants."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from warp_trunk.bone_motion.bone_path import rigid_displacement
from warp_trunk.bone_motion.path_derivative import PathDerivative, difference_derivative, spline_derivative
from warp_trunk.case.layers import NAMES
from warp_trunk.engine.constants import Constant, constants_of
from warp_trunk.engine.linearization import Linearization
from warp_trunk.errors import InputError
from warp_trunk.geometry.normals import vertex_normals
from warp_trunk.measures import measure
from warp_trunk.measures.derivatives import (
    Derivative,
    hump_derivative,
    point_derivative,
    rotation_derivative,
    shoulder_derivative,
)
from warp_trunk.results import predicted_skin

from .options import RunOptions
from .paths import motions_of
from .prepare import Prepared

if TYPE_CHECKING:
    from warp_trunk.case import Case
    from warp_trunk.case.landmarks import Landmarks
    from warp_trunk.engine.simulation import Increment
    from warp_trunk.geometry.surface import Surface


@dataclass(frozen=True, eq=False)
class Sensitivity:
    """A number of the predicted trunk, and its derivative in everything it depends on."""

    name: str
    """`bsr T8`, `hump T9`, `shoulder difference`, or `skin 1234` for a vertex of the skin along its normal."""
    unit: str
    """Its unit: degrees or mm."""
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
    """In each constant of the tissue and gravity [unit per its unit]; in layers `fat.youngs_modulus` and so on.
    Empty where the rest state under gravity was found for these constants (`sag_free`)."""


def sensitivities(
    case: Case,
    prepared: Prepared,
    increment: Increment,
    options: RunOptions | None = None,
    *,
    vertices: Sequence[int] = (),
    all_humps: bool = False,
    linear: Linearization | None = None,
) -> tuple[Sensitivity, ...]:
    """What the back surface rotation of each level, the largest hump and the shoulders depend on.

    One linear solve with the true curvature of the energy gives the derivative of one number in everything (its
    adjoint, see `Linearization`); no simulation is repeated. Derivatives hold for small changes; beyond some mm a
    point of contact of the dual tangent may jump to another fold of the skin.

    Args:
        case: what was simulated.
        prepared: what `prepare` made of it.
        increment: the last increment that `simulate` yielded.
        options: those that `prepare` was given.
        vertices: vertices of the skin of which the place along the normal is asked for too.
        all_humps: whether the hump of each level is asked for, and not the largest alone.
        linear: the trunk linearised at the increment, where there is one; made when left out.

    Raises:
        InputError: the last relaxation did not converge, or there is no such vertex.
    """
    options = options or RunOptions()
    skin = predicted_skin(case, prepared.trunk, increment.displacement)
    numbers = dict(_numbers(skin, case.planned_landmarks, vertices, all_humps))
    linear = linear or Linearization(prepared.model, increment)
    weights = [_on_nodes(prepared, number.vertices) for number in numbers.values()]
    adjoints = linear.adjoints(np.array(weights).reshape(-1, *prepared.trunk.nodes.shape))
    by_bones = linear.by_bones(adjoints)
    held = prepared.trunk.prescribed
    before, after = landmark_derivative(case, prepared, options)(by_bones[:, held])
    constants = {} if prepared.model.scan is not None else constant_names(prepared)
    pulls = {name: linear.pull(constant) for name, constant in constants.items()}
    return tuple(
        Sensitivity(
            name=name,
            unit="degrees" if name.startswith("bsr") else "mm",
            value=number.value,
            landmarks_before=before[i],
            landmarks_after=after[i] + number.landmarks,
            bones=by_bones[i],
            constants={constant: -float(np.vdot(adjoints[i], pull)) for constant, pull in pulls.items()},
        )
        for i, (name, number) in enumerate(numbers.items())
    )


def landmark_derivative(case: Case, prepared: Prepared, options: RunOptions) -> PathDerivative:
    """How the nodes on bone follow the landmarks on the path that these options choose."""
    trunk, before, after = prepared.trunk, case.landmarks_before, case.planned_landmarks
    held = trunk.prescribed
    if options.bones == "spline":
        return spline_derivative(trunk.nodes[held], before, after)

    def end(before: Landmarks, after: Landmarks) -> np.ndarray:
        moved = replace(case, landmarks_before=before, landmarks_after=after)
        return rigid_displacement(trunk, motions_of(moved))[held]

    return difference_derivative(end, before, after)


def constant_names(prepared: Prepared) -> dict[str, Constant]:
    """The constants of a model by the names that a case has for them."""
    several = len(prepared.model.tissues) > 1
    return {
        f"{NAMES[constant.tissue]}.{constant.name}" if several and constant.tissue is not None else constant.name:
        constant
        for constant in constants_of(prepared.model)
    }  # fmt: skip


def _numbers(
    skin: Surface, landmarks: Landmarks, vertices: Sequence[int], all_humps: bool
) -> Iterator[tuple[str, Derivative]]:
    """The numbers of a skin by name, each with its derivative."""
    measured = measure(skin, landmarks)
    for level, tangent in measured.tangents.items():
        if tangent is not None:
            yield f"bsr {level}", rotation_derivative(skin, landmarks, level, tangent)
    for level, tangent in measured.tangents.items():
        if tangent is not None and (all_humps or level == measured.hump_level):
            hump = hump_derivative(skin, landmarks, level, tangent)
            if hump is not None:
                yield f"hump {level}", hump
    shoulders = shoulder_derivative(skin, landmarks)
    if shoulders is not None:
        yield "shoulder difference", shoulders
    normals = vertex_normals(skin)
    for vertex in vertices:
        if not 0 <= vertex < len(normals):
            raise InputError(
                f"sensitivities: 'vertices' must be from 0 to {len(normals) - 1}, the vertices of the skin, "
                f"not {vertex}"
            )
        yield f"skin {vertex}", point_derivative(skin, landmarks, vertex, normals[vertex])


def _on_nodes(prepared: Prepared, by_vertex: np.ndarray) -> np.ndarray:
    """A derivative in the vertices of the skin as one in the nodes of the mesh."""
    by_node = np.zeros_like(prepared.trunk.nodes)
    by_node[prepared.trunk.skin_nodes] = by_vertex
    return by_node
