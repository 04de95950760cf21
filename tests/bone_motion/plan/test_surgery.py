"""Planned surgeries: targets are met by formulas of this test's own, by the least motion, and as films allow."""

import math
import re
from dataclasses import replace
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from scipy import optimize

from support.anatomy import anatomy_landmarks
from support.known_spine import known_spine
from warp_trunk.bone_motion.plan import CurvePlan, Plan, lenke_of, plan_surgery
from warp_trunk.bone_motion.plan.least_motion import least_motion, limits_of, rim_gaps, segments
from warp_trunk.bone_motion.plan.spine_chain import Placed, spine_chain_of
from warp_trunk.bone_motion.plan.targets import targets_of
from warp_trunk.case import Case
from warp_trunk.case.landmarks import Landmarks
from warp_trunk.errors import InputError
from warp_trunk.geometry.rigid import fit_rigid
from warp_trunk.geometry.spline import fit_spline
from warp_trunk.geometry.surface import Surface
from warp_trunk.preparation.deformity import SpineCurve, correct
from warp_trunk.preparation.phantom import straight_trunk
from warp_trunk.spine import cobb_angles

NOTHING = Surface(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int32))


def case_of(landmarks: Landmarks) -> Case:
    return Case("spine", NOTHING, {}, landmarks)


def straight(of: str) -> Landmarks:
    """Landmarks of the phantom while it is straight, or of the anatomy."""
    return straight_trunk()[2] if of == "phantom" else anatomy_landmarks()


@cache
def imposed(kind: Any = "thoracic", cobb: float = 60.0, direction: Any = "right", of: str = "phantom") -> Case:
    """A scoliosis imposed on the landmarks of a straight trunk."""
    return case_of(correct(straight(of), SpineCurve(kind=kind, cobb=cobb, direction=direction), 0.0))


def axis(landmarks: Landmarks, level: str) -> np.ndarray:
    return landmarks.point(f"{level}_superior_endplate") - landmarks.point(f"{level}_inferior_endplate")


def angle_between(landmarks: Landmarks, upper: str, lower: str, plane: int) -> float:
    """Angle between two vertebrae's axes in the coronal (plane 0: x, z) or sagittal (1: y, z) plane."""
    u, v = (axis(landmarks, level)[[plane, 2]] for level in (upper, lower))
    return math.degrees(math.acos(u @ v / math.hypot(*u) / math.hypot(*v)))


def rotation(landmarks: Landmarks, level: str) -> float:
    """Angle of the pedicles' line against the iliac spines', seen from above."""
    left, right = (
        0.5
        * (
            landmarks.point(f"{level}_{side}_pedicle_superior")
            + landmarks.point(f"{level}_{side}_pedicle_inferior")
        )
        for side in ("left", "right")
    )
    line, pelvis = (left - right)[:2], (landmarks.point("asis_left") - landmarks.point("asis_right"))[:2]
    cosine = line @ pelvis / math.hypot(*line) / math.hypot(*pelvis)
    return math.degrees(math.acos(min(1.0, cosine)))  # rounding


def plumb(landmarks: Landmarks) -> np.ndarray:
    """T1 over the foot of L5, to the left and to the back."""
    return (landmarks.of_bone("T1").points.mean(axis=0) - landmarks.point("L5_inferior_endplate"))[:2]


def check_bodies_and_discs(before: Landmarks, after: Landmarks) -> None:
    levels = before.vertebrae()
    for level in levels:
        distances, other = (
            np.linalg.norm(points[:, None] - points[None], axis=2)
            for points in (before.of_bone(level).points, after.of_bone(level).points)
        )
        np.testing.assert_allclose(other, distances, atol=1e-9)
        assert np.linalg.det(fit_rigid(before.of_bone(level).points, after.of_bone(level).points).rotation) > 0
    for upper, lower in pairwise(levels):
        lengths = [
            np.linalg.norm(marks.point(f"{upper}_inferior_endplate") - marks.point(f"{lower}_superior_endplate"))
            for marks in (before, after)
        ]
        assert lengths[1] == pytest.approx(lengths[0], abs=0.5)
    for name in ("asis_left", "asis_right"):
        np.testing.assert_array_equal(after.point(name), before.point(name))


