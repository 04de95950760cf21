"""Everything that can be chosen of a run, as one record."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from warp_trunk import RelaxOptions, SimulationOptions, Tissue
from warp_trunk.engine.energies.by_name import EnergyName, WeightsName


@dataclass(frozen=True, kw_only=True)
class Choices:
    """One run; the defaults are those of the program."""

    tets: int = 225_000
    """Number of tetrahedra asked for."""
    energy: EnergyName = "neo-hookean"
    """Energy of the tissue."""
    weights: WeightsName = "count"
    """Weights of itmsm."""
    epsilon: float = Tissue.epsilon
    """Stiffness of faces against edges."""
    theta: float = Tissue.theta
    """Stiffness of tetrahedra against edges."""
    poisson_ratio: float = Tissue.poisson_ratio
    """Of the neo-Hookean energy."""
    layers: bool = False
    """Skin, fat and muscle by depth instead of one tissue."""
    gravity: float = 0.0
    """Gravity [m/s^2]."""
    rest: Literal["sag-free", "scan"] = "sag-free"
    """The rest state under gravity."""
    bones: Literal["follow", "spline"] = "follow"
    """How bones are carried."""
    skin_rigidity: float | None = None
    """Flexural rigidity of the skin [N mm]; when left out what the program takes with such bones."""
    precision: Literal["float32", "float64"] = "float32"
    """Precision of the simulation."""
    tolerance: float = RelaxOptions.tolerance
    """Of the relaxation [mm]."""
    increments: int = SimulationOptions.increments
    """Equal parts in which the correction is applied."""
    landmark_error: Literal["none", "each", "shared"] = "none"
    """Errors of the landmarks: drawn before and after each on its own, or the same for both."""
    bone_error: float = 0.0
    """Mean length by which the bones' surfaces are displaced [mm]; the trunk is then meshed anew."""
    sample: int = 0
    """Which of the random errors."""
