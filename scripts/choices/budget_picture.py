"""The picture of the error budget."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from .budget import Cost
from .rows import Group

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COLOURS: dict[Group, str] = {"computation": "#0072b2", "model": "#e69f00", "input": "#d55e00"}
"""Of the palette of Okabe and Ito, which all readers tell apart; their lightness differs too."""
NAMES: dict[Group, str] = {
    "computation": "of the computation",
    "model": "of the model",
    "input": "of what the clinic gives",
}
DETECTABLE = 2.5
"""Smallest difference of the back's rotation that a surgeon can detect [degrees] (section 4.5 of [2])."""
FLOOR_MM, FLOOR_DEG = 1e-7, 1e-7
"""Where the logarithmic axes begin; what is less is not drawn."""
INK = "#222222"


def draw_budget(path: Path, costs: Sequence[Cost]) -> None:
    """Draws a bar for each row, the largest at the top: mm of the back on the left, degrees on the right."""
    from matplotlib.figure import Figure  # heavy
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    figure = Figure(figsize=(9.5, 0.29 * len(costs) + 1.9), layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True)
    places = range(len(costs), 0, -1)
    for place, cost in zip(places, costs, strict=True):
        colour = COLOURS[cost.group]
        told = f"{_short(cost.mean_mm)}, {_short(cost.max_mm)}"
        _draw_bar(left, place, cost.mean_mm, cost.max_mm, colour=colour, text=told)
        most = cost.spread["bsr_deg"]["p95"] if cost.spread else None
        _draw_bar(right, place, cost.bsr_deg, most, colour=colour, text=_short(cost.bsr_deg))
    left.set_yticks(places, [cost.label.replace("+-", "±") for cost in costs], fontsize=9.5)
    left.set_ylim(0.3, len(costs) + 0.7)
    for axes, least, most, label in (
        (left, FLOOR_MM, 300.0, "skin of the back [mm]: mean, max"),
        (right, FLOOR_DEG, 100.0, "rotation of the back [degrees], largest"),
    ):
        axes.set_xscale("log")
        axes.set_xlim(least, most)
        axes.set_xlabel(label, fontsize=10, color=INK)
        axes.grid(axis="x", color="#dddddd", linewidth=0.6)
        axes.set_axisbelow(True)
        axes.tick_params(axis="y", length=0)
        axes.spines[["top", "right", "left"]].set_visible(False)
    right.axvline(DETECTABLE, color=INK, linestyle="--", linewidth=1.0, zorder=1.5)
    right.text(
        DETECTABLE / 1.3,
        1.0,
        f"a surgeon detects\n{DETECTABLE:g} degrees",
        fontsize=9,
        ha="right",
        va="center",
        color=INK,
    )
    handles = [
        *(Patch(color=COLOURS[group], label=f"error {name}") for group, name in NAMES.items()),
        Line2D([], [], color=INK, linewidth=0.8, marker="|", label="rotation over samples: mean, 95 %"),
    ]
    figure.legend(handles=handles, loc="outside upper left", ncols=4, frameon=False, fontsize=9)
    figure.savefig(path, dpi=160, metadata={"Software": None})


def _draw_bar(axes: Axes, place: int, value: float, most: float | None, *, colour: str, text: str) -> None:
    """A bar to a value, a whisker from there to the most, and the numbers behind them."""
    axes.barh(place, value, height=0.66, color=colour)
    if most is not None:
        axes.plot([value, most], [place, place], color=INK, linewidth=0.8)
        axes.plot(most, place, marker="|", markersize=9, markeredgewidth=1.8, color=INK)
    clear = {"facecolor": "white", "edgecolor": "none", "pad": 0.8}
    axes.text((most or value) * 1.4, place, text, va="center", fontsize=8.5, color=INK, bbox=clear)


def _short(value: float) -> str:
    return f"{value:.2g}" if value >= 1e-3 else f"{value:.0e}".replace("e-0", "e-")
