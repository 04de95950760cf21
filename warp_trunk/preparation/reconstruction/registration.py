"""The scanned skin brought into the frame of the bones, by markers seen on both."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from warp_trunk.case.landmarks import Landmarks
from warp_trunk.checking import checked
from warp_trunk.errors import InputError
from warp_trunk.geometry.distance_field import SurfaceDistance
from warp_trunk.geometry.rigid import RigidMotion, fit_rigid
from warp_trunk.geometry.spline import fit_spline
from warp_trunk.geometry.surface import Surface, check_surface


@dataclass(frozen=True)
class Registration:
    """A skin in the frame of the bones: first moved rigidly, then by a spline."""

    skin: Surface
    """The skin, same vertices and faces, in the frame of the bones [mm]."""
    rigid: RigidMotion
    """From the frame of the scan to that of the bones."""
    names: tuple[str, ...]
    """The markers."""
    rigid_miss: np.ndarray
    """Distance of each marker from its place on the films after the rigid part [mm], shape (n,)."""
    miss: np.ndarray
    """The same after both parts [mm], shape (n,); 0 without a nugget."""
    strain: np.ndarray
    """Stretches of the affine part of the spline along its own three axes, less 1; no unit, shape (3,)."""
    bending: np.ndarray
    """Length of the part of the spline that is not affine, at each skin vertex [mm], shape (vertices,)."""
    least_volume: float
    """Smallest ratio of volumes, after to before, at a skin vertex; a fold would make it negative."""


@checked
def register_skin(skin: Surface, on_skin: Landmarks, on_films: Landmarks, nugget: float = 0.0) -> Registration:
    """Carry the skin by the rigid motion nearest to its markers, then by the spline through what that leaves.

    This is the elastic registration of trunk surface and bones by radio-opaque markers, section 4.3.5 of [2].
    An affine change is met without any bending.

    >>> markers = wt.Landmarks(tuple("abcde"), case.skin.vertices[[0, 300, 600, 900, 1200]])
    >>> films = wt.Landmarks(markers.names, markers.points + [5.0, 0.0, 0.0])
    >>> moved = wt.register_skin(case.skin, markers, films).skin.vertices - case.skin.vertices
    >>> bool(np.allclose(moved, [5.0, 0.0, 0.0], atol=1e-6))
    True

    Args:
        skin: in the frame of the scan [mm].
        on_skin: markers on it, in that frame.
        on_films: the same markers, in any order, in the frame of the bones.
        nugget: see `fit_spline` [mm]; more than 0 smooths the errors of the markers.

    Raises:
        InputError: names that differ, markers off the skin or of another size, markers on which no spline can
            be fitted, or a map that folds the skin.
    """
    check_surface(skin, "register_skin: 'skin'")
    if not on_skin.names:
        raise InputError("register_skin: 'on_skin' is empty; give four markers or more")
    if differ := sorted(set(on_skin.names) ^ set(on_films.names)):
        fault = f"of {', '.join(differ[:4])} there is only one"
        raise InputError(f"register: markers on skin and films must have the same names, but {fault}; name both")
    targets = on_films.points[[on_films.index(name) for name in on_skin.names]]
    check_near("register", on_skin.names, on_skin.points, skin, "the skin")
    check_size("register", on_skin.points, targets)
    rigid = fit_rigid(on_skin.points, targets)
    markers, vertices = rigid.apply(on_skin.points), rigid.apply(skin.vertices)
    spline = fit_spline(markers, targets, nugget, on_skin.names)
    volume = np.linalg.det(spline.jacobian(vertices))
    if volume.min() <= 0.0:
        x, y, z = skin.vertices[volume.argmin()]
        nearest = int(np.linalg.norm(vertices[volume.argmin()] - markers, axis=1).argmin())
        where = f"at ({x:.0f}, {y:.0f}, {z:.0f}) mm of the scan near '{on_skin.names[nearest]}'"
        cure = "look for swapped or wrong markers there, or set a nugget"
        raise InputError(f"register: the markers fold the skin, {where}; {cure}")
    return Registration(
        skin=skin.moved(spline(vertices)),
        rigid=rigid,
        names=on_skin.names,
        rigid_miss=np.linalg.norm(markers - targets, axis=1),
        miss=np.linalg.norm(spline(markers) - targets, axis=1),
        strain=np.linalg.svd(np.eye(3) + spline.linear)[1] - 1.0,
        bending=np.linalg.norm(spline.bending(vertices), axis=1),
        least_volume=float(volume.min()),
    )


NEAR = 30.0
"""A landmark or marker farther from its surface than this [mm] is in other units or another frame."""
GROWTH = 2.5
"""A patient is not larger or smaller than this, against an atlas or the patient's own scan."""


def check_near(what: str, names: tuple[str, ...], points: np.ndarray, surface: Surface, where: str) -> None:
    """InputError, which begins with `what`, for points (n, 3) that are far from the surface called `where`."""
    off = np.abs(SurfaceDistance(surface).at(points))
    worst = int(np.argmax(off))
    if not off[worst] <= NEAR:
        fault = f"'{names[worst]}' is {off[worst]:.0f} mm from {where}, {NEAR:g} mm is the most"
        raise InputError(f"{what}: {fault}; give both in mm and in one frame")


def check_size(what: str, sources: np.ndarray, targets: np.ndarray) -> None:
    """InputError, which begins with `what`, for points (n, 3) that spread far wider or less than their targets."""
    before, after = (np.sqrt(np.mean(np.sum((p - p.mean(axis=0)) ** 2, axis=1))) for p in (sources, targets))
    if not before / GROWTH <= after <= before * GROWTH:
        fault = f"the points spread over {before:.3g} mm in one file and {after:.3g} mm in the other"
        raise InputError(f"{what}: {fault}, a ratio of {GROWTH:g} is the most; give both in mm")
