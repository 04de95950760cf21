import numpy as np

from warp_trunk.meshing.build import morton_order


def test_cells_of_a_cube_come_in_z_order():
    points = np.stack(np.meshgrid(*(np.arange(4.0),) * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    shuffled = np.random.default_rng(0).permutation(points)
    ordered = shuffled[morton_order(shuffled)]
    np.testing.assert_array_equal(ordered[:4], [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]])
    # every run of eight is one octant of the cube
    octants = (ordered // 2).reshape(8, 8, 3)
    assert (octants == octants[:, :1]).all()


def test_order_is_a_permutation_also_of_equal_points():
    points = np.vstack([np.ones((5, 3)), np.random.default_rng(1).normal(size=(50, 3))])
    np.testing.assert_array_equal(np.sort(morton_order(points)), np.arange(55))
    np.testing.assert_array_equal(morton_order(np.zeros((3, 3))), [0, 1, 2])
