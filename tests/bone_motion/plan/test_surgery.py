"""Planned surgeries: targets are met by formulas of this test's own, by the least motion, and as films allow."""

import math
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from scipy import optimize

from support.anatomy import anatomy_landmarks
from support.asserting import refuses
from support.known_spine import known_spine
from support.shown import check_shown, described
from warp_trunk.bone_motion.plan import CurvePlan, Plan, lenke_of, plan_surgery, plan_words
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
    return math.degrees(abs(math.atan2(u[0] * v[1] - u[1] * v[0], u @ v)))


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


AFTERWARDS = Plan(uiv="T4", liv="L1", curves=(CurvePlan(apex="T8", cobb_after=21.0, rotation_after=5.0),))
T9, FILMS, NONE = CurvePlan(apex="T9", correction=0.5), case(), case(None, None)
PLANS = {
    "as films allow": (FILMS, SELECTIVE),
    "gentler": (FILMS, replace(SELECTIVE, curves=(CurvePlan(apex="T8", correction=0.4),))),
    "another share of what is not fused": (FILMS, replace(SELECTIVE, spontaneous=0.2)),
    "a film to the right alone": (case(left=None), SELECTIVE),
    "films that are exchanged": (case(RIGHT, LEFT), SELECTIVE),
    "without films": (NONE, SELECTIVE),
    "a quarter": (NONE, replace(SELECTIVE, curves=(CurvePlan(apex="T8", correction=0.25),))),
    "derotation alone": (NONE, replace(SELECTIVE, curves=(CurvePlan(apex="T8", derotation=0.3),))),
    "no target": (NONE, replace(SELECTIVE, curves=())),
    "T1 as before": (NONE, replace(SELECTIVE, balance="keep")),
    "T1 over the sacrum": (NONE, replace(SELECTIVE, balance="centre", sva_after=12.0)),
    "values after": (imposed(), AFTERWARDS),
    "values after, below it nothing": (imposed(), replace(AFTERWARDS, unfused="fixed")),
    "no share": (imposed(), replace(AFTERWARDS, spontaneous=0.0, kyphosis_T5_T12=20.0)),
    "an apex outside": (FILMS, Plan(uiv="T4", liv="T10", curves=(CurvePlan(apex="L2", correction=0.5),))),
    "a curve twice": (FILMS, replace(SELECTIVE, curves=(*SELECTIVE.curves, T9))),
    "no such vertebra": (FILMS, replace(SELECTIVE, uiv="C6")),
    "a target of what stays": (NONE, Plan(uiv="T4", liv="T12", unfused="fixed", lordosis_L1_L5=40.0)),
}


def test_plans_and_what_comes_of_them_are_as_accepted() -> None:
    """Curves, the apex, kyphosis, lordosis, T1 and the ends of the fusion by formulas of this test's own."""
    lines = []
    for name, (patient, plan) in PLANS.items():
        lines += [f"== {name}: {plan_words(plan)}", *outcome(patient, plan)]
    check_shown("surgeries", lines)


def outcome(patient: Case, plan: Plan) -> Iterator[str]:
    """Curves, angles and ways before and after a plan, or why it is refused."""
    try:
        surgery = plan_surgery(patient, plan)
    except InputError as refusal:
        yield str(refusal)
        return
    yield f"Lenke {lenke_of(patient)}"
    before, after = patient.landmarks_before, surgery.landmarks_after
    for curve in surgery.curves:
        ends = curve.before.upper, curve.before.lower
        bent, angles = described(curve.flexibility), [angle_between(m, *ends, 0) for m in (before, after)]
        yield f"{'-'.join(ends)} {described(angles)}, {curve.cobb_after:.3f} stated, bends out by {bent}"
    for marks in (before, after):
        turns, sides = [rotation(marks, level) for level in ("T1", "T8", "L2")], [("T5", "T12"), ("L1", "L5")]
        seen = [angle_between(marks, *ends, 1) for ends in sides]
        yield f"turned {described(turns)}, from the side {described(seen)}, T1 at {described(plumb(marks))}"
    rows = (after.of_bone(level).points - before.of_bone(level).points for level in ("T1", "T4", "L1", "L5"))
    yield f"T1, T4, L1 and L5 move by {described([float(np.linalg.norm(row, axis=1).mean()) for row in rows])}"
    yield from surgery.warnings


SPINE = known_spine(
    to_left={"T1": 0.0, "T5": 30.0, "T9": 0.0, "T12": -30.0, "L4": 0.0},
    back={"T1": -20.0, "T5": -15.0, "T12": 15.0, "L1": 15.0, "L5": -15.0},
    turned={"T4": 0.0, "T8": 18.0, "T12": 0.0},
)
CASE = case_of(SPINE)


@pytest.mark.slow
def test_the_nearest_can_be_met() -> None:
    """A fusion with nothing that follows cannot be straightened so far and keep T1 where it is."""
    plan = replace(SELECTIVE, unfused="fixed")
    with refuses("curve T8: Cobb angle after 12 degrees cannot be met", "the nearest is 16.1"):
        plan_surgery(NONE, plan)
    plan_surgery(NONE, replace(plan, curves=(CurvePlan(apex="T8", cobb_after=16.2),)))


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
