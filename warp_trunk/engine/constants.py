"""The constants that a model's energy reads, and the derivative of its weights in each of them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from warp_trunk.errors import InputError

from .model import Model
from .rest_mesh import RestMesh
from .tissue import TISSUE_LIMITS, Limits

CONSTANT_STEP = 1e-6
"""Part of a constant by which it is changed to either side; weights are float64, and linear in most constants."""
PART_STEP = 1e-3
"""How much of a change of parts is added and taken away; weights are float64, and linear in the parts."""
OF_SKIN = "skin_rigidity"
STIFFNESS = "stiffness"
"""Name of the array of the skin's weights among those of the energy."""
_OF_TERM = {"epsilon": "area", "theta": "volume"}


@dataclass(frozen=True)
class Constant:
    """One number of the model."""

    name: str
    """A field of `Tissue`, `gravity`, or `skin_rigidity` [N mm]."""
    tissue: int | None = None
    """Which of the model's tissues, from 0; None is gravity, or the same change in all of them."""


def constants_of(model: Model) -> tuple[Constant, ...]:
    """Every constant that moves an equilibrium of the model.

    With displacements prescribed and no gravity only ratios of stiffness act, so that the Young's modulus of a
    uniform trunk is none of them where its skin resists no bending.
    """
    falls = model.gravity != 0.0
    several, skin = len(model.tissues) > 1, model.skin is not None
    itmsm = "distance" in model.elements.terms
    names = [name for name, term in _OF_TERM.items() if itmsm and term in model.elements.terms]
    names += ["poisson_ratio"] * (not itmsm)
    names += ["youngs_modulus"] * (falls or several or skin) + ["density"] * falls
    constants = [Constant(name, number) for number in range(len(model.tissues)) for name in names]
    return (*constants, *[Constant("gravity")] * falls, *[Constant(OF_SKIN)] * skin)


def value_of(model: Model, constant: Constant) -> float:
    """The value of a constant in a model.

    Raises:
        InputError: a tissue or a constant that there is not.
    """
    if constant.name == "gravity":
        return model.gravity
    if constant.name == OF_SKIN and model.skin is not None:
        return model.skin.rigidity
    if constant.name in TISSUE_LIMITS and (constant.tissue or 0) in range(len(model.tissues)):
        return float(getattr(model.tissues[constant.tissue or 0], constant.name))
    raise InputError(
        f"sensitivities: there is no constant '{constant.name}' of tissue {constant.tissue}; "
        "take those of constants_of(model)"
    )


def weight_derivative(model: Model, constant: Constant) -> dict[str, np.ndarray]:
    """Derivative of the arrays of the model's energy that hold its weights in a constant, float64.

    They have the names of their fields in the energy and in the skin.

    Raises:
        InputError: a tissue or a constant that there is not.
    """
    value, lower, upper = _sides(model, constant)
    step = upper - lower
    high, low = (_weights(model, constant, limit - value) for limit in (upper, lower))
    return {name: (high[name] - low[name]) / step for name in high}


def parts_derivative(model: Model, change: np.ndarray) -> dict[str, np.ndarray]:
    """Derivative of the same arrays in the parts of the tissues, float64; weights are linear in them.

    Args:
        model: of a mixture of tissues in each tetrahedron.
        change: by how much the part of each tissue in each tetrahedron of its mesh changes, shape (tets, tissues).

    Raises:
        InputError: a model whose tetrahedra are not mixtures, or a change of another shape.
    """
    if model.label is None or model.label.shape != change.shape:
        raise InputError(
            "sensitivities: parts of tissues change only where each tetrahedron has a part of every tissue; "
            f"give the change for {len(model.corners)} tetrahedra and {len(model.tissues)} tissues"
        )
    ordered = change[model.tet_order]
    mesh = scanned_mesh(model)
    high, low = (
        model.elements.weights(replace(mesh, label=model.label + sign * PART_STEP * ordered), model.gravity)
        for sign in (1.0, -1.0)
    )
    return {name: (high[name] - low[name]) / (2.0 * PART_STEP) for name in high}


def _sides(model: Model, constant: Constant) -> tuple[float, float, float]:
    """The constant, and the values below and above it at which weights are compared."""
    value = value_of(model, constant)
    step = CONSTANT_STEP * max(abs(value), 1e-3)
    limits = TISSUE_LIMITS.get(constant.name, Limits())
    return value, max(value - step, limits.ge), min(value + step, limits.le)


def _weights(model: Model, constant: Constant, change: float) -> dict[str, np.ndarray]:
    """The weights where the constant differs by `change`."""
    gravity = model.gravity + (change if constant.name == "gravity" else 0.0)
    tissues = tuple(
        replace(tissue, **{constant.name: getattr(tissue, constant.name) + change})
        if constant.name in TISSUE_LIMITS and constant.tissue in (None, number)
        else tissue
        for number, tissue in enumerate(model.tissues)
    )
    mesh = replace(scanned_mesh(model), tissues=tissues)
    weights = model.elements.weights(mesh, gravity)
    if model.skin is None:
        return weights
    rigidity = model.skin.rigidity + (change if constant.name == OF_SKIN else 0.0)
    return {**weights, STIFFNESS: rigidity * model.elements.per_millijoule(mesh) * model.skin.shares}


def scanned_mesh(model: Model) -> RestMesh:
    """The tetrahedra before surgery, where weights are taken, also if the rest state was moved from there."""
    nodes = model.rest if model.scan is None else model.rest + model.scan
    return RestMesh(nodes, model.corners, model.tissues, model.label, model.scalar, model.parallel)
