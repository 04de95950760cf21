"""Measures of trunks turned by known angles, of real anatomy too, and their derivatives against differences."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from support.anatomy import anatomy, anatomy_landmarks
from support.asserting import not_none
from support.meshes import turned_about_z
from support.phantoms import whole_phantom
from support.small_trunk import small_case, turned
from warp_trunk.case.landmarks import Landmarks
from warp_trunk.geometry.surface import Surface
from warp_trunk.measures import TrunkMeasures, back_surface_rotation, compare_skins, measure
from warp_trunk.measures.derivatives import (
    Derivative,
    hump_derivative,
    rotation_derivative,
    shoulder_derivatives,
    slope_derivative,
)
from warp_trunk.measures.quantities import QUANTITIES, measured


def test_change_of_the_skin_is_that_of_its_vertices():
    case, trunk = small_case()
    displacement = turned(trunk, -14.0)[trunk.skin_nodes]
    skin = Surface(case.skin.vertices + displacement, case.skin.faces)
    measures = measure(skin, case.landmarks_before, case.skin)
    lengths = np.sqrt((displacement**2).sum(axis=1))
    assert measures.skin_change_max == pytest.approx(lengths.max())
    assert measures.skin_change_mean == pytest.approx(lengths.mean())


def test_turning_the_whole_patient_about_the_vertical_changes_no_measure_of_the_back():
    case = whole_phantom()
    turn = Rotation.from_euler("z", 33.0, degrees=True)
    turned = Landmarks(case.landmarks_before.names, turn.apply(case.landmarks_before.points))
    skins = case.skin, Surface(turn.apply(case.skin.vertices), case.skin.faces)
    before, after = (
        {(row.quantity, row.level): row.value for row in measured("", measure(skin, marks))}
        for skin, marks in zip(skins, (case.landmarks_before, turned), strict=True)
    )
    of_back = [name for name in before if QUANTITIES[name[0]].of_skin or name[0] == "trunk_shift_mm"]
    assert len(of_back) > 80
    for name in of_back:
        assert after[name] == pytest.approx(before[name], abs=1e-6)


TWIST = 20.0
"""Clockwise, over the height of the trunk above the pelvis [degrees]."""


def twist(points, bottom, top):
    share = np.clip((points[:, 2] - bottom) / (top - bottom), 0.0, None)
    return turned_about_z(points, -TWIST * share, (0.0, -60.0))


def test_twisted_anatomy_has_the_angles_of_its_twist():
    (skin, _), landmarks = anatomy(), anatomy_landmarks()
    bottom, top = landmarks.of_bone("L5").points[:, 2].min() - 10.0, skin.vertices[:, 2].max()
    turned = Landmarks(landmarks.names, twist(landmarks.points, bottom, top))
    twisted = Surface(twist(skin.vertices, bottom, top), skin.faces)
    straight, measures = measure(skin, landmarks), measure(twisted, turned)
    for level in straight.bsr:
        height = landmarks.of_bone(level).points[:, 2].mean()
        angle = TWIST * (height - bottom) / (top - bottom)
        for name in ("bsr", "axial_rotation"):
            before, after = (not_none(getattr(state, name)[level]) for state in (straight, measures))
            assert after - before == pytest.approx(angle, abs=0.5)
    assert not_none(measures.hump_height["T8"]) > 15.0
    error = not_none(compare_skins(twisted, skin, turned).bsr_error["T4-T12"])
    assert error.mean > 5.0
    assert not error.undetectable


CASE = whole_phantom()
LEVELS = ("T2", "T5", "T8", "T12", "L2", "L4")
DIFFERENCE = 1e-6


def rough() -> Surface:
    """A lopsided skin, no two of whose points are level."""
    noise = np.random.default_rng(1).normal(scale=0.3, size=CASE.skin.vertices.shape)
    return Surface(CASE.skin.vertices + noise, CASE.skin.faces)


def differs(
    number: Callable[[TrunkMeasures], float | None], derivative: Derivative, skin: Surface, landmarks: Landmarks
) -> list[tuple[float, float]]:
    """The change of a number in random directions, by its derivative and by central differences."""
    pairs = []
    for seed in range(8):
        rng = np.random.default_rng(seed)
        along = (
            rng.normal(size=skin.vertices.shape) * (seed != 1),
            rng.normal(size=landmarks.points.shape) * (seed != 0),
        )
        ends = []
        for sign in (1.0, -1.0):
            moved = Surface(skin.vertices + sign * DIFFERENCE * along[0], skin.faces)
            marks = Landmarks(landmarks.names, landmarks.points + sign * DIFFERENCE * along[1])
            ends.append(not_none(number(measure(moved, marks))))
        predicted = np.vdot(derivative.vertices, along[0]) + np.vdot(derivative.landmarks, along[1])
        pairs.append((float(predicted), (ends[0] - ends[1]) / (2.0 * DIFFERENCE)))
    return pairs


def agree(pairs: list[tuple[float, float]]) -> None:
    predicted, wanted = np.array(pairs).T
    np.testing.assert_allclose(predicted, wanted, rtol=0.0, atol=1e-5 * np.abs(wanted).max())
    assert np.abs(wanted).max() > 0.0


def turned_pelvis(degrees: float) -> Landmarks:
    """The landmarks with the line of the iliac spines turned about its middle, seen from above."""
    points, names = CASE.landmarks_before.points.copy(), CASE.landmarks_before.names
    rows = [names.index("asis_left"), names.index("asis_right")]
    middle = points[rows].mean(axis=0)
    points[rows] = Rotation.from_euler("z", degrees, degrees=True).apply(points[rows] - middle) + middle
    return Landmarks(names, points)


@pytest.mark.parametrize(("level", "pelvis"), [("T2", 0), ("T8", 0), ("L2", 0), ("T10", 20)])
def test_rotation(level: str, pelvis: float) -> None:
    skin, landmarks = rough(), turned_pelvis(pelvis)
    tangent = not_none(back_surface_rotation(skin, landmarks)[level])
    derivative = rotation_derivative(skin, landmarks, level, tangent)
    assert derivative.value == pytest.approx(tangent.angle, abs=1e-9)
    agree(differs(lambda m: m.bsr[level], derivative, skin, landmarks))


@pytest.mark.parametrize("level", ["T8", "L2"])
def test_hump(level: str) -> None:
    skin, landmarks = rough(), CASE.landmarks_before
    tangent = not_none(back_surface_rotation(skin, landmarks)[level])
    derivative = not_none(hump_derivative(skin, landmarks, level, tangent))
    agree(differs(lambda m: m.hump_height[level], derivative, skin, landmarks))


@pytest.mark.parametrize("level", ["T8", "L2"])
def test_slope(level: str) -> None:
    skin, landmarks = rough(), turned_pelvis(5.0)
    slope = not_none(measure(skin, landmarks).slopes[level])
    derivative = not_none(slope_derivative(skin, landmarks, level, slope))
    assert derivative.value == pytest.approx(measure(skin, landmarks).slopes[level], abs=1e-9)
    agree(differs(lambda m: m.slopes[level], derivative, skin, landmarks))


def test_shoulders() -> None:
    skin, landmarks = rough(), CASE.landmarks_before
    derivatives = shoulder_derivatives(skin, landmarks, not_none(measure(skin, landmarks).shoulders))
    for key, name in (("shoulder_difference_mm", "difference"), ("clavicle_angle_deg", "angle")):

        def number(measures: TrunkMeasures, name: str = name) -> float | None:
            return None if measures.shoulders is None else getattr(measures.shoulders, name)

        agree(differs(number, derivatives[key], skin, landmarks))
