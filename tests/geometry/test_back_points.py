"""The skin of a back in scans with surroundings, hair and noise, where the skin is known."""

import numpy as np
import pytest

from support.asserting import not_none
from warp_trunk.case.landmarks import Landmarks
from warp_trunk.errors import InputError
from warp_trunk.geometry.back_points import NOISY, find_back
from warp_trunk.geometry.raised import DepthGrid, bridge
from warp_trunk.measures import measure_back

LEFT = np.array([1.0, 0.0])
TURN = np.radians(7.0)


def depth_at(x, z):
    """A back between 0 and 420 mm that is turned by 7 degrees and twisted, with a furrow along its spine."""
    return 100.0 - np.tan(TURN) * (z / 420.0) * x - x**2 / 250.0 - 9.0 * np.exp(-((x / 28.0) ** 2))


def places(step=3.0, half=145.0):
    x, z = np.meshgrid(np.arange(-half, half, step), np.arange(-20.0, 440.0, step))
    rng = np.random.default_rng(3)
    return np.column_stack([x.ravel(), z.ravel()]) + rng.uniform(-0.8, 0.8, (x.size, 2))


def scan(*, noise=0.1, hair=None, seed=0):
    at = places()
    y = depth_at(*at.T) + np.random.default_rng(seed).normal(0.0, noise, len(at))
    if hair is not None:
        y += hair(*at.T)
    return np.column_stack([at[:, 0], y, at[:, 1]])


def plane(x, y, z, step=7.0):
    """Points of a plane: two of the three are ranges, one is a number."""
    sides = [np.arange(s[0], s[1], step) if isinstance(s, tuple) else np.array([float(s)]) for s in (x, y, z)]
    points = np.stack(np.meshgrid(*sides, indexing="ij"), axis=-1).reshape(-1, 3)
    return points + np.random.default_rng(1).normal(0.0, 0.4, points.shape)


LINE = np.column_stack([np.zeros(50), np.full(50, 40.0), np.linspace(400.0, 5.0, 50)])
MARKERS = Landmarks(
    ("C7", "PSIS_left", "PSIS_right"), np.array([[0.0, 91.0, 400.0], [50.0, 86.0, 0.0], [-50.0, 86.0, 0.0]])
)


def measured(points):
    return measure_back(points, LINE, MARKERS)


@pytest.fixture(scope="module")
def true_rotations():
    """Rotation by level of the skin without noise."""
    return {level: not_none(level_back).rotation for level, level_back in measured(scan(noise=0.0)).levels.items()}


def errors(back, truth):
    """The error of each level that has a rotation."""
    pairs = ((at and at.rotation, truth[level]) for level, at in back.levels.items())
    return np.array([np.nan if angle is None else abs(angle - right) for angle, right in pairs])


WIDE, HIGH = (-800.0, 800.0), (-300.0, 900.0)
SIDES = (-500.0, -148.0), (148.0, 500.0)
SURROUNDINGS = {
    "a wall 200 mm in front": plane(WIDE, -150.0, HIGH),
    "a wall 1 m in front": plane(WIDE, -1000.0, HIGH),
    "a wall 1 m behind": plane(WIDE, 1000.0, HIGH),
    "a table that the flanks touch": np.vstack([plane(side, 12.0, (-100.0, 500.0)) for side in SIDES]),
    "a floor through the hips": plane(WIDE, (-600.0, 600.0), -15.0),
    "the front of the body": scan() - [0.0, 350.0, 0.0],
    "the back of a chair beside it": plane((160.0, 420.0), 60.0, (-20.0, 300.0)),
}


@pytest.mark.parametrize("name", SURROUNDINGS)
def test_what_surrounds_a_back_is_left_out_and_counted(name, true_rotations):
    around = SURROUNDINGS[name]
    back = measured(np.vstack([scan(), around]))
    assert errors(back, true_rotations).max() < 0.5
    left = len(not_none(back.scan).surroundings) + len(not_none(back.scan).hidden)
    assert left > 0.8 * len(np.unique(np.floor(around / 3.0), axis=0))
    assert f"{left} of {left + len(not_none(back.scan).skin)} " in back.text()


