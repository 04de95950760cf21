import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from warp_trunk.geometry.linked_parts import linked_parts

RNG = np.random.default_rng(3)


def by_scipy(first: np.ndarray, second: np.ndarray, count: int) -> np.ndarray:
    links = coo_array((np.ones(len(first)), (first, second)), shape=(count, count))
    return connected_components(links, directed=False)[1]


def test_random_links_give_the_parts_that_scipy_finds() -> None:
    for count, links in [(1, 0), (2, 1), (50, 10), (50, 40), (400, 300), (3000, 2500), (3000, 9000)]:
        first, second = RNG.integers(count, size=(2, links))
        np.testing.assert_array_equal(linked_parts(first, second, count), by_scipy(first, second, count))


def test_a_long_chain_in_any_order_is_one_part() -> None:
    for chain in (np.arange(5000), np.arange(5000)[::-1], RNG.permutation(5000)):
        assert linked_parts(chain[:-1], chain[1:], 5001).tolist() == [0] * 5000 + [1]


def test_a_star_is_one_part_whichever_number_its_middle_has() -> None:
    for middle in (0, 250, 499):
        assert not linked_parts(np.full(500, middle), np.arange(500), 500).any()
