"""Hessians of tetrahedra and hinges, added up into 3x3 blocks for the pairs of their corners."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np
import warp as wp

from warp_trunk.kernels.assembly import (
    KEPT,
    NUMBERS,
    PAIRS,
    PLACES,
    gather_kernels,
    threads_over,
    vec16i,
)
from warp_trunk.kernels.vectors import slab_kernels

from .model import Model
from .parallel import Launch, in_sequence, view
from .topology import Pattern

BLOCK = 64
"""Threads of a CUDA block of a Hessian; of larger ones, which need many registers, fewer run at once."""


class Assembly(Protocol):
    """Where the Hessian of each tetrahedron is added; made once for a pattern of blocks."""

    def into(self, blocks: wp.array, displacement: wp.array) -> Callable[[str], Launch]:
        """Records, for a kernel of `TetEnergy.kernels` by its name, that blocks become the sums of its Hessians.

        Args:
            blocks: in the first slab, shape (ranges, blocks), mat33; the others are what threads add into.
            displacement: where the Hessian is taken, shape (nodes,), vec3.
        """
        ...


def assembly_of_blocks(model: Model, block_of: np.ndarray, size: int) -> Assembly:
    """The assembly of blocks of which none is the mirror image of another.

    Args:
        model: the trunk.
        block_of: the block of corner pair (row, column) of each tetrahedron, -1 for none, shape (tets, 16), int32;
            of a pair and the pair turned round one at most.
        size: number of blocks, all of them in `block_of`.
    """
    if not model.parallel.is_cuda:
        return _Added(model, model.array(block_of, vec16i))
    return _Gathered(model, block_of, np.arange(size, dtype=np.int32))


def assembly_of_rows(model: Model, pattern: Pattern) -> Assembly:
    """The assembly of a symmetric matrix: blocks on and above its diagonal are added up.

    Those below are their images on CUDA; on the CPU, whose product does not read them, they stay zero.
    """
    rows, columns = pattern.rows, pattern.columns
    size, upper = len(pattern.row_start) - 1, np.flatnonzero(columns > rows)
    if model.parallel.is_cuda:
        number = np.full(len(columns), -1, dtype=np.int32)
        number[columns == rows] = np.arange(size)  # with most parts, and so first
        number[upper] = np.arange(len(upper)) + size
        return _Gathered(model, pattern.block_of, number, symmetric=size)
    below = (columns < rows)[pattern.block_of]
    return _Added(model, model.array(np.where(below, np.int32(-1), pattern.block_of), vec16i))


class _Added:
    """On the CPU: every range of tetrahedra adds to blocks of its own."""

    def __init__(self, model: Model, block_of: wp.array) -> None:
        self._model, self._block_of = model, block_of

    def into(self, blocks: wp.array, displacement: wp.array) -> Callable[[str], Launch]:
        model = self._model
        ranges, size = blocks.shape
        record, slabs = model.parallel.record, slab_kernels(blocks.dtype)
        before = [record(slabs.clear, size, [ranges], [blocks])]
        after = [record(slabs.gather, size, [ranges], [blocks])] if ranges > 1 else []

        def recorded(name: str) -> Launch:
            return in_sequence(*before, *_over_all(model, name, self._block_of, displacement, blocks), *after)

        return recorded


class _Gathered:
    """On CUDA: every block gathers what the tetrahedra keep for it."""

    def __init__(self, model: Model, block_of: np.ndarray, number: np.ndarray, symmetric: int = 0) -> None:
        """`number` is the place of each block in the order of gathering, -1 for those that are images.

        The `symmetric` first ones are on the diagonal.
        """
        self._model, self._symmetric = model, symmetric
        self._stencils = len(block_of)
        lists = list_parts(block_of, number)
        self._blocks, self._lists = len(lists[2]), [model.array(values, wp.int32) for values in lists]

    def into(self, blocks: wp.array, displacement: wp.array) -> Callable[[str], Launch]:
        model = self._model
        parts = model.zeros(model.scalar, KEPT * (self._stencils + BLOCK))  # the last block of threads is whole
        gather = model.parallel.record(
            gather_kernels(model.scalar).gather,
            threads_over(self._blocks),
            [self._blocks, self._symmetric, *self._lists, parts],
            [view(blocks, model.scalar, NUMBERS * blocks.shape[1])],
        )
        unused = model.zeros(vec16i, 0)

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


def _over_all(model: Model, name: str, block_of: wp.array, displacement: wp.array, to: wp.array) -> list[Launch]:
    """Launches of the kernels of a name over tetrahedra and hinges, which come after them in `block_of`.

    In this order: what threads past the last tetrahedron keep stands where the first hinges keep theirs.
    """
    tets = model.over_tets(getattr(model.elements.kernels, name), [block_of, displacement], [to], BLOCK)
    return [tets, *model.over_hinges(name, [len(model.corners), block_of, displacement], [to], BLOCK)]