@pytest.mark.parametrize("unfused", ["follow", "fixed"])
def test_without_a_target_nothing_moves(unfused: Any) -> None:
    case = imposed()
    surgery = plan_surgery(case, Plan(uiv="T4", liv="L1", unfused=unfused))
    np.testing.assert_allclose(surgery.landmarks_after.points, case.landmarks_before.points, atol=1e-9)
    assert surgery.warnings == ()


@pytest.mark.parametrize(
    ("kind", "cobb", "direction", "of"),
    [
        ("thoracic", 60.0, "right", "phantom"),
        ("thoracic", 40.0, "left", "phantom"),
        ("thoracolumbar", 45.0, "left", "phantom"),
        ("double_major", 75.0, "right", "phantom"),
        ("thoracic", 60.0, "right", "anatomy"),
        ("double_major", 75.0, "right", "anatomy"),
    ],
)
def test_targets_are_met(kind: str, cobb: float, direction: str, of: str) -> None:
    case = imposed(kind, cobb, direction, of)
    before = case.landmarks_before
    curves = [curve for curve in cobb_angles(before) if curve.angle > 0.7 * cobb]
    assert len(curves) == (2 if kind == "double_major" else 1)
    asked = tuple(CurvePlan(apex=curve.apex, correction=0.65, derotation=0.4) for curve in curves)
    plan = Plan(
        uiv="T3",
        liv="L4",
        curves=asked,
        kyphosis_T5_T12=25.0,
        lordosis_L1_L5=30.0,
        balance="centre",
        sva_after=10.0,
    )
    after = plan_surgery(case, plan).landmarks_after
    for curve in curves:
        assert angle_between(after, curve.upper, curve.lower, 0) == pytest.approx(0.35 * curve.angle, abs=0.5)
        assert rotation(after, curve.apex) == pytest.approx(0.6 * rotation(before, curve.apex), abs=0.5)
    assert angle_between(after, "T5", "T12", 1) == pytest.approx(25.0, abs=0.5)
    assert angle_between(after, "L1", "L5", 1) == pytest.approx(30.0, abs=0.5)
    np.testing.assert_allclose(plumb(after), [0.0, -10.0], atol=0.5)
    check_bodies_and_discs(before, after)


def test_values_after_are_met_and_the_rest_is_kept() -> None:
    case = imposed()
    before = case.landmarks_before
    after = plan_surgery(
        case, Plan(uiv="T4", liv="L1", curves=(CurvePlan(apex="T8", cobb_after=21.0, rotation_after=5.0),))
    ).landmarks_after
    assert angle_between(after, "T5", "T12", 0) == pytest.approx(21.0, abs=0.5)
    assert rotation(after, "T8") == pytest.approx(5.0, abs=0.5)
    for upper, lower in (("T5", "T12"), ("L1", "L5")):
        assert angle_between(after, upper, lower, 1) == pytest.approx(
            angle_between(before, upper, lower, 1), abs=0.5
        )
    assert plumb(after)[1] == pytest.approx(plumb(before)[1], abs=0.5)
    assert rotation(after, "T1") == pytest.approx(rotation(before, "T1"), abs=0.5)


def test_fixed_segments_keep_their_rotation() -> None:
    """Below the fusion nothing moves; above it the spine goes as one body with the uppermost fused vertebra."""
    case = imposed()
    before = case.landmarks_before
    plan = Plan(uiv="T4", liv="L1", unfused="fixed", curves=(CurvePlan(apex="T8", correction=0.5),))
    after = plan_surgery(case, plan).landmarks_after
    for level in ("L1", "L2", "L5"):
        np.testing.assert_allclose(after.of_bone(level).points, before.of_bone(level).points, atol=1e-9)
    for level in ("T1", "T2", "T3"):
        turned, top = (fit_rigid(before.of_bone(b).points, after.of_bone(b).points) for b in (level, "T4"))
        assert math.degrees((turned * top.inv()).angle) < 1.0
    assert angle_between(after, "T5", "T12", 0) == pytest.approx(30.0, abs=0.5)


@pytest.mark.parametrize("share", [0.0, 0.3])
def test_unfused_curve_corrects_by_its_share(share: float) -> None:
    case = imposed()
    lumbar = cobb_angles(case.landmarks_before)[-1]
    plan = Plan(uiv="T4", liv="T12", spontaneous=share, curves=(CurvePlan(apex="T8", correction=0.65),))
    after = plan_surgery(case, plan).landmarks_after
    assert lumbar.upper == "T12"
    left = angle_between(after, lumbar.upper, lumbar.lower, 0) / lumbar.angle
    assert left == pytest.approx(1.0 - share, abs=0.02 if share else 1.0)


