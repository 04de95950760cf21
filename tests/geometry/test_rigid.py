import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from warp_trunk.geometry.rigid import RigidMotion, fit_rigid

RNG = np.random.default_rng(5)
UP = np.array([0.0, 0.0, 1.0])
POINTS = RNG.uniform([-40, -20, 900], [40, 60, 1300], size=(12, 3))


def test_a_part_of_a_motion_is_a_part_of_its_screw() -> None:
    # a quarter turn about a vertical axis through (5, 0), rising by 8 mm
    aside = np.array([5.0, 0.0, 0.0])
    turn = Rotation.from_rotvec([0.0, 0.0, np.pi / 2])
    motion = fit_rigid(POINTS, turn.apply(POINTS - aside) + aside + 8.0 * UP)
    third = Rotation.from_rotvec([0.0, 0.0, np.pi / 6])
    expected = third.apply(POINTS - aside) + aside + 8.0 / 3 * UP
    np.testing.assert_allclose(motion.part(1 / 3).apply(POINTS), expected, atol=1e-9)


def test_points_on_a_line_are_turned_by_the_least_angle() -> None:
    line = np.array([[0.0, 0.0, 1000.0], [100.0, 0.0, 1000.0], [250.0, 0.0, 1000.0]])
    motion = fit_rigid(line, Rotation.from_rotvec([0.0, 0.0, 0.2]).apply(line) + UP)
    np.testing.assert_allclose(motion.log()[:3], [0.0, 0.0, 0.2], atol=1e-12)
    np.testing.assert_array_equal(fit_rigid(line, line).apply(POINTS), POINTS)


def scipy_of(motion: RigidMotion) -> RigidTransform:
    return RigidTransform.from_matrix(motion.as_matrix())


@pytest.mark.parametrize("size", [1e-9, 0.03, 1.0, 3.0, np.pi - 1e-9, np.pi], ids="{:g}".format)
def test_stacks_of_motions_against_scipy(size: float) -> None:
    """Exponential, logarithm, products, inverses and points, for angles from none to half a turn."""
    axes = RNG.normal(size=(2, 3, 3))
    screws = np.concatenate(
        [size * axes / np.linalg.norm(axes, axis=2)[..., None], 9.0 * RNG.normal(size=(2, 3, 3))], 2
    )
    motions, wanted = RigidMotion.exp(screws), RigidTransform.from_exp_coords(screws.reshape(-1, 6))
    np.testing.assert_allclose(motions.as_matrix().reshape(-1, 4, 4), wanted.as_matrix(), atol=1e-12)
    np.testing.assert_allclose(
        RigidMotion.exp(motions.log()).as_matrix(), motions.as_matrix(), atol=1e-7 if size > 3 else 1e-12
    )
    np.testing.assert_allclose(motions.angle, size, rtol=1e-7)
    a, b, points = motions[0], motions[1, ::-1], RNG.normal(size=(3, 3))
    both = scipy_of(a) * scipy_of(b)
    np.testing.assert_allclose((a * b).as_matrix(), both.as_matrix(), atol=1e-12)
    np.testing.assert_allclose((a * b).inv().apply(points), both.inv().apply(points), atol=1e-12)
    np.testing.assert_allclose((a[0] * b).apply(points)[1], (a[0] * b[1]).apply(points[1]), atol=1e-12)
    np.testing.assert_array_equal(RigidMotion.stack([a[:2], a[2]]).last(1).as_matrix()[0], a[2].as_matrix())


def test_many_bodies_at_once_are_as_scipy_aligns_each() -> None:
    """Bodies in space, one mirrored, one flat, one on a line, whose turn about it is none, one by fewer points."""
    rng = np.random.default_rng(6)
    before = rng.normal(size=(6, 7, 3)) * 20.0
    before[3, :, 2] = 0.0
    before[4] = np.linspace(-1.0, 1.0, 7)[:, None] * [3.0, 4.0, 5.0]
    turns, weights = Rotation.from_rotvec(rng.normal(size=(6, 3))), np.ones((6, 7))
    after = np.array([turn.apply(body) for turn, body in zip(turns, before, strict=True)])
    after += rng.normal(size=(6, 1, 3))
    after[:3] += rng.normal(size=(3, 7, 3))
    after[2] *= [-1.0, 1.0, 1.0]
    weights[5, 4:] = 0.0
    motions = fit_rigid(before, after, weights)
    for number, (body, target, weight) in enumerate(zip(before, after, weights, strict=True)):
        own, goal = body[weight > 0.0], target[weight > 0.0]
        a, b = own - own.mean(axis=0), goal - goal.mean(axis=0)
        wanted = Rotation.align_vectors(b[:1], a[:1]) if number == 4 else Rotation.align_vectors(b, a)
        np.testing.assert_allclose(motions[number].rotation, wanted[0].as_matrix(), atol=1e-9)
        np.testing.assert_allclose(motions[number].apply(own.mean(axis=0)), goal.mean(axis=0), atol=1e-9)
