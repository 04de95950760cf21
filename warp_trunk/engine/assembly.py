"""Hessians of tetrahedra and hinges, added up into 3x3 blocks for the pairs of their corners."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np
import warp as wp

from warp_trunk.kernels.assembly import (
    KEPT,
    NUMBERS,
    PAIRS,
    PLACES,
    block_completer,
    gather_kernels,
    threads_over,
    vec10i,
)

from .model import Model
from .parallel import Launch, in_sequence, view
from .topology import Pattern

BLOCK = 64
"""Threads of a CUDA block of a Hessian; of larger ones, which need many registers, fewer run at once."""


def assemble_symmetric(
    model: Model, pattern: Pattern, bounds: np.ndarray
) -> tuple[Pattern, AddedBlocks | GatheredBlocks]:
    """The assembly of a symmetric matrix: blocks on and above its diagonal are added up, the others are images.

    On the CPU only the former have a place, and those below it between two ranges of rows (`Pattern.upper_half`);
    on CUDA all have.

    Args:
        model: the trunk.
        pattern: all blocks.
        bounds: the ranges of rows.

    Returns:
        The blocks that have a place, and their assembly.
    """
    if not model.parallel.is_cuda:
        pattern, image = pattern.upper_half(bounds)
        return pattern, AddedBlocks(model, pattern.block_of, image)
    rows, columns = pattern.rows, pattern.columns
    size, upper = len(pattern.row_start) - 1, np.flatnonzero(columns > rows)
    number = np.full(len(columns), -1, dtype=np.int32)
    number[columns == rows] = np.arange(size)  # with most parts, and so first
    number[upper] = np.arange(len(upper)) + size
    return pattern, GatheredBlocks(model, pattern.block_of, number, size)


class AddedBlocks:
    """The assembly on the CPU: ranges add to the same blocks, and to blocks of their own where they meet."""

    blocks: wp.array
    """The sums, then room for what ranges add at places of their own, shape (at least blocks + 1,), mat33."""

    def __init__(self, model: Model, block_of: np.ndarray, image: np.ndarray) -> None:
        """`image` is the place where the transposed block is copied to, -1 for none, shape (blocks,)."""
        self._model, size = model, len(image)
        tets, split = len(model.corners), model.parallel.split
        parts = pairwise(split(tets)), pairwise(tets + split(len(block_of) - tets))  # of tetrahedra and of hinges
        ranges = [np.r_[slice(*tet), slice(*hinge)] for tet, hinge in zip(*parts, strict=True)]
        a, b = np.array(PAIRS).T
        own, turned = block_of[:, 4 * a + b], block_of[:, 4 * b + a]
        place_of, others = separate_ranges(np.maximum(own, turned), ranges, size)
        self._place_of = model.array(2 * place_of + (own < turned), vec10i)
        self.blocks = model.zeros(wp.types.matrix((3, 3), model.scalar), size + 1 + len(others))
        order = np.argsort(others, kind="stable")
        completed = np.union1d(others, np.flatnonzero(image >= 0))
        completed = completed[completed < size]
        start = np.searchsorted(others[order], np.append(completed, size))
        others = order + size + 1
        lists = [model.array(each, wp.int32) for each in (completed, start, others, image[completed])]
        self._complete = model.parallel.record(block_completer(model.scalar), len(completed), lists, [self.blocks])
        self._clear = model.parallel.clear(self.blocks)

    def at(self, displacement: wp.array) -> Callable[[str], Launch]:
        """Records, for a kernel of `TetEnergy.kernels` by its name, that blocks become the sums of its Hessians.

        `displacement` is where the Hessian is taken, shape (nodes,), vec3.
        """

        def recorded(name: str) -> Launch:
            added = _over_all(self._model, name, self._place_of, displacement, self.blocks)
            return in_sequence(self._clear, *added, self._complete)

        return recorded


def separate_ranges(
    block_of: np.ndarray, ranges: Sequence[np.ndarray], size: int
) -> tuple[np.ndarray, np.ndarray]:
    """Places where ranges of stencils add at the same time, none of them to that of another.

    Args:
        block_of: the block of each part of a stencil, below 0 for none, shape (stencils, parts).
        ranges: the stencils of each range.
        size: number of blocks; the place after them takes what has none.

    Returns:
        The place of each part, of the shape of `block_of`, and the block of each place after `size`.
    """
    place_of, others = np.empty_like(block_of), [np.zeros(0, dtype=np.int64)]
    taken, places = np.zeros(size + 1, dtype=bool), size + 1
    for stencils in ranges:
        used = np.zeros(size + 1, dtype=bool)
        used[block_of[stencils]] = True  # those without a block: the last
        again, place = np.flatnonzero(used & taken), np.arange(size + 1)
        place[again] = places + np.arange(len(again))
        place_of[stencils] = place[block_of[stencils]]
        others.append(again)
        taken, places = taken | used, places + len(again)
    return place_of, np.concatenate(others)


class GatheredBlocks:
    """The assembly on CUDA: every block gathers what the tetrahedra keep for it."""

    blocks: wp.array
    """The sums, shape (at least blocks + 1,), mat33."""

    def __init__(self, model: Model, block_of: np.ndarray, number: np.ndarray, symmetric: int) -> None:
        """`number` is the place of each block in the order of gathering, -1 for those that are images.

        The `symmetric` first ones are on the diagonal.
        """
        self._model, self._symmetric = model, symmetric
        self._stencils = len(block_of)
        self.blocks = model.zeros(wp.types.matrix((3, 3), model.scalar), len(number) + 1)
        lists = list_parts(block_of, number)
        self._gathered, self._lists = len(lists[2]), [model.array(values, wp.int32) for values in lists]

    def at(self, displacement: wp.array) -> Callable[[str], Launch]:
        """See `AddedBlocks`."""
        model = self._model
        parts = model.zeros(model.scalar, KEPT * (self._stencils + BLOCK))  # the last block of threads is whole
        gather = model.parallel.record(
            gather_kernels(model.scalar).gather,
            threads_over(self._gathered),
            [self._gathered, self._symmetric, *self._lists, parts],
            [view(self.blocks, model.scalar, NUMBERS * len(self.blocks))],
        )
        unused = model.zeros(vec10i, 0)

        def recorded(name: str) -> Launch:
            return in_sequence(*_over_all(model, name, unused, displacement, parts), gather)

        return recorded


def list_parts(block_of: np.ndarray, number: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Which parts of the stencils each block gathers.

    Args:
        block_of: the block of each corner pair, -1 for none, shape (stencils, 16).
        number: the place of each block in the order of gathering, -1 for those that are images of others.

    Returns:
        Of each block in that order the first entry in the list of parts, shape (blocks + 1,); the list: where a
        part begins among the numbers that are kept, in bits turned over where it is the transposed one; and of
        each block its own number and that of its image, which is its own where it has none.
    """
    a, b = np.array(PAIRS).T
    own, image = block_of[:, 4 * a + b], block_of[:, 4 * b + a]
    key, key_of_image = (np.append(number, -1)[blocks] for blocks in (own, image))
    turned = key < 0
    key, own, image = (np.where(turned, *pair) for pair in ((key_of_image, key), (image, own), (own, image)))
    place = KEPT * np.arange(len(block_of))[:, None] + np.array(PLACES)
    place = np.where(turned, ~place, place)
    gathered = key >= 0
    key, own, image = key[gathered], own[gathered], image[gathered]
    block, mirrored = np.empty((2, int(number.max(initial=-1)) + 1), dtype=np.int32)
    block[key], mirrored[key] = own, np.where(image < 0, own, image)
    order = np.argsort(key, kind="stable")
    start = np.searchsorted(key[order], np.arange(len(block) + 1))
    return start, place[gathered][order], block, mirrored


def _over_all(model: Model, name: str, place_of: wp.array, displacement: wp.array, to: wp.array) -> list[Launch]:
    """Launches of the kernels of a name over tetrahedra and hinges, which come after them in `place_of`.

    In this order: what threads past the last tetrahedron keep stands where the first hinges keep theirs.
    """
    tets = model.over_tets(getattr(model.elements.kernels, name), [place_of, displacement], [to], BLOCK)
    return [tets, *model.over_hinges(name, [len(model.corners), place_of, displacement], [to], BLOCK)]
