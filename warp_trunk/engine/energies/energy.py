"""The interface of an energy."""

from __future__ import annotations

from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, ClassVar, Protocol

import numpy as np
import warp as wp

if TYPE_CHECKING:
    from ..rest_mesh import RestMesh


class TetEnergy(Protocol):
    """An energy over the tetrahedra of one trunk: what its kernels read, on the device; a frozen dataclass."""

    __dataclass_fields__: ClassVar[dict[str, Any]]
    unit: ClassVar[str]
    """Unit of the energy."""
    columns: ClassVar[dict[str, int]]
    """The column of the sums in which its kernels add each of its terms."""
    rights_inverted: ClassVar[bool]
    """Whether its forces turn an inverted tetrahedron back. A step may then invert some: one that has no room
    between bones would hold up all others. Where they do not, no step inverts any."""

    @property
    def kernels(self) -> SimpleNamespace:
        """`gradient` (with the energy), `projected_hessian` (made positive semidefinite) and `hessian`."""
        ...

    @property
    def terms(self) -> tuple[str, ...]:
        """Names of the terms that the scene uses, in the order in which they are added."""
        ...

    @property
    def arrays(self) -> Any:
        """The struct of its arrays, which its kernels take after the tetrahedra."""
        ...

    @property
    def rest_volume(self) -> wp.array:
        """Volumes at rest [mm^3], shape (tets,)."""
        ...

    @property
    def gravity_weight(self) -> wp.array:
        """Energy for each mm^3 of a tetrahedron and mm of height of a corner, shape (tets,)."""
        ...

    @property
    def gravity_at_rest(self) -> float:
        """The gravity term of the trunk at rest, which the displacement's part adds to."""
        ...

    def measures(self, rest: RestMesh, /) -> dict[str, wp.array]:
        """The values of the arrays of these names for a rest state, in new arrays."""
        ...

    def weights(self, rest: RestMesh, gravity: float, /) -> dict[str, np.ndarray]:
        """The values of the arrays of these names for the tissues of a mesh and a gravity [m/s^2], float64.

        The energy is linear in them: put in their place, their derivative in a constant gives the derivative of
        energy, gradient and Hessian in it.
        """
        ...

    def per_millijoule(self, rest: RestMesh) -> float:
        """Units of the energy in a mJ, for the tissues of a mesh."""
        ...
