import numpy as np
from scipy.spatial import KDTree

from warp_trunk.geometry.section import section
from warp_trunk.geometry.surface_checks import check_solid, components
from warp_trunk.preparation.phantom.skin import EDGE, section_at, trunk_skin


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


def loop_at(z: float) -> np.ndarray:
    (loop,) = section(trunk_skin(), z)
    return loop


def width_at(z: float) -> float:
    return float(np.ptp(loop_at(z)[:, 0]))


def test_it_has_neck_shoulders_waist_and_hips():
    neck, shoulders, waist, hips = (width_at(z) for z in (565.0, 465.0, 240.0, 40.0))
    assert neck < 0.4 * shoulders
    assert waist < 0.85 * min(shoulders, hips)


def test_a_furrow_runs_down_the_back():
    for z in (400.0, 300.0, 200.0):
        loop = loop_at(z)
        behind = loop[loop[:, 1] > 0.0]
        at_spine = np.interp(0.0, *behind[np.argsort(behind[:, 0])].T)
        beside = behind[np.abs(np.abs(behind[:, 0]) - 35.0) < 15.0, 1].max()
        depth = section_at(np.array([z])).groove[0]
        assert 0.4 * depth < beside - at_spine < 2.0 * depth
