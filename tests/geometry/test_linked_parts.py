import numpy as np

from warp_trunk.geometry.surface_checks import linked_parts


def test_parts_are_numbered_in_the_order_of_their_first_things() -> None:
    links = np.array([[7, 2], [5, 9], [9, 1], [2, 8], [2, 8], [3, 3]])
    assert linked_parts(links[:, 0], links[:, 1], 10).tolist() == [0, 1, 2, 3, 4, 1, 5, 2, 2, 1]


def test_without_links_each_thing_is_a_part() -> None:
    none = np.empty(0, dtype=np.int64)
    assert linked_parts(none, none, 3).tolist() == [0, 1, 2]
