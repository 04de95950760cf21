"""From a case to what `simulate` needs: mesh, bone path and model. Runs and studies share it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from warp_trunk.bone_motion.bone_path import BonePath
from warp_trunk.engine.model import Model
from warp_trunk.engine.trunk_mesh import TrunkMesh

from .options import RunOptions
from .paths import find_path
from .patient import Patient, patient_of
from .progress import stage_of

if TYPE_CHECKING:
    from warp_trunk.case import Case

    from .progress import Progress


@dataclass(frozen=True, eq=False)
class Prepared:
    """A case that is ready to be simulated: `simulate(prepared.model, prepared.bone_path)`."""

    trunk: TrunkMesh
    """The mesh, with the tissue of its tetrahedra and with free joints where bones move each on its own."""
    model: Model
    """The mesh on its device, at rest."""
    bone_path: BonePath
    """Where its bones go."""


def prepare(
    case: Case,
    options: RunOptions | None = None,
    trunk: TrunkMesh | None = None,
    progress: Progress | None = None,
) -> Prepared:
    """Mesh a case, build its model and find the path of its bones.

    Args:
        case: what to simulate, with its tissue.
        options: how; the defaults when left out. Only what comes before the increments is read.
        trunk: the mesh of the case where there is one already; made, or fetched from the cache, when left out.
        progress: what to show the stages on; nothing is shown when left out.

    Raises:
        InputError: the case or an option is one that a stage refuses.
    """
    return prepare_plan(patient_of(case, options, trunk, progress), case, progress)


def prepare_plan(patient: Patient, case: Case, progress: Progress | None = None) -> Prepared:
    """A plan for a patient who is ready: the path of the bones is all that is still to be found.

    Args:
        patient: her mesh and model.
        case: the patient with what is planned.
        progress: what to show the stage on; nothing is shown when left out.

    Raises:
        InputError: the case is of another patient or tissue, or has landmarks on which no spline can be fitted.
    """
    patient.check(case)
    with stage_of(progress, "path", "finding where the bones go"):
        return Prepared(patient.trunk, patient.model, find_path(case, patient.trunk, patient.options))
