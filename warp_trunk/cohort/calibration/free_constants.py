"""The constants that a calibration may change: how each is counted, what is believed, what cannot be seen."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from warp_trunk.case import Case
from warp_trunk.case.layers import CONSTANTS, NAMES
from warp_trunk.case.rib_coupling import LIMITS, RANGES
from warp_trunk.case.tissue_file import CONSTANT_NAMES, RIBS
from warp_trunk.case.uncertainty import FACTORS, Uncertainty
from warp_trunk.engine.tissue import TISSUE_LIMITS
from warp_trunk.errors import InputError, closest_name
from warp_trunk.run.options import RunOptions

_DENSITY = 50.0
"""Prior standard deviation of a density [kg/m^3]; soft tissues have 900 to 1100."""
_FACTOR = 1000.0
"""A stiffness is looked for between its start over this and its start times this."""


@dataclass(frozen=True, kw_only=True)
class FreeConstant:
    """One constant, counted so that steps of it mean the same everywhere: a stiffness by its logarithm."""

    name: str
    """One of `CONSTANT_NAMES`."""
    start: float
    """Where the search begins, and the middle of what is believed of it."""

    @property
    def of(self) -> str:
        """The layer, `ribs`, or nothing for the uniform tissue."""
        return self.name.rpartition(".")[0]

    @property
    def constant(self) -> str:
        """Its name in its tissue."""
        return self.name.rpartition(".")[2]

    @property
    def logarithmic(self) -> bool:
        """Whether it is counted by its logarithm."""
        return self.of != RIBS and self.constant in FACTORS

    @property
    def believed(self) -> float:
        """Standard deviation of what is believed of it before, as it is counted.

        As `--bands` has it: half the range of a share, the deviation or the logarithm of the factor of a constant.
        """
        if self.of == RIBS:
            low, high = RANGES[self.constant]
            return 0.5 * (high - low)
        if self.constant == "density":
            return _DENSITY
        spread = getattr(Uncertainty(), self.constant)
        return math.log(spread) if self.logarithmic else spread

    @property
    def limits(self) -> tuple[float, float]:
        """Between which it is looked for, as it is counted."""
        if self.of == RIBS:
            return LIMITS[self.constant]
        if self.constant == "density":
            return 500.0, 2000.0
        if not self.logarithmic:
            return TISSUE_LIMITS[self.constant].ge, TISSUE_LIMITS[self.constant].le
        middle = self.counted(self.start)
        return middle - math.log(_FACTOR), middle + math.log(_FACTOR)

    def counted(self, value: float) -> float:
        """A value as it is counted."""
        return math.log(value) if self.logarithmic else value

    def value(self, counted: float) -> float:
        """The value of what was counted."""
        return math.exp(counted) if self.logarithmic else counted

    def slope(self, value: float) -> float:
        """Change of the value with what is counted."""
        return value if self.logarithmic else 1.0


def values_of(free: Sequence[FreeConstant], counted: np.ndarray) -> dict[str, float]:
    """Constants by name, of what was counted, shape (constants,)."""
    return {constant.name: constant.value(float(x)) for constant, x in zip(free, counted, strict=True)}


def check_free(names: Sequence[str], case: Case, options: RunOptions) -> None:
    """Raise InputError for constants that no skin depends on, with the reason."""
    if not names:
        raise InputError(
            "--free: is missing; give constants to find, such as --free poisson_ratio ribs.reversible_part"
        )
    for number, name in enumerate(names):
        if name not in CONSTANT_NAMES:
            hint = closest_name(name, CONSTANT_NAMES)
            raise InputError(f"--free: there is no constant '{name}'{hint}; known are {', '.join(CONSTANT_NAMES)}")
        if name in names[:number]:
            raise InputError(f"--free: '{name}' is given twice; give it once")
    layered = options.layers != "none" and (options.layers is not None or case.layers is not None)
    for name in names:
        if why := _unseen(name, case, options, layered):
            raise InputError(f"--free: '{name}' cannot be found from any skin: {why}")
    if all(f"{layer}.youngs_modulus" in names for layer in NAMES) and not options.gravity:
        raise InputError("--free: without gravity only ratios of the layers' Young's moduli act; leave one out")


def _unseen(name: str, case: Case, options: RunOptions, layered: bool) -> str:
    """Why a constant changes no prediction with these options; empty where it does."""
    of, _, constant = name.rpartition(".")
    energy, weightless = options.energy_of_tissue, not options.gravity
    bending = " (but those of bending skin, which hardly move the back)" * bool(options.rigidity_of_skin)
    springs, cure = constant in ("epsilon", "theta"), "give --gravity 9.81, or free the ratio of layers"
    every = not of and layered and (name == "youngs_modulus" or len(layers_with(case, name)) == len(NAMES))
    reasons = [
        (of == RIBS and options.bones != "follow", "ribs have shares where bones follow; give --bones follow"),
        (of in NAMES and not layered, "the trunk has no layers; give --layers depth"),
        (springs and energy != "itmsm", f"it is simulated with {energy}; give --energy itmsm"),
        (constant == "poisson_ratio" and energy == "itmsm", "itmsm has none; give --energy neo-hookean"),
        (constant == "density" and weightless, "a density acts only with gravity; give --gravity 9.81"),
        (every, "every layer has its own; free fat.youngs_modulus instead"),
        (name == "youngs_modulus" and weightless, f"all forces{bending} grow with it alike; {cure}"),
    ]
    return next((why for holds, why in reasons if holds), "")


def layers_with(case: Case, constant: str) -> list[str]:
    """The layers that have a constant of their own, given by the case or by default."""
    own = {} if case.layers is None else case.layers.constants
    return [layer for layer in NAMES if constant in {**CONSTANTS[layer], **own.get(layer, {})}]
