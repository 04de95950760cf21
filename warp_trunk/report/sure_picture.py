"""The predicted back coloured by how sure it is."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .panels import panels, shaded
from .relief import BEHIND, Relief, Window, seen_values
from .style import Pose

if TYPE_CHECKING:
    from matplotlib.figure import Figure

STEP = 1.0
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
    most = STEP * max(2.0, float(np.ceil(np.nanmax(values) / STEP)))
    colours, norm = colormaps["YlOrBr"], BoundaryNorm(np.arange(0.0, most + 0.5 * STEP, STEP), 256)
    painted = colours(norm(np.nan_to_num(values)))[:, :, :3]
    images = [shaded(back, painted, 0.9 * np.isfinite(values))]
    figure, plots = panels([pose], seen, BEHIND, images, legend=0.8)
    bar = figure.colorbar(ScalarMappable(norm, colours), cax=plots[-1], orientation="horizontal")
    bar.ax.set_xlabel("standard deviation [mm]", fontsize=8.5)
    return figure
