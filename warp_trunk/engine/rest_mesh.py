"""The tetrahedra of a trunk at rest, as the energies measure them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import warp as wp

from .parallel import Parallel
from .tissue import Tissue
from .trunk_mesh import tet_volumes

PRECISIONS = {"float32": wp.float32, "float64": wp.float64}
"""Precisions of device arrays by name."""


@dataclass(frozen=True, eq=False)
class RestMesh:
    """Tetrahedra in model order, float64, and where their measures go."""

    nodes: np.ndarray
    """Positions at rest [mm], shape (nodes, 3)."""
    corners: np.ndarray
    """Nodes of the tetrahedra, shape (tets, 4), int32."""
    tissues: tuple[Tissue, ...]
    """Materials of the tetrahedra."""
    label: np.ndarray | None
    """The tissue of each tetrahedron, shape (tets,), or the part of each tissue in it, shape (tets, tissues); None
    where there is one tissue."""
    scalar: Any
    """Precision of the device arrays, wp.float32 or wp.float64."""
    parallel: Parallel
    """Where they are measured."""

    @property
    def is_cuda(self) -> bool:
        """Whether the device is a CUDA device."""
        return self.parallel.is_cuda

    @cached_property
    def tets(self) -> wp.array:
        """`corners` on the device, shape (tets,), vec4i."""
        return self.upload(self.corners, wp.vec4i)

    @cached_property
    def volume(self) -> np.ndarray:
        """Volumes [mm^3], shape (tets,)."""
        return tet_volumes(self.nodes, self.corners)

    def by_tissue(self, values: Sequence[float]) -> np.ndarray:
        """A constant of the tissues for each tetrahedron, shape (tets,).

        For a mixture it is the mean by volume (Voigt's): the constants enter the energy as factors.
        """
        constants = np.asarray(values, dtype=np.float64)
        if self.label is None:
            return np.full(len(self.corners), constants[0])
        return constants[self.label] if self.label.ndim == 1 else self.label @ constants

    def height_energy(self, weight: np.ndarray) -> float:
        """The gravity term at rest, of a weight per mm^3 and mm of a corner, shape (tets,).

        Heights are above the lowest node: the term rounds what the energy of a step can show.
        """
        above = self.nodes[:, 2] - self.nodes[:, 2].min()
        height = sum(above.take(corner) for corner in self.corners.T)
        return float((weight * self.volume * height).sum())

    def upload(self, values: np.ndarray, dtype: Any) -> wp.array:
        """The values as a device array."""
        return wp.array(np.ascontiguousarray(values), dtype=dtype, device=self.parallel.device)
