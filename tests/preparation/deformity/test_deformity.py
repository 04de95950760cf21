import os
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from warp_trunk.case.landmarks import VERTEBRAE, Landmarks
from warp_trunk.errors import InputError
from warp_trunk.geometry.surface import Surface
from warp_trunk.geometry.surface_checks import crossings
from warp_trunk.io.surface_files import read_surface
from warp_trunk.preparation.deformity import SpineCurve, correct, impose
from warp_trunk.preparation.landmark_finder import find_landmarks
from warp_trunk.preparation.phantom import straight_trunk

SKIN, BONES, LANDMARKS = straight_trunk()
CURVE = SpineCurve(cobb=50.0)
IMPOSED = impose(SKIN, BONES, LANDMARKS, CURVE)


def tilts(landmarks: Landmarks) -> np.ndarray:
    axes = np.array([np.subtract(*landmarks.of_bone(bone).points[:2]) for bone in VERTEBRAE])
    return np.degrees(np.arctan2(axes[:, 0], axes[:, 2]))


def test_no_curve_gives_the_input_back_to_the_bit() -> None:
    skin, bones, landmarks = impose(SKIN, BONES, LANDMARKS, SpineCurve(cobb=0.0))
    np.testing.assert_array_equal(skin.vertices, SKIN.vertices)
    np.testing.assert_array_equal(landmarks.points, LANDMARKS.points)
    for name, bone in BONES.items():
        np.testing.assert_array_equal(bones[name].vertices, bone.vertices)


def test_landmarks_stay_on_their_vertebra() -> None:
    _, bones, landmarks = IMPOSED
    for bone in ("T4", "T9", "L3"):
        gaps = [
            np.linalg.norm(marks.of_bone(bone).points[:, None] - surfaces[bone].vertices[None], axis=2)
            for marks, surfaces in ((LANDMARKS, BONES), (landmarks, bones))
        ]
        np.testing.assert_allclose(gaps[1], gaps[0], atol=1e-9)


def test_pelvis_stays() -> None:
    _, bones, landmarks = IMPOSED
    for name in ("hip_left", "hip_right", "sacrum"):
        np.testing.assert_array_equal(bones[name].vertices, BONES[name].vertices)
    for name in ("asis_left", "asis_right"):
        np.testing.assert_array_equal(landmarks.point(name), LANDMARKS.point(name))


def test_correcting_all_gives_the_straight_spine_and_nothing_the_curved_one() -> None:
    np.testing.assert_array_equal(correct(LANDMARKS, CURVE, 1.0).points, LANDMARKS.points)
    np.testing.assert_allclose(correct(LANDMARKS, CURVE, 0.0).points, IMPOSED[2].points, atol=1e-12)


def test_hump_stands_on_the_convex_side() -> None:
    skin, _, landmarks = IMPOSED
    height = landmarks.of_bone("T9").points[:, 2].mean()
    back = skin.vertices[np.abs(skin.vertices[:, 2] - height) < 25.0]
    spine = landmarks.of_bone("T9").points[:, 0].mean()
    right, left = (back[(side * (back[:, 0] - spine) > 20.0)][:, 1].max() for side in (-1.0, 1.0))
    assert right > left + 4.0


def test_skin_does_not_cross_itself() -> None:
    assert len(crossings(IMPOSED[0])) == 0


def test_curve_that_folds_the_trunk_is_refused() -> None:
    squeezed = {n: Surface(b.vertices * [3.0, 1.0, 1.0], b.faces) for n, b in BONES.items()}
    wide = Surface(SKIN.vertices * [3.0, 1.0, 1.0], SKIN.faces)
    with pytest.raises(InputError, match=r"folds this trunk.*ask for less"):
        impose(wide, squeezed, LANDMARKS, SpineCurve(cobb=120.0, apical_rotation=60.0))


def test_skin_that_crosses_itself_is_refused() -> None:
    # a second sheet through the first
    crossed = Surface(
        np.vstack([SKIN.vertices, SKIN.vertices + np.array([15.0, 0.0, 0.0])]),
        np.vstack([SKIN.faces, SKIN.faces + len(SKIN.vertices)]),
    )
    with pytest.raises(InputError, match="cross itself"):
        impose(crossed, BONES, LANDMARKS, SpineCurve(cobb=20.0))


@cache
def anatomy() -> tuple[Surface, dict[str, Surface], Landmarks]:
    folder = os.environ.get("WARP_TRUNK_ANATOMY")
    if not folder or not Path(folder).is_dir():
        pytest.skip("WARP_TRUNK_ANATOMY names no folder with skin.ply and bones/")
    bones = {path.stem: read_surface(path) for path in sorted(Path(folder, "bones").glob("*.ply"))}
    return read_surface(Path(folder, "skin.ply")), bones, find_landmarks(bones).complete()


@pytest.mark.parametrize("kind", ["thoracic", "thoracolumbar", "double_major"])
def test_real_anatomy_bears_80_degrees(kind: Any) -> None:
    skin, bones, straight = anatomy()
    _, _, landmarks = impose(skin, bones, straight, SpineCurve(kind=kind, cobb=80.0))
    assert np.ptp(tilts(landmarks)) == pytest.approx(80.0, abs=1.0)
    after = correct(straight, SpineCurve(kind=kind, cobb=80.0), 0.7)
    assert np.ptp(tilts(after)) == pytest.approx(24.0, abs=1.0)
