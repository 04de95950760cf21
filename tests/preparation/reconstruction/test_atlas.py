from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from warp_trunk.case.landmarks import Landmarks
from warp_trunk.errors import InputError
from warp_trunk.geometry.surface import Surface
from warp_trunk.preparation.phantom import straight_trunk
from warp_trunk.preparation.reconstruction.atlas import fit_atlas

TURN = Rotation.from_rotvec([0.3, -0.2, 0.9])


@cache
def atlas() -> tuple[dict[str, Surface], Landmarks]:
    """Two vertebrae, a rib without landmarks and the hips; the landmarks of these."""
    _, bones, landmarks = straight_trunk()
    few = {name: bones[name] for name in ("T7", "T8", "rib_left_07", "hip_left", "hip_right")}
    rows = [i for i, name in enumerate(landmarks.names) if name.startswith(("T7_", "T8_", "asis"))]
    return few, Landmarks(tuple(landmarks.names[i] for i in rows), landmarks.points[rows])


def patient(noise: float = 0.0) -> Landmarks:
    """The landmarks of a child's smaller spine, in another place, with an error of this size."""
    _, landmarks = atlas()
    points = 0.8 * TURN.apply(landmarks.points) + 50.0
    return Landmarks(landmarks.names, points + noise * np.random.default_rng(4).normal(size=points.shape))


def test_an_affine_patient_gets_bones_that_are_affine_images() -> None:
    bones, landmarks = atlas()
    fit = fit_atlas(bones, landmarks, patient())
    for name, bone in fit.bones.items():
        np.testing.assert_allclose(bone.vertices, 0.8 * TURN.apply(bones[name].vertices) + 50.0, atol=1e-7)
    assert fit.own == ("T7", "T8")
    assert np.nanmax(fit.left_out) < 1e-7


@pytest.mark.parametrize("nugget", [0.0, 5.0])
def test_left_out_errors_follow_from_the_whole_system(nugget: float) -> None:
    # e_i = w_i / (A^-1)_ii, without leaving anything out (Dubrule 1983)
    bones, landmarks = atlas()
    fit, there = fit_atlas(bones, landmarks, patient(3.0), nugget=nugget), patient(3.0)
    rows = [i for i, name in enumerate(landmarks.names) if name.startswith("T8_")]
    x, u = landmarks.points[rows], there.points[rows] - landmarks.points[rows]
    # the nugget belongs to the patient's scale: the bone is turned first, which changes no distance
    A = np.zeros((10, 10))
    A[:6, :6] = np.linalg.norm(x[:, None] - x[None], axis=2) - nugget * np.eye(6)
    A[:6, 6], A[6, :6] = 1.0, 1.0
    A[:6, 7:], A[7:, :6] = x - x.mean(axis=0), (x - x.mean(axis=0)).T
    inverse = np.linalg.inv(A)
    expected = np.linalg.norm(inverse[:6, :6] @ u / np.diag(inverse)[:6, None], axis=1)
    np.testing.assert_allclose(fit.left_out[rows], expected, rtol=1e-6)


def test_a_landmark_the_patient_has_not_is_named() -> None:
    bones, landmarks = atlas()
    few = Landmarks(landmarks.names[:-1], patient().points[:-1])
    with pytest.raises(InputError, match=f"'{landmarks.names[-1]}' is missing"):
        fit_atlas(bones, landmarks, few)


def test_with_skins_ribs_are_fitted_under_the_skin_of_a_wider_chest() -> None:
    skin, bones, landmarks = straight_trunk()
    kept = {name: bone for name, bone in bones.items() if name.startswith(("T", "L", "rib", "sternum"))}
    wide = [1.25, 1.2, 1.0]
    there = Landmarks(landmarks.names, landmarks.points.copy())  # the spine is as it was; only the cage grows
    trunk = Surface(skin.vertices * wide, skin.faces)
    ribs = [name for name in kept if name.startswith("rib")]
    errors = {}
    for what, skins in (("without", None), ("with", (skin, trunk))):
        fit = fit_atlas(kept, landmarks, there, skins=skins)
        errors[what] = np.mean(
            [np.linalg.norm(fit.bones[name].vertices - kept[name].vertices * wide, axis=1).mean() for name in ribs]
        )
    assert errors["with"] < 0.5 * errors["without"]
    assert set(fit.depth) == set(kept)
    assert min(fit.depth.values()) > 0.0
