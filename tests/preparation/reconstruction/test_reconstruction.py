"""Landmarks of two films, bones of an atlas fitted to them, and a skin registered by markers."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from support.biplanar import biplanar, projection_matrix
from support.shown import check_shown
from support.synthetic import sphere
from warp_trunk.case.landmarks import Landmarks
from warp_trunk.errors import InputError
from warp_trunk.geometry.surface import Surface
from warp_trunk.preparation.phantom import straight_trunk
from warp_trunk.preparation.reconstruction.atlas import fit_atlas
from warp_trunk.preparation.reconstruction.registration import register_skin
from warp_trunk.preparation.reconstruction.triangulation import Film, project, triangulate


@pytest.fixture(scope="module")
def landmarks() -> Landmarks:
    return straight_trunk()[2]


def changed(film: Film, **places: list[float] | np.ndarray) -> Film:
    points = film.points.copy()
    for name, place in places.items():
        points[film.names.index(name)] = place
    return replace(film, points=points)


def swapped(film: Film, name: str, other: str) -> Film:
    i, j = film.names.index(name), film.names.index(other)
    return changed(film, **{name: film.points[j], other: film.points[i]})


def test_a_matrix_projects_along_rays_to_the_film() -> None:
    # a source 1000 mm behind a film in the plane y = -200, pixels of 0.5 mm with v downward
    source, origin = np.array([0.0, 800.0, 50.0]), np.array([-100.0, -200.0, 300.0])
    P = projection_matrix(source, origin, np.array([0.5, 0.0, 0.0]), np.array([0.0, 0.0, -0.5]))
    point = np.array([30.0, 300.0, 90.0])  # halfway: its shadow is twice as far from the axis
    np.testing.assert_allclose(project(P, point[None])[0], [(60.0 + 100.0) / 0.5, (300.0 - 130.0) / 0.5])


def test_exact_films_give_the_exact_points_in_any_scale_of_their_matrices(landmarks) -> None:
    pa, lateral = biplanar(landmarks)
    made = triangulate(pa, replace(lateral, projection=-3.7 * lateral.projection))
    assert np.abs(made.landmarks.points - landmarks.points).max() < 1e-7
    assert max(made.miss.max(), made.noise) < 1e-7


def test_errors_are_as_large_as_the_uncertainty_says(landmarks) -> None:
    """Below that of the paper for one millimetre on the film."""
    made = [triangulate(*biplanar(landmarks, noise=0.8, seed=seed)) for seed in range(6)]
    errors = np.array([each.landmarks.points - landmarks.points for each in made])
    said = np.array([each.uncertainty for each in made])
    # 6 x 104 landmarks: 3 % of statistical error
    spread, expected = (np.sqrt(np.mean(np.square(each), axis=(0, 1))) for each in (errors, said))
    np.testing.assert_allclose(spread, expected, rtol=0.1)
    assert np.mean([each.noise for each in made]) == pytest.approx(0.8, rel=0.1)
    assert np.linalg.norm(errors, axis=2).mean() < 0.8 * 2.1


def behind(pa: Film, lateral: Film, landmarks: Landmarks) -> tuple[Film, Film]:
    """A landmark behind the source of the first film, and in front of the other's."""
    name = "T6_superior_endplate"
    points = landmarks.points.copy()
    row = landmarks.names.index(name)
    points[row, 1] = 300.0 - np.linalg.solve(pa.projection[:, :3], pa.projection[:, 3])[1]
    changed_pa, other = (changed(film, **{name: project(film.projection, points)[row]}) for film in (pa, lateral))
    return changed_pa, other


PAIR = "L3_left_pedicle_superior", "L3_right_pedicle_superior"
FAULTS: dict[str, Callable[[Film, Film, Landmarks], tuple[Film, Film]]] = {
    "swapped": lambda a, b, _: (a, swapped(b, "T4_superior_endplate", "L2_left_pedicle_superior")),
    "mismatched": lambda a, b, _: (a, changed(b, T9_inferior_endplate=[0.0, 40.0])),
    "left and right": lambda a, b, _: (swapped(a, *PAIR), b),
    "behind the source": behind,
    "on one film only": lambda a, b, _: (a, replace(b, names=b.names[:-1], points=b.points[:-1])),
    "from one side": lambda a, b, _: (a, replace(a, view="again.csv")),
    "of one source": lambda a, b, _: (a, replace(b, projection=a.projection)),
}


def test_films_that_do_not_fit_are_refused_as_accepted(landmarks) -> None:
    shown = []
    for fault, change in FAULTS.items():
        with pytest.raises(InputError) as error:
            triangulate(*change(*biplanar(landmarks), landmarks))
        shown.append(f"{fault}: {error.value}")
    check_shown("refused_films", shown)


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


