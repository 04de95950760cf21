"""Landmarks found on bones whose landmarks are known: blocks, curved and broken ones too, and the real anatomy."""

from collections.abc import Mapping

import numpy as np
import pytest

from support.anatomy import anatomy, anatomy_landmarks
from support.blocks import VERTEBRA, blocks, known_landmarks, moved, skeleton, spine_and_hips
from support.shown import check_shown, described
from support.trunk_shapes import joined
from warp_trunk import InputError, Landmarks, SpineCurve, Surface, find_landmarks
from warp_trunk.case.anatomy import VERTEBRAE
from warp_trunk.case.landmarks import ASIS, VERTEBRA_POINTS, bone_of
from warp_trunk.geometry.distance_field import SurfaceDistance
from warp_trunk.preparation.deformity import correct
from warp_trunk.preparation.deformity.spine_curve import VertebraPose, vertebra_poses
from warp_trunk.spine.apical import axial_rotation
from warp_trunk.spine.spine import asis_axis, spine_of

SPINE = spine_and_hips()


def imposed(
    bones: Mapping[str, Surface], straight: Landmarks, curve: SpineCurve
) -> tuple[dict[str, Surface], Landmarks, dict[str, VertebraPose]]:
    """Bones, landmarks and poses of the curved spine; vertebrae move rigidly and the pelvis stays."""
    poses = vertebra_poses(straight, curve)
    curved = {n: Surface(poses[n](b.vertices), b.faces) if n in poses else b for n, b in bones.items()}
    return curved, correct(straight, curve, 0.0), poses


def check_known(marks: Landmarks, truth: Landmarks, turns: Mapping[str, np.ndarray]) -> None:
    """Vertebrae have their landmarks; those of a pedicle lie anywhere along it, which is 10 mm long."""
    for level in marks.vertebrae():
        off = (marks.of_bone(level).points - truth.of_bone(level).points) @ turns.get(level, np.eye(3))
        assert np.abs(off[:2]).max() < 0.3, level
        assert np.abs(off[2:, [0, 2]]).max() < 0.3, level
        assert -1.0 < off[2:, 1].min() <= off[2:, 1].max() < 9.0, level


def rotation_off(measured: Landmarks, truth: Landmarks, left: np.ndarray) -> float:
    """Largest error of a vertebra's axial rotation [degrees]."""
    turned, right = (axial_rotation(spine_of(marks), left) for marks in (measured, truth))
    return max(abs((turned[name] or 0.0) - (right[name] or 0.0)) for name in turned)


@pytest.mark.parametrize(
    ("curve", "levels"),
    [
        (SpineCurve(kind="double_major", cobb=75.0, apical_rotation=40.0), VERTEBRAE[6:13]),
        pytest.param(SpineCurve(kind="thoracic", cobb=90.0), VERTEBRAE, marks=pytest.mark.slow),
        pytest.param(
            SpineCurve(kind="thoracolumbar", cobb=45.0, direction="left"), VERTEBRAE, marks=pytest.mark.slow
        ),
    ],
    ids=["double_major", "thoracic", "thoracolumbar"],
)
def test_curved_spine_of_known_landmarks(curve: SpineCurve, levels: tuple[str, ...]) -> None:
    bones, truth, poses = imposed(SPINE, known_landmarks(), curve)
    marks = find_landmarks({name: bones[name] for name in (*levels, *ASIS.values())}).complete()
    assert marks.names == (*(f"{level}_{point}" for level in levels for point in VERTEBRA_POINTS), *ASIS)
    check_known(marks, truth, {name: pose.matrix for name, pose in poses.items()})
    names = marks.names[:-2]
    true_marks = Landmarks(names, np.array([truth.point(name) for name in names]))
    assert rotation_off(Landmarks(names, marks.points[:-2]), true_marks, np.array([1.0, 0.0])) < 0.7
    for side, sign in (("left", 1.0), ("right", -1.0)):  # not the pubis, which is further forward
        x, y, z = (marks.point(f"asis_{side}") - [0.0, 20.0, 0.0]) / 0.8
        assert y == pytest.approx(-80.0)
        assert z > 80.0
        assert sign * x >= 80.0


def of_blocks(level: str, *boxes) -> Surface:
    """A vertebra of these blocks at its place."""
    return moved(blocks(boxes), 0.8 * np.eye(3), [0.0, 50.0, 440.0 - 20.0 * VERTEBRAE.index(level)])


def tilted(bone: Surface, degrees: float) -> Surface:
    """It leans forward or back about its centroid."""
    angle, centre = np.radians(degrees), bone.vertices.mean(axis=0)
    turn = np.array(
        [[1, 0, 0], [0, np.cos(angle), -np.sin(angle)], [0, np.sin(angle), np.cos(angle)]], dtype=float
    )
    return moved(bone, turn, list(centre - turn @ centre))


BODY, _, _, *BEHIND = VERTEBRA
RIDGE = ((2, -30, 14), (6, -28, 18))
"""Of the wall of the body beside the midline, as coarse voxels make it: no pedicle."""
UNEQUAL = ((8, -30, 4), (14, -18, 18)), ((-14, -30, 12), (-8, -18, 18))
"""Pedicles: the left one is twice as high as the right one."""
FUSED = (
    *(((a[0], a[1], a[2] - up), (b[0], b[1], b[2] - up)) for up in (0, 24) for a, b in VERTEBRA),
    ((-16, -60, -6), (16, -30, 2)),  # bone in place of the disc
)