def test_a_clean_scan_is_the_back_alone():
    points = scan()
    back = find_back(points, LINE, LEFT)
    assert len(back.surroundings) + len(back.hidden) <= 0.001 * len(points)
    assert not back.stands
    assert not back.smoothed
    assert back.noise == pytest.approx(0.1, rel=0.25)
    assert measured(points).notes == ()


def plait(profile, width=50.0, height=12.0, end=250.0, aside=0.0):
    def hair(x, z):
        u = np.minimum(2.0 * np.abs(x - aside) / width, 1.0)
        form = {"box": u < 1.0, "round": np.sqrt(1.0 - u * u), "cosine": np.cos(np.pi / 2.0 * u)}[profile]
        return np.where(z > end, height * form, 0.0)

    return hair


@pytest.mark.parametrize("profile", ["box", "round", "cosine"])
@pytest.mark.parametrize("aside", [0.0, 45.0])
def test_a_plait_does_not_turn_the_back(profile, aside, true_rotations):
    """Each level is right within a degree, or left out because it depends on the skin under the plait."""
    points = scan(hair=plait(profile, aside=aside))
    back = measured(points)
    error = errors(back, true_rotations)
    assert np.nanmax(error) < 1.0
    below = [k for k, at in enumerate(back.levels.values()) if not_none(at).height < 230.0]
    assert np.isfinite(error[below]).all()
    upper = {level for level, at in back.levels.items() if not_none(at).height > 260.0}
    told = {level for level, at in back.levels.items() if not_none(at).bridged} | back.missing.keys()
    assert upper <= told
    on = not_none(back.scan).raised
    assert (on[:, 2] > 235.0).mean() > 0.98
    assert (np.abs(on[:, 0] - aside) < 33.0).mean() > 0.98
    for level in upper:
        assert level in back.text().split("Positive:")[1]


def test_hair_over_the_whole_upper_back_leaves_its_levels_out(true_rotations):
    back = measured(scan(hair=lambda x, z: np.where((np.abs(x - 20.0) < 80.0) & (z > 220.0), 15.0, 0.0)))
    error = errors(back, true_rotations)
    assert np.nanmax(error) < 1.0
    assert {level for level, at in back.levels.items() if not_none(at).height > 245.0} <= back.missing.keys()


def hand(x, z, lift, seen):
    """A hand that lies on the back or is held behind it, all of it or what a scanner sees."""
    points = np.random.default_rng(1).normal(0.0, 1.0, (3000, 3))
    points *= np.array([40.0, 12.0, 60.0]) / np.linalg.norm(points, axis=1, keepdims=True)
    points = points[points[:, 1] > 0.0] if seen else points
    return points + np.array([x, depth_at(x, z) + lift, z])


@pytest.mark.parametrize(
    "at", [(120.0, 330.0, 64.0, False), (100.0, 360.0, 40.0, True), (70.0, 380.0, 40.0, False)]
)
def test_a_hand_on_or_behind_the_back_turns_no_level(at, true_rotations):
    back = measured(np.vstack([scan(), hand(*at)]))
    assert np.nanmax(errors(back, true_rotations)) < 1.0
    assert np.isfinite(errors(back, true_rotations)).sum() >= 14


def slow(*values):
    """Parameters that a plain pytest leaves out."""
    return [pytest.param(value, marks=pytest.mark.slow) for value in values]


