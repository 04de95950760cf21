"""The picture of the error budget."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from .budget import Cost
from .rows import Group

COLOURS: dict[Group, str] = {"computation": "#0072b2", "model": "#e69f00", "input": "#d55e00"}
"""Of the palette of Okabe and Ito, which all readers tell apart; their lightness differs too."""
NAMES: dict[Group, str] = {
    "computation": "of the computation",
    "model": "of the model",
    "input": "of what the clinic gives",
}
DETECTABLE = 2.5
"""Smallest difference of the back's rotation that a surgeon can detect [degrees] (section 4.5 of [2])."""
FLOOR_MM, FLOOR_DEG = 1e-5, 1e-6
"""Where the logarithmic axes begin; what is less is not drawn."""
INK = "#222222"


def draw_budget(path: Path, costs: Sequence[Cost]) -> None:
    """Draws a bar for each row, the largest at the top: mm of the back on the left, degrees on the right."""
    from matplotlib.figure import Figure  # heavy
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    figure = Figure(figsize=(10.0, 0.29 * len(costs) + 1.9), layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True)
    places = range(len(costs), 0, -1)
    for place, cost in zip(places, costs, strict=True):
        colour = COLOURS[cost.group]
        left.barh(place, cost.mean_mm, height=0.66, color=colour)
        left.plot(cost.max_mm, place, marker="|", markersize=9, markeredgewidth=1.8, color=INK)
        left.plot([cost.mean_mm, cost.max_mm], [place, place], color=INK, linewidth=0.8)
        left.text(
            cost.max_mm * 1.3, place, f"{_short(cost.mean_mm)} / {_short(cost.max_mm)}", va="center", fontsize=8
        )
        right.barh(place, cost.bsr_deg, height=0.66, color=colour)
        end = cost.bsr_deg
        if cost.samples > 1:
            end = cost.spread["bsr_deg"]["p95"]
            right.plot([cost.bsr_deg, end], [place, place], color=INK, linewidth=0.8)
            right.plot(end, place, marker="|", markersize=9, markeredgewidth=1.8, color=INK)
        right.text(end * 1.3, place, _short(cost.bsr_deg), va="center", fontsize=8)
    left.set_yticks(places, [cost.label.replace("+-", "±") for cost in costs], fontsize=8.5)
    left.set_ylim(0.3, len(costs) + 0.7)
    for axes, least, most, label in (
        (left, FLOOR_MM, 300.0, "difference on the back [mm]: bar mean, mark max"),
        (right, FLOOR_DEG, 100.0, "largest difference of the back's rotation [degrees]"),
    ):
        axes.set_xscale("log")
        axes.set_xlim(least, most)
        axes.set_xlabel(label, fontsize=9.5, color=INK)
        axes.grid(axis="x", color="#dddddd", linewidth=0.6)
        axes.set_axisbelow(True)
        axes.tick_params(axis="y", length=0)
        axes.spines[["top", "right", "left"]].set_visible(False)
    right.axvline(DETECTABLE, color=INK, linestyle="--", linewidth=1.0)
    right.text(
        DETECTABLE / 1.2,
        0.9,
        f"a surgeon detects\n{DETECTABLE:g} degrees",
        fontsize=8,
        ha="right",
        va="center",
        color=INK,
    )
    handles = [
        *(Patch(color=COLOURS[group], label=f"error {name}") for group, name in NAMES.items()),
        Line2D([], [], color=INK, linewidth=0.8, marker="|", label="of samples: mean, 95th percentile"),
    ]
    figure.legend(handles=handles, loc="outside upper left", ncols=4, frameon=False, fontsize=9)
    figure.savefig(path, dpi=160, metadata={"Software": None})


def _short(value: float) -> str:
    return f"{value:.2g}" if value >= 1e-3 else f"{value:.0e}".replace("e-0", "e-")