@pytest.mark.parametrize("of", ["phantom", "anatomy"])
def test_imposed_curve_is_corrected_as_it_was_imposed(of: str) -> None:
    """70 % of every curve, all levels fused: what `correct` does by taking 70 % of the imposed curve away.

    Seen from the side it changes the angles, as a vertebra that is upright leans less; the plan asks for them.
    T1 comes back to the sacrum by more than with `correct`.
    """
    true = correct(straight(of), SpineCurve(cobb=60.0), 0.7)
    before = imposed(of=of).landmarks_before
    curves = tuple(CurvePlan(apex=c.apex, correction=0.7, derotation=0.7) for c in cobb_angles(before))
    plan = Plan(
        uiv="T1", liv="L5", curves=curves,
        kyphosis_T5_T12=angle_between(true, "T5", "T12", 1),
        lordosis_L1_L5=angle_between(true, "L1", "L5", 1),
    )  # fmt: skip
    after = plan_surgery(case_of(before), plan).landmarks_after
    assert np.linalg.norm(after.points - true.points, axis=1).max() < {"phantom": 4.5, "anatomy": 8.0}[of]
    for level in true.vertebrae():
        off = fit_rigid(after.of_bone(level).points, true.of_bone(level).points).angle
        assert math.degrees(off) < 2.0


@pytest.mark.parametrize(
    ("plan", "rule"),
    [
        (Plan(uiv="T4", liv="L1", curves=(CurvePlan(apex="L3", correction=0.5),)), "outside the fusion"),
        (
            Plan(
                uiv="T4",
                liv="L1",
                curves=(CurvePlan(apex="T8", correction=0.5), CurvePlan(apex="T9", correction=0.5)),
            ),
            "give each curve once",
        ),
        (Plan(uiv="C6", liv="L1"), "'C6' has no landmarks"),
    ],
)
def test_what_the_spine_does_not_have_is_refused(plan: Plan, rule: str) -> None:
    with pytest.raises(InputError, match=rule):
        plan_surgery(imposed(), plan)


STANDING = {"T1": -5.0, "T5": 30.0, "T12": -30.0, "L4": 10.0, "L5": 10.0}
"""A thoracic curve of 60 degrees to the right over a lumbar one of 40 to the left."""
RIGHT = {"T1": -30.0, "T5": -5.0, "T12": -35.0, "L4": 13.0, "L5": 13.0}
LEFT = {"T1": 45.0, "T5": 50.0, "T12": -4.0, "L4": 6.0, "L5": 6.0}
"""Bent to the right the thoracic curve is 30 degrees, to the left the lumbar one is 10."""


def case(left: dict[str, float] | None = LEFT, right: dict[str, float] | None = RIGHT) -> Case:
    return replace(
        case_of(known_spine(to_left=STANDING)),
        bending_left=None if left is None else known_spine(to_left=left),
        bending_right=None if right is None else known_spine(to_left=right),
    )


SELECTIVE = Plan(uiv="T4", liv="T12", curves=(CurvePlan(apex="T8", correction=0.8),))


def test_share_that_bends_out() -> None:
    flexibility = {curve.before.upper: curve.flexibility for curve in plan_surgery(case(), SELECTIVE).curves}
    assert flexibility["T5"] == pytest.approx(0.5, abs=1e-6)
    assert flexibility["T12"] == pytest.approx(0.75, abs=1e-6)


def test_unfused_curve_corrects_by_what_bent_out() -> None:
    """Unless the plan says another share."""
    for plan, left in ((SELECTIVE, 10.0), (replace(SELECTIVE, spontaneous=0.2), 32.0)):
        assert plan_surgery(case(), plan).curves[-1].cobb_after == pytest.approx(left, abs=0.1)


