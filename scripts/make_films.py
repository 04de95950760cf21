"""Radiographs of a case whose truth is known: what a landmark's place on the film is worth in space.

Usage: python scripts/make_films.py CASE OUT [NOISE]

Writes pa.csv, pa.txt, lateral.csv and lateral.txt: the case's landmarks before surgery on two films, 1800 mm
from their sources and 300 mm from the patient, with a normal error of NOISE mm (1 when left out) in each
coordinate. Then finds the landmarks again and compares them with the truth.
"""

from __future__ import annotations

import csv
import sys
from pathlib import Path

import numpy as np

from warp_trunk import InputError, Landmarks, read_case
from warp_trunk.preparation.reconstruction import Film, triangulate
from warp_trunk.preparation.reconstruction.films import project, projection_matrix

SOURCE, FILM = 1500.0, 300.0
"""How far the source and the film are from the middle of the patient [mm]."""


def films_of(landmarks: Landmarks, noise: float, rng: np.random.Generator) -> tuple[Film, Film]:
    """A postero-anterior and a lateral film in mm, v upward."""
    middle, up = landmarks.points.mean(axis=0), np.array([0.0, 0.0, 1.0])
    films = []
    for view, ray, across in (
        ("pa", [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]),
        ("lateral", [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]),
    ):
        ray, across = np.array(ray), np.array(across)
        P = projection_matrix(middle - SOURCE * ray, middle + FILM * ray, across, up)
        places = project(P, landmarks.points)
        films.append(Film(view, landmarks.names, places + noise * rng.normal(size=places.shape), P))
    return films[0], films[1]


def main(folder: str, out: str, noise: float = 1.0) -> None:
    """Writes the films and prints the errors of 20 such pairs of films."""
    landmarks = read_case(folder).landmarks_before
    rng = np.random.default_rng(0)
    Path(out).mkdir(parents=True, exist_ok=True)
    for film in films_of(landmarks, noise, rng):
        np.savetxt(Path(out) / f"{film.view}.txt", film.projection, fmt="%.17g")
        with (Path(out) / f"{film.view}.csv").open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(["name", "u", "v"])
            writer.writerows([name, *place] for name, place in zip(film.names, film.points.tolist(), strict=True))
    errors, said, noises = [], [], []
    for _ in range(20):
        found = triangulate(*films_of(landmarks, noise, rng), limit=np.inf)
        errors.append(np.linalg.norm(found.landmarks.points - landmarks.points, axis=1))
        said.append(found.error)
        noises.append(found.noise)
    error = np.concatenate(errors)
    print(f"{noise:g} mm on the films, found {np.mean(noises):.2f}")
    print(f"error in space: {error.mean():.2f} +- {error.std():.2f} mm, largest {error.max():.2f} mm")
    print(
        f"root mean square: {np.sqrt(np.mean(error**2)):.2f}, expected {np.sqrt(np.mean(np.square(said))):.2f} mm"
    )


if __name__ == "__main__":
    try:
        main(sys.argv[1], sys.argv[2], *(float(value) for value in sys.argv[3:4]))
    except InputError as error:
        sys.exit(str(error))
