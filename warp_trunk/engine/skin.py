"""The skin of a trunk as a thin plate: what its kernels read of every hinge, two skin triangles on one edge."""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import warp as wp

from warp_trunk.kernels.skin_bending import skin_bending_kernels

from .rest_mesh import RestMesh


@dataclass(frozen=True)
class Skin:
    """A plate without moment where the trunk is at rest; its energy has the unit of the tissue's."""

    kernels: SimpleNamespace
    """`gradient`, `projected_hessian` and `hessian`, as those of the tetrahedra."""
    rigidity: float
    """Flexural rigidity E h^3 / (12 (1 - nu^2)) [N mm]: moment for each width and curvature."""
    corners: np.ndarray
    """Ends of the edge of each hinge and the third corner of either triangle, shape (hinges, 4), int32."""
    shares: np.ndarray
    """Energy for each rigidity and square radian, l^2 / (2 A) of the edge and both triangles, shape (hinges,)."""
    hinges: wp.array
    """`corners` on the device, shape (hinges,), vec4i."""
    rest_edge: wp.array
    """Vectors from corner 0 to corners 1, 2, 3 at rest [mm], shape (hinges, 3), vec3."""
    rest_angle: wp.array
    """Angle between the triangles at rest [radians], shape (hinges,)."""
    stiffness: wp.array
    """Energy for each square radian, shape (hinges,)."""

    @property
    def arguments(self) -> list[Any]:
        """The first arguments of its kernels."""
        return [self.hinges, self.rest_edge, self.rest_angle, self.stiffness]

    def measures(self, rest: RestMesh) -> dict[str, wp.array]:
        """The values of the arrays of these names for a rest state."""
        return _measures(rest, self.corners)

    def at_rest(self, rest: RestMesh) -> Skin:
        """The same skin on a trunk with another rest state, in arrays of its own."""
        return replace(self, **self.measures(rest))


def make_skin(rest: RestMesh, faces: np.ndarray, rigidity: float, per_millijoule: float) -> Skin:
    """Measures the skin and uploads it.

    The energy of a hinge is half the rigidity times l^2 / A of the square of the change of its angle (Grinspun,
    Hirani, Desbrun and Schroder, Discrete shells, 2003; the factor is that of a lattice of equal triangles bent to
    a cylinder: Seung and Nelson, Phys. Rev. A 38, 1988, 1005).

    Args:
        rest: the trunk before surgery.
        faces: triangles of the skin in the numbers of its nodes, shape (faces, 3).
        rigidity: flexural rigidity [N mm].
        per_millijoule: units of the tissue's energy in a mJ.
    """
    corners = hinges_of(faces)
    a, b, c = _edges(rest, corners)
    twice_area = sum(np.linalg.norm(np.cross(a, side), axis=1) for side in (b, c))
    shares = np.einsum("hi,hi->h", a, a) / twice_area
    return Skin(
        kernels=skin_bending_kernels(rest.scalar, rest.is_cuda),
        rigidity=rigidity,
        corners=corners,
        shares=shares,
        hinges=rest.upload(corners, wp.vec4i),
        stiffness=rest.upload(rigidity * per_millijoule * shares, rest.scalar),
        **_measures(rest, corners),
    )


def hinges_of(faces: np.ndarray) -> np.ndarray:
    """The hinges of triangles (faces, 3), shape (hinges, 4), int32; an edge of one triangle alone is none.

    Ends of the edge in the order of its first triangle, then the third corner of that one and of the other.
    """
    ends = faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2).astype(np.int64)
    third = faces[:, [2, 0, 1]].ravel()
    key = ends.min(axis=1) * (int(faces.max(initial=0)) + 1) + ends.max(axis=1)
    order = np.argsort(key, kind="stable")
    first = np.flatnonzero(key[order][1:] == key[order][:-1])
    first_face, other = order[first], order[first + 1]
    return np.column_stack([ends[first_face], third[first_face], third[other]]).astype(np.int32)


def _edges(rest: RestMesh, corners: np.ndarray) -> np.ndarray:
    """Vectors from corner 0 of hinges (hinges, 4) to corners 1, 2, 3, shape (3, hinges, 3)."""
    at = np.moveaxis(rest.nodes[corners], 1, 0)
    return at[1:] - at[0]


def _measures(rest: RestMesh, corners: np.ndarray) -> dict[str, wp.array]:
    """Edge vectors and angles of hinges (hinges, 4), as the fields of `Skin`."""
    a, b, c = edges = _edges(rest, corners)
    n, m = np.cross(a, b), np.cross(c, a)
    length = np.linalg.norm(a, axis=1)
    angles = np.arctan2(np.einsum("hi,hi->h", np.cross(n, m), a), length * np.einsum("hi,hi->h", n, m))
    return {
        "rest_edge": rest.upload(np.moveaxis(edges, 0, 1), wp.types.vector(3, rest.scalar)),
        "rest_angle": rest.upload(angles, rest.scalar),
    }