def test_left_out_errors_follow_from_the_whole_system() -> None:
    # e_i = w_i / (A^-1)_ii, without leaving anything out (Dubrule 1983)
    (bones, landmarks), nugget = atlas(), 5.0
    fit, moved = fit_atlas(bones, landmarks, patient(3.0), nugget=nugget), patient(3.0)
    rows = [i for i, name in enumerate(landmarks.names) if name.startswith("T8_")]
    x, u = landmarks.points[rows], moved.points[rows] - landmarks.points[rows]
    # the nugget belongs to the patient's scale: the bone is turned first, which changes no distance
    A = np.zeros((10, 10))
    A[:6, :6] = np.linalg.norm(x[:, None] - x[None], axis=2) - nugget * np.eye(6)
    A[:6, 6], A[6, :6] = 1.0, 1.0
    A[:6, 7:], A[7:, :6] = x - x.mean(axis=0), (x - x.mean(axis=0)).T
    inverse = np.linalg.inv(A)
    expected = np.linalg.norm(inverse[:6, :6] @ u / np.diag(inverse)[:6, None], axis=1)
    np.testing.assert_allclose(fit.left_out[rows], expected, rtol=1e-6)


def test_names_that_differ_are_refused() -> None:
    bones, landmarks = atlas()
    few = Landmarks(landmarks.names[:-1], patient().points[:-1])
    with pytest.raises(InputError, match=f"'{landmarks.names[-1]}' is missing"):
        fit_atlas(bones, landmarks, few)
    with pytest.raises(InputError, match="of marker_0, sticker there is only one"):
        register_skin(SKIN, ON_SKIN, Landmarks(("sticker", *NAMES[1:]), ON_SKIN.points))


def test_with_skins_ribs_are_fitted_under_the_skin_of_a_wider_chest() -> None:
    skin, bones, landmarks = straight_trunk()
    cage = {name: bone for name, bone in bones.items() if name.startswith(("T", "rib_left", "sternum"))}
    wide = [1.25, 1.2, 1.0]
    grown = Landmarks(landmarks.names, landmarks.points.copy())  # the spine is as it was; only the cage grows
    trunk = Surface(skin.vertices * wide, skin.faces)
    ribs = [name for name in cage if name.startswith("rib")]
    errors = {}
    for what, skins in (("without", None), ("with", (skin, trunk))):
        fit = fit_atlas(cage, landmarks, grown, skins=skins)
        errors[what] = np.mean(
            [np.linalg.norm(fit.bones[name].vertices - cage[name].vertices * wide, axis=1).mean() for name in ribs]
        )
    assert errors["with"] < 0.5 * errors["without"]
    assert set(fit.depth) == set(cage)
    assert min(fit.depth.values()) > 0.0


SKIN = sphere(150.0, (0.0, 0.0, 1000.0), 2)
ROWS = np.arange(12, 42)  # spread evenly
NAMES = tuple(f"marker_{i}" for i in range(len(ROWS)))
ON_SKIN = Landmarks(NAMES, SKIN.vertices[ROWS])
AWAY, SHIFT = Rotation.from_rotvec([0.2, -0.1, 0.6]), np.array([30.0, -400.0, 12.0])


def bent(points: np.ndarray) -> np.ndarray:
    """A lean to the side that grows with the square of the height."""
    return points + 30.0 * ((points[:, 2:] - 850.0) / 300.0) ** 2 * [1.0, 0.0, 0.0]


def test_an_affine_change_bends_nothing() -> None:
    stretch = np.array([1.1, 0.95, 1.0])
    carried = AWAY.apply(ON_SKIN.points * stretch) + SHIFT
    registered = register_skin(SKIN, ON_SKIN, Landmarks(NAMES, carried))
    np.testing.assert_allclose(registered.skin.vertices, AWAY.apply(SKIN.vertices * stretch) + SHIFT, atol=1e-8)
    np.testing.assert_allclose(registered.strain, [0.1, 0.0, -0.05], atol=1e-9)
    assert registered.bending.max() < 1e-8
    assert registered.rigid_miss.max() > 5.0
    assert registered.least_volume == pytest.approx(stretch.prod())


def test_a_lean_is_met_at_the_markers_and_nearly_between_them() -> None:
    order = np.random.default_rng(2).permutation(len(NAMES))
    carried = AWAY.apply(bent(ON_SKIN.points)) + SHIFT
    shuffled = Landmarks(tuple(NAMES[i] for i in order), carried[order])
    registered = register_skin(SKIN, ON_SKIN, shuffled)
    assert registered.miss.max() < 1e-8
    assert registered.bending.max() > 1.0
    off = np.linalg.norm(registered.skin.vertices - AWAY.apply(bent(SKIN.vertices)) - SHIFT, axis=1)
    assert off.max() < 0.2 * registered.rigid_miss.max()


def test_a_fold_is_refused_and_placed() -> None:
    points = ON_SKIN.points.copy()
    i = 20
    j = np.argsort(np.linalg.norm(points - points[i], axis=1))[1]
    points[[i, j]] = points[[j, i]]  # two neighbours that are swapped
    with pytest.raises(InputError, match=rf"fold the skin.*near 'marker_({i}|{j})'"):
        register_skin(SKIN, ON_SKIN, Landmarks(NAMES, points))
