"""Draws the figures of the explanations into docs/figures: section, load_factor and follow.

    uv run python scripts/draw_figures.py ANATOMY

ANATOMY holds skin.ply and bones/ of a straight trunk, on which a thoracic curve of 60 degrees is imposed.
"""

from __future__ import annotations

import math
import sys
from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from warp_trunk.bone_motion.articulation import bone_motions
from warp_trunk.case import Case
from warp_trunk.geometry.surface import Surface
from warp_trunk.io.surface_files import read_surface
from warp_trunk.measures.back_rotation import DualTangent, back_surface_rotation
from warp_trunk.measures.hump import hump_top
from warp_trunk.measures.spine import spine_of
from warp_trunk.preparation.deformity import SpineCurve, make_case

OUT = Path(__file__).parents[1] / "docs" / "figures"
GREY, BLUE, ORANGE = "#8a8a8a", "#0072b2", "#d55e00"
"""Colours that differ in brightness too, for colour-blind readers and print."""
CORRECTION = 0.7


def main(anatomy: Path) -> None:
    """Draws all figures."""
    OUT.mkdir(exist_ok=True)
    plt.rcParams.update({"font.size": 11, "axes.spines.top": False, "axes.spines.right": False})
    bones = {path.stem: read_surface(path) for path in sorted((anatomy / "bones").glob("*.ply"))}
    curve = SpineCurve(kind="thoracic", cobb=60.0, kyphosis=24.0)
    case = make_case(read_surface(anatomy / "skin.ply"), bones, curve, CORRECTION)
    _save("section", _section(case))
    _save("load_factor", _load_factor(case))
    _save("follow", _follow(case, bones))


def _section(case: Case) -> Figure:
    tangents = back_surface_rotation(case.skin, case.landmarks_before)
    level, tangent = max(
        ((level, one) for level, one in tangents.items() if one), key=lambda item: abs(item[1].angle)
    )
    figure, (rotation, hump) = plt.subplots(1, 2, figsize=(11, 4.6))
    for axes in (rotation, hump):
        outline = _in_pelvis(tangent, np.vstack([tangent.outline, tangent.outline[:1]]))
        axes.fill(*outline.T, facecolor="#f1e3d8", edgecolor=GREY)
        axes.plot(0.0, 0.0, "o", color="black", markersize=9)
        axes.annotate(f"{level}", (0.0, 0.0), (8, -14), textcoords="offset points")
        axes.set_aspect("equal")
        axes.set_axis_off()
    left, right = _in_pelvis(tangent, np.array([tangent.left, tangent.right]))
    along = (right - left) / np.linalg.norm(right - left)
    ends = np.array([left - 70.0 * along, right + 70.0 * along])
    rotation.plot(*ends.T, color=BLUE, linewidth=2)
    rotation.plot(*np.array([left, right]).T, "o", color=BLUE)
    rotation.plot([ends[0, 0], ends[1, 0]], [ends[0, 1], ends[0, 1]], "--", color="black", linewidth=1)
    rotation.annotate("parallel to the line through the iliac spines", (ends[1, 0], ends[0, 1]), (-6, -15),
                      textcoords="offset points", ha="right", fontsize=9)  # fmt: skip
    rotation.annotate("dual tangent", left, (-5, 12), textcoords="offset points", color=BLUE, ha="right")
    rotation.set_title(f"Back surface rotation at {level}: {abs(tangent.angle):.1f}°", pad=22)
    _draw_hump(hump, tangent)
    figure.text(0.5, 0.0, "Horizontal sections seen from above, back at the top, the patient's right on the right",
                ha="center", fontsize=9)  # fmt: skip
    return figure


def _draw_hump(axes: Axes, tangent: DualTangent) -> None:
    top = hump_top(tangent)
    assert top is not None
    sides = dict(zip(("right", "left"), _in_pelvis(tangent, top.points), strict=True))
    level = max(sides["right"][1], sides["left"][1])
    for x, y in sides.values():
        axes.plot([x, x], [0.0, y], ":", color="black")
        axes.plot(x, y, "o", color=ORANGE)
        axes.annotate(f"{abs(x):.0f} mm", (x / 2, 4), ha="center", fontsize=9)
    axes.plot([sides["left"][0], sides["right"][0]], [level, level], "--", color="black", linewidth=1)
    low = min(sides.values(), key=lambda place: place[1])
    axes.annotate("", (low[0], level), (low[0], low[1]), arrowprops={"arrowstyle": "<->", "color": ORANGE})
    axes.annotate(
        "hump", (low[0], (level + low[1]) / 2), (-6, 6), textcoords="offset points", color=ORANGE, ha="right"
    )
    axes.plot([sides["left"][0], sides["right"][0]], [0.0, 0.0], color="black", linewidth=1)
    axes.set_title(f"Hump: {abs(top.height):.0f} mm", pad=22)


