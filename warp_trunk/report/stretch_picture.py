"""The predicted skin coloured by how much it is stretched."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from warp_trunk.geometry.surface import Surface
from warp_trunk.measures.skin_quality import LOOK, STRETCH, SkinChange

from .panels import panels, shaded
from .relief import View, relief, seen_values, window
from .skin_pictures import COARSE, hatch
from .style import Pose

if TYPE_CHECKING:
    from matplotlib.figure import Figure

STEP = 0.05
"""Difference of stretch between two colours."""


def stretch_picture(pose: Pose, change: SkinChange, view: View) -> Figure:
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
    colours, norm = colormaps["YlOrRd"], BoundaryNorm(np.arange(LOOK, 1.55, STEP), 256, extend="max")
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
