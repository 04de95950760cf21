import numpy as np
from scipy.spatial import KDTree

from warp_trunk.preparation.deformity.deformity import guiding_points
from warp_trunk.preparation.deformity.spine_curve import SpineCurve, vertebra_poses
from warp_trunk.preparation.phantom import straight_trunk

SKIN, BONES, LANDMARKS = straight_trunk()


def guides(cobb: float, names: tuple[str, ...]) -> tuple[np.ndarray, np.ndarray]:
    poses = vertebra_poses(LANDMARKS, SpineCurve(cobb=cobb))
    chosen = {name: BONES[name] for name in BONES if name.startswith((*names, "T"))}
    return guiding_points(chosen, poses, LANDMARKS.points)


def test_guides_keep_apart_from_each_other_and_from_landmarks() -> None:
    before, _ = guides(60.0, ("rib", "sternum", "hip", "sacrum"))
    everything = np.vstack([before, LANDMARKS.points])
    gaps = np.linalg.norm(before[:, None] - everything[None], axis=2)
    gaps[np.arange(len(before)), np.arange(len(before))] = np.inf
    assert gaps.min() >= 8.0


def test_sternum_moves_as_one_rigid_body() -> None:
    poses = vertebra_poses(LANDMARKS, SpineCurve(cobb=60.0))
    cage = {n: b for n, b in BONES.items() if n.startswith(("rib", "T"))}
    both, after = guiding_points({**cage, "sternum": BONES["sternum"]}, poses, np.empty((0, 3)))
    sternum = KDTree(BONES["sternum"].vertices).query(both)[0] == 0.0
    gaps = [np.linalg.norm(x[sternum][:, None] - x[sternum][None], axis=2) for x in (both, after)]
    assert gaps[0].max() > 50.0
    np.testing.assert_allclose(gaps[1], gaps[0], atol=1e-9)
    assert np.abs(after[sternum] - both[sternum]).max() > 1.0


def test_backs_of_ribs_go_back_on_the_convex_side_and_forward_on_the_other() -> None:
    for side, sign in (("right", 1.0), ("left", -1.0)):
        before, after = guides(60.0, (f"rib_{side}_08",))
        behind = (np.abs(before[:, 0]) > 30.0) & (before[:, 1] > LANDMARKS.of_bone("T8").points[:, 1].mean())
        assert behind.any()
        assert (sign * (after - before)[behind, 1] > 5.0).all()
