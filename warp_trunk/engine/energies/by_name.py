"""The energies by name: another one is a file of kernels, a file here and two lines below."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

from ..rest_mesh import RestMesh
from .energy import TetEnergy
from .itmsm import make_itmsm
from .neo_hookean import make_neo_hookean

EnergyName = Literal["itmsm", "neo-hookean"]
WeightsName = Literal["count", "volume"]
ENERGIES: dict[str, Callable[[RestMesh, float, str], TetEnergy]] = {
    "itmsm": make_itmsm,
    "neo-hookean": make_neo_hookean,
}
"""Functions that measure the rest state for an energy, given the gravity [m/s^2] and the weights of features."""
