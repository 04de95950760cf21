import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from support.biplanar import biplanar, projection_matrix
from warp_trunk.case.landmarks import Landmarks
from warp_trunk.errors import InputError
from warp_trunk.io.surface_files import read_surface
from warp_trunk.preparation.landmark_finder import find_landmarks
from warp_trunk.preparation.phantom import straight_trunk
from warp_trunk.preparation.reconstruction import Film, read_film, triangulate
from warp_trunk.preparation.reconstruction.triangulation import project


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


def test_the_films_need_not_have_the_same_order(landmarks) -> None:
    pa, lateral = biplanar(landmarks)
    turned = replace(lateral, names=lateral.names[::-1], points=lateral.points[::-1])
    assert np.abs(triangulate(pa, turned).landmarks.points - landmarks.points).max() < 1e-7


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


def test_no_other_point_misses_less(landmarks) -> None:
    films = biplanar(landmarks, noise=2.0)
    found = triangulate(*films, limit=50.0)
    best = np.sum(found.miss**2, axis=1)
    for step in 0.05 * np.random.default_rng(1).normal(size=(20, 3)):
        moved = found.landmarks.points + step
        assert (sum(np.sum((project(f.projection, moved) - f.points) ** 2, axis=1) for f in films) > best).all()


def test_one_millimetre_on_the_film_gives_less_than_the_papers_error_in_space(landmarks) -> None:
    found = triangulate(*biplanar(landmarks, noise=1.0), limit=6.0)
    assert np.linalg.norm(found.landmarks.points - landmarks.points, axis=1).mean() < 2.1


@pytest.mark.skipif(not os.environ.get("WARP_TRUNK_ANATOMY"), reason="WARP_TRUNK_ANATOMY is not set")
def test_on_real_anatomy_it_is_better_than_the_papers_error() -> None:
    bones = {
        path.stem: read_surface(path) for path in (Path(os.environ["WARP_TRUNK_ANATOMY"]) / "bones").iterdir()
    }
    landmarks = find_landmarks(bones).complete()
    found = triangulate(*biplanar(landmarks, noise=1.0), limit=8.0)
    error = np.linalg.norm(found.landmarks.points - landmarks.points, axis=1)
    assert error.mean() < 2.1
    assert np.sqrt(np.mean(error**2)) == pytest.approx(np.sqrt(np.mean(found.error**2)), rel=0.25)


def test_swapped_names_are_named(landmarks) -> None:
    pa, lateral = biplanar(landmarks, noise=0.3)
    pair = "T4_superior_endplate", "L2_left_pedicle_superior"
    with pytest.raises(InputError, match="'T4_superior_endplate' and 'L2_left_pedicle_superior' look swapped"):
        triangulate(pa, swapped(lateral, *pair))


def test_a_mismatched_landmark_is_named_with_its_error(landmarks) -> None:
    pa, lateral = biplanar(landmarks)
    u, v = lateral.points[lateral.names.index("T9_inferior_endplate")]
    with pytest.raises(InputError, match=r"'T9_inferior_endplate' cannot be the same .* miss by \d+\.\d where 5"):
        triangulate(pa, changed(lateral, T9_inferior_endplate=[u, v + 40.0]))


def test_left_and_right_of_one_height_are_told_apart_by_their_names(landmarks) -> None:
    pa, lateral = biplanar(landmarks)
    pair = "L3_left_pedicle_superior", "L3_right_pedicle_superior"
    with pytest.raises(InputError, match="'L3_left_pedicle_superior' must lie to the left of 'L3_right"):
        triangulate(swapped(pa, *pair), lateral, limit=20.0)


def test_points_behind_the_source_are_named(landmarks) -> None:
    pa, lateral = biplanar(landmarks)
    source = -np.linalg.solve(pa.projection[:, :3], pa.projection[:, 3])
    points = landmarks.points.copy()
    row = landmarks.names.index("T6_superior_endplate")
    points[row, 1] = source[1] + 300.0  # behind it, and in front of the lateral film's
    places = [project(film.projection, points)[row] for film in (pa, lateral)]
    with pytest.raises(InputError, match=r"pa\.csv: 'T6_superior_endplate' would lie behind the source"):
        triangulate(changed(pa, T6_superior_endplate=places[0]), changed(lateral, T6_superior_endplate=places[1]))


def test_names_on_one_film_only_are_named(landmarks) -> None:
    pa, lateral = biplanar(landmarks)
    with pytest.raises(InputError, match=r"lateral\.csv: '.*' is missing, which pa\.csv has"):
        triangulate(pa, replace(lateral, names=lateral.names[:-1], points=lateral.points[:-1]))


def test_two_films_from_one_side_are_refused(landmarks) -> None:
    pa, _ = biplanar(landmarks)
    with pytest.raises(InputError, match=r"rays of '.*' are parallel"):
        triangulate(pa, replace(pa, view="again.csv"))


def test_one_projection_for_both_films_is_refused(landmarks) -> None:
    pa, lateral = biplanar(landmarks)
    with pytest.raises(InputError, match="meet in a source"):
        triangulate(pa, replace(lateral, projection=pa.projection))


def test_reads_films(tmp_path, landmarks) -> None:
    pa, _ = biplanar(landmarks)
    rows = "\n".join(f"{name},{u!r},{v!r}" for name, (u, v) in zip(pa.names, pa.points.tolist(), strict=True))
    (tmp_path / "pa.csv").write_text(f"name,u,v\n{rows}\n")
    np.savetxt(tmp_path / "pa.txt", pa.projection, fmt="%.17g", header="source 1500 mm behind")
    back = read_film(tmp_path / "pa.csv", tmp_path / "pa.txt")
    np.testing.assert_array_equal(back.points, pa.points)
    np.testing.assert_array_equal(back.projection, pa.projection)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1 2 3\n4 5 6\n", "3 by 4"),
        ("1 2 3 4\n5 6 7 8\nx 10 11 12\n", "cannot be read"),
        ("1 0 0 0\n1 0 0 5\n0 0 1 0\n", "regular"),
        ("1 0 0 0\n0 nan 0 5\n0 0 1 0\n", "finite"),
    ],
)
def test_bad_matrices_are_refused(tmp_path, text: str, message: str) -> None:
    (tmp_path / "pa.csv").write_text("name,u,v\na,1,2\n")
    (tmp_path / "pa.txt").write_text(text)
    with pytest.raises(InputError, match=rf"pa\.txt: .*{message}"):
        read_film(tmp_path / "pa.csv", tmp_path / "pa.txt")
