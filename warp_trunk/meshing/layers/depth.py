"""How deep the tissue lies under the skin, and which part of each tetrahedron lies above a depth."""

from __future__ import annotations

import numpy as np

from warp_trunk.engine.trunk_mesh import TrunkMesh
from warp_trunk.errors import InputError
from warp_trunk.geometry.surface import Surface

LEAST_CUT = 5000.0
"""A patch of the scan that is flat over more than this [mm^2] is where the scan was cut off, not skin."""
FLATNESS = 500.0
"""Two triangles are in one flat patch when (radius of their curvature / their size)^2 is above this."""
BEYOND = 30.0
"""Points this much deeper than any layer [mm] are all alike: larger than a tetrahedron."""
OPPOSITE = np.array([[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]])
"""The corners that a tetrahedron split at its centroid shares with each of its parts."""


def real_skin(skin: Surface) -> np.ndarray:
    """True for the triangles of a scan that are skin, shape (faces,); the flat ends of the scan are not.

    A scan of the trunk ends in planes at the neck, the thighs and perhaps the arms, which close it but have
    muscle and bone under them. No skin is flat over 50 cm^2.

    Raises:
        InputError: all of it is flat.
    """
    import trimesh  # heavy

    mesh = trimesh.Trimesh(skin.vertices, skin.faces, process=False)
    is_skin = np.ones(len(skin.faces), dtype=bool)
    for patch in trimesh.graph.facets(mesh, facet_threshold=FLATNESS):
        if mesh.area_faces[patch].sum() > LEAST_CUT:
            is_skin[patch] = False
    if not is_skin.any():
        raise InputError(
            f"skin: all of it is flat over more than {LEAST_CUT / 100.0:g} cm^2, as where a scan is cut off; "
            "layers by depth need a curved skin, so give them by a mesh or leave them out"
        )
    return is_skin


def part_above(trunk: TrunkMesh, bottoms: np.ndarray) -> np.ndarray:
    """The part of each tetrahedron's volume that lies above each of some surfaces under the skin.

    The depth under the skin is the distance to its nearest point; within a quarter of a tetrahedron (its
    centroid and three of its corners) it is taken to be linear.

    Args:
        trunk: the mesh.
        bottoms: depth of each surface under each skin vertex [mm], shape (surfaces, skin vertices).

    Returns:
        Numbers from 0 to 1, shape (surfaces, tets).
    """
    from warp_trunk.geometry.nearest import nearest  # heavy

    skin = Surface(trunk.nodes[trunk.skin_nodes], trunk.skin_faces)
    faces = skin.faces[real_skin(skin)]
    count = len(trunk.nodes)
    points = np.concatenate([trunk.nodes, trunk.nodes[trunk.tets].mean(axis=1)])
    face, weights = nearest(Surface(skin.vertices, faces), points, float(bottoms.max()) + BEYOND)
    seen = face >= 0
    corners, weights = faces[face[seen]], weights[seen]
    depth = np.linalg.norm(points[seen] - np.einsum("pc,pcx->px", weights, skin.vertices[corners]), axis=1)
    result = np.empty((len(bottoms), len(trunk.tets)))
    for surface, bottom in enumerate(bottoms):
        below = np.full(len(points), BEYOND)
        below[seen] = depth - np.einsum("pc,pc->p", weights, bottom[corners])
        at_corners, at_centroid = below[:count][trunk.tets], below[count:]
        parts = [part_negative(np.column_stack([at_corners[:, corners], at_centroid])) for corners in OPPOSITE]
        result[surface] = np.mean(parts, axis=0)
    return result


def part_negative(values: np.ndarray) -> np.ndarray:
    """The part of each tetrahedron where a linear function is negative, from its values at the corners.

    With values a <= b <= c <= d, by how many are negative: none, nothing; one, the small tetrahedron at it,
    -a^3 / ((b - a)(c - a)(d - a)); two, three tetrahedra between the cuts of the four edges; three, all
    but the small one at the last; four, everything.

    Args:
        values: shape (tets, 4), any order.

    Returns:
        Shape (tets,), from 0 to 1.
    """
    a, b, c, d = np.sort(values, axis=1).T
    negative = (values < 0.0).sum(axis=1)
    result = (negative == 4).astype(np.float64)
    one, two, three = (negative == count for count in (1, 2, 3))

    def cut(end: np.ndarray, other: np.ndarray, where: np.ndarray) -> np.ndarray:
        """Where the function is zero on an edge, as a part of its length from the end."""
        return end[where] / (end[where] - other[where])

    result[one] = cut(a, b, one) * cut(a, c, one) * cut(a, d, one)
    result[three] = 1.0 - cut(d, a, three) * cut(d, b, three) * cut(d, c, three)
    ac, ad, bc, bd = cut(a, c, two), cut(a, d, two), cut(b, c, two), cut(b, d, two)
    result[two] = ac * ad + ac * bd * (1.0 - ad) + bc * bd * (1.0 - ac)
    return result
