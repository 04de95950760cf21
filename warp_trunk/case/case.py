"""The record of a case: a patient and the planned surgery."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Literal

import numpy as np
from msgspec import Meta

from warp_trunk.checking import check_fields
from warp_trunk.engine.tissue import Tissue
from warp_trunk.errors import InputError
from warp_trunk.geometry.rigid import RigidMotion, fit_rigid
from warp_trunk.geometry.surface import Surface

from .landmarks import Landmarks, bone_of
from .layers import Layers
from .motions import Motion, rigid_motions
from .points import Points
from .rib_coupling import RibCoupling
from .uncertainty import Invented, Uncertainty

Posture = Literal["standing", "supine", "prone"]
Pose = Literal["surgery", "bending"]
"""The change of the trunk from before to after."""


@dataclass(frozen=True, kw_only=True)
class Study:
    """The table [study] of case.toml: the patient, and what a study of several cases needs to know besides.

    >>> dataclasses.replace(case, study=wt.Study(patient="P7", months_after=24.0)).study.pose
    'surgery'
    """

    patient: str = ""
    """Identifier of the patient: cases with the same one are of one person. The case itself if empty."""
    pose: Pose = "surgery"
    """The change from before to after: surgery, or sideways bending of the same patient, when the landmarks after
    and the actual skin are those of the bent trunk."""
    months_after: Annotated[float, Meta(ge=0.0, le=1200.0)] | None = None
    """Months from surgery to the scan of the actual skin; None if unknown."""
    synthetic: bool = False
    """Whether the case, including the actual skin, was made by a computer and is of no patient."""

    def __post_init__(self) -> None:
        """Raises InputError for a time out of range."""
        check_fields(self, "study")


@dataclass(frozen=True, eq=False, repr=False)
class Case:
    """A patient, and the planned surgery if there is one, in LPS axes and mm.

    >>> case = wt.phantom_case()
    >>> "T8" in case.bones and "T8_left_pedicle_inferior" in case.landmarks_before.names
    True
    """

    name: str
    """Name of the case in results."""
    skin: Surface
    """The trunk before surgery: closed, in one piece, outward winding."""
    bones: dict[str, Surface]
    """The bones before surgery by name (`T7`, `rib_left_01`, `hip_left`); they may overlap."""
    landmarks_before: Landmarks
    """Points on the bones before surgery; `NO_LANDMARKS` for a case without a spine."""
    landmarks_after: Landmarks | None = None
    """The same points after surgery, same names in the same order; None if nothing is planned yet."""
    plan_text: str | None = None
    """The plan.toml that made the landmarks after surgery; None where none did."""
    actual_skin: Surface | None = None
    """The skin after surgery if known; its triangles may differ from those of `skin`."""
    tissue: Tissue = dataclasses.field(default_factory=Tissue)
    """Constants of the soft tissue."""
    bones_after: dict[str, Surface] = dataclasses.field(default_factory=dict)
    """Bones known after surgery, by name; each has the vertices of the one before, moved rigidly."""
    layers: Layers | None = None
    """Skin, fat and muscle, if the case describes them."""
    rib_coupling: RibCoupling = dataclasses.field(default_factory=RibCoupling)
    """Fractions of the motion of a vertebra that its ribs take (`--bones follow`)."""
    posture: Posture = "standing"
    """Posture during the scan; curves are smaller and the back is flatter when lying."""
    uncertainty: Uncertainty = dataclasses.field(default_factory=Uncertainty)
    """Uncertainty of the input and of the assumptions of the model."""
    study: Study = dataclasses.field(default_factory=Study)
    """The patient, and what else a study of several cases needs."""
    invented: Invented | None = None
    """The parts that were not measured, where the case was fitted to a part of the trunk."""
    unseen: np.ndarray | None = None
    """Which vertices of the skin were not measured, bool, shape (vertices,); None where all were."""
    bending_left: Landmarks | None = None
    """Landmarks of the vertebrae while the patient bends to the left, some or all of those before surgery."""
    bending_right: Landmarks | None = None
    """The same while the patient bends to the right."""
    motions: dict[str, Motion] = dataclasses.field(default_factory=dict)
    """Motions of bones without landmarks, by name; other bones without landmarks stay in place."""
    points: Points = dataclasses.field(default_factory=Points)
    """Points on skin and bones that are followed."""
    notes: tuple[str, ...] = ()
    """Doubts of the image that the case was made from, a sentence each; every command warns of them."""

    def __post_init__(self) -> None:
        """Raises InputError for a field of another type, or a posture that is none."""
        check_fields(self, "case")

    def __repr__(self) -> str:
        moves = self.landmarks_after is not None or self.motions or self.bones_after
        parts = (f"skin of {len(self.skin.vertices)} vertices", f"{len(self.bones)} bones")
        parts += (f"{len(self.landmarks_before.names)} landmarks", "planned" if moves else "not planned")
        return f"Case({self.name!r}: {', '.join(parts)})"

    @property
    def has_spine(self) -> bool:
        """Whether landmarks of the spine and the pelvis are known; if not, bones move by motions alone."""
        return "asis_left" in self.landmarks_before.names

    @cached_property
    def point_owners(self) -> list[tuple[str, float]]:
        """The surface on which each followed point lies, `SKIN` or a bone, and its distance from it [mm]."""
        return self.points.owners(self.skin, self.bones)

    @cached_property
    def planned_landmarks(self) -> Landmarks:
        """The landmarks after surgery; with motions alone, each landmark moves with its bone.

        Raises:
            InputError: nothing is planned.
        """
        if self.landmarks_after is not None:
            return self.landmarks_after
        if not self.motions and self.bones.keys() != self.bones_after.keys():
            raise InputError(f"case {self.name!r}: has no landmarks_after; make them with warp-trunk plan")
        names, points = self.landmarks_before.names, self.landmarks_before.points.copy()
        for bone, motion in self.given_motions.items():
            rows = [row for row, name in enumerate(names) if bone_of(name, self.bones) == bone]
            points[rows] = motion.apply(points[rows])
        return Landmarks(names, points)

    @cached_property
    def given_motions(self) -> dict[str, RigidMotion]:
        """The rigid motions of the bones that are known after surgery or whose motion is given."""
        rigid = {
            bone: fit_rigid(self.bones[bone].vertices, after.vertices) for bone, after in self.bones_after.items()
        }
        return rigid | rigid_motions(self.motions)

    def landmarks_at(self, load_factor: float) -> Landmarks:
        """The landmarks at a load factor in [0, 1]; each moves along a line. InputError without a plan."""
        if load_factor == 1.0:
            return self.planned_landmarks  # to the bit
        before, after = self.landmarks_before.points, self.planned_landmarks.points
        return Landmarks(self.landmarks_before.names, before + load_factor * (after - before))
