"""Bones by many sets of landmarks at once, and derivatives of where they go in all landmarks."""

import numpy as np
import pytest

from support.known_spine import with_errors
from support.meshes import nodes_of_bones
from warp_trunk.bone_motion.articulation import bone_motions, spine_features
from warp_trunk.bone_motion.prescribed_motion import rigid_derivative, sets_around, spline_derivative
from warp_trunk.bone_motion.rib_cage import ends
from warp_trunk.bone_motion.skeleton import Skeleton
from warp_trunk.case.case import Pose
from warp_trunk.case.landmarks import Landmarks
from warp_trunk.case.rib_coupling import RibCoupling
from warp_trunk.geometry.rigid import NamedMotions
from warp_trunk.geometry.spline import fit_spline
from warp_trunk.geometry.surface import Surface
from warp_trunk.preparation.deformity import SpineCurve, correct, impose
from warp_trunk.preparation.phantom import straight_trunk

STRAIGHT = straight_trunk()[2]
_, BONES, BEFORE = impose(*straight_trunk(), SpineCurve(cobb=50.0))
AFTER = correct(STRAIGHT, SpineCurve(cobb=20.0, apical_rotation=2.0), 0.0)
NO_FACES = np.empty((0, 3), dtype=np.int32)
MOVE = 1e-4


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
def test_each_bone(bones: dict[str, Surface], rows: np.ndarray, pose: Pose) -> None:
    names = tuple(BEFORE.names[row] for row in rows)
    compare(bones, Landmarks(names, BEFORE.points[rows]), Landmarks(names, AFTER.points[rows]), pose)


def test_landmarks_with_errors() -> None:
    """Vertebrae are smoothed, by a smoothness that a derivative takes as given."""
    random = np.random.default_rng(2)
    compare(all_kinds(), with_errors(BEFORE, random), with_errors(AFTER, random), "surgery")


def compare(bones: dict[str, Surface], before: Landmarks, after: Landmarks, pose: Pose) -> None:
    """The derivative of each bone's motion in two directions of all landmarks, against central differences."""
    random = np.random.default_rng(1)
    trunk = nodes_of_bones(bones, 20)
    skeleton = Skeleton(bones, before)
    features = spine_features(skeleton, before.points, after.points)

    def motions(before: np.ndarray, after: np.ndarray) -> NamedMotions:
        return bone_motions(skeleton, before, after, RibCoupling(), pose=pose, features=features)

    weights = random.normal(size=(len(bones), *trunk.nodes.shape))
    weights *= (trunk.bone == np.arange(len(bones))[:, None])[:, :, None]
    around = motions(*sets_around(before.points, after.points))
    by_before, by_after = rigid_derivative(trunk, around)(weights)
    ways = random.normal(size=(2, 2, *before.points.shape))
    signs = MOVE * np.array([1.0, -1.0])[:, None, None]
    for way in ways:
        bones_at = motions(before.points + signs * way[0], after.points + signs * way[1])
        ends = np.array([[bones_at[name][end].apply(trunk.nodes) for name in bones] for end in range(2)])
        wanted = ((ends[0] - ends[1]) * weights).sum(axis=(1, 2)) / (2.0 * MOVE)
        derivative = np.einsum("kni,ni->k", by_before, way[0]) + np.einsum("kni,ni->k", by_after, way[1])
        np.testing.assert_allclose(derivative, wanted, rtol=1e-4, atol=1e-4 * np.abs(wanted).max())


def test_sets_at_once_are_as_each_alone() -> None:
    """Of a plan, and of landmarks with errors, whose vertebrae are smoothed each by its own smoothness."""
    random, bones = np.random.default_rng(7), all_kinds()
    marks = [(BEFORE, AFTER), *((with_errors(BEFORE, random), with_errors(AFTER, random)) for _ in range(3))]
    before, after = np.array([[landmarks.points for landmarks in pair] for pair in marks]).transpose(1, 0, 2, 3)
    for pose in ("surgery", "bending"):
        together = bone_motions(Skeleton(bones, BEFORE), before, after, RibCoupling(), pose=pose)
        for number, (start, end) in enumerate(zip(before, after, strict=True)):
            skeleton = Skeleton(bones, Landmarks(BEFORE.names, start))
            alone = bone_motions(skeleton, start[None], end[None], RibCoupling(), pose=pose)
            for name, bone in bones.items():
                in_batch, other = (sets[name].apply(bone.vertices) for sets in (together.at(number), alone.at(0)))
                np.testing.assert_allclose(in_batch, other, atol=1e-9)


def test_bones_that_the_spline_carries() -> None:
    random, nodes = np.random.default_rng(3), np.vstack([bone.vertices[::60] for bone in BONES.values()])
    before, after = BEFORE.points, AFTER.points
    weights = random.normal(size=(3, *nodes.shape))
    by_before, by_after = spline_derivative(nodes, before, after)(weights)
    way = random.normal(size=(2, *before.shape))
    ends = [fit_spline(before + s * MOVE * way[0], after + s * MOVE * way[1])(nodes) for s in (1.0, -1.0)]
    wanted = np.tensordot(weights, ends[0] - ends[1], axes=2) / (2.0 * MOVE)
    derivative = np.tensordot(by_before, way[0], axes=2) + np.tensordot(by_after, way[1], axes=2)
    np.testing.assert_allclose(derivative, wanted, rtol=1e-4, atol=1e-4 * np.abs(wanted).max())
