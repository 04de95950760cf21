"""How pelvis, ribs and sternum follow landmarks that move in known ways, on the phantom and real anatomy."""

import os
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from support.anatomy import anatomy
from warp_trunk.bone_motion import articulation
from warp_trunk.bone_motion.rib_cage import RibCage, ends
from warp_trunk.bone_motion.rib_cage import follow as follow_cage
from warp_trunk.bone_motion.skeleton import Skeleton
from warp_trunk.bone_motion.vertebra_motion import Vertebrae
from warp_trunk.case.case import Pose
from warp_trunk.case.landmarks import Landmarks
from warp_trunk.case.rib_coupling import RibCoupling
from warp_trunk.geometry.distance_field import SurfaceDistance
from warp_trunk.geometry.rigid import NamedMotions, RigidMotion, fit_rigid
from warp_trunk.geometry.surface import Surface
from warp_trunk.io.surface_files import read_surface, surface_files
from warp_trunk.preparation.deformity import SpineCurve, make_case
from warp_trunk.preparation.deformity.spine_curve import vertebra_poses
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
    prescribed: dict[str, RigidMotion] | None = None,
    coupling: RibCoupling | None = None,
    pose: Pose = "surgery",
) -> dict[str, RigidMotion]:
    """Those of one set of landmarks, by name."""
    sets, coupling = (before.points[None], after.points[None]), coupling or RibCoupling()
    return dict(articulation.bone_motions(Skeleton(bones, before), *sets, coupling, prescribed, pose=pose).at(0))


def way(motion: RigidMotion, points: np.ndarray) -> np.ndarray:
    return motion.apply(points) - points


def test_a_whole_trunk_that_moves_rigidly_moves_every_bone_alike() -> None:
    bones, before = straight()
    for bone, motion in bone_motions(bones, before, moved("")).items():
        if bone not in ("hip_left", "hip_right", "sacrum"):  # two landmarks do not hold them
            np.testing.assert_allclose(motion.as_matrix(), TURN.as_matrix(), atol=1e-9)


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


def test_shoulder_blades_and_clavicles_of_real_anatomy() -> None:
    """A curve of 60 degrees is corrected by 70 %: blades do not cut into ribs, and a clavicle keeps its joints."""
    skin, bones = anatomy()
    extra = Path(os.environ["WARP_TRUNK_ANATOMY"], "bones_extra")
    if not extra.is_dir():
        pytest.skip("the folder that WARP_TRUNK_ANATOMY names has no bones_extra/")
    more = {name: read_surface(path) for name, path in surface_files(extra).items()}
    case = make_case(skin, bones | more, SpineCurve(), 0.7)
    motions = motions_of(case)
    for side in ("left", "right"):
        blade = case.bones[f"scapula_{side}"]
        after = SurfaceDistance(Surface(motions[f"scapula_{side}"].apply(blade.vertices), blade.faces))
        for rib in (f"rib_{side}_{number:02d}" for number in range(1, 9)):
            assert after.at(motions[rib].apply(case.bones[rib].vertices)).min() > -1.0
    for neighbour in ("sternum", "scapula_left"):
        joint = ends(case.bones["clavicle_left"], case.bones[neighbour])[0]
        assert np.linalg.norm(motions["clavicle_left"].apply(joint) - motions[neighbour].apply(joint)) < 4.0


SKIN, BONES, LANDMARKS = straight_trunk()
NO_STERNUM = {name: bone for name, bone in BONES.items() if name != "sternum"}
RIBS = [name for name in BONES if name.startswith("rib")]


def vertebrae_of(curve: SpineCurve) -> Vertebrae:
    poses = vertebra_poses(LANDMARKS, curve)
    axes = np.array([[pose.before, pose.axis] for pose in poses.values()])
    return Vertebrae(tuple(poses), RigidMotion.stack(pose.motion for pose in poses.values()), axes)


