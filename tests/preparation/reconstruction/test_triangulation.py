from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from support.biplanar import biplanar, projection_matrix
from warp_trunk.case.landmarks import Landmarks
from warp_trunk.errors import InputError
from warp_trunk.preparation.phantom import straight_trunk
from warp_trunk.preparation.reconstruction.triangulation import Film, project, triangulate


@pytest.fixture(scope="module")
def landmarks() -> Landmarks:
    return straight_trunk()[2]


def changed(film: Film, **places: list[float] | np.ndarray) -> Film:
    points = film.points.copy()
    for name, place in places.items():
        points[film.names.index(name)] = place
    return replace(film, points=points)


def swapped(film: Film, one: str, other: str) -> Film:
    i, j = film.names.index(one), film.names.index(other)
    return changed(film, **{one: film.points[j], other: film.points[i]})


def test_a_matrix_projects_along_rays_to_the_film() -> None:
    # a source 1000 mm behind a film in the plane y = -200, pixels of 0.5 mm with v downward
    source, origin = np.array([0.0, 800.0, 50.0]), np.array([-100.0, -200.0, 300.0])
    P = projection_matrix(source, origin, np.array([0.5, 0.0, 0.0]), np.array([0.0, 0.0, -0.5]))
    point = np.array([30.0, 300.0, 90.0])  # halfway: its shadow is twice as far from the axis
    np.testing.assert_allclose(project(P, point[None])[0], [(60.0 + 100.0) / 0.5, (300.0 - 130.0) / 0.5])


def test_exact_films_give_the_exact_points_in_any_scale_of_their_matrices(landmarks) -> None:
    pa, lateral = biplanar(landmarks)
    found = triangulate(pa, replace(lateral, projection=-3.7 * lateral.projection))
    assert np.abs(found.landmarks.points - landmarks.points).max() < 1e-7
    assert found.miss.max() < 1e-7
    assert found.noise < 1e-7


def test_errors_are_as_large_as_the_uncertainty_says(landmarks) -> None:
    errors, said, noises = [], [], []
    for seed in range(6):
        found = triangulate(*biplanar(landmarks, noise=0.8, seed=seed))
        errors.append(found.landmarks.points - landmarks.points)
        said.append(found.uncertainty)
        noises.append(found.noise)
    # 6 x 104 landmarks: 3 % of statistical error
    spread, expected = (
        np.sqrt(np.mean(np.square(errors), axis=(0, 1))),
        np.sqrt(np.mean(np.square(said), axis=(0, 1))),
    )
    np.testing.assert_allclose(spread, expected, rtol=0.1)
    assert np.mean(noises) == pytest.approx(0.8, rel=0.1)


def test_one_millimetre_on_the_film_gives_less_than_the_papers_error_in_space(landmarks) -> None:
    found = triangulate(*biplanar(landmarks, noise=1.0), limit=6.0)
    assert np.linalg.norm(found.landmarks.points - landmarks.points, axis=1).mean() < 2.1


def behind(pa: Film, lateral: Film, landmarks: Landmarks) -> tuple[Film, Film]:
    """A landmark behind the source of the first film, and in front of the other's."""
    name = "T6_superior_endplate"
    points = landmarks.points.copy()
    row = landmarks.names.index(name)
    points[row, 1] = 300.0 - np.linalg.solve(pa.projection[:, :3], pa.projection[:, 3])[1]
    one, other = (changed(film, **{name: project(film.projection, points)[row]}) for film in (pa, lateral))
    return one, other


PAIR = "L3_left_pedicle_superior", "L3_right_pedicle_superior"
FAULTS: dict[str, tuple[Callable[[Film, Film, Landmarks], tuple[Film, Film]], str]] = {
    "swapped": (
        lambda a, b, _: (a, swapped(b, "T4_superior_endplate", "L2_left_pedicle_superior")),
        "'T4_superior_endplate' and 'L2_left_pedicle_superior' look swapped",
    ),
    "mismatched": (
        lambda a, b, _: (a, changed(b, T9_inferior_endplate=[0.0, 40.0])),
        r"'T9_inferior_endplate' cannot be the same .* miss by \d+\.\d where 5",
    ),
    "left and right": (
        lambda a, b, _: (swapped(a, *PAIR), b),
        "'L3_left_pedicle_superior' must lie to the left of 'L3_right",
    ),
    "behind the source": (behind, r"pa\.csv: 'T6_superior_endplate' would lie behind the source"),
    "on one film only": (
        lambda a, b, _: (a, replace(b, names=b.names[:-1], points=b.points[:-1])),
        r"lateral\.csv: '.*' is missing, which pa\.csv has",
    ),
    "from one side": (lambda a, b, _: (a, replace(a, view="again.csv")), r"rays of '.*' are parallel"),
    "of one source": (lambda a, b, _: (a, replace(b, projection=a.projection)), "meet in a source"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_films_that_do_not_fit_are_refused(landmarks, fault: str) -> None:
    change, says = FAULTS[fault]
    with pytest.raises(InputError, match=says):
        triangulate(*change(*biplanar(landmarks), landmarks))
