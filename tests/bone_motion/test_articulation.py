"""How bones move on the phantom, whose landmarks follow known motions, and on real anatomy."""

import os
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from support.anatomy import anatomy
from warp_trunk.bone_motion import articulation
from warp_trunk.bone_motion.rib_cage import ends
from warp_trunk.bone_motion.skeleton import Skeleton
from warp_trunk.case.case import Pose
from warp_trunk.case.landmarks import Landmarks
from warp_trunk.case.rib_coupling import RibCoupling
from warp_trunk.geometry.distance_field import SurfaceDistance
from warp_trunk.geometry.rigid import RigidMotion
from warp_trunk.geometry.surface import Surface
from warp_trunk.io.surface_files import read_surface, surface_files
from warp_trunk.preparation.deformity import SpineCurve, make_case
from warp_trunk.preparation.phantom import straight_trunk
from warp_trunk.run.patient import motions_of

TURN = RigidMotion.exp(np.array([0.02, 0.1, -0.03, -14.0, 6.0, 5.0]))


@cache
def straight() -> tuple[dict[str, Surface], Landmarks]:
    _, bones, landmarks = straight_trunk()
    return bones, landmarks


def moved(*which: str) -> Landmarks:
    """Landmarks after a surgery that moves those whose names begin so, and no other."""
    _, before = straight()
    rows = [name.startswith(which) for name in before.names]
    return Landmarks(before.names, np.where(np.array(rows)[:, None], TURN.apply(before.points), before.points))


def bone_motions(
    bones: dict[str, Surface],
    before: Landmarks,
    after: Landmarks,
    known: dict[str, RigidMotion] | None = None,
    coupling: RibCoupling | None = None,
    pose: Pose = "surgery",
) -> dict[str, RigidMotion]:
    """Those of one set of landmarks, by name."""
    sets, coupling = (before.points[None], after.points[None]), coupling or RibCoupling()
    return dict(articulation.bone_motions(Skeleton(bones, before), *sets, coupling, known, pose=pose).at(0))


def way(motion: RigidMotion, points: np.ndarray) -> np.ndarray:
    return motion.apply(points) - points


def test_a_whole_trunk_that_moves_rigidly_moves_every_bone_alike() -> None:
    bones, before = straight()
    for bone, motion in bone_motions(bones, before, moved("")).items():
        if bone not in ("hip_left", "hip_right", "sacrum"):  # two landmarks do not hold them
            np.testing.assert_allclose(motion.as_matrix(), TURN.as_matrix(), atol=1e-9)


def test_vertebrae_follow_their_own_landmarks_and_the_pelvis_its_spines() -> None:
    bones, before = straight()
    motions = bone_motions(bones, before, moved("T8_"))
    np.testing.assert_allclose(motions["T8"].as_matrix(), TURN.as_matrix(), atol=1e-9)
    for still in ("T7", "L5", "hip_left", "hip_right", "sacrum"):
        assert np.abs(way(motions[still], bones[still].vertices)).max() < 1e-9


def test_the_pelvis_is_one_body_without_a_turn_about_its_spines() -> None:
    bones, before = straight()
    motions = bone_motions(bones, before, moved("asis"))
    np.testing.assert_array_equal(motions["hip_left"].as_matrix(), motions["sacrum"].as_matrix())
    across = before.point("asis_left") - before.point("asis_right")
    assert motions["sacrum"].log()[:3] @ across == pytest.approx(0.0, abs=1e-9)
    spines = np.array([before.point(f"asis_{side}") for side in ("left", "right")])
    np.testing.assert_allclose(motions["sacrum"].apply(spines), TURN.apply(spines), atol=1e-9)


@pytest.mark.parametrize("number", [3, 7, 10])
def test_ribs_follow_against_the_pelvis_wherever_that_goes(number: int) -> None:
    bones, before = straight()
    rib = f"rib_left_{number:02d}"
    alone = bone_motions(bones, before, moved(f"T{number}_"))[rib]
    after = moved(f"T{number}_")
    # about the line of the iliac spines, which two landmarks leave open, the pelvis does not turn: a shift it is
    way = np.array([7.0, -3.0, 11.0])
    with_pelvis = bone_motions(bones, before, Landmarks(after.names, after.points + way))[rib]
    points = bones[rib].vertices
    np.testing.assert_allclose(with_pelvis.apply(points), alone.apply(points) + way, atol=1e-8)
    head, _ = ends(bones[rib], bones[f"T{number}"])
    np.testing.assert_allclose(alone.apply(head), TURN.apply(head), atol=1e-8)