CURVED = vertebrae_of(SpineCurve(cobb=40.0))
UPRIGHT = np.array([[np.zeros(3), [0.0, 0.0, 1.0]]])


def follow(
    bones: dict[str, Surface],
    vertebrae: Vertebrae,
    coupling: RibCoupling,
    prescribed: dict[str, RigidMotion] | None = None,
) -> NamedMotions:
    return follow_cage(RibCage(bones, vertebrae.levels), vertebrae, coupling, prescribed)


def moved_vertebra(level: str) -> RigidMotion:
    return CURVED.motion[CURVED.levels.index(level)]


def vertebra(rib: str) -> str:
    return f"T{int(rib[-2:])}"


def turned(motion: RigidMotion) -> float:
    """Turn about the vertical [degrees]."""
    return float(np.degrees(Rotation.from_matrix(motion.rotation).as_euler("YXZ")[2]))


def test_heads_stay_at_their_facets_and_ribs_keep_their_shape() -> None:
    motions = follow(BONES, CURVED, RibCoupling())
    for rib in RIBS:
        head, _ = ends(BONES[rib], BONES[vertebra(rib)])
        goal = moved_vertebra(vertebra(rib)).apply(head)
        np.testing.assert_allclose(motions[rib].apply(head), goal, atol=1e-9)


def test_what_a_front_end_lacks_of_the_shift_turns_the_rib_about_its_head() -> None:
    way = Vertebrae(("T8",), RigidMotion(np.eye(3)[None], np.array([[20.0, 0.0, 0.0]])), UPRIGHT)
    whole, part = (follow(NO_STERNUM, way, RibCoupling(shift=shift))["rib_left_08"] for shift in (1.0, 0.8))
    head, tip = ends(BONES["rib_left_08"], BONES["T8"])
    assert whole.apply(tip)[0] - tip[0] == pytest.approx(20.0, abs=1e-9)
    assert part.apply(head)[0] - head[0] == pytest.approx(20.0, abs=1e-9)
    assert part.apply(tip)[0] - tip[0] < 17.0


def test_cartilages_keep_their_length_within_a_tenth() -> None:
    for curve in (SpineCurve(cobb=40.0), SpineCurve(kind="double_major", cobb=40.0)):
        motions = follow(BONES, vertebrae_of(curve), RibCoupling())
        sternum = BONES["sternum"].vertices
        for rib in RIBS:
            if int(rib[-2:]) <= 7:
                _, tip = ends(BONES[rib], BONES[vertebra(rib)])
                anchor = sternum[np.linalg.norm(sternum - tip, axis=1).argmin()]
                before = np.linalg.norm(tip - anchor)
                after = np.linalg.norm(motions[rib].apply(tip) - motions["sternum"].apply(anchor))
                assert abs(after - before) <= 0.1 * before + 0.011


def directly(degrees: float) -> Vertebrae:
    """The motions of the curve, with so much of each vertebra's turn forced by screws."""
    return CURVED._replace(coupled=CURVED.parts(CURVED.levels).axial_rotation - np.radians(degrees))


@pytest.mark.parametrize("degrees", [-4.0, 4.0, 25.0])
def test_where_screws_turn_a_vertebra_its_ribs_lag_within_the_facets(degrees: float) -> None:
    motions = follow(NO_STERNUM, directly(degrees), RibCoupling())
    gaps = []
    for rib in RIBS:
        head, _ = ends(BONES[rib], BONES[vertebra(rib)])
        gaps.append(np.linalg.norm(motions[rib].apply(head) - moved_vertebra(vertebra(rib)).apply(head)))
    assert 0.5 < max(gaps) <= 3.0 + 1e-9


