"""Hessians of tetrahedra and hinges, added up into 3x3 blocks for the pairs of their corners."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np
import warp as wp

from warp_trunk.errors import InputError
from warp_trunk.kernels.assembly import (
    NUMBERS,
    NUMBERS_KEPT,
    PAIRS,
    PLACES,
    block_completer,
    block_gatherer,
    threads_over,
    vec10i,
)

from .model import Model
from .parallel import Launch, in_sequence, view
from .topology import Pattern

BLOCK = 64
"""Threads of a CUDA block of a Hessian; of larger ones, which need many registers, fewer run at once."""


def assemble_symmetric(model: Model, bounds: np.ndarray) -> tuple[Pattern, AddedBlocks | GatheredBlocks]:
    """The assembly of a symmetric matrix: blocks on and above its diagonal are added up, the others are images.

    On the CPU only the former have a place, and those below it between two ranges of rows; on CUDA all have.

    Args:
        model: the trunk.
        bounds: the ranges of rows, of all nodes or the free ones.

    Returns:
        The blocks that have a place, and their assembly.
    """
    if model.parallel.is_cuda:
        pattern = model.edges.pattern(np.arange(bounds[-1]))
        return pattern, GatheredBlocks(model, pattern)
    pattern = model.edges.pattern(np.repeat(np.arange(len(bounds) - 1), np.diff(bounds)))
    return pattern, AddedBlocks(model, pattern)


class AddedBlocks:
    """The assembly on the CPU: ranges add to the same blocks, and to blocks of their own where they meet."""

    blocks: wp.array
    """The sums, then room for what ranges add at places of their own, shape (at least blocks + 1,), mat33."""

    def __init__(self, model: Model, pattern: Pattern) -> None:
        """Adds to the blocks of a pattern on and above the diagonal, and copies them to their images."""
        self._model, image, size = model, pattern.image, len(pattern.columns)
        tets, split = len(model.corners), model.parallel.split
        hinges = split(len(pattern.block_of) - tets)
        parts = pairwise(split(tets)), pairwise(tets + hinges)
        ranges = [np.r_[slice(*tet), slice(*hinge)] for tet, hinge in zip(*parts, strict=True)]
        place_of, extra_blocks = separate_ranges(pattern.block_of, ranges, size)
        self._place_of = model.array(2 * place_of + turned(model.edges.stencils), vec10i)
        self.blocks = model.zeros(wp.types.matrix((3, 3), model.scalar), size + 1 + len(extra_blocks))
        order = np.argsort(extra_blocks, kind="stable")
        completed = np.union1d(extra_blocks, np.flatnonzero(image >= 0))
        completed = completed[completed < size]
        start = np.searchsorted(extra_blocks[order], np.append(completed, size))
        extra_blocks = order + size + 1
        lists = [model.array(each, wp.int32) for each in (completed, start, extra_blocks, image[completed])]
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
    place_of, extra_blocks = np.empty_like(block_of), [np.zeros(0, dtype=np.int64)]
    taken, places = np.zeros(size + 1, dtype=bool), size + 1
    for stencils in ranges:
        used = np.zeros(size + 1, dtype=bool)
        used[block_of[stencils]] = True  # those without a block: the last
        again, place = np.flatnonzero(used & taken), np.arange(size + 1)
        place[again] = places + np.arange(len(again))
        place_of[stencils] = place[block_of[stencils]]
        extra_blocks.append(again)
        taken, places = taken | used, places + len(again)
    return place_of, np.concatenate(extra_blocks)


class GatheredBlocks:
    """The assembly on CUDA: every block gathers what the tetrahedra keep for it."""

    blocks: wp.array
    """The sums, shape (at least blocks + 1,), mat33."""

    def __init__(self, model: Model, pattern: Pattern) -> None:
        """Gathers the blocks of a pattern on the diagonal, with most parts and so first, and those above it."""
        check_stencils(len(pattern.block_of))
        self._model, self._symmetric, self._stencils = model, len(pattern.diagonal), len(pattern.block_of)
        self.blocks = model.zeros(wp.types.matrix((3, 3), model.scalar), len(pattern.columns) + 1)
        above = np.flatnonzero(pattern.image >= 0)
        block, image = (np.concatenate([pattern.diagonal, other]) for other in (above, pattern.image[above]))
        start, parts = list_parts(pattern.block_of, turned(model.edges.stencils), block)
        self._gathered, self._lists = (
            len(block),
            [model.array(each, wp.int32) for each in (start, parts, block, image)],
        )

    def at(self, displacement: wp.array) -> Callable[[str], Launch]:
        """See `AddedBlocks`."""
        model = self._model
        whole_blocks = self._stencils + BLOCK  # the last block of threads is whole
        parts = model.zeros(model.scalar, NUMBERS_KEPT * whole_blocks)
        gather = model.parallel.record(
            block_gatherer(model.scalar),
            threads_over(self._gathered),
            [self._gathered, self._symmetric, *self._lists, parts],
            [view(self.blocks, model.scalar, NUMBERS * len(self.blocks))],
        )
        unused = model.zeros(vec10i, 0)

        def recorded(name: str) -> Launch:
            return in_sequence(*_over_all(model, name, unused, displacement, parts), gather)

        return recorded


def check_stencils(stencils: int) -> None:
    """InputError where tetrahedra and hinges keep more numbers than 32 bits can count."""
    most = np.iinfo(np.int32).max // NUMBERS_KEPT - BLOCK
    if stencils > most:
        raise InputError(
            f"trunk: {stencils} tetrahedra and hinges of skin are more than the {most} that CUDA assembles; mesh "
            "it coarser, or use the device cpu"
        )


def turned(stencils: np.ndarray) -> np.ndarray:
    """Whether the block of each of PAIRS of stencils (stencils, 4) is added transposed, (stencils, 10)."""
    first, other = (np.take(stencils, corner, axis=1) for corner in np.array(PAIRS).T)
    return first > other


def list_parts(block_of: np.ndarray, turned: np.ndarray, gathered: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Which parts of the stencils each block gathers.

    Args:
        block_of: the block of each of PAIRS, -1 for none, shape (stencils, 10).
        turned: whether its part is the transposed one, the same shape.
        gathered: the blocks in the order of gathering, which holds all of `block_of`, shape (gathered,).

    Returns:
        The first entry of each block in the list of parts, shape (gathered + 1,), and the list: where a part
        begins among the numbers that are kept, in bits turned over where it is the transposed one.
    """
    number = np.full(int(gathered.max(initial=-1)) + 2, -1, dtype=np.int32)  # the last: of what is no block
    number[gathered] = np.arange(len(gathered))
    key = number[block_of]
    place = NUMBERS_KEPT * np.arange(len(block_of))[:, None] + np.array(PLACES)
    place = np.where(turned, ~place, place)[key >= 0]
    order = np.argsort(key[key >= 0], kind="stable")
    start = np.searchsorted(key[key >= 0][order], np.arange(len(gathered) + 1))
    return start, place[order]


def _over_all(model: Model, name: str, place_of: wp.array, displacement: wp.array, to: wp.array) -> list[Launch]:
    """Launches of the kernels of a name over tetrahedra and hinges, which come after them in `place_of`.

    In this order: what threads past the last tetrahedron keep stands where the first hinges keep theirs.
    """
    tets = model.over_tets(getattr(model.elements.kernels, name), [place_of, displacement], [to], BLOCK)
    return [tets, *model.over_hinges(name, [len(model.corners), place_of, displacement], [to], BLOCK)]
