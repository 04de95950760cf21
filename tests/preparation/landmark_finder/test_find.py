"""Landmarks found on bones whose landmarks are known: blocks upright and in curves, and the real anatomy."""

from collections.abc import Mapping

import numpy as np
import pytest

from support.anatomy import anatomy, anatomy_landmarks
from support.blocks import VERTEBRA, blocks, moved, skeleton, spine_and_hips
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
SOME = {name: SPINE[name] for name in ("hip_left", "hip_right", "T5", "T6", "T7", "T8", "T9")}


def known_spine() -> Landmarks:
    """Those of `spine_and_hips`, by its blocks; pedicles are as wide and high wherever they are cut."""
    six = np.array([[0, -45, 20], [0, -45, 0], [11, -29, 18], [11, -29, 10], [-11, -29, 18], [-11, -29, 10]])
    points = [0.8 * six + [0.0, 50.0, 440.0 - 20.0 * i] for i in range(len(VERTEBRAE))]
    return Landmarks(tuple(f"{b}_{p}" for b in VERTEBRAE for p in VERTEBRA_POINTS), np.vstack(points))


def test_points_of_a_vertebra_of_known_shape() -> None:
    marks = find_landmarks(skeleton()).complete()
    assert marks.names == (*(f"T7_{point}" for point in VERTEBRA_POINTS), "asis_left", "asis_right")
    np.testing.assert_allclose(marks.points[:2], [[0, -45, 520], [0, -45, 500]], atol=0.1)
    for side, sign in (("left", 1.0), ("right", -1.0)):
        for end, height in (("superior", 518.0), ("inferior", 510.0)):
            x, y, z = marks.point(f"T7_{side}_pedicle_{end}")
            assert sign * x == pytest.approx(11.0, abs=0.2)
            assert -30.0 < y < -18.0
            assert z == pytest.approx(height, abs=0.2)


def imposed(
    bones: Mapping[str, Surface], straight: Landmarks, curve: SpineCurve
) -> tuple[dict[str, Surface], Landmarks, dict[str, VertebraPose]]:
    """Bones, landmarks and poses of the curved spine; vertebrae move rigidly and the pelvis stays."""
    poses = vertebra_poses(straight, curve)
    curved = {n: Surface(poses[n](b.vertices), b.faces) if n in poses else b for n, b in bones.items()}
    return curved, correct(straight, curve, 0.0), poses


def rotation_off(measured: Landmarks, truth: Landmarks, left: np.ndarray) -> float:
    """Largest error of a vertebra's axial rotation [degrees]."""
    turned, right = (axial_rotation(spine_of(marks), left) for marks in (measured, truth))
    return max(abs((turned[name] or 0.0) - (right[name] or 0.0)) for name in turned)


@pytest.mark.parametrize(
    "curve",
    [
        pytest.param(SpineCurve(kind="thoracic", cobb=90.0), marks=pytest.mark.slow),
        pytest.param(SpineCurve(kind="thoracolumbar", cobb=45.0, direction="left"), marks=pytest.mark.slow),
        SpineCurve(kind="double_major", cobb=75.0, apical_rotation=40.0),
    ],
    ids=["thoracic", "thoracolumbar", "double_major"],
)
def test_curved_spine_of_known_landmarks(curve: SpineCurve) -> None:
    curved, truth, poses = imposed(SPINE, known_spine(), curve)
    marks = find_landmarks(curved).complete()
    turns = np.array([poses[name].matrix for name in VERTEBRAE])
    off = np.einsum("vpi,vij->vpj", (marks.points[:-2] - truth.points).reshape(-1, 6, 3), turns)
    assert np.abs(off[:, :2]).max() < 0.3
    assert np.abs(off[:, 2:, [0, 2]]).max() < 0.3
    assert off[:, 2:, 1].min() > -1.0  # anywhere along the pedicle, which is 10 mm long
    assert off[:, 2:, 1].max() < 9.0
    assert rotation_off(Landmarks(truth.names, marks.points[:-2]), truth, np.array([1.0, 0.0])) < 0.7


def test_iliac_spine_is_not_the_pubis() -> None:
    for side, sign in (("left", 1.0), ("right", -1.0)):
        x, y, z = find_landmarks(skeleton()).landmarks.point(f"asis_{side}")
        assert y == -80.0
        assert z > 80.0
        assert sign * x >= 80.0


def test_missing_bones_are_named_and_the_others_found() -> None:
    landmarks = find_landmarks({name: bone for name, bone in SOME.items() if name not in ("hip_right", "T7")})
    assert set(landmarks.unsure) == {"T7", "asis_left", "asis_right"}
    assert "between T5 and T9" in landmarks.unsure["T7"]
    assert "'hip_right' is missing" in landmarks.unsure["asis_left"]
    assert landmarks.landmarks.vertebrae() == ("T5", "T6", "T8", "T9")
    with pytest.raises(InputError, match=r"no landmarks on 'T7'.*no surface"):
        landmarks.complete()
    with pytest.raises(InputError, match="any of T1 to L5 is missing"):
        find_landmarks({name: bone for name, bone in skeleton().items() if name != "T7"})


