"""The back coloured by its hump: how far each place stands behind the other side. Imports matplotlib."""

from collections.abc import Sequence

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke

from warp_trunk.measures.back_rotation import hump_top

from .hump import COLOUR_STEP, hump_palette, painted_difference, scale_limit
from .panels import panels, shaded
from .relief import BEHIND, Relief, Window, seen_from
from .skin_pictures import lines
from .style import INK, TrunkState


def hump_limit(poses: Sequence[TrunkState], reliefs: Sequence[Relief], seen: Window) -> float:
    """Where the scale of the hump ends that holds all poses [mm]."""
    differences = [painted_difference(back, seen) for back in reliefs]
    largest = [float(np.nanmax(np.where(part > 0.5, abs(one), 0.0))) for one, part in differences]
    return scale_limit([*largest, *(abs(pose.measures.max_hump or 0.0) for pose in poses)])


def hump_picture(poses: Sequence[TrunkState], reliefs: Sequence[Relief], seen: Window, limit: float) -> Figure:
    """Every pose coloured by how far each place stands behind the other side of the back, with its spine; the two
    places of the largest hump are ringed. The scale ends at `limit` [mm]."""
    differences = [painted_difference(back, seen) for back in reliefs]
    bounds, palette = np.arange(-limit, limit + COLOUR_STEP, COLOUR_STEP), hump_palette(limit)
    colours, norm = ListedColormap(palette), BoundaryNorm(bounds, len(palette))
    images = [
        shaded(back, colours(norm(np.nan_to_num(difference)))[:, :, :3], part * np.isfinite(difference))
        for back, (difference, part) in zip(reliefs, differences, strict=True)
    ]
    figure, plots = panels([pose.look.heading for pose in poses], seen.extent, BEHIND, images, legend=0.95)
    for axes, pose, back, (difference, part) in zip(plots[:-1], poses, reliefs, differences, strict=True):
        compared = np.ma.masked_where(~((part > 0.5) & np.isfinite(difference)), np.nan_to_num(difference))
        steps = np.arange(10.0, limit, 10.0)
        lines(axes, seen, compared, steps.tolist(), "solid")
        lines(axes, seen, compared, (-steps[::-1]).tolist(), "dashed")
        axes.plot(*back.spine.T, "o-", color=INK, markersize=1.8, linewidth=0.7)
        level, height = pose.measures.hump_level, pose.measures.max_hump
        if level is not None and height is not None:
            tangent, z = pose.measures.tangents[level], back.spine[pose.landmarks.vertebrae().index(level)][1]
            top = None if tangent is None else hump_top(tangent)
            assert top is not None  # there is a hump
            places = seen_from(np.column_stack([top[1], [z, z]]), pose.landmarks, BEHIND)[:, 0]  # right, left
            for edge, thick in (("white", 2.4), (INK, 1.2)):
                axes.plot(places, [z, z], "o", ms=7.0, mfc="none", mec=edge, mew=thick)
            x = places[0 if height > 0.0 else 1] - np.copysign(14.0, height)
            axes.text(
                x, z + 20.0, f"{abs(height):.0f} mm", ha="center", va="center", fontsize=10,
                fontweight="bold", color=INK, path_effects=[withStroke(linewidth=2.5, foreground="white")],
            )  # fmt: skip
    ticks = np.arange(-limit, limit + 1.0, 10.0 if limit <= 40.0 else 20.0)
    bar = figure.colorbar(ScalarMappable(norm, colours), cax=plots[-1], orientation="horizontal", ticks=ticks)
    bar.ax.set_xlabel("difference from the other side of the back [mm]", fontsize=8.5)
    for x, ha, words in ((0.0, "left", "purple, dashed: further forward"), (1.0, "right", "orange: further back")):
        bar.ax.text(x, 1.35, words, transform=bar.ax.transAxes, ha=ha, va="bottom", fontsize=8.5)
    return figure