def test_a_bone_known_after_surgery_goes_there_and_takes_its_neighbours_along() -> None:
    bones, before = straight()
    motions = bone_motions(bones, before, before, {"sternum": TURN})
    np.testing.assert_allclose(motions["sternum"].as_matrix(), TURN.as_matrix(), atol=1e-9)
    assert np.linalg.norm(way(motions["rib_left_05"], bones["rib_left_05"].vertices), axis=1).max() > 5.0
    assert np.abs(way(motions["rib_left_09"], bones["rib_left_09"].vertices)).max() < 1e-9


def test_the_cage_leans_as_one_with_a_thoracic_spine_that_bends_sideways() -> None:
    """All thoracic vertebrae turn by 15 degrees in the coronal plane: every rib and the sternum do just that."""
    bones, before = straight()
    turn = Rotation.from_euler("y", 15.0, degrees=True).as_matrix()
    lean = RigidMotion(turn, np.array([25.0, 0.0, -8.0]))
    thoracic = np.array([name.startswith("T") for name in before.names])
    after = Landmarks(before.names, np.where(thoracic[:, None], lean.apply(before.points), before.points))
    motions = bone_motions(bones, before, after, pose="bending")
    for bone in ("rib_left_01", "rib_right_12", "sternum"):
        np.testing.assert_allclose(motions[bone].as_matrix(), lean.as_matrix(), atol=1e-9)
    assert np.abs(way(motions["hip_left"], bones["hip_left"].vertices)).max() < 1e-9
    surgery = bone_motions(bones, before, after)["rib_right_08"].log()
    assert abs(surgery[1]) < np.radians(5.0)  # a curve that surgery takes away leaves ribs as they lean


def test_what_vertebrae_do_beside_leaning_reaches_the_ribs_by_shares() -> None:
    """A turn of T8 about its own axis, in a trunk that leans as well: her ribs turn by its share."""
    bones, before = straight()
    lean = RigidMotion.exp(np.array([0.0, np.radians(12.0), 0.0, 0.0, 0.0, 0.0]))
    shares = RibCoupling(axial_rotation=0.5, reversible_part=1.0)
    centre = bones["T8"].vertices.mean(axis=0)
    axis = before.point("T8_superior_endplate") - before.point("T8_inferior_endplate")
    turn = Rotation.from_rotvec(np.radians(10.0) * axis / np.linalg.norm(axis))
    about = RigidMotion.about(turn.as_matrix(), centre, centre)
    points = before.points.copy()
    eight = np.array([name.startswith("T8_") for name in before.names])
    points[eight] = about.apply(points[eight])
    upright = bone_motions(bones, before, Landmarks(before.names, points), coupling=shares)
    thoracic = np.array([name.startswith("T") for name in before.names])
    points[thoracic] = lean.apply(points[thoracic])
    bent = bone_motions(bones, before, Landmarks(before.names, points), coupling=shares, pose="bending")
    for bone in ("rib_left_08", "rib_right_08"):
        np.testing.assert_allclose(bent[bone].as_matrix(), (lean * upright[bone]).as_matrix(), atol=1e-8)


@cache
def corrected_anatomy() -> tuple[dict[str, Surface], dict[str, RigidMotion]]:
    """Bones before surgery, and how they go as a curve of 60 degrees is corrected by 70 %."""
    skin, bones = anatomy()
    extra = Path(os.environ["WARP_TRUNK_ANATOMY"], "bones_extra")
    if not extra.is_dir():
        pytest.skip("the folder that WARP_TRUNK_ANATOMY names has no bones_extra/")
    more = {name: read_surface(path) for name, path in surface_files(extra).items()}
    case = make_case(skin, bones | more, SpineCurve(), 0.7)
    return dict(case.bones), dict(motions_of(case))


@pytest.mark.parametrize("side", ["left", "right"])
def test_a_shoulder_blade_does_not_cut_into_ribs(side: str) -> None:
    bones, motions = corrected_anatomy()
    blade = bones[f"scapula_{side}"]
    after = SurfaceDistance(Surface(motions[f"scapula_{side}"].apply(blade.vertices), blade.faces))
    for number in range(1, 9):
        rib = f"rib_{side}_{number:02d}"
        assert after.at(motions[rib].apply(bones[rib].vertices)).min() > -1.0


def test_a_clavicle_keeps_both_of_its_joints() -> None:
    bones, motions = corrected_anatomy()
    clavicle = "clavicle_left"
    for neighbour in ("sternum", "scapula_left"):
        joint = ends(bones[clavicle], bones[neighbour])[0]
        assert np.linalg.norm(motions[clavicle].apply(joint) - motions[neighbour].apply(joint)) < 4.0
