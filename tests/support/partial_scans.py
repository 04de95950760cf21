"""Scans as digitizers around a trunk would make them, of a known surface: open, partial, noisy, shifted."""

from dataclasses import dataclass

import numpy as np
import trimesh

from warp_trunk.geometry.surface import Surface


@dataclass(frozen=True)
class PartialScans:
    """The scans, and what is known about them."""

    parts: dict[str, Surface]
    removed: np.ndarray
    """Faces of the true surface that no scan has seen, in patches, shape (faces,), bool."""
    transforms: dict[str, np.ndarray]
    """Transform of each scan back to its place, shape (4, 4)."""


def patches(skin: Surface, fraction: float, count: int, seed: int, allowed: np.ndarray) -> np.ndarray:
    """Faces in `count` discs that hold this fraction of the faces; bool. `allowed` may be centres."""
    middles, random = skin.vertices[skin.faces].mean(axis=1), np.random.default_rng(seed)
    removed = np.zeros(len(skin.faces), dtype=bool)
    for number in range(count):
        touched = np.isin(skin.faces, skin.faces[removed]).any(axis=1)
        centre = middles[random.choice(np.flatnonzero(allowed & ~touched))]
        order = np.argsort(np.where(allowed & ~removed, np.linalg.norm(middles - centre, axis=1), np.inf))
        wanted = round(fraction * len(skin.faces) * (number + 1) / count) - int(removed.sum())
        removed[order[:wanted]] = True
    return removed


def scan(
    skin: Surface,
    *,
    views: int = 4,
    overlap: float = 15.0,
    fraction: float = 0.05,
    count: int = 6,
    noise: float = 1.0,
    isotropic: bool = False,
    shift: float = 0.0,
    turn: float = 0.0,
    unseen: np.ndarray | None = None,
    seed: int = 0,
) -> PartialScans:
    """Views of a skin from around the z axis, by the way its faces look.

    Args:
        skin: the true surface.
        views: how many; 1 keeps the surface whole.
        overlap: how far each view goes beyond its share on both sides [degrees].
        fraction, count: of the faces removed, in so many patches.
        noise: standard deviation [mm], along the normal or, if `isotropic`, in each direction.
        shift, turn: how far each view but the first is moved [mm] and turned [degrees].
        unseen: faces that no view holds besides, such as those of flat ends; bool.
        seed: of all that is random.
    """
    random = np.random.default_rng(seed)
    unseen = np.zeros(len(skin.faces), dtype=bool) if unseen is None else unseen
    removed = patches(skin, fraction, count, seed, ~unseen) if fraction else np.zeros(len(skin.faces), dtype=bool)
    mesh = trimesh.Trimesh(skin.vertices, skin.faces, process=False)
    normal, vertex_normal = mesh.face_normals, mesh.vertex_normals
    azimuth = np.degrees(np.arctan2(normal[:, 1], normal[:, 0]))
    parts, transforms = {}, {}
    for view in range(views):
        off = np.abs((azimuth - 360.0 * (view + 0.5) / views + 180.0) % 360.0 - 180.0)
        seen = (off <= 180.0 / views + overlap) & ~removed & ~unseen
        used, faces = np.unique(skin.faces[seen], return_inverse=True)
        error = noise * random.normal(size=(len(used), 3 if isotropic else 1))
        error = error * (1.0 if isotropic else vertex_normal[used])
        matrix = _moved(random, skin, shift, turn) if view else np.eye(4)
        points = (skin.vertices[used] + error) @ matrix[:3, :3].T + matrix[:3, 3]
        name = f"view_{view + 1}.ply"
        parts[name] = Surface(points, faces.reshape(-1, 3).astype(np.int32))
        transforms[name] = np.linalg.inv(matrix)
    return PartialScans(parts, removed, transforms)


def _moved(random: np.random.Generator, skin: Surface, shift: float, turn: float) -> np.ndarray:
    """Turned about the middle of the skin and shifted, both in a random direction."""
    axis, direction = random.normal(size=(2, 3))
    matrix = trimesh.transformations.rotation_matrix(np.radians(turn), axis, skin.vertices.mean(axis=0))
    matrix[:3, 3] += shift * direction / np.linalg.norm(direction)
    return matrix