def without_faces(surface: Surface) -> Surface:
    return Surface(surface.vertices, surface.faces[20:])


def of_blocks(*boxes) -> Surface:
    return moved(blocks(boxes), 0.8 * np.eye(3), [0.0, 50.0, 440.0 - 20.0 * 6])  # where T7 is


FUSED = (
    *(((a[0], a[1], a[2] - up), (b[0], b[1], b[2] - up)) for up in (0, 24) for a, b in VERTEBRA),
    ((-16, -60, -6), (16, -30, 2)),  # bone in place of the disc
)
ONE_PEDICLE = (*VERTEBRA[:2], *VERTEBRA[3:])
NO_ARCH = (VERTEBRA[0],)
NO_CANAL = (*VERTEBRA, ((-16, -30, 0), (16, -10, 20)))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("broken", "reason"),
    [
        (of_blocks(*ONE_PEDICLE), "pedicle"),
        (of_blocks(*NO_ARCH), "no canal"),
        (of_blocks(*NO_CANAL), "no canal"),
        (of_blocks(*FUSED), "two vertebrae fused"),
        (without_faces(SPINE["T7"]), "hole"),
        (joined(SPINE["T7"], SPINE["T8"]), "2 pieces"),
    ],
    ids=["one pedicle", "no arch", "no canal", "fused", "hole", "two pieces"],
)
def test_vertebra_that_cannot_be_told_is_named_and_the_others_found(broken: Surface, reason: str) -> None:
    landmarks = find_landmarks({**SOME, "T7": broken})
    assert reason in landmarks.unsure["T7"]
    assert list(landmarks.unsure) == ["T7"]
    assert list(landmarks.vertebrae) == ["T5", "T6", "T8", "T9"]


RIDGE = ((2, -30, 14), (6, -28, 18))
"""A ridge of the wall of the body beside the midline, as coarse voxels make it."""


def test_a_ridge_of_the_wall_is_not_taken_for_a_pedicle() -> None:
    whole, ridged = (find_landmarks({**SOME, "T7": of_blocks(*VERTEBRA, *more)}) for more in ((), (RIDGE,)))
    assert not ridged.unsure
    lateral = [ridged.landmarks.point(f"T7_{side}_pedicle_superior")[0] for side in ("left", "right")]
    expected = [whole.landmarks.point(f"T7_{side}_pedicle_superior")[0] for side in ("left", "right")]
    np.testing.assert_allclose(lateral, expected, atol=0.3)


def test_a_pedicle_unlike_the_opposite_one_is_in_doubt() -> None:
    pedicles = ((8, -30, 4), (14, -18, 18)), ((-14, -30, 12), (-8, -18, 18))
    landmarks = find_landmarks({**SOME, "T7": of_blocks(VERTEBRA[0], *pedicles, *VERTEBRA[3:])})
    assert list(landmarks.unsure) == ["T7"]
    assert "left pedicle is" in landmarks.unsure["T7"]


def test_vertebrae_that_the_image_cuts_off_are_in_doubt() -> None:
    top = SPINE["T5"].vertices[:, 2].max()
    rib = moved(blocks((((40, -20, -60), (50, -10, 0)),)), np.eye(3), [0.0, 0.0, top])
    assert not find_landmarks(SOME).unsure
    assert not find_landmarks({**SOME, "rib_left_05": moved(rib, np.eye(3), [0.0, 0.0, -5.0])}).unsure
    landmarks = find_landmarks({**SOME, "rib_left_05": rib})
    assert list(landmarks.unsure) == ["T5"]
    assert "it ends flat at z = 376 mm, as rib_left_05 does" in landmarks.unsure["T5"]


def test_a_vertebra_off_the_curve_of_its_neighbours_is_in_doubt() -> None:
    tilt = np.radians(28.0)
    turn = np.array([[1, 0, 0], [0, np.cos(tilt), -np.sin(tilt)], [0, np.sin(tilt), np.cos(tilt)]])
    centre = SPINE["T7"].vertices.mean(axis=0)
    tilted = moved(SPINE["T7"], turn, list(centre - turn @ centre))
    assert "28 degrees off the curve of the spine" in find_landmarks({**SOME, "T7": tilted}).unsure["T7"]


def test_exchanged_names_are_told() -> None:
    landmarks = find_landmarks({**SOME, "T7": SPINE["T8"], "T8": SPINE["T7"]})
    assert set(landmarks.unsure) == {"T7", "T8"}
    assert "names exchanged" in landmarks.unsure["T7"]


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
