import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from warp_trunk.geometry.rigid import fit_rigid, fit_rigid_adjoint, fit_rigid_all, misfit, part_of

RNG = np.random.default_rng(5)
UP = np.array([0.0, 0.0, 1.0])
POINTS = RNG.uniform([-40, -20, 900], [40, 60, 1300], size=(12, 3))


def test_finds_a_known_motion() -> None:
    R, shift = Rotation.from_rotvec([0.3, -0.8, 0.4]), np.array([30.0, -4.0, 90.0])
    motion = fit_rigid(POINTS, R.apply(POINTS) + shift)
    np.testing.assert_allclose(motion.rotation.as_matrix(), R.as_matrix(), atol=1e-12)
    np.testing.assert_allclose(motion.translation, shift, atol=1e-10)


def test_never_mirrors() -> None:
    mirrored = POINTS * [-1.0, 1.0, 1.0]
    assert np.linalg.det(fit_rigid(POINTS, mirrored).rotation.as_matrix()) == pytest.approx(1.0)


def test_no_other_motion_is_nearer() -> None:
    after = POINTS + RNG.normal(scale=9.0, size=POINTS.shape)

    def miss(points: np.ndarray) -> float:
        return float(np.sum((points - after) ** 2))

    best = fit_rigid(POINTS, after)
    for step in 1e-3 * RNG.normal(size=(50, 3)):
        moved, centre = best.apply(POINTS), after.mean(axis=0)
        assert miss(moved) < miss(moved + step)
        assert miss(moved) < miss(Rotation.from_rotvec(step).apply(moved - centre) + centre)


@pytest.mark.parametrize("count", [1, 2, 3, 6, 12])
def test_the_misfit_is_what_the_fit_leaves(count: int) -> None:
    for after in (POINTS + 5.0 * UP, POINTS + RNG.normal(scale=9.0, size=POINTS.shape), POINTS * [-1.0, 1.0, 1.0]):
        before, there = POINTS[:count], after[:count]
        left = np.linalg.norm(fit_rigid(before, there).apply(before) - there, axis=1)
        assert misfit(before, there) == pytest.approx(np.sqrt(np.mean(left**2)), abs=1e-5)


def test_a_part_of_a_motion_is_a_part_of_its_screw() -> None:
    # a quarter turn about a vertical axis through (5, 0), rising by 8 mm
    aside = np.array([5.0, 0.0, 0.0])
    turn = Rotation.from_rotvec([0.0, 0.0, np.pi / 2])
    motion = fit_rigid(POINTS, turn.apply(POINTS - aside) + aside + 8.0 * UP)
    third = Rotation.from_rotvec([0.0, 0.0, np.pi / 6])
    expected = third.apply(POINTS - aside) + aside + 8.0 / 3 * UP
    np.testing.assert_allclose(part_of(motion, 1 / 3).apply(POINTS), expected, atol=1e-9)


def test_points_on_a_line_are_turned_by_the_least_angle() -> None:
    line = np.array([[0.0, 0.0, 1000.0], [100.0, 0.0, 1000.0], [250.0, 0.0, 1000.0]])
    motion = fit_rigid(line, Rotation.from_rotvec([0.0, 0.0, 0.2]).apply(line) + UP)
    np.testing.assert_allclose(motion.rotation.as_rotvec(), [0.0, 0.0, 0.2], atol=1e-12)
    np.testing.assert_array_equal(fit_rigid(line, line).apply(POINTS), POINTS)


def test_many_bodies_at_once_are_as_each_alone() -> None:
    """Bodies in space, one mirrored, one flat, and one on a line, whose turn about it is none."""
    rng = np.random.default_rng(6)
    before = rng.normal(size=(5, 7, 3)) * 20.0
    before[3, :, 2] = 0.0
    before[4] = np.linspace(-1.0, 1.0, 7)[:, None] * [3.0, 4.0, 5.0]
    turns = Rotation.from_rotvec(rng.normal(size=(5, 3)))
    after = np.array([turn.apply(body) for turn, body in zip(turns, before, strict=True)]) + rng.normal(
        size=(5, 1, 3)
    )
    after[:3] += rng.normal(size=(3, 7, 3))
    after[2] *= [-1.0, 1.0, 1.0]
    for one, there, body in zip(fit_rigid_all(before, after).as_matrix(), after, before, strict=True):
        np.testing.assert_allclose(one, fit_rigid(body, there).as_matrix(), atol=1e-9)


@pytest.mark.parametrize("count", [3, 12])
def test_the_derivative_of_a_fit_against_differences_of_it(count: int) -> None:
    before = POINTS[:count]
    after = fit_rigid(POINTS, POINTS + RNG.normal(scale=30.0, size=POINTS.shape)).apply(before)
    after += RNG.normal(scale=5.0, size=after.shape)  # the fit leaves something over
    turn, shift = RNG.normal(size=(2, 4, 3))
    fitted, step = fit_rigid(before, after), 1e-5
    for way_before, way_after in RNG.normal(size=(3, 2, count, 3)):
        ends = [fit_rigid(before + s * way_before, after + s * way_after) for s in (step, -step)]
        turns, shifts = zip(*[np.split((end * fitted.inv()).as_exp_coords(), 2) for end in ends], strict=True)
        wanted = (turn @ (turns[0] - turns[1]) + shift @ (shifts[0] - shifts[1])) / (2.0 * step)
        by_before, by_after = fit_rigid_adjoint(before, after, turn, shift)
        found = np.einsum("kni,ni->k", by_before, way_before) + np.einsum("kni,ni->k", by_after, way_after)
        np.testing.assert_allclose(found, wanted, rtol=1e-6, atol=1e-6)