def broken_spine() -> dict[str, Surface]:
    """A fault at most levels; T4, T8, T9, T12, L2 and L4 have none, and T4 has a ridge."""
    top, open_one = SPINE["T1"].vertices[:, 2].max(), SPINE["L1"]
    return {
        **{name: bone for name, bone in SPINE.items() if name != "T11"},
        "rib_left_01": moved(blocks((((40, -20, -60), (50, -10, 0)),)), np.eye(3), [0.0, 0.0, top]),
        "T2": of_blocks("T2", *VERTEBRA, ((-16, -30, 0), (16, -10, 20))),  # a canal that is filled
        "T3": of_blocks("T3", BODY, VERTEBRA[1], *BEHIND),
        "T4": of_blocks("T4", *VERTEBRA, RIDGE),
        "T5": of_blocks("T5", BODY),
        "T6": SPINE["T7"],
        "T7": SPINE["T6"],
        "T10": of_blocks("T10", *FUSED),
        "L1": Surface(open_one.vertices, open_one.faces[20:]),
        "L3": tilted(SPINE["L3"], 28.0),
        "L5": of_blocks("L5", BODY, *UNEQUAL, *BEHIND),
    }


def test_the_doubts_of_a_broken_spine_are_as_accepted() -> None:
    """Each bone without landmarks has a reason, and the others have their landmarks."""
    landmarks = find_landmarks(broken_spine())
    check_known(landmarks.landmarks, known_landmarks(), {})
    doubts = [f"{name}: {why}" for name, why in landmarks.unsure.items()]
    apart = find_landmarks(
        {"T7": joined(SPINE["T7"], SPINE["T9"]), "T8": SPINE["T8"], "hip_left": SPINE["hip_left"]}
    )
    check_shown(
        "landmark_doubts",
        [
            *(f"{name} {described(landmarks.landmarks.point(name))}" for name in landmarks.landmarks.names),
            *doubts,
            "== T7 with T9, T8 and a hip bone",
            *(f"{name}: {why}" for name, why in apart.unsure.items()),
        ],
    )
    with pytest.raises(InputError, match=r"no landmarks on 'T1'.*give that bone whole"):
        landmarks.complete()


def test_a_spine_that_ends_above_a_rib_is_not_cut_off_and_one_without_vertebrae_is_refused() -> None:
    rib = moved(blocks((((40, -20, -60), (50, -10, 0)),)), np.eye(3), [0.0, 0.0, 515.0])
    assert not find_landmarks({**skeleton(), "rib_left_07": rib}).unsure
    with pytest.raises(InputError, match="any of T1 to L5 is missing"):
        find_landmarks({name: bone for name, bone in skeleton().items() if name != "T7"})


def test_real_anatomy() -> None:
    (_, bones), marks = anatomy(), anatomy_landmarks()
    assert len(marks.names) == 17 * 6 + 2
    for name, point in zip(marks.names, marks.points, strict=True):
        if "pedicle" not in name:  # those lie on the outline of the pedicle, or within the root of a process
            bone = bones[bone_of(name, bones) or ""]
            assert abs(SurfaceDistance(bone).at(point[None])[0]) < 0.05, name
    left, right = marks.point("asis_left"), marks.point("asis_right")
    assert 200.0 < left[0] - right[0] < 320.0
    # above the hip joints, below the top of the crest
    assert 60.0 < left[2] - bones["hip_left"].vertices[:, 2].min() < 180.0


CURVES = (
    SpineCurve(kind="thoracic", cobb=40.0),
    SpineCurve(kind="thoracic", cobb=60.0),
    SpineCurve(kind="thoracic", cobb=90.0),
    SpineCurve(kind="thoracolumbar", cobb=45.0, direction="left"),
    SpineCurve(kind="double_major", cobb=75.0),
)


@pytest.mark.parametrize(
    "curve",
    [CURVES[0], *(pytest.param(curve, marks=pytest.mark.slow) for curve in CURVES[1:])],
    ids=lambda curve: f"{curve.kind} {curve.cobb:g}",
)
def test_curves_imposed_on_real_anatomy(curve: SpineCurve) -> None:
    bones = {name: anatomy()[1][name] for name in (*VERTEBRAE, *ASIS.values())}  # those with landmarks
    curved, truth, _ = imposed(bones, anatomy_landmarks(), curve)
    landmarks = find_landmarks(curved)
    names = landmarks.landmarks.names
    true_marks = Landmarks(names, np.array([truth.point(name) for name in names]))
    off = np.linalg.norm(landmarks.landmarks.points - true_marks.points, axis=1)
    assert not landmarks.unsure
    assert off.mean() <= 1.0
    assert np.percentile(off, 95.0) <= 2.5
    assert off.max() <= 4.0
    assert rotation_off(landmarks.landmarks, true_marks, asis_axis(true_marks)) <= 2.0
