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
    "mean_mm": "mean distance on the back [mm]",
    "bsr_deg": f"largest difference of its rotation [degrees]; line: {SMALL:g}",
}
INK = "#222222"
BORDER = "#d55e00"
"""Vermilion of Okabe and Ito, told from every shade of the map by all readers."""


def draw_map(path: Path, points: Sequence[dict[str, Any]], nu: float) -> None:
    """Draws the differences of all points from the neo-Hookean solution of one Poisson's ratio."""
    from matplotlib.figure import Figure  # heavy

    epsilon = sorted({point["epsilon"] for point in points})
    theta = sorted({point["theta"] for point in points})
    default = epsilon.index(Tissue.epsilon), theta.index(Tissue.theta)
    figure = Figure(figsize=(10.0, 4.4), layout="constrained")
    figure.suptitle(
        f"The seeds' springs against a neo-Hookean continuum (Poisson's ratio {nu:g}), after surgery",
        x=0.01,
        ha="left",
        fontsize=13,
        color=INK,
    )
    for axes, (measure, title) in zip(figure.subplots(1, 2, sharey=True), PANELS.items(), strict=True):
        values = np.full((len(epsilon), len(theta)), np.nan)
        for point in points:
            if point["status"] == "CONVERGED":
                at = epsilon.index(point["epsilon"]), theta.index(point["theta"])
                values[at] = point["against"][f"nu {nu:g}"][measure]
        axes.imshow(values, cmap="YlGnBu", origin="lower", aspect="auto", vmin=0.0)
        nearest = np.unravel_index(np.nanargmin(values), values.shape)
        for at in np.ndindex(values.shape):
            marks = [mark for mark, place in (("default", default), ("nearest", nearest)) if place == at]
            number = "not\nconverged" if np.isnan(values[at]) else f"{values[at]:.2f}"
            axes.text(
                at[1],
                at[0],
                "\n".join([number, *marks]),
                ha="center",
                va="center",
                fontsize=9 if marks else 10.5,
                fontweight="bold" if marks else "normal",
                color="white" if values[at] > 0.6 * np.nanmax(values) else INK,
            )
        if measure == "bsr_deg":
            _draw_border(axes, values < SMALL)
        axes.set_title(title, fontsize=10.5, color=INK, loc="left")
        axes.set_xticks(range(len(theta)), [f"{value:g}" for value in theta], fontsize=10)
        axes.set_yticks(range(len(epsilon)), [f"{value:g}" for value in epsilon], fontsize=10)
        axes.set_xlabel("theta, stiffness of volumes", fontsize=11)
        axes.tick_params(length=0)
        axes.spines[:].set_visible(False)
    figure.axes[0].set_ylabel("epsilon, stiffness of areas", fontsize=11)
    figure.savefig(path, dpi=160, metadata={"Software": None})


def _draw_border(axes: Axes, inside: np.ndarray) -> None:
    """A line between the cells that are inside and their neighbours that are not."""
    style: dict[str, Any] = {"color": BORDER, "linewidth": 3.5, "solid_capstyle": "round"}
    for row, column in np.argwhere(inside[:, 1:] != inside[:, :-1]):
        axes.plot([column + 0.5] * 2, [row - 0.5, row + 0.5], **style)
    for row, column in np.argwhere(inside[1:] != inside[:-1]):
        axes.plot([column - 0.5, column + 0.5], [row + 0.5] * 2, **style)
