"""Derivatives of where all bones go in all landmarks, against differences of all steps together."""

from __future__ import annotations

from typing import Literal

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from support.marked_spine import with_errors
from warp_trunk.bone_motion import vertebra_smoothing as smoothing_module
from warp_trunk.bone_motion.articulation import bone_motions
from warp_trunk.bone_motion.rib_cage import ends
from warp_trunk.bone_motion.steps import RememberedSteps, Steps, rigid_derivative
from warp_trunk.bone_motion.vertebra_smoothing import vertebra_smoothing
from warp_trunk.case.landmarks import Landmarks
from warp_trunk.engine.trunk_mesh import TrunkMesh
from warp_trunk.geometry.surface import Surface
from warp_trunk.preparation.deformity import SpineCurve, correct, impose
from warp_trunk.preparation.phantom import straight_trunk

STRAIGHT = straight_trunk()[2]
_, BONES, BEFORE = impose(*straight_trunk(), SpineCurve(cobb=50.0))
AFTER = correct(STRAIGHT, SpineCurve(cobb=20.0, apical_rotation=2.0), 0.0)
NO_FACES = np.empty((0, 3), dtype=np.int32)
STEP = 1e-4


def rod(start: np.ndarray, end: np.ndarray) -> Surface:
    """A bone as thick as a finger."""
    middle = start + np.linspace(0.0, 1.0, 9)[:, None] * (end - start)
    return Surface(np.vstack([middle + 5.0 * axis for axis in (*np.eye(3), *-np.eye(3))]), NO_FACES)


def all_kinds() -> dict[str, Surface]:
    """The bones of the phantom with cartilages, a shoulder blade and a clavicle."""
    bones = dict(BONES)
    middle = bones["sternum"].vertices.mean(axis=0)
    for number in (2, 6):
        rib = f"rib_left_{number:02d}"
        _, tip = ends(bones[rib], bones[f"T{number}"])
        bones[f"costal_cartilage_left_{number:02d}"] = rod(tip, middle)
    bones["scapula_left"] = Surface(bones["rib_left_04"].vertices + np.array([8.0, 15.0, 0.0]), NO_FACES)
    bones["clavicle_left"] = rod(middle + np.array([0.0, 0.0, 60.0]), bones["scapula_left"].vertices.mean(axis=0))
    return bones


def bones_without(*names: str) -> dict[str, Surface]:
    return {name: bone for name, bone in all_kinds().items() if not name.startswith(names)}


def without_landmarks_of(bone: str) -> np.ndarray:
    return np.array([row for row, name in enumerate(BEFORE.names) if not name.startswith(bone)])


EVERY = np.arange(len(BEFORE.names))


@pytest.mark.parametrize(
    ("bones", "rows", "pose"),
    [
        (all_kinds(), EVERY, "surgery"),
        (all_kinds(), EVERY, "bending"),
        (all_kinds(), without_landmarks_of("T8_"), "surgery"),
        (all_kinds(), without_landmarks_of("asis"), "surgery"),
        (bones_without("sternum"), EVERY, "surgery"),
        (bones_without("T", "L"), EVERY, "surgery"),
    ],
    ids=["surgery", "bending", "no landmarks of T8", "no iliac spines", "no sternum", "no vertebrae"],
)
def test_each_bone(bones: dict[str, Surface], rows: np.ndarray, pose: Literal["surgery", "bending"]) -> None:
    names = tuple(BEFORE.names[row] for row in rows)
    compare(bones, Landmarks(names, BEFORE.points[rows]), Landmarks(names, AFTER.points[rows]), pose)


def test_landmarks_with_errors(monkeypatch: pytest.MonkeyPatch) -> None:
    """Vertebrae are smooth_vertebrae, by a smoothness that a derivative takes as given."""
    random = np.random.default_rng(2)
    before, after = with_errors(BEFORE, random), with_errors(AFTER, random)
    given = vertebra_smoothing(before, after)
    assert given is not None
    monkeypatch.setattr(smoothing_module, "vertebra_smoothing", lambda *_: given)
    compare(all_kinds(), before, after, "surgery")


def compare(
    bones: dict[str, Surface], marks: Landmarks, marks_after: Landmarks, pose: Literal["surgery", "bending"]
) -> None:
    """The derivative of each bone's motion in two directions of all landmarks, against differences."""
    random = np.random.default_rng(1)
    names, before, after = marks.names, marks.points, marks_after.points
    steps = RememberedSteps(before, after)
    trunk, owner = mesh_of(bones)

    def motions(before: np.ndarray, after: np.ndarray, steps: Steps | None = None) -> dict[str, RigidTransform]:
        return bone_motions(bones, Landmarks(names, before), Landmarks(names, after), pose=pose, steps=steps)

    weights = random.normal(size=(len(bones), *trunk.nodes.shape))
    weights *= (owner == np.arange(len(bones))[:, None])[:, :, None]
    by_before, by_after = rigid_derivative(trunk, motions(before, after, steps), steps)(weights)
    for way in random.normal(size=(2, 2, *before.shape)):
        there = [motions(before + s * STEP * way[0], after + s * STEP * way[1]) for s in (1.0, -1.0)]
        wanted = []
        for weight, name in zip(weights, bones, strict=True):
            mine = owner == list(bones).index(name)
            ends = [end[name].apply(trunk.nodes[mine]) for end in there]
            wanted.append(np.vdot(weight[mine], ends[0] - ends[1]) / (2.0 * STEP))
        found = np.einsum("kni,ni->k", by_before, way[0]) + np.einsum("kni,ni->k", by_after, way[1])
        np.testing.assert_allclose(found, wanted, rtol=1e-4, atol=1e-4 * np.abs(wanted).max())


def mesh_of(bones: dict[str, Surface]) -> tuple[TrunkMesh, np.ndarray]:
    """Some vertices of each bone as nodes, and whose they are."""
    points = [bone.vertices[::20] for bone in bones.values()]
    owner = np.repeat(np.arange(len(bones)), [len(some) for some in points])
    tets = np.empty((0, 4), dtype=np.int32)
    return TrunkMesh(np.vstack(points), tets, NO_FACES[:, 0], NO_FACES, owner, tuple(bones), NO_FACES), owner
