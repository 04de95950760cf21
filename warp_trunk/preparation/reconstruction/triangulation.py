"""Landmarks in space from their places on two radiographs."""

from __future__ import annotations

import csv
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from warp_trunk.case.landmarks import Landmarks
from warp_trunk.errors import InputError
from warp_trunk.io.atomic_write import atomic_write

from .films import Film, project
from .mismatches import check_miss, check_order, check_side, common_names
from .rays import meeting_point


@dataclass(frozen=True)
class Triangulation:
    """Landmarks in space, and how well they are known."""

    landmarks: Landmarks
    """Where the rays of both films come nearest to meeting, in LPS [mm]."""
    miss: np.ndarray
    """Distance of each landmark's projection from its place on each film [units of the films], (n, 2)."""
    uncertainty: np.ndarray
    """Standard deviation along x, y and z of each landmark [mm], shape (n, 3)."""
    noise: float
    """Standard deviation of a coordinate on a film that the uncertainty is for [units of the films]."""

    @property
    def error(self) -> np.ndarray:
        """Root mean square distance in space to expect of each landmark [mm], shape (n,)."""
        return np.linalg.norm(self.uncertainty, axis=1)


def triangulate(first: Film, second: Film, limit: float = 5.0, noise: float | None = None) -> Triangulation:
    """The points whose projections lie nearest to their places on both films, in least squares.

    Starts from the direct linear transformation (two equations of each film, scaled to distances in mm) and
    minimises the reprojection error. With two films four numbers give three, so that one of them is left to
    judge by: across the rays' common plane a landmark that is off shows itself, along it not. The noise is
    estimated from these left-over numbers of all landmarks.

    Args:
        first: a film, such as the postero-anterior one.
        second: a film of the same landmarks from another side.
        limit: reprojection error above which landmarks are refused [units of the films].
        noise: standard deviation of a coordinate on the films; estimated when left out.

    Raises:
        InputError: a landmark that is on one film only; landmarks that are behind a source, that look swapped
            or mismatched (an error above the limit, or left and right or top and bottom of a bone exchanged),
            or whose two rays do not cross.
    """
    if not limit > 0.0:
        raise InputError(f"triangulate: 'limit' must be above 0, not {limit}")
    if noise is not None and not noise >= 0.0:
        raise InputError(f"triangulate: 'noise' must be at least 0, not {noise}")
    names = common_names(first, second)
    films = (first, second)
    places = [film.rows(names) for film in films]
    projections = [film.projection for film in films]
    found = [meeting_point(projections, [p[i] for p in places], name) for i, name in enumerate(names)]
    points = np.array([point for point, _ in found])
    miss = np.column_stack(
        [np.linalg.norm(project(P, points) - p, axis=1) for P, p in zip(projections, places, strict=True)]
    )
    check_side(films, names, points)
    check_miss(films, names, miss, limit)
    check_order(names, points)
    if noise is None:
        noise = math.sqrt(float(np.sum(miss**2)) / len(names))  # one number left over for each landmark
    spread = np.array([np.diag(np.linalg.inv(gradient.T @ gradient)) for _, gradient in found])
    return Triangulation(Landmarks(names, points), miss, noise * np.sqrt(spread), noise)


def write_triangulation(path: str | Path, found: Triangulation) -> None:
    """Write a CSV file that `read_landmarks` reads, with columns for the error on the films and in space."""
    with atomic_write(Path(path)) as unfinished, unfinished.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["name", "x", "y", "z", "reprojection_error", "sd_x", "sd_y", "sd_z"])
        rows = np.column_stack([found.landmarks.points, found.miss.max(axis=1), found.uncertainty])
        for name, row in zip(found.landmarks.names, rows.tolist(), strict=True):
            writer.writerow([name, *map(repr, row)])
