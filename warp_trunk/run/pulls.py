"""Derivatives of the forces on free nodes by the constants of a scene: moduli, densities, thickness of layers."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from warp_trunk.case.layers import NAMES, Layers
from warp_trunk.engine.constants import Constant, constants_of, parts_derivative, weight_derivative
from warp_trunk.engine.linearization import Linearization
from warp_trunk.meshing.layers import thickness_derivatives

from .options import RunOptions
from .patient import layers_from
from .prepare import Prepared

if TYPE_CHECKING:
    from warp_trunk.case import Case


def constant_names(prepared: Prepared) -> dict[str, Constant]:
    """The constants of a model by the names that a case has for them."""
    several = len(prepared.model.tissues) > 1
    return {
        f"{NAMES[constant.tissue]}.{constant.name}" if several and constant.tissue is not None else constant.name:
        constant
        for constant in constants_of(prepared.model)
    }  # fmt: skip


def pulls_of(case: Case, prepared: Prepared, options: RunOptions, linear: Linearization) -> dict[str, np.ndarray]:
    """dF/dc by the name of each constant, see `Linearization.pull`, shape (nodes, 3).

    Layers by depth have their thickness in mm too, of skin and of fat, everywhere alike.
    """
    model, trunk = prepared.model, prepared.trunk
    changes = {name: weight_derivative(model, constant) for name, constant in constant_names(prepared).items()}
    if layers_from(case, options) == "depth":
        for name, change in thickness_derivatives(trunk, case.layers or Layers()).items():
            changes[name.replace("_", ".")] = parts_derivative(model, trunk.tets, change)
    return dict(zip(changes, linear.pulls(list(changes.values())), strict=True))