def test_ribs_take_a_share_of_their_own_of_what_screws_turn() -> None:
    shares = RibCoupling(axial_rotation=0.6, reversible_part=0.5, derotation_transfer=0.2)
    rib = "rib_left_06"
    part, all_ = (follow(NO_STERNUM, motions, shares)[rib] for motions in (directly(5.0), CURVED))
    assert turned(part) - turned(all_) == pytest.approx((0.2 - 0.5 * 0.6) * 5.0, abs=0.1)
    whole = follow(NO_STERNUM, directly(5.0), replace(shares, derotation_transfer=1.0))[rib]
    head, _ = ends(BONES[rib], BONES["T6"])
    np.testing.assert_allclose(whole.apply(head), moved_vertebra("T6").apply(head), atol=1e-9)


def test_ribs_below_the_seventh_take_a_part_of_the_tilt_that_grows_downwards() -> None:
    bones = {name: bone for name, bone in NO_STERNUM.items() if not name.endswith(("_07", "_09"))}
    level, some = (follow(bones, CURVED, RibCoupling(floating=share)) for share in (0.0, 0.5))

    def leaned(rib: str) -> float:
        axis = vertebra_poses(LANDMARKS, SpineCurve())[vertebra(rib)].axis
        axis_of_all, other = (motions[rib].rotation @ axis for motions in (level, some))
        return float(np.arctan2(other[0], other[2]) - np.arctan2(axis_of_all[0], axis_of_all[2]))

    assert leaned("rib_left_06") == pytest.approx(0.0, abs=1e-12)
    for rib, part in (("rib_left_08", 0.2), ("rib_left_11", 0.8), ("rib_right_12", 1.0)):
        assert leaned(rib) == pytest.approx(
            part * 0.5 * CURVED.parts([vertebra(rib)]).lateral_bending[0], abs=2e-3
        )


def test_sternum_and_shoulder_blade_are_nearest_to_what_carries_them() -> None:
    """Of ribs each of which moves on its own: the rigid motion fitted to the points that carry, all together."""
    bones, random = {**BONES, "scapula_left": BONES["rib_left_05"]}, np.random.default_rng(2)
    prescribed = {rib: RigidMotion.exp(random.normal(size=6) * [0.1, 0.1, 0.1, 9.0, 9.0, 9.0]) for rib in RIBS}
    followed = follow(bones, CURVED, RibCoupling(), prescribed)
    tips = {rib: ends(BONES[rib], BONES[vertebra(rib)])[1][None] for rib in RIBS if int(rib[-2:]) <= 7}
    near = {rib: BONES[rib].vertices for rib in (f"rib_left_{number:02d}" for number in range(2, 8))}
    tree = KDTree(bones["scapula_left"].vertices)
    near = {rib: points[tree.query(points)[0] <= 20.0] for rib, points in near.items()}
    for bone, parts in (("sternum", tips), ("scapula_left", near)):
        after = np.vstack([prescribed[rib].apply(points) for rib, points in parts.items()])
        wanted = fit_rigid(np.vstack(list(parts.values())), after)
        np.testing.assert_allclose(followed[bone].as_matrix(), wanted.as_matrix(), atol=1e-9)


def test_a_shoulder_blade_rides_on_the_ribs_under_it() -> None:
    bones = {**BONES, "scapula_left": BONES["rib_left_05"]}
    way = RigidMotion.exp(np.array([0.0, 0.1, 0.0, 4.0, 0.0, 9.0]))
    motions = follow_cage(RibCage(bones, ()), CURVED, RibCoupling(), {name: way for name in RIBS})
    assert "scapula_left" not in motions  # ribs whose vertebrae are unknown lead nothing
    prescribed = dict.fromkeys(RIBS, way)
    motions = follow(bones, CURVED, RibCoupling(), prescribed)
    np.testing.assert_allclose(motions["scapula_left"].as_matrix(), way.as_matrix(), atol=1e-9)
    half = follow(bones, CURVED, RibCoupling(scapula=0.5), prescribed)["scapula_left"]
    np.testing.assert_allclose((half * half).as_matrix(), way.as_matrix(), atol=1e-9)