def _in_pelvis(tangent: DualTangent, points: np.ndarray) -> np.ndarray:
    """Points from the spine in the axes of the pelvis: to the patient's right, and back."""
    across = tangent.across
    return (points - tangent.spine) @ np.array([-across, [-across[1], across[0]]]).T


def _load_factor(case: Case) -> Figure:
    assert case.landmarks_after is not None
    before, after = (spine_of(one).centroids for one in (case.landmarks_before, case.landmarks_after))
    figure, (spine, steps) = plt.subplots(1, 2, figsize=(10, 4.6), width_ratios=[1, 1.7])
    colours = plt.get_cmap("cividis")
    for share in (0.0, 0.2, 0.4, 0.6, 0.8, 1.0):
        x, _, z = ((1.0 - share) * before + share * after).T
        spine.plot(-x, z, "o-", color=colours(0.9 * share), markersize=4, label=f"t = {share:.1f}")
    spine.set_aspect("equal")
    spine.set_axis_off()
    spine.legend(frameon=False, fontsize=9, loc="center left", bbox_to_anchor=(0.95, 0.5))
    spine.set_title("Spine from behind")
    time = np.linspace(0.0, 5.0, 1001)
    bones = np.minimum(np.ceil(time + 1e-9), 5.0) / 5.0
    skin = (np.floor(time - 1e-9) + 1.0 - np.exp(-6.0 * (time - np.floor(time - 1e-9)))) / 5.0
    steps.plot(time, bones, color="black", label="bones")
    steps.plot(time, np.clip(skin, 0.0, 1.0), color=ORANGE, label="soft tissue")
    steps.set_xlabel("increment")
    steps.set_ylabel("load factor t")
    steps.legend(frameon=False, loc="upper left")
    steps.set_title("In each increment the bones move, then the tissue relaxes")
    return figure


def _follow(case: Case, straight: dict[str, Surface]) -> Figure:
    assert case.landmarks_after is not None
    moved = bone_motions(case.bones, case.landmarks_before, case.landmarks_after)
    names = ("T8", "rib_left_08", "rib_right_08")
    states = [
        [straight[name].vertices for name in names],
        [case.bones[name].vertices for name in names],
        [moved[name].apply(case.bones[name].vertices) for name in names],
    ]
    figure, both = plt.subplots(1, 2, figsize=(11, 3.4))
    for axes, old, new, colour, title in (
        (both[0], states[0], states[1], BLUE, "A curve of 60° grows"),
        (both[1], states[1], states[2], ORANGE, f"Surgery corrects {100 * CORRECTION:.0f} % of it"),
    ):
        start = old[0][:, :2].mean(axis=0)
        end = new[0][:, :2].mean(axis=0)
        for name, a, b in zip(names, old, new, strict=True):
            _silhouette(axes, a[:, :2] - start, straight[name].faces, GREY)
            _silhouette(axes, b[:, :2] - end, straight[name].faces, colour)
        turns = [_turn(a, b) for a, b in zip(old, new, strict=True)]
        axes.set_title(
            f"{title}: T8 turns by {abs(turns[0]):.0f}°,\n"
            f"its ribs by {abs(turns[1]):.0f}° and {abs(turns[2]):.0f}°"
        )
        axes.set_aspect("equal")
        axes.autoscale_view()
        axes.set_axis_off()
    figure.text(0.5, 0.0, "From above, back at the top, drawn with the vertebra in one place; grey: before",
                ha="center", fontsize=9)  # fmt: skip
    return figure


def _silhouette(axes: Axes, points: np.ndarray, faces: np.ndarray, colour: str) -> None:
    flipped = points * [-1.0, 1.0]
    axes.add_collection(
        PolyCollection(list(flipped[faces]), facecolor=colour, edgecolor=colour, linewidth=0.3, alpha=0.75)
    )


def _turn(before: np.ndarray, after: np.ndarray) -> float:
    """Turn about the vertical of the best rigid motion of points seen from above [degrees]."""
    a, b = (points[:, :2] - points[:, :2].mean(axis=0) for points in (before, after))
    return math.degrees(math.atan2(float(np.sum(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])), float(np.sum(a * b))))


def _save(name: str, figure: Figure) -> None:
    figure.savefig(OUT / f"{name}.png", dpi=110, bbox_inches="tight")
    plt.close(figure)
    print(OUT / f"{name}.png")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