def splats(sd, seed, hair=None):
    rng = np.random.default_rng(seed)
    points = scan(noise=0.0, hair=hair)
    points += rng.normal(0.0, sd, points.shape)
    low, high = points.min(axis=0) - 100.0, points.max(axis=0) + 100.0
    return np.vstack([points, rng.uniform(low, high, (len(points) // 20, 3))])


@pytest.mark.parametrize("profile", ["box", *slow("round", "cosine")])
def test_a_plait_in_the_points_of_apps_turns_no_level(profile, true_rotations):
    """Each level is right within a degree, or left out; below the plait all are there."""
    back = measured(splats(3.0, 1, hair=plait(profile)))
    error = errors(back, true_rotations)
    assert np.nanmax(error) < 1.1
    below = [k for k, level in enumerate(back.levels.values()) if not_none(level).height < 210.0]
    assert np.isfinite(error[below]).all()


STRAPS = {
    "band with two straps": lambda x, z: 4.0 * (
        (np.abs(z - 290.0) < 15.0) | ((np.abs(np.abs(x) - 70.0) < 7.5) & (z > 290.0))
    ),
    "crossed straps": lambda x, z: 4.0 * (np.abs(np.abs(z - 290.0) - np.abs(x)) < 10.0),
}  # fmt: skip


@pytest.mark.parametrize("noisy", [False, *slow(True)])
@pytest.mark.parametrize("strap", STRAPS)
def test_straps_turn_no_level_also_where_noise_hides_them(strap, noisy, true_rotations):
    """In the points of apps they are not seen, but smoothed with the skin."""
    back = measured(splats(3.0, 0, hair=STRAPS[strap]) if noisy else scan(hair=STRAPS[strap]))
    assert np.nanmax(errors(back, true_rotations)) < 1.0
    assert not_none(back.scan).stands or noisy


@pytest.mark.parametrize("seed", [0, *slow(1, 2)])
def test_points_of_apps_are_smoothed_and_their_noise_is_in_the_intervals(seed, true_rotations):
    back = measured(splats(3.0, seed))
    scanned = not_none(back.scan)
    assert scanned.smoothed
    assert scanned.noise == pytest.approx(3.0, rel=0.25)
    assert scanned.error < 0.3 * scanned.noise
    error = errors(back, true_rotations)
    assert np.isfinite(error).sum() >= 16
    assert np.nanmax(error) < 1.0
    assert np.sqrt(np.nanmean(error**2)) < 0.5
    rows = [row for row in back.measured() if row.quantity == "bsr_deg"]
    inside = [not_none(row.low) <= true_rotations[row.level] <= not_none(row.high) for row in rows]
    assert np.mean(inside) > 0.8
    assert "scatter by" in back.text()
    assert NOISY < 1.0


def test_a_spine_that_does_not_meet_the_scan_is_said():
    for shift in ([300.0, 0.0, 0.0], [0.0, -500.0, 0.0], [0.0, 0.0, 2000.0]):
        with pytest.raises(InputError, match="no part of it lies behind the spine"):
            find_back(scan() + shift, LINE, LEFT)


def test_a_bridge_over_a_cylinder_is_the_cylinder():
    x, z = np.meshgrid(np.arange(40) * 4.0, np.arange(40) * 4.0, indexing="ij")
    depth = 50.0 - (x - 70.0) ** 2 / 300.0 + 0.1 * z
    part = (np.abs(x - 80.0) < 25.0) & (np.abs(z - 80.0) < 40.0)
    spoilt = DepthGrid(np.where(part, depth + 9.0, depth), np.zeros(2), 4.0)
    np.testing.assert_allclose(bridge(spoilt, ~part, part)[part], depth[part], atol=0.8)


def test_a_plait_is_found_before_a_sparser_wall(true_rotations):
    back = measured(np.vstack([scan(hair=plait("round")), SURROUNDINGS["a wall 200 mm in front"]]))
    assert np.nanmax(errors(back, true_rotations)) < 1.0
    assert not_none(back.scan).stands


def test_points_in_too_few_places_are_no_back():
    with pytest.raises(InputError, match="lie in 1 places 3 mm apart, and a back needs 100"):
        find_back(np.tile([0.0, 1.0, 0.0], (5000, 1)), LINE, LEFT)
