"""One case of a calibration, as a worker does it: how far it lies from the actual skin, and what changes that."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING
from uuid import uuid4

import numpy as np

from warp_trunk.case import read_checked_case
from warp_trunk.case.layers import CONSTANTS, NAMES
from warp_trunk.case.rib_shares import LIMITS
from warp_trunk.case.tissue_file import RIBS, constant_of, with_constants
from warp_trunk.engine.constants import Constant
from warp_trunk.engine.linearization import Linearization
from warp_trunk.engine.newton import Relaxer
from warp_trunk.engine.relaxation import RelaxStatus
from warp_trunk.engine.simulation import simulate
from warp_trunk.errors import InputError
from warp_trunk.geometry.distance_field import SurfaceDistance
from warp_trunk.geometry.normals import area_vectors, unit
from warp_trunk.measures import compare_skins
from warp_trunk.measures.skin_distance import skin_distance
from warp_trunk.meshing import MeshOptions, make_trunk
from warp_trunk.results import predicted_skin
from warp_trunk.run.options import RunOptions
from warp_trunk.run.patient import Prepared, find_path, prepare
from warp_trunk.run.starting import start_warp

from .free_constants import FreeConstant, values_of

if TYPE_CHECKING:
    from warp_trunk.case import Case
    from warp_trunk.engine.trunk_mesh import TrunkMesh
    from warp_trunk.geometry.surface import Surface

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
MOST_KEPT = 16
"""Cases of which a worker keeps mesh and places between rounds, of some 30 MB each."""
STEP = 1e-2
"""Part of what is believed of a constant by which it is changed for a difference."""


@dataclass(frozen=True, kw_only=True)
class FitJob:
    """The task of a worker."""

    folder: Path
    """The case."""
    options: RunOptions
    """How it is simulated."""
    align_pelvis: bool
    """Bring what is known after surgery back onto the pelvis before it."""
    refine: Callable[[Case], Case] | None
    """The changes of the command line to each case."""
    free: tuple[FreeConstant, ...]
    """The constants that are fitted."""
    derivative: bool = True
    """Whether the change with each constant is wanted."""
    key: str = field(default_factory=lambda: uuid4().hex)
    """With it, a worker that has done the job before uses its copy of the case."""


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
    start_warp()
    now = _simulated(_kept(job.key, job.folder, job.align_pelvis, job.options.mesh), job, counted)
    places = now.kept.places
    distance, direction = _distance(now, places)
    scale = np.sqrt(WORTH / len(places)) / SKIN_SD
    derivative = None
    if job.derivative:
        moved = _moved(now, job)[:, places]
        derivative = scale * np.einsum("vi,cvi->vc", direction, moved)
    judged = compare_skins(now.skin, now.kept.actual, now.case.planned_landmarks)
    back, rotation = judged.distance["back"], judged.bsr_error["T3-L5"]
    return CaseFit(
        residuals=scale * distance,
        derivative=derivative,
        skin_mm=float("nan") if back is None else back.mean,
        bsr_deg=None if rotation is None else rotation.mean,
    )


def tried(job: FitJob, counted: np.ndarray) -> CaseFit | InputError:
    """The same, or what it refuses: an answer for the round, and no failure of a worker."""
    try:
        return fit_case(job, counted)
    except InputError as error:
        return error


@dataclass(frozen=True, eq=False)
class _Kept:
    """The data of a case that do not depend on the constants."""

    case: Case
    """As it was read."""
    actual: Surface
    """Its actual skin."""
    trunk: TrunkMesh
    """Its mesh."""
    places: np.ndarray
    """Vertices of the skin at which it is compared, chosen by the skin before, shape (places,)."""


@lru_cache(maxsize=MOST_KEPT)
def _kept(key: str, folder: Path, align_pelvis: bool, mesh: MeshOptions) -> _Kept:
    """Reads and meshes a case, once on each worker for as long as `key` is the same.

    Raises:
        InputError: it cannot be read or meshed, or has no actual skin.
    """
    case, _ = read_checked_case(folder, align=align_pelvis)
    if case.actual_skin is None:
        raise InputError(f"{folder}: has no actual skin to calibrate on; add actual_skin.ply or leave it out")
    there = np.flatnonzero(skin_distance(case.skin, case.actual_skin, case.landmarks_before).counted)
    places = there[np.linspace(0, len(there) - 1, min(PLACES, len(there))).astype(np.int64)]
    return _Kept(case, case.actual_skin, make_trunk(case.skin, case.bones, mesh).trunk, places)


@dataclass(frozen=True, eq=False)
class _Simulated:
    """A case at its end."""

    kept: _Kept
    case: Case
    prepared: Prepared
    linear: Linearization
    skin: Surface


def _simulated(kept: _Kept, job: FitJob, counted: np.ndarray) -> _Simulated:
    case = kept.case if job.refine is None else job.refine(kept.case)
    case = with_constants(case, values_of(job.free, counted))
    prepared = prepare(case, job.options, kept.trunk)
    relaxer = Relaxer(prepared.model, job.options.simulation.relax)
    *_, last = simulate(prepared.model, prepared.bone_path, job.options.simulation, relaxer=relaxer)
    status = last.relaxation.status
    linear = Linearization(prepared.model, last, relaxer=relaxer, unconfirmed=status is not RelaxStatus.NOT_FINITE)
    if status is not RelaxStatus.CONVERGED:
        way = linear.newton_correction()[prepared.trunk.skin_nodes]
        far = float(np.linalg.norm(way, axis=1).max())
        if not far <= SETTLED:
            ended = f"ended {status.name}, the skin {far:.1f} mm from equilibrium"
            raise InputError(f"{job.folder}: {ended}, which is no prediction")
    return _Simulated(kept, case, prepared, linear, predicted_skin(case, prepared.trunk, last.displacement))


def _distance(now: _Simulated, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Signed distance of places of the predicted skin from the actual one, and the direction in which it grows."""
    points = now.skin.vertices[places]
    nearest = SurfaceDistance(now.kept.actual).nearest(points)
    distance = nearest.distance.astype(np.float64)
    away = points - nearest.point
    length = np.linalg.norm(away, axis=1)
    normal = unit(area_vectors(now.kept.actual.vertices, now.kept.actual.faces[nearest.face]))
    far = length > 0.05  # float32 knows no direction of less
    direction = np.where(
        far[:, None], np.sign(distance)[:, None] * away / np.maximum(length, 1e-9)[:, None], normal
    )
    return distance, direction


