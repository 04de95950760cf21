"""The picture of the map of constants."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from warp_trunk import Tissue

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SMALL = 1.0
"""A line borders the differences of the rotation below this [degrees]."""
PANELS = {
    "mean_mm": "the back, mean [mm]",
    "bsr_deg": f"its rotation, max [degrees]; line: {SMALL:g}",
}
INK = "#222222"
BORDER = "#d55e00"
"""Vermilion of Okabe and Ito, told from every shade of the map by all readers."""


def draw_map(path: Path, points: Sequence[dict[str, Any]], nu: float) -> None:
    """Draws the differences of all points from the neo-Hookean solution of one Poisson's ratio."""
    from matplotlib.figure import Figure  # heavy

    weights = list(dict.fromkeys(point["weights"] for point in points))
    figure = Figure(figsize=(10.0, 0.8 + 3.6 * len(weights)), layout="constrained")
    figure.suptitle(
        f"The energy itmsm against a neo-Hookean continuum (Poisson's ratio {nu:g}), after surgery",
        x=0.01,
        ha="left",
        fontsize=13,
        color=INK,
    )
    panels = figure.subplots(len(weights), len(PANELS), sharex=True, sharey=True, squeeze=False)
    for column, (measure, title) in enumerate(PANELS.items()):
        most = max(point["against"][f"nu {nu:g}"][measure] for point in points if _converged(point))
        for row, name in enumerate(weights):
            axes = panels[row, column]
            of_weights = [point for point in points if point["weights"] == name]
            _draw_panel(axes, of_weights, nu, measure, most)
            axes.set_title(f"weights by {name}: {title}", fontsize=10.5, color=INK, loc="left")
        panels[-1, column].set_xlabel("theta, stiffness of volumes", fontsize=11)
    for axes in panels[:, 0]:
        axes.set_ylabel("epsilon, stiffness of areas", fontsize=11)
    figure.savefig(path, dpi=160, metadata={"Software": None})


def _draw_panel(axes: Axes, points: Sequence[dict[str, Any]], nu: float, measure: str, most: float) -> None:
    """One heat map, with every value in its cell; the darkest colour stands for the most."""
    epsilon = sorted({point["epsilon"] for point in points})
    theta = sorted({point["theta"] for point in points})
    values = np.full((len(epsilon), len(theta)), np.nan)
    for point in filter(_converged, points):
        at = epsilon.index(point["epsilon"]), theta.index(point["theta"])
        values[at] = point["against"][f"nu {nu:g}"][measure]
    axes.imshow(values, cmap="YlGnBu", origin="lower", aspect="auto", vmin=0.0, vmax=most)
    default = epsilon.index(Tissue.epsilon), theta.index(Tissue.theta)
    nearest = np.unravel_index(np.nanargmin(values), values.shape)
    for at in np.ndindex(values.shape):
        marks = [mark for mark, place in (("default", default), ("nearest", nearest)) if place == at]
        ended = not np.isnan(values[at])
        number = f"{values[at]:.2f}" if ended else "not\nconverged"
        axes.text(
            at[1],
            at[0],
            "\n".join([number, *marks]),
            ha="center",
            va="center",
            fontsize=10 if ended and not marks else 8 if ended else 6.5,
            fontweight="bold" if marks else "normal",
            color="white" if values[at] > 0.6 * most else INK,
        )
    if measure == "bsr_deg":
        _draw_border(axes, values < SMALL)
    axes.set_xticks(range(len(theta)), [f"{value:g}" for value in theta], fontsize=10)
    axes.set_yticks(range(len(epsilon)), [f"{value:g}" for value in epsilon], fontsize=10)
    axes.tick_params(length=0)
    axes.spines[:].set_visible(False)


def _converged(point: dict[str, Any]) -> bool:
    return point["status"] == "CONVERGED"


def _draw_border(axes: Axes, inside: np.ndarray) -> None:
    """A line between the cells that are inside and their neighbours that are not."""
    style: dict[str, Any] = {"color": BORDER, "linewidth": 3.5, "solid_capstyle": "round"}
    for row, column in np.argwhere(inside[:, 1:] != inside[:, :-1]):
        axes.plot([column + 0.5] * 2, [row - 0.5, row + 0.5], **style)
    for row, column in np.argwhere(inside[1:] != inside[:-1]):
        axes.plot([column - 0.5, column + 0.5], [row + 0.5] * 2, **style)
