import numpy as np
from scipy.spatial import KDTree

from warp_trunk.geometry.surface_checks import check_solid, components
from warp_trunk.preparation.phantom.skin import EDGE, trunk_skin


def test_the_skin_is_one_solid_of_even_triangles():
    skin = trunk_skin()
    check_solid(skin, "skin")
    assert components(skin).max() == 0
    assert 3000 <= len(skin.vertices) <= 5000
    edges = np.linalg.norm(np.diff(skin.vertices[skin.faces[:, [0, 1, 2, 0]]], axis=1), axis=2)
    assert 0.9 * EDGE < np.median(edges) < 1.1 * EDGE
    assert edges.max() < 2.5 * EDGE


def test_the_skin_is_its_own_mirror_image():
    skin = trunk_skin()
    gap, twin = KDTree(skin.vertices).query(skin.vertices * [-1.0, 1.0, 1.0])
    assert gap.max() == 0.0
    triangles = {tuple(sorted(face)) for face in skin.faces.tolist()}
    assert triangles == {tuple(sorted(face)) for face in np.asarray(twin)[skin.faces].tolist()}
