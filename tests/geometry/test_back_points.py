"""The skin of a back in scans with surroundings, hair and noise, where the skin is known."""

import numpy as np
import pytest

from support.asserting import not_none
from support.shown import check_shown, described
from warp_trunk.case.landmarks import Landmarks
from warp_trunk.errors import InputError
from warp_trunk.geometry.back_points import find_back
from warp_trunk.geometry.raised import DepthGrid, bridge
from warp_trunk.measures import measure_back
from warp_trunk.measures.back import BackMeasures

LEFT = np.array([1.0, 0.0])
TURN = np.radians(7.0)


def depth_at(x, z):
    """A back between 0 and 420 mm that is turned by 7 degrees and twisted, with a furrow along its spine."""
    return 100.0 - np.tan(TURN) * (z / 420.0) * x - x**2 / 250.0 - 9.0 * np.exp(-((x / 28.0) ** 2))


def scan(*, noise=0.1, hair=None, seed=0):
    """Points 3 mm apart, perhaps with something that stands on the skin."""
    x, z = (axis.ravel() for axis in np.meshgrid(np.arange(-145.0, 145.0, 3.0), np.arange(-20.0, 440.0, 3.0)))
    x, z = np.array([x, z]) + np.random.default_rng(3).uniform(-0.8, 0.8, (2, x.size))
    y = depth_at(x, z) + np.random.default_rng(seed).normal(0.0, noise, x.size)
    return np.column_stack([x, y if hair is None else y + hair(x, z), z])


