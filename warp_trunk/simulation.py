"""The incremental loop, eq. 4.5 of [2]; one increment is Algorithm 1 of [1]."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from .errors import InputError
from .model import Model
from .relaxation import Relaxation, Relaxer, RelaxOptions

if TYPE_CHECKING:
    from .bone_path import BonePath


@dataclass(frozen=True, kw_only=True)
class SimulationOptions:
    """How the bones are carried from before to after surgery."""

    increments: int = 10
    """Number of equal parts in which the correction is applied."""
    relax: RelaxOptions = field(default_factory=RelaxOptions)
    """How the tissue is relaxed after each increment."""

    def __post_init__(self) -> None:
        if self.increments < 1:
            raise InputError(f"increments: must be at least 1, not {self.increments}")


@dataclass(frozen=True)
class Increment:
    """The trunk after one part of the correction, relaxed."""

    number: int
    """1 for the first."""
    load_factor: float
    """The part of the correction applied so far, in (0, 1]."""
    displacement: np.ndarray
    """Displacement of every mesh node from before surgery [mm], shape (nodes, 3), float64."""
    relaxation: Relaxation
    """How the relaxation ended."""
    seconds: float
    """Time of this increment [s]."""


def simulate(model: Model, bone_path: BonePath, options: SimulationOptions | None = None) -> Iterator[Increment]:
    """Carries the trunk along the path of its bones and yields it after every increment.

    The rest state is always the mesh before surgery. All increments but the last are relaxed to ten
    times the tolerance.

    Raises:
        InputError: the path does not belong to the model's mesh.
    """
    options = options or SimulationOptions()
    if bone_path.displacement.shape != (len(model.order), 3):
        raise InputError(
            f"bone_path: has {len(bone_path.displacement)} nodes but the trunk has {len(model.order)}; "
            "make the path from the nodes of this trunk"
        )
    relaxer = Relaxer(model, options.relax)
    now = np.zeros((len(model.order), 3))
    last = None
    for number in range(1, options.increments + 1):
        start = time.perf_counter()
        load_factor, before = number / options.increments, (number - 1) / options.increments
        last, now = now, carry(now, last, bone_path, before, load_factor)  # phi_t of eq. 4.5
        relaxer.state.place(held(now, bone_path.at(load_factor), model))
        final = number == options.increments
        relaxation = relaxer.relax(options.relax.tolerance * (1.0 if final else 10.0))  # phi~ of eq. 4.3
        now = relaxer.state.host_displacement()
        yield Increment(number, load_factor, now, relaxation, time.perf_counter() - start)


def carry(
    now: np.ndarray, last: np.ndarray | None, bone_path: BonePath, before: float, load_factor: float
) -> np.ndarray:
    """Where the tissue is expected at the load factor, from which it is relaxed.

    The first increment is carried by the spline, eq. 4.5. A later one goes on by what the relaxed trunk
    did over the increment before, which for equal increments moves the bones just as the spline does and
    the tissue nearly to its equilibrium.
    """
    if last is None:
        return now + bone_path.at(load_factor) - bone_path.at(before)
    return now + (now - last)


def held(displacement: np.ndarray, bones: np.ndarray, model: Model) -> np.ndarray:
    """The displacement with every prescribed node exactly at its place, shape (nodes, 3)."""
    prescribed = model.order[model.free :]
    displacement[prescribed] = bones[prescribed]
    return displacement
