"""The interface of an energy."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
import warp as wp

if TYPE_CHECKING:
    from ..rest_mesh import RestMesh


@dataclass(frozen=True, kw_only=True)
class TetEnergy:
    """An energy over the tetrahedra of one trunk: what its kernels read, on the device."""

    unit: ClassVar[str]
    """Unit of the energy."""
    columns: ClassVar[dict[str, int]]
    """The column of the sums in which its kernels add each of its terms."""
    rights_inverted: ClassVar[bool]
    """Whether its forces turn an inverted tetrahedron back. A step may then invert some: one that has no room
    between bones would hold up all others. Where they do not, no step inverts any."""
    kernels: SimpleNamespace
    """`gradient` (with the energy), `projected_hessian` (made positive semidefinite) and `hessian`."""
    terms: tuple[str, ...]
    """Names of the terms that the scene uses, in the order in which they are added."""
    rest_volume: wp.array
    """Volumes at rest [mm^3], shape (tets,)."""
    gravity_weight: wp.array
    """Energy for each mm^3 of a tetrahedron and mm of height of a corner, shape (tets,)."""
    gravity_at_rest: float
    """The gravity term of the trunk at rest [energy's unit], which the displacement's part adds to."""
    measures: Callable[[RestMesh], dict[str, wp.array]]
    """The values of the arrays of these names for a rest state, in new arrays; the weights stay."""
    weights: Callable[[RestMesh, float], dict[str, np.ndarray]]
    """The values of the arrays of these names for the tissues of a mesh and a gravity [m/s^2], float64.

    The energy is linear in them: put in their place, their derivative in a constant gives the derivative of
    energy, gradient and Hessian in it."""
    per_millijoule: Callable[[RestMesh], float]
    """Units of the energy in a mJ, for the tissues of a mesh."""

    @property
    def arrays(self) -> Any:
        """The struct of its arrays, which its kernels take after the tetrahedra."""
        return self.kernels.bundle(self)
