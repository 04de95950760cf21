"""The tetrahedra of a trunk at rest, on the host, as the energies measure them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import warp as wp

from .memo import Memo
from .tissue import Tissue


@dataclass(frozen=True, eq=False)
class RestMesh:
    """Tetrahedra in model order, float64, and where their measures go."""

    nodes: np.ndarray
    """Positions at rest [mm], shape (nodes, 3)."""
    corners: np.ndarray
    """Nodes of the tetrahedra, shape (tets, 4), int32."""
    tissues: tuple[Tissue, ...]
    """What the tetrahedra are made of."""
    label: np.ndarray | None
    """The tissue of each tetrahedron, shape (tets,), or the part of each tissue in it, shape (tets, tissues); None
    where there is one tissue."""
    scalar: Any
    """Precision of the device arrays, wp.float32 or wp.float64."""
    device: str
    """'cpu' or 'cuda:N'."""
    memo: Memo | None = None
    """What is remembered of this trunk."""

    @property
    def is_cuda(self) -> bool:
        """Whether the device is a CUDA device."""
        return self.device.startswith("cuda")

    @cached_property
    def positions(self) -> np.ndarray:
        """Corners of every tetrahedron [mm], shape (tets, 4, 3)."""
        return np.take(self.nodes, self.corners, axis=0)

    @cached_property
    def edges(self) -> np.ndarray:
        """Vectors from corner 0 to corners 1, 2, 3 [mm], shape (tets, 3, 3)."""
        return self.positions[:, 1:] - self.positions[:, :1]

    @cached_property
    def volume(self) -> np.ndarray:
        """Volumes [mm^3], shape (tets,)."""
        return np.einsum("ij,ij->i", self.edges[:, 0], np.cross(self.edges[:, 1], self.edges[:, 2])) / 6.0

    def by_tissue(self, values: Sequence[float]) -> np.ndarray:
        """A constant of the tissues for each tetrahedron, shape (tets,), or for all of them, shape (1,).

        For a mixture it is the mean by volume (Voigt's): the constants enter the energy as factors.
        """
        constants = np.asarray(values, dtype=np.float64)
        if self.label is None:
            return constants[:1]
        return constants[self.label] if self.label.ndim == 1 else self.label @ constants

    def height_energy(self, weight: np.ndarray) -> float:
        """The gravity term at rest, of a weight per mm^3 and mm of a corner, shape (1,) or (tets,)."""
        return float((weight * self.volume * self.positions[:, :, 2].sum(axis=1)).sum())

    def upload(self, values: np.ndarray, dtype: Any) -> wp.array:
        """The values as a device array."""
        return wp.array(np.ascontiguousarray(values), dtype=dtype, device=self.device)
