"""Poses of the vertebrae of a curve, and the curve found in measured points."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from warp_trunk.case.anatomy import VERTEBRAE
from warp_trunk.case.landmarks import VERTEBRA_POINTS, Landmarks
from warp_trunk.errors import InputError
from warp_trunk.preparation.deformity import SpineCurve, correct, read_measured_spine
from warp_trunk.preparation.deformity.spine_curve import vertebra_poses
from warp_trunk.preparation.phantom import straight_trunk
from warp_trunk.spine.cobb import kyphosis
from warp_trunk.spine.spine import spine_of

KINDS = ("thoracic", "thoracolumbar", "double_major")


def straight_spine() -> Landmarks:
    """Upright bodies of 20 mm with discs of 6 mm, swaying from front to back but not tilted."""
    body = np.array([[0, 0, 10], [0, 0, -10], [9, 20, 6], [9, 20, -6], [-9, 20, 6], [-9, 20, -6]], dtype=float)
    names, points = [], []
    for i, bone in enumerate(VERTEBRAE):
        names += [f"{bone}_{point}" for point in VERTEBRA_POINTS]
        points.append(body + np.array([0.0, 20.0 * math.sin(0.4 * i), 900.0 - 26.0 * i]))
    return Landmarks((*names, "asis_left"), np.vstack([*points, [[110.0, -60.0, 430.0]]]))


def pose_landmarks(curve: SpineCurve) -> np.ndarray:
    """Landmarks of the curved spine, shape (17, 6, 3), T1 first."""
    straight = straight_spine()
    poses = vertebra_poses(straight, curve)
    return np.stack([poses[bone](straight.of_bone(bone).points) for bone in VERTEBRAE])


def tilts(posed: np.ndarray) -> np.ndarray:
    """Coronal tilt of each body [deg], from its endplate centres."""
    axis = posed[:, 0] - posed[:, 1]
    return np.degrees(np.arctan2(axis[:, 0], axis[:, 2]))


def between(tilt: np.ndarray, upper: str, lower: str) -> float:
    """Angle between the most tilted bodies from one vertebra down to another [deg]."""
    return float(np.ptp(tilt[VERTEBRAE.index(upper) : VERTEBRAE.index(lower) + 1]))


@pytest.mark.parametrize("direction", ["right", "left"])
@pytest.mark.parametrize("cobb", [15.0, 80.0])
@pytest.mark.parametrize("kind", KINDS)
def test_cobb_angle_is_the_one_asked_for(kind: Any, cobb: float, direction: Any) -> None:
    tilt = tilts(pose_landmarks(SpineCurve(kind=kind, cobb=cobb, direction=direction)))
    assert np.ptp(tilt) == pytest.approx(cobb, abs=1.0)
    if kind == "thoracic":  # shares of the curves above and below: 0.43 ± 0.13 and 0.54 ± 0.14 in patients
        assert between(tilt, "T1", "T5") == pytest.approx(0.43 * cobb, abs=0.03 * cobb)
        assert between(tilt, "T12", "L5") == pytest.approx(0.54 * cobb, abs=0.05 * cobb)


@pytest.mark.parametrize("kind", KINDS)
def test_curved_spine_keeps_its_length_and_loses_height(kind: Any) -> None:
    before = straight_spine().points[:-1].reshape(17, 6, 3)[:, :2].mean(axis=1)
    after = pose_landmarks(SpineCurve(kind=kind, cobb=60.0))[:, :2].mean(axis=1)
    lengths = [np.linalg.norm(np.diff(x, axis=0), axis=1) for x in (before, after)]
    np.testing.assert_allclose(lengths[1], lengths[0], rtol=0.01)  # chords of arcs of at most 20 degrees
    assert 10.0 < before[0, 2] - after[0, 2] < 60.0
    assert -25.0 < after[0, 0] < 20.0  # T1 above the sacrum or to the convex side, as in patients
    np.testing.assert_allclose(after[:, 1], before[:, 1], atol=1e-9)


def test_right_thoracic_curve_bulges_right_and_turns_the_right_side_back() -> None:
    posed = pose_landmarks(SpineCurve(kind="thoracic", cobb=60.0, apical_rotation=20.0, direction="right"))
    apex = posed[VERTEBRAE.index("T8")]
    assert apex[:2, 0].mean() < -30.0
    left, right = apex[2], apex[4]
    # the bodies stand upright before, so that only the axial rotation moves a pedicle back
    assert math.degrees(math.asin((right[1] - left[1]) / 18.0)) == pytest.approx(20.0, abs=1e-3)
    body, pedicles = apex[:2].mean(axis=0), apex[2:].mean(axis=0)
    assert body[0] < pedicles[0]  # the body turns to the convex side


def test_left_is_the_mirror_image_of_right() -> None:
    right, left = (
        pose_landmarks(SpineCurve(kind="double_major", cobb=50.0, direction=side, t1_offset=30.0))
        for side in ("right", "left")
    )
    np.testing.assert_allclose(left, right[:, [0, 1, 4, 5, 2, 3]] * [-1.0, 1.0, 1.0], atol=1e-9)
    assert right[0, :2].mean(axis=0)[0] == pytest.approx(-30.0, abs=0.1)  # T1 stands where it is asked for


def test_rotation_by_default_is_that_of_the_cited_cohort() -> None:
    assert SpineCurve(cobb=68.0).rotation == pytest.approx(22.0, abs=2.0)  # Brink et al. 2017, another cohort
    assert SpineCurve(cobb=0.0, kyphosis=30.0).rotation == 0.0
    assert SpineCurve(cobb=68.0, apical_rotation=5.0).rotation == 5.0


def test_kyphosis_is_the_one_asked_for_and_t1_stays_as_far_forward() -> None:
    before = straight_spine()
    posed = pose_landmarks(SpineCurve(cobb=5.0, kyphosis=35.0))  # a tilt adds to the projection
    after = Landmarks(before.names, np.vstack([posed.reshape(-1, 3), before.points[-1:]]))
    assert kyphosis(spine_of(after))["T5-T12"] == pytest.approx(35.0, abs=1.0)
    assert np.ptp(tilts(posed)) == pytest.approx(5.0, abs=0.2)
    foremost = posed[0, :2].mean(axis=0)[1]
    assert foremost == pytest.approx(before.points[:2].mean(axis=0)[1], abs=0.1)


def test_secondary_curves_have_the_shares_asked_for() -> None:
    tilt = tilts(pose_landmarks(SpineCurve(cobb=60.0, upper_share=0.6, lower_share=0.3)))
    assert between(tilt, "T1", "T5") == pytest.approx(36.0, abs=0.5)
    assert between(tilt, "T12", "L4") == pytest.approx(18.0, abs=3.0)


def test_bad_numbers_and_spines_are_refused() -> None:
    for field, value in {"kind": "lumbar", "cobb": 121.0, "apical_rotation": float("nan")}.items():
        with pytest.raises(InputError, match=f"'{field}'.*not"):
            SpineCurve(**{field: value})
    straight = straight_spine()
    keep = [i for i, name in enumerate(straight.names) if name != "T9_inferior_endplate"]
    fewer = Landmarks(tuple(straight.names[i] for i in keep), straight.points[keep])
    for spine, says in (
        (fewer, "T9_inferior_endplate"),
        (Landmarks(straight.names, straight.points * [1.0, 1.0, -1.0]), "T1 highest"),
    ):
        with pytest.raises(InputError, match=says):
            vertebra_poses(spine, SpineCurve())


STRAIGHT = straight_trunk()[2]
CURVE = SpineCurve(cobb=50.0)


def written(folder: Path, levels: tuple[str, ...] = VERTEBRAE, edit: str = "") -> Path:
    """Body centres and pedicles of a curved spine as a table."""
    spine = spine_of(correct(STRAIGHT, CURVE, 0.0))
    lines = ["name,x,y,z"]
    for level in levels:
        row = spine.levels.index(level)
        points = (spine.endplates[row].mean(axis=0), *spine.pedicles[row])
        for part, point in zip(("body", "left_pedicle", "right_pedicle"), points, strict=True):
            lines.append(f"{level}_{part}," + ",".join(f"{value:.3f}" for value in point))
    path = folder / "spine.csv"
    path.write_text("\n".join([*lines, edit] if edit else lines) + "\n", encoding="utf-8")
    return path


def test_curve_is_found_again_in_its_points(tmp_path: Path) -> None:
    poses = vertebra_poses(STRAIGHT, read_measured_spine(written(tmp_path)))
    true = vertebra_poses(STRAIGHT, CURVE)
    for level in VERTEBRAE[1:-1]:
        assert np.degrees(poses[level].tilt - true[level].tilt) == pytest.approx(0.0, abs=3.0), level
        assert np.degrees(poses[level].rotation - true[level].rotation) == pytest.approx(0.0, abs=3.0), level
    apart = [poses[level].after - true[level].after for level in VERTEBRAE]
    assert np.linalg.norm(apart, axis=1).max() < 6.0


def test_levels_above_the_highest_fade_out_and_bad_tables_are_refused(tmp_path: Path) -> None:
    spine = read_measured_spine(written(tmp_path, VERTEBRAE[4:]))
    assert spine.continued == ("T1", "T2", "T3", "T4")
    assert (np.diff(np.abs(spine.tilt[:5])) > 0.0).all()
    assert (np.diff(np.abs(spine.turn[:5])) > 0.0).all()
    for levels, edit, rule in (
        (VERTEBRAE[12:], "", "8 or more levels"),
        (VERTEBRAE[:12], "", "down to L5"),
        (VERTEBRAE[8:], "T8_body,0,0,9", "'T8_left_pedicle' is missing"),
        (VERTEBRAE[8:], "T8_body,0,0,0\nT8_left_pedicle,1,0,0\nT8_right_pedicle,0,0,0", "runs the other way"),
    ):
        with pytest.raises(InputError, match=rule):
            read_measured_spine(written(tmp_path, levels, edit))