def test_unfused_curves_follow_the_fused_ones() -> None:
    """By three quarters of their share without films, above the fusion and below it."""
    surgery = plan_surgery(case(None, None), SELECTIVE)
    assert surgery.curves[-1].cobb_after == pytest.approx(0.4 * 40.0, abs=0.1)
    after = surgery.landmarks_after
    before = case_of(known_spine(to_left=STANDING)).landmarks_before
    assert angle_between(after, "T1", "T4", 0) == pytest.approx(
        0.4 * angle_between(before, "T1", "T4", 0), abs=0.1
    )


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("lean", [-4.0, 0.0, 4.0])
def test_t1_leans_to_the_curve_that_is_left(side: float, lean: float) -> None:
    """By 0.65 mm for each of its 16 degrees, wherever it stood before; a mirrored spine mirrors it."""
    before = known_spine(to_left={level: side * tilt + lean for level, tilt in STANDING.items()})
    after = plan_surgery(case_of(before), SELECTIVE).landmarks_after
    assert plumb(after)[0] == pytest.approx(side * 0.65 * 16.0, abs=0.1)


@pytest.mark.parametrize(("lowest", "left"), [("L1", 0.10), ("L2", 0.28), ("L3", 0.46), ("L4", 0.64)])
def test_t1_comes_home_by_the_discs_below_the_fusion(lowest: str, left: float) -> None:
    """0.18 of its way for each of the five below L1 and so on, and no lean to a curve that begins below them."""
    before = known_spine(to_left={"T1": 0.0, "T9": -25.0, "L4": 25.0, "L5": 5.0})
    plan = Plan(uiv="T9", liv=lowest, curves=(CurvePlan(apex="L1", correction=0.6),))
    after = plan_surgery(case_of(before), plan).landmarks_after
    assert plumb(after)[0] == pytest.approx(left * plumb(before)[0], abs=0.1)


def test_posture_changes_with_the_correction() -> None:
    """With a quarter of the curve corrected T1 goes half the way; where nothing is to follow it stays."""
    before = case(None, None).landmarks_before
    quarter = replace(SELECTIVE, curves=(CurvePlan(apex="T8", correction=0.25),))
    left = (1.0 - 0.75 * 0.25) * 40.0
    for plan, expected in (
        (quarter, 0.5 * plumb(before)[0] + 0.5 * 0.65 * left),
        (replace(SELECTIVE, curves=(CurvePlan(apex="T8", derotation=0.3),)), plumb(before)[0]),
        (replace(SELECTIVE, balance="keep"), plumb(before)[0]),
        (replace(quarter, unfused="fixed"), plumb(before)[0]),
        (replace(SELECTIVE, balance="centre"), 0.0),
    ):
        after = plan_surgery(case(None, None), plan).landmarks_after
        assert plumb(after)[0] == pytest.approx(expected, abs=0.1), plan


def test_films_decide_the_curve_type() -> None:
    """The lumbar curve bends out to 10 on the film to the left; the one to the right alone shows it stiff."""
    assert lenke_of(case())[0] == "1"
    assert lenke_of(case(left=None))[0] == "3"


def test_more_than_a_film_showed_is_told() -> None:
    """60 degrees over T5 to T12 bent out to 30: 4.3 of 8.6 degrees a segment; a correction of 48 asks for 6.9."""
    (text,) = plan_surgery(case(), SELECTIVE).warnings
    assert "bends further than the films of side bending showed" in text
    assert "T8-T9 by 2.6" in text
    gentle = Plan(uiv="T4", liv="T12", curves=(CurvePlan(apex="T8", correction=0.4),))
    assert plan_surgery(case(), gentle).warnings == ()


def test_films_that_are_exchanged() -> None:
    with pytest.raises(InputError, match="exchange the two files"):
        plan_surgery(case(RIGHT, LEFT), SELECTIVE)


SPINE = known_spine(
    to_left={"T1": 0.0, "T5": 30.0, "T9": 0.0, "T12": -30.0, "L4": 0.0},
    back={"T1": -20.0, "T5": -15.0, "T12": 15.0, "L1": 15.0, "L5": -15.0},
    turned={"T4": 0.0, "T8": 18.0, "T12": 0.0},
)
CASE = case_of(SPINE)


def refusal(plan: Plan) -> str:
    with pytest.raises(InputError) as caught:
        plan_surgery(CASE, plan)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def nearest(text: str) -> float:
    match = re.search(r"the nearest is (-?[\d.]+)", text)
    assert match is not None, text
    return float(match[1])


