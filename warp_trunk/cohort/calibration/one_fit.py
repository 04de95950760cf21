"""One case of a calibration, as a worker does it: how far it lies from the actual skin, and what changes that."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple
from uuid import uuid4

import numpy as np

from warp_trunk.case import Case, read_checked_case
from warp_trunk.case.case import Study
from warp_trunk.case.layers import NAMES
from warp_trunk.case.rib_coupling import LIMITS
from warp_trunk.case.tissue_file import RIBS, constant_of, with_constants
from warp_trunk.engine.constants import Constant
from warp_trunk.engine.linearization import Linearization
from warp_trunk.engine.relaxation import RelaxStatus
from warp_trunk.engine.trunk_mesh import TrunkMesh
from warp_trunk.errors import InputError
from warp_trunk.geometry.distance_field import SurfaceDistance
from warp_trunk.geometry.surface import Surface, area_vectors, unit
from warp_trunk.measures import compare_skins
from warp_trunk.measures.comparison import skin_distance
from warp_trunk.meshing import MeshOptions, make_trunk
from warp_trunk.run.prediction import Prediction, prepare

from ..one_case import CohortOptions
from .free_constants import FreeConstant, layers_with, values_of

PLACES = 400
"""Places of the skin at which a case is compared, spread evenly over it."""
WORTH = 40
"""How many of them are independent: errors of a scan and of a model are alike over 50 mm, and back and
flanks of a trunk are some 300 by 350 mm. All places of a case together weigh as much as this many."""
SKIN_SD = 2.0
"""Error of a point of the skin if the constants are right [mm]: 1.4 of the scanner of both papers, and the same
of the model; assumed."""
SETTLED = 0.1
"""How far a skin may be from its equilibrium [mm]: no scanner resolves it, and tissue that is caught between
two bones deep inside, where a relaxation ends STALLED, leaves less open."""
MOST_CACHED = 16
"""Cases of which a worker keeps mesh and places between rounds, of some 30 MB each."""
CONSTANT_STEP = 1e-2
"""Part of what is believed of a constant by which it is changed for a difference."""


@dataclass(frozen=True, kw_only=True)
class FitJob:
    """A case of a calibration, the task of a worker."""

    folder: Path
    """The case."""
    options: CohortOptions
    """How it is simulated."""
    free: tuple[FreeConstant, ...]
    """The constants that are fitted."""
    study: Study = field(default_factory=Study)
    """Whose case it is, its pose, and whether it is synthetic."""
    derivative: bool = True
    """Whether the change with each constant is wanted."""
    key: str = field(default_factory=lambda: uuid4().hex)
    """With it, a worker that has done the job before uses its copy of the case."""

    @property
    def name(self) -> str:
        """Name of the folder."""
        return self.folder.name

    @property
    def patient(self) -> str:
        """Whose case it is."""
        return self.study.patient or self.name


@dataclass(frozen=True, eq=False, kw_only=True)
class CaseFit:
    """How far a case is from its actual skin at some constants."""

    residuals: np.ndarray
    """Distance of each place from the actual skin, positive outside, over `SKIN_SD` and by `WORTH`, (places,)."""
    derivative: np.ndarray | None
    """Its change with each constant as it is counted, (places, constants); None where it was not asked for."""
    skin_mm: float
    """Mean distance of the back from the actual one [mm]."""
    bsr_deg: float | None
    """Mean absolute error of back surface rotation from T3 to L5 [degrees]."""


def fit_case(job: FitJob, counted: np.ndarray) -> CaseFit:
    """Simulates a case with constants, and compares it with its actual skin.

    Derivatives come from one linear solve for each constant at the equilibrium.

    Args:
        job: the case and what is free.
        counted: the constants as they are counted, shape (constants,).

    Raises:
        InputError: a case that cannot be simulated, has no actual skin, or whose skin finds no equilibrium.
    """
    meshed = _meshed(job.key, job.folder, job.options.align_pelvis, job.options.run.mesh)
    constants = {**job.options.run.constants, **values_of(job.free, counted)}
    options, case = replace(job.options.run, constants=constants), with_constants(meshed.case, constants)
    prediction = prepare(case, options, meshed.trunk, execution=job.options.execution).relax()
    trunk, last = prediction.trunk, prediction.last
    relaxer, skin_nodes, status = prediction.relaxer, trunk.skin_nodes, last.relaxation.status
    linear = Linearization(
        prediction.model, last, relaxer=relaxer, unconfirmed=status is not RelaxStatus.NOT_FINITE
    )
    if status is not RelaxStatus.CONVERGED:
        far = float(np.linalg.norm(linear.newton_correction()[skin_nodes], axis=1).max())
        if not far <= SETTLED:
            ended = f"ended {status.name}, the skin {far:.1f} mm from equilibrium"
            raise InputError(f"{job.folder}: {ended}, which is no prediction")
    skin = prediction.skin
    distance, direction = _distance(skin.vertices[meshed.places], meshed.actual)
    scale = np.sqrt(WORTH / len(meshed.places)) / SKIN_SD
    derivative = None
    if job.derivative:
        none = np.zeros_like(prediction.trunk.nodes)
        bones = [_bones_moved(case, prediction, free) if free.of == RIBS else none for free in job.free]
        force_derivatives = [
            none if free.of == RIBS else _force_derivative(linear, prediction, free) for free in job.free
        ]
        moved = linear.follow(np.stack(bones), np.stack(force_derivatives))[:, skin_nodes][:, meshed.places]
        derivative = scale * np.einsum("vi,cvi->vc", direction, moved)
    judged = compare_skins(skin, meshed.actual, case.planned_landmarks)
    back, rotation = judged.distance["back"], judged.bsr_error["T3-L5"]
    return CaseFit(
        residuals=scale * distance,
        derivative=derivative,
        skin_mm=float("nan") if back is None else back.mean,
        bsr_deg=None if rotation is None else rotation.mean,
    )


class _MeshedCase(NamedTuple):
    """The data of a case that do not depend on the constants."""

    case: Case
    actual: Surface
    trunk: TrunkMesh
    places: np.ndarray
    """Vertices of the skin at which it is compared, chosen by the skin before, shape (places,)."""


@lru_cache(maxsize=MOST_CACHED)
def _meshed(key: str, folder: Path, align_pelvis: bool, mesh: MeshOptions) -> _MeshedCase:
    """Reads and meshes a case, once on each worker for as long as `key` is the same.

    Raises:
        InputError: it cannot be read or meshed, or has no actual skin.
    """
    case, _ = read_checked_case(folder, align=align_pelvis)
    if case.actual_skin is None:
        raise InputError(f"{folder}: has no actual skin to calibrate on; add actual_skin.ply or leave it out")
    counted_rows = np.flatnonzero(skin_distance(case.skin, case.actual_skin, case.landmarks_before).counted)
    places = counted_rows[np.linspace(0, len(counted_rows) - 1, min(PLACES, len(counted_rows))).astype(np.int64)]
    return _MeshedCase(case, case.actual_skin, make_trunk(case.skin, case.bones, mesh).trunk, places)


def _distance(points: np.ndarray, actual: Surface) -> tuple[np.ndarray, np.ndarray]:
    """Signed distance of points from the actual skin, and the direction in which it grows."""
    nearest = SurfaceDistance(actual).nearest(points)
    distance = nearest.distance.astype(np.float64)
    away = points - nearest.point
    length = np.linalg.norm(away, axis=1)[:, None]
    normal = unit(area_vectors(actual.vertices, actual.faces[nearest.face]))
    outward = np.sign(distance)[:, None] * away / np.maximum(length, 1e-9)
    return distance, np.where(length > 0.05, outward, normal)  # float32 has no direction of less


def _bones_moved(case: Case, prediction: Prediction, free: FreeConstant) -> np.ndarray:
    """Change of the places of bones with a share of the ribs [mm], shape (nodes, 3)."""
    value, step = getattr(case.rib_coupling, free.constant), CONSTANT_STEP * free.believed
    low, high = max(value - step, LIMITS[free.constant][0]), min(value + step, LIMITS[free.constant][1])
    lower, upper = (
        prediction.patient.path_of(with_constants(case, {free.name: end})).at(1.0) for end in (low, high)
    )
    return (upper - lower) / (high - low)


def _force_derivative(linear: Linearization, prediction: Prediction, free: FreeConstant) -> np.ndarray:
    """Derivative of the gradient of every free node by a constant, in the scale in which it is fitted."""
    case = prediction.case
    tissues = [0] if len(prediction.model.tissues) == 1 else _without_own(case, free.constant)
    if free.of:
        tissues = [NAMES.index(free.of)]
    nothing = np.zeros_like(prediction.trunk.nodes)
    pull = sum((linear.force_derivative(Constant(free.constant, tissue)) for tissue in tissues), start=nothing)
    return free.slope(constant_of(case, free.name)) * pull


def _without_own(case: Case, constant: str) -> list[int]:
    """The layers that have a constant from the uniform tissue."""
    own = layers_with(case, constant)
    return [number for number, layer in enumerate(NAMES) if layer not in own]
