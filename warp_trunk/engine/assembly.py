"""Hessians of tetrahedra and hinges, added up into 3x3 blocks for the pairs of their corners."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np
import warp as wp

from warp_trunk.kernels.assembly import (
    KEPT,
    NUMBERS,
    PARTS,
    blocks_of_rows,
    find_starts,
    gather_kernels,
    list_parts,
    threads_over,
    vec16i,
)
from warp_trunk.kernels.sparse import sparse_kernels
from warp_trunk.kernels.vectors import slab_kernels

from .model import Model, Pattern
from .parallel import Launch, in_sequence, view

BLOCK = 64
"""Threads of a CUDA block of a Hessian; of larger ones, which need so many registers, fewer run at once."""


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
    on_device = model.array(block_of, vec16i)
    if not model.parallel.is_cuda:
        return _Added(model, on_device, [model.zeros(wp.int32, 0)] * 2)
    return _Gathered(model, on_device, np.arange(size, dtype=np.int32))


def assembly_of_rows(model: Model, pattern: Pattern) -> Assembly:
    """The assembly of a symmetric matrix: blocks on and above its diagonal are added up, the others their
    images."""
    row_start, columns, place = pattern.row_start, pattern.columns, pattern.place
    rows = np.repeat(np.arange(len(row_start) - 1, dtype=np.int32), np.diff(row_start))
    upper = np.flatnonzero(columns > rows)
    block_of, cuda = model.zeros(vec16i, len(place)), model.parallel.is_cuda
    at = [not cuda, model.array(row_start, wp.int32), model.stencils_there, model.array(place, wp.uint16)]
    model.parallel.record(blocks_of_rows, len(place), at, [block_of])()
    if cuda:
        number = np.full(len(columns), -1, dtype=np.int32)
        number[columns == rows] = np.arange(len(row_start) - 1)  # with most parts, and so first
        number[upper] = np.arange(len(upper)) + len(row_start) - 1
        return _Gathered(model, block_of, number, symmetric=len(row_start) - 1)
    mirrored = upper[np.argsort(columns[upper], kind="stable")]  # in the order of the lower ones
    mirrors = [
        model.array(blocks.astype(np.int32), wp.int32) for blocks in (np.flatnonzero(columns < rows), mirrored)
    ]
    return _Added(model, block_of, mirrors)


class _Added:
    """On the CPU: every range of tetrahedra adds to blocks of its own."""

    def __init__(self, model: Model, block_of: wp.array, mirrors: list[wp.array]) -> None:
        """`mirrors` are blocks, shape (k,), int32, and those that they are the transposes of."""
        self._model, self._block_of, self._mirrors = model, block_of, mirrors

    def into(self, blocks: wp.array, displacement: wp.array) -> Callable[[str], Launch]:
        model = self._model
        ranges, size = blocks.shape
        record, slabs = model.parallel.record, slab_kernels(blocks.dtype)
        mirror = sparse_kernels(model.scalar).mirror
        before = [record(slabs.clear, size, [ranges], [blocks])]
        after = [record(slabs.gather, size, [ranges], [blocks])] if ranges > 1 else []
        after.append(record(mirror, len(self._mirrors[0]), self._mirrors, [blocks]))

        def recorded(name: str) -> Launch:
            return in_sequence(*before, *_over_all(model, name, self._block_of, displacement, blocks), *after)

        return recorded


class _Gathered:
    """On CUDA: every block gathers what the tetrahedra keep for it."""

    def __init__(self, model: Model, block_of: wp.array, number: np.ndarray, symmetric: int = 0) -> None:
        """`number` is the place of each block in the order of gathering, -1 for those that are images.

        The `symmetric` first ones are on the diagonal.
        """
        self._model, self._symmetric = model, symmetric
        self._stencils = len(model.stencils)
        parts, count = PARTS * self._stencils, int(number.max(initial=-1)) + 1
        keys, places = (model.zeros(wp.int32, 2 * parts) for _ in range(2))  # half of it is for the sort
        block, mirrored, start = (model.zeros(wp.int32, count + 1) for _ in range(3))
        wp.launch(
            list_parts,
            self._stencils,
            [count, block_of, model.array(number, wp.int32)],
            [keys, places, block, mirrored],
            device=model.device,
        )
        wp.utils.radix_sort_pairs(keys, places, parts)
        start.fill_(parts)  # where all parts are gathered nothing follows the last block
        wp.launch(find_starts, parts, [keys], [start], device=model.device)
        self._blocks, self._lists = count, (start, places, block, mirrored)

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


def _over_all(model: Model, name: str, block_of: wp.array, displacement: wp.array, to: wp.array) -> list[Launch]:
    """Launches of the kernels of a name over tetrahedra and hinges, which come after them in `block_of`.

    In this order: what threads past the last tetrahedron keep stands where the first hinges keep theirs.
    """
    tets = model.over_tets(getattr(model.elements.kernels, name), [block_of, displacement], [to], BLOCK)
    return [tets, *model.over_hinges(name, [len(model.corners), block_of, displacement], [to], BLOCK)]