@pytest.mark.slow
def test_nearest_can_be_met() -> None:
    """A fusion with nothing that follows cannot be straightened wholly and keep T1 where it is."""
    plan = Plan(uiv="T5", liv="T12", unfused="fixed", curves=(CurvePlan(apex="T9", correction=1.0),))
    text = refusal(plan)
    assert "curve T9: Cobb angle after" in text
    reached = nearest(text)
    assert 0.0 < reached < 60.0
    plan_surgery(CASE, replace(plan, curves=(CurvePlan(apex="T9", cobb_after=reached + 1.0),)))


def test_target_of_segments_that_stay() -> None:
    text = refusal(Plan(uiv="T4", liv="T12", unfused="fixed", lordosis_L1_L5=40.0))
    assert "lordosis_L1_L5 40 degrees cannot be met" in text
    assert nearest(text) == pytest.approx(30.0, abs=0.5)


def test_height_of_a_disc_at_its_rim() -> None:
    """Against the least height over points on both rims."""
    chain = spine_chain_of(SPINE)
    change = np.random.default_rng(3).normal(scale=6.0, size=chain.angles.shape)
    placed = Placed(chain, change)
    circle = np.linspace(0.0, 2.0 * np.pi, 20000)
    for row, gap in enumerate(rim_gaps(placed)):
        upper, lower, disc = placed.axes[row], placed.axes[row + 1], placed.discs[row]
        least = []
        for normal, across, sign in ((lower, upper, 1.0), (upper, lower, -1.0)):
            side = np.cross(across, [1.0, 0.0, 0.0])
            side /= np.linalg.norm(side)
            rim = 12.0 * (np.outer(np.cos(circle), side) + np.outer(np.sin(circle), np.cross(across, side)))
            least.append(float((sign * (sign * disc + rim) @ normal).min()))
        assert gap == pytest.approx(min(least), abs=1e-6)


def test_least_motion_is_that_of_sequential_quadratic_programming() -> None:
    """The sum of s^2 / b over T4 to L4 under targets without a proportional part."""
    chain = spine_chain_of(SPINE)
    free = np.array([level in SPINE.vertebrae()[3:15] for level in chain.levels])
    plan = Plan(uiv="T4", liv="L4", unfused="fixed", kyphosis_T5_T12=40.0, sva_after=5.0)
    targets = targets_of(chain, plan, ())
    mine = least_motion(limits_of(chain), targets, free)
    still = chain.angles - chain.angles[-1] * [0.0, 1.0, 0.0]
    bend = np.abs(segments(still)[free]) + 1.0
    bend[:, 1] = 3.0

    def change(s: np.ndarray) -> np.ndarray:
        steps = np.zeros_like(mine)
        steps[free] = s.reshape(-1, 3)
        return np.cumsum(steps[::-1], axis=0)[::-1]

    def cost(s: np.ndarray) -> float:
        return float((s**2 / bend.ravel()).sum() + (100.0 * change(s)[0, 2]) ** 2)

    def off(s: np.ndarray) -> np.ndarray:
        return np.array([target.off(Placed(chain, change(s))) for target in targets])

    met = {"type": "eq", "fun": off}
    reference = optimize.minimize(
        cost, np.zeros(bend.size), method="SLSQP", constraints=met, options={"maxiter": 500, "ftol": 1e-12}
    )
    assert np.abs(off(reference.x)).max() < 1e-6
    np.testing.assert_allclose(mine, change(reference.x), atol=5e-3)
    assert np.abs(mine).max() > 3.0


PLAN = Plan(uiv="T4", liv="L1", curves=(CurvePlan(apex="T9", correction=0.6, derotation=0.4),))


def test_other_landmarks_go_by_the_spline() -> None:
    """Ribs and sternum have landmarks in some cases."""
    extra = SPINE.points[:20:5] + np.array([60.0, -50.0, 4.0])
    names = tuple(f"rib_left_0{i}_tip" for i in range(1, 5))
    order = np.random.default_rng(0).permutation(len(SPINE.names) + 4)
    both, points = (*SPINE.names, *names), np.vstack([SPINE.points, extra])
    before = Landmarks(tuple(both[i] for i in order), points[order])
    after = plan_surgery(replace(CASE, landmarks_before=before), PLAN).landmarks_after
    spine = plan_surgery(CASE, PLAN).landmarks_after
    expected = fit_spline(SPINE.points, spine.points)(extra)
    np.testing.assert_allclose([after.point(name) for name in names], expected, atol=1e-8)
    np.testing.assert_allclose([after.point(name) for name in SPINE.names], spine.points, atol=1e-12)