def splats(sd, seed, hair=None):
    """The points of an app: off in all directions, and a twentieth of them anywhere."""
    rng, points = np.random.default_rng(seed), scan(noise=0.0, hair=hair)
    points += rng.normal(0.0, sd, points.shape)
    low, high = points.min(axis=0) - 100.0, points.max(axis=0) + 100.0
    return np.vstack([points, rng.uniform(low, high, (len(points) // 20, 3))])


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


def rotation_of(back: BackMeasures) -> np.ndarray:
    """By level [degrees]; NaN where it is missing."""
    return np.array([np.nan if at is None or at.rotation is None else at.rotation for at in back.levels.values()])


@pytest.fixture(scope="module")
def off():
    """How far the rotation of each level is from that of the skin without noise [degrees]; NaN where missing."""
    truth = rotation_of(measured(scan(noise=0.0)))
    return lambda back: np.abs(rotation_of(back) - truth)


WIDE, HIGH = (-800.0, 800.0), (-300.0, 900.0)
SIDES = (-500.0, -148.0), (148.0, 500.0)
WALL = plane(WIDE, -150.0, HIGH)
SURROUNDINGS = {
    "a wall 200 mm in front": [WALL],
    "walls 1 m in front and behind, and a floor through the hips": [
        plane(WIDE, -1000.0, HIGH), plane(WIDE, 1000.0, HIGH), plane(WIDE, (-600.0, 600.0), -15.0)
    ],
    "a table that the flanks touch": [plane(side, 12.0, (-100.0, 500.0)) for side in SIDES],
    "the front of the body, and the back of a chair beside it": [
        scan() - [0.0, 350.0, 0.0], plane((160.0, 420.0), 60.0, (-20.0, 300.0))
    ],
}  # fmt: skip


@pytest.mark.parametrize("name", SURROUNDINGS)
def test_what_surrounds_a_back_is_left_out_and_counted(name, off):
    around = np.vstack(SURROUNDINGS[name])
    back = measured(np.vstack([scan(), around]))
    assert off(back).max() < 0.5
    left = len(not_none(back.scan).surroundings) + len(not_none(back.scan).hidden)
    assert left > 0.8 * len(np.unique(np.floor(around / 3.0), axis=0))
    assert f"{left} of {left + len(not_none(back.scan).skin)} " in back.text()


def test_a_clean_scan_is_the_back_alone():
    points = scan()
    back = measured(points)
    clean = not_none(back.scan)
    assert clean.left_out <= 0.001 * len(points)
    assert not clean.smoothed
    assert clean.noise == pytest.approx(0.1, rel=0.25)
    assert back.notes == ()


def plait(profile, width=50.0, height=12.0, end=250.0, aside=0.0):
    def hair(x, z):
        u = np.minimum(2.0 * np.abs(x - aside) / width, 1.0)
        form = {"box": u < 1.0, "round": np.sqrt(1.0 - u * u), "cosine": np.cos(np.pi / 2.0 * u)}[profile]
        return np.where(z > end, height * form, 0.0)

    return hair


@pytest.mark.parametrize(("profile", "aside"), [("box", 0.0), ("round", 45.0), ("cosine", 0.0)])
def test_a_plait_does_not_turn_the_back(profile, aside, off):
    """Each level is right within a degree, or left out because it depends on the skin under the plait."""
    back = measured(np.vstack([scan(hair=plait(profile, aside=aside)), WALL]))  # before a sparser wall
    error = off(back)
    assert np.nanmax(error) < 1.0
    below = [k for k, at in enumerate(back.levels.values()) if not_none(at).height < 230.0]
    assert np.isfinite(error[below]).all()
    upper = {level for level, at in back.levels.items() if not_none(at).height > 260.0}
    told = {level for level, at in back.levels.items() if not_none(at).bridged} | back.missing.keys()
    assert upper <= told
    on = not_none(back.scan).raised
    assert (on[:, 2] > 235.0).mean() > 0.98
    assert (np.abs(on[:, 0] - aside) < 33.0).mean() > 0.98


def test_hair_over_the_whole_upper_back_leaves_its_levels_out(off):
    back = measured(scan(hair=lambda x, z: np.where((np.abs(x - 20.0) < 80.0) & (z > 220.0), 15.0, 0.0)))
    assert np.nanmax(off(back)) < 1.0
    assert {level for level, at in back.levels.items() if not_none(at).height > 245.0} <= back.missing.keys()


@pytest.mark.parametrize(("x", "z", "lift", "seen"), [(120.0, 330.0, 64.0, False), (100.0, 360.0, 40.0, True)])
def test_a_hand_on_or_behind_the_back_turns_no_level(x, z, lift, seen, off):
    """All of it, or what a scanner sees."""
    points = np.random.default_rng(1).normal(0.0, 1.0, (3000, 3))
    points *= np.array([40.0, 12.0, 60.0]) / np.linalg.norm(points, axis=1, keepdims=True)
    hand = points[points[:, 1] > 0.0] if seen else points
    error = off(measured(np.vstack([scan(), hand + np.array([x, depth_at(x, z) + lift, z])])))
    assert np.nanmax(error) < 1.0
    assert np.isfinite(error).sum() >= 14


def band(x, z):
    """A band with two straps."""
    return 4.0 * ((np.abs(z - 290.0) < 15.0) | ((np.abs(np.abs(x) - 70.0) < 7.5) & (z > 290.0)))


def crossed(x, z):
    """Crossed straps."""
    return 4.0 * (np.abs(np.abs(z - 290.0) - np.abs(x)) < 10.0)


@pytest.mark.parametrize("strap", [band, crossed])
def test_straps_turn_no_level(strap, off):
    back = measured(scan(hair=strap))
    assert np.nanmax(off(back)) < 1.0
    assert not_none(back.scan).stands


@pytest.mark.slow
@pytest.mark.parametrize("hair", [plait("round"), plait("cosine"), band, crossed])
def test_what_noise_hides_is_smoothed_with_the_skin(hair, off):
    assert np.nanmax(off(measured(splats(3.0, 0, hair=hair)))) < 1.0


def check_noise(back: BackMeasures, error: np.ndarray) -> None:
    """Noise of 3 mm is found and smoothed, and most intervals hold the true rotation."""
    scanned = not_none(back.scan)
    assert scanned.smoothed
    assert scanned.noise == pytest.approx(3.0, rel=0.25)
    assert scanned.error < 0.3 * scanned.noise
    half = np.array([1.96 * level.rotation_sd for level in map(not_none, back.levels.values())])
    judged = np.isfinite(error)
    assert np.mean(error[judged] < half[judged]) > 0.8


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1])
def test_points_of_apps_are_smoothed_and_their_noise_is_in_the_intervals(seed, off):
    back = measured(splats(3.0, seed))
    error = off(back)
    check_noise(back, error)
    assert np.isfinite(error).sum() >= 16
    assert np.nanmax(error) < 1.0
    assert np.sqrt(np.nanmean(error**2)) < 0.5


def test_a_noisy_back_with_a_plait_is_as_accepted(off):
    """Each level is right within a degree or left out, and below the plait all are there."""
    back = measured(splats(3.0, 1, hair=plait("box")))
    error = off(back)
    check_noise(back, error)
    assert np.nanmax(error) < 1.1
    below = [k for k, level in enumerate(back.levels.values()) if not_none(level).height < 210.0]
    assert np.isfinite(error[below]).all()
    rows = (f"{r.level} {r.quantity}: {described([r.value, r.low, r.high])}" for r in back.measured() if r.low)
    check_shown("noisy_back", [back.text(), *rows])


def test_scans_without_a_back_are_refused():
    for shift in ([300.0, 0.0, 0.0], [0.0, -500.0, 0.0], [0.0, 0.0, 2000.0]):
        with pytest.raises(InputError, match="no part of it lies behind the spine"):
            find_back(scan() + shift, LINE, LEFT)
    with pytest.raises(InputError, match="lie in 1 places 3 mm apart, and a back needs 100"):
        find_back(np.tile([0.0, 1.0, 0.0], (5000, 1)), LINE, LEFT)


def test_a_bridge_over_a_cylinder_is_the_cylinder():
    x, z = np.meshgrid(np.arange(40) * 4.0, np.arange(40) * 4.0, indexing="ij")
    depth = 50.0 - (x - 70.0) ** 2 / 300.0 + 0.1 * z
    part = (np.abs(x - 80.0) < 25.0) & (np.abs(z - 80.0) < 40.0)
    spoilt = DepthGrid(np.where(part, depth + 9.0, depth), np.zeros(2), 4.0)
    np.testing.assert_allclose(bridge(spoilt, ~part, part)[part], depth[part], atol=0.8)