def _moved(now: _Simulated, job: FitJob) -> np.ndarray:
    """How the skin moves with each constant as it is counted [mm], shape (constants, vertices, 3)."""
    linear = now.linear
    none = np.zeros_like(now.prepared.trunk.nodes)
    bones = [_bones_moved(now, job, free) if free.of == RIBS else none for free in job.free]
    pulls = [none if free.of == RIBS else _pull(now, linear, free) for free in job.free]
    return linear.follow(np.stack(bones), np.stack(pulls))[:, now.prepared.trunk.skin_nodes]


def _bones_moved(now: _Simulated, job: FitJob, free: FreeConstant) -> np.ndarray:
    """Change of the places of bones with a share of the ribs [mm], shape (nodes, 3)."""
    value, step = getattr(now.case.rib_shares, free.constant), STEP * free.believed
    low, high = max(value - step, LIMITS[free.constant][0]), min(value + step, LIMITS[free.constant][1])
    lower, upper = (
        find_path(with_constants(now.case, {free.name: end}), now.prepared.trunk, job.options).at(1.0)
        for end in (low, high)
    )
    return (upper - lower) / (high - low)


def _pull(now: _Simulated, linear: Linearization, free: FreeConstant) -> np.ndarray:
    """Derivative of the gradient of every free node by a constant, in the scale in which it is fitted."""
    tissues = now.prepared.model.tissues
    slope = free.slope(constant_of(now.case, free.name))
    if free.of:
        return slope * linear.pull(Constant(free.constant, NAMES.index(free.of)))
    if len(tissues) == 1:
        return slope * linear.pull(Constant(free.constant, 0))
    return slope * sum(
        (linear.pull(Constant(free.constant, n)) for n in _without_own(now.case, free.constant)),
        start=np.zeros_like(now.prepared.trunk.nodes),
    )


def _without_own(case: Case, constant: str) -> Sequence[int]:
    """The layers that have a constant from the uniform tissue."""
    given: Mapping[str, Mapping[str, float]] = {} if case.layers is None else case.layers.constants
    return [n for n, layer in enumerate(NAMES) if constant not in {**CONSTANTS[layer], **given.get(layer, {})}]
