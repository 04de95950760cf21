"""The trunk from behind, in front and the side: shaded, with what each view shows."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from warp_trunk.geometry.surface import Surface
from warp_trunk.measures.skin_quality import LOOK, STRETCH, SkinChange

from .panels import panels, shaded
from .relief import BEHIND, FRONT, RIGHT, Relief, Viewpoint, Window, relief, seen_from, seen_values, window
from .style import INK, Pose

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

LINE_STEP = 10.0
"""Distance in depth between two lines [mm]."""
STEEP = 0.3
"""Where the skin faces back by less than this, lines would run into each other; the cosine of 73 degrees."""
COARSE = 1.0
"""Size of a pixel where nothing is measured in the picture [mm]."""
BUST = 190.0
"""The picture of the shoulders ends this far below T1 [mm]."""


def back_picture(
    poses: Sequence[Pose], reliefs: Sequence[Relief], seen: Window, doubtful: np.ndarray | None = None
) -> Figure:
    """Every pose from behind, with lines through places that stand equally far back.

    Args:
        poses: what is shown.
        reliefs: the relief of each.
        seen: the window of all.
        doubtful: 1 at vertices of the second skin that are to be hatched, else 0, shape (vertices,).
    """
    figure, plots = panels(poses, seen, BEHIND, [shaded(back) for back in reliefs])
    highest = np.nanmax([np.nanmax(back.depth) for back in reliefs])
    lowest = np.nanmin([np.nanmin(back.depth) for back in reliefs])
    levels = LINE_STEP * np.arange(np.floor(lowest / LINE_STEP), np.ceil(highest / LINE_STEP) + 1)
    for axes, back in zip(plots, reliefs, strict=True):
        steep = ~(back.normal[:, :, 1] > STEEP)
        lines(axes, seen, np.ma.masked_where(steep, back.depth), levels.tolist(), "solid")
    if doubtful is not None:
        hatch(plots[1], seen, seen_values(poses[1].skin, poses[1].landmarks, seen, doubtful))
    return figure


def hatch(axes: Axes, seen: Window, doubtful: np.ndarray) -> None:
    """Hatch the pixels where an image, shape (rows, columns), is more than a half."""
    from matplotlib import rc_context  # heavy

    with rc_context({"hatch.linewidth": 0.8, "hatch.color": INK}):
        inside = np.nan_to_num(doubtful[::2, ::2])
        axes.contourf(seen.x[::2], seen.z[::2], inside, [0.5, 2.0], colors="none", hatches=["////"])


def lines(axes: Axes, seen: Window, values: np.ma.MaskedArray, levels: Sequence[float], style: str) -> None:
    """Lines of equal values, from every second pixel: the others are not visible, and they take four times as
    long."""
    axes.contour(seen.x[::2], seen.z[::2], values[::2, ::2], levels, colors=INK, linewidths=0.5, linestyles=style)


def front_picture(poses: Sequence[Pose]) -> Figure:
    """Every pose from the front."""
    return plain_picture(poses, FRONT)


def side_picture(poses: Sequence[Pose]) -> Figure:
    """Every pose from its right side."""
    return plain_picture(poses, RIGHT)


def shoulders_picture(poses: Sequence[Pose]) -> Figure | None:
    """The upper trunk of every pose from the front, with the heights of its shoulders; None without T1."""
    tops = [_top(pose) for pose in poses]
    if any(top is None for top in tops):
        return None
    seen = window([(pose.skin, pose.landmarks) for pose in poses], COARSE, FRONT)
    lowest = min(top[2] for top in tops if top is not None) - BUST
    seen = Window(seen.x, seen.z[seen.z > lowest], seen.pixel)
    looks = [shaded(relief(pose.skin, pose.landmarks, seen, FRONT)) for pose in poses]
    figure, plots = panels(poses, seen, FRONT, looks)
    for axes, pose, top in zip(plots, poses, tops, strict=True):
        found = pose.measures.shoulders
        if found is None or top is None:
            continue
        for height, sign in (
            (found.right, 1.0),
            (found.left, -1.0),
        ):  # from the front the right side is on the left
            outer, inner = (top[0] + sign * reach for reach in (found.outer, found.inner))
            axes.plot([outer, inner], [top[2] + height] * 2, color=pose.look.colour, linewidth=2.2)
            axes.plot([inner, top[0]], [top[2] + height] * 2, color=pose.look.colour, linewidth=0.8, linestyle=":")
        axes.text(
            top[0], top[2] - 0.55 * BUST, _shoulder_words(found.difference), ha="center", va="center",
            fontsize=9, color=INK,
        )  # fmt: skip
    return figure


def _shoulder_words(difference: float) -> str:
    if abs(difference) < 0.5:
        return "level"
    return f"{'right' if difference > 0.0 else 'left'} shoulder\n{abs(difference):.0f} mm higher"


def _top(pose: Pose) -> np.ndarray | None:
    """The centroid of T1 as the front view has it [mm], shape (3,)."""
    points = pose.landmarks.of_bone("T1").points
    return seen_from(points, pose.landmarks, FRONT).mean(axis=0) if len(points) else None


def plain_picture(poses: Sequence[Pose], view: Viewpoint) -> Figure:
    """Every pose from one side."""
    seen = window([(pose.skin, pose.landmarks) for pose in poses], COARSE, view)
    looks = [shaded(relief(pose.skin, pose.landmarks, seen, view)) for pose in poses]
    return panels(poses, seen, view, looks)[0]


STRETCH_STEP = 0.05
"""Difference of stretch between two colours."""


def stretch_picture(pose: Pose, change: SkinChange, view: Viewpoint) -> Figure:
    """The predicted skin from one side, coloured where it is stretched by more than `LOOK`.

    What is stretched by more than `STRETCH` or sharply folded is hatched.

    Args:
        pose: the prediction.
        change: how its triangles are stretched and folded.
        view: from where it is seen.
    """
    from matplotlib import colormaps
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import BoundaryNorm

    seen = window([(pose.skin, pose.landmarks)], COARSE, view)
    values = seen_values(pose.skin, pose.landmarks, seen, at_vertices(pose.skin, change.stretch), view)
    colours, norm = colormaps["YlOrRd"], BoundaryNorm(np.arange(LOOK, 1.55, STRETCH_STEP), 256, extend="max")
    painted = colours(norm(np.nan_to_num(values)))[:, :, :3]
    image = shaded(relief(pose.skin, pose.landmarks, seen, view), painted, 0.9 * (np.nan_to_num(values) > LOOK))
    figure, plots = panels([pose], seen, view, [image], legend=0.8)
    doubtful = at_vertices(pose.skin, change.doubtful.astype(np.float64))
    hatch(plots[0], seen, seen_values(pose.skin, pose.landmarks, seen, doubtful, view))
    bar = figure.colorbar(
        ScalarMappable(norm, colours), cax=plots[-1], orientation="horizontal", ticks=[1.25, STRETCH, 1.45]
    )
    bar.ax.set_xlabel("length over that before", fontsize=8.5)
    return figure


def at_vertices(skin: Surface, values: np.ndarray) -> np.ndarray:
    """Mean of a value of the triangles around each vertex, shape (vertices,)."""
    corner, count = skin.faces.ravel(), len(skin.vertices)
    triangles = np.maximum(np.bincount(corner, minlength=count), 1)
    return np.bincount(corner, np.repeat(values, 3), minlength=count) / triangles


SD_STEP = 1.0
"""Difference between two colours [mm]."""


def sure_picture(pose: Pose, back: Relief, seen: Window, skin_sd: np.ndarray) -> Figure:
    """The predicted back, darker where its places are less sure.

    Args:
        pose: the prediction.
        back: its relief from behind.
        seen: the window of the picture.
        skin_sd: standard deviation of each vertex along its normal [mm], shape (vertices,).
    """
    from matplotlib import colormaps
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import BoundaryNorm

    values = seen_values(pose.skin, pose.landmarks, seen, skin_sd)
    most = SD_STEP * max(2.0, float(np.ceil(np.nanmax(values) / SD_STEP)))
    colours, norm = (
        colormaps["YlOrBr"],
        BoundaryNorm(np.arange(0.0, most + 0.5 * SD_STEP, SD_STEP), 256),
    )
    painted = colours(norm(np.nan_to_num(values)))[:, :, :3]
    images = [shaded(back, painted, 0.9 * np.isfinite(values))]
    figure, plots = panels([pose], seen, BEHIND, images, legend=0.8)
    bar = figure.colorbar(ScalarMappable(norm, colours), cax=plots[-1], orientation="horizontal")
    bar.ax.set_xlabel("standard deviation [mm]", fontsize=8.5)
    return figure
