"""A postero-anterior and a lateral film of landmarks, taken with sources 1800 mm from the films."""

from pathlib import Path

import numpy as np

from warp_trunk.case.landmarks import Landmarks
from warp_trunk.preparation.reconstruction.triangulation import Film, project


def projection_matrix(source: np.ndarray, origin: np.ndarray, across: np.ndarray, up: np.ndarray) -> np.ndarray:
    """The matrix (3, 4) of a focal spot and a flat film: its origin, and steps of 1 in u and in v [mm]."""
    # source + s (X - source) = origin + u across + v up, for (u, v, 1) / s
    inverse = np.linalg.inv(np.column_stack([across, up, origin - source]))
    return np.column_stack([inverse, -inverse @ source])


def biplanar(landmarks: Landmarks, noise: float = 0.0, seed: int = 0) -> tuple[Film, Film]:
    """Both films in mm, with v upward, and a normal error of this standard deviation in each coordinate."""
    x, y, z = landmarks.points.mean(axis=0)
    rng = np.random.default_rng(seed)
    films = []
    for view, source, origin, across in (
        ("pa.csv", [x, y + 1500.0, z], [x, y - 300.0, z], [1.0, 0.0, 0.0]),
        ("lateral.csv", [x - 1500.0, y, z], [x + 300.0, y, z], [0.0, 1.0, 0.0]),
    ):
        P = projection_matrix(np.array(source), np.array(origin), np.array(across), np.array([0.0, 0.0, 1.0]))
        places = project(P, landmarks.points)
        films.append(Film(view, landmarks.names, places + noise * rng.normal(size=places.shape), P))
    return films[0], films[1]


def write_film(points: Path, matrix: Path, film: Film) -> None:
    """The landmarks of a film and its projection, as triangulate reads them."""
    rows = [f"{name},{u!r},{v!r}" for name, (u, v) in zip(film.names, film.points.tolist(), strict=True)]
    points.write_text("\n".join(["name,u,v", *rows]), encoding="utf-8")
    np.savetxt(matrix, film.projection, fmt="%.17g")


def write_films(folder: Path, films: tuple[Film, Film]) -> list[str]:
    """Both films in a folder, and the flags that name them to triangulate."""
    flags = []
    for flag, film in zip(("pa", "lateral"), films, strict=True):
        points, matrix = folder / f"{flag}.csv", folder / f"{flag}.txt"
        write_film(points, matrix, film)
        flags += [f"--{flag}", str(points), f"--{flag}-matrix", str(matrix)]
    return flags
