"""Pictures of a scanned back: its measures, and a body fitted to it."""

from __future__ import annotations

import numpy as np
from matplotlib import colormaps, rc_context
from matplotlib.cm import ScalarMappable
from matplotlib.colors import BoundaryNorm
from matplotlib.figure import Figure

from warp_trunk.geometry.back_points import BackPoints
from warp_trunk.measures import BackMeasures
from warp_trunk.preparation.back_scan import FittedBack
from warp_trunk.views.relief import BEHIND, FRONT, LEFT, relief, seen_from, window

from .panels import panels, shaded
from .skin_pictures import GREY
from .style import FAINT, INK, RC, file_of

_ORANGE, _PURPLE = "#ee7733", "#aa3377"
_DISTANCE_STEPS = (0.0, 0.25, 0.5, 1.0, 1.5, 3.0)
_PIXEL, _SHOWN = 1.0, 6000


def fit_picture(fit: FittedBack) -> bytes:
    """The fitted body from behind, from the left and from the front, as a PNG file.

    The skin is grey where it is invented, and the points of the scan are coloured by their distance from it; those
    that were left out are drawn over it.
    """
    skin, marks = fit.case.skin, fit.case.landmarks_before
    unseen, norm = (~fit.seen).astype(np.float64), BoundaryNorm(_DISTANCE_STEPS, 256, extend="max")
    views = {"from behind": BEHIND, "from the left": LEFT, "from the front": FRONT}
    frames = [window([(skin, marks)], _PIXEL, view) for view in views.values()]
    images = []
    for seen, view in zip(frames, views.values(), strict=True):
        side = relief(skin, marks, seen, view)
        part = np.nan_to_num(side.values(unseen))
        images.append(shaded(side, GREY, part))
    with rc_context(RC):
        figure, plots = panels(list(views), frames[0].extent, BEHIND, images, legend=0.8)
        for axes, view, seen in zip(plots[:3], views.values(), frames, strict=True):
            axes.set(xlim=seen.extent[:2])
            axes.images[0].set_extent(seen.extent)
            for text, side in zip(axes.texts, view.sides, strict=False):
                text.set_text(side)
            if view is not FRONT:
                at, values = _some(seen_from(fit.scan.points, marks, view), fit.distance)
                axes.scatter(at[:, 0], at[:, 2], s=0.35, linewidths=0, c=values, cmap="viridis", norm=norm)
            at, _ = _some(seen_from(fit.left_out, marks, view), np.zeros(len(fit.left_out)))
            axes.scatter(at[:, 0], at[:, 2], s=0.5, linewidths=0, color=_PURPLE)
            centres = seen_from(marks.middles(), marks, view)
            axes.plot(centres[:, 0], centres[:, 2], color=INK, lw=0.9, marker="o", ms=1.6)
        mapped = ScalarMappable(norm, colormaps["viridis"])
        bar = figure.colorbar(mapped, cax=plots[-1], orientation="horizontal", ticks=_DISTANCE_STEPS)
        bar.ax.set_xlabel("distance of the scan from the skin [mm]", fontsize=8.5)
        words = f"grey: invented ({100.0 * fit.invented:.0f} % of the skin)"
        figure.text(0.02, 0.02, words, fontsize=8.0, color=FAINT)
        figure.text(0.98, 0.02, f"{len(fit.left_out)} points left out", fontsize=8.0, color=_PURPLE, ha="right")
        return file_of(figure, "png")


def _some(points: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """As many of some points (n, 3) and their values as a picture can show."""
    rows = np.linspace(0, len(points) - 1, min(len(points), _SHOWN)).astype(int)
    return points[rows], values[rows]


_MARGIN = 150.0
"""Points farther than this beside the skin are counted and not drawn [mm]."""
_MOST_POINTS = 20_000


def scan_picture(measures: BackMeasures, scan: BackPoints) -> bytes:
    """The points of a scan seen from behind, as a PNG file.

    The skin is grey, what stands on it purple, surroundings are orange; a line at each level joins the points that
    the dual tangent touches.
    """
    skin = scan.skin[~scan.bridged]
    around = np.vstack([scan.surroundings, scan.hidden])
    low, high = skin.min(axis=0) - _MARGIN, skin.max(axis=0) + _MARGIN
    with rc_context(RC):
        figure = Figure(figsize=(5.0, 6.0), dpi=110, layout="constrained")
        axes = figure.add_subplot()
        parts = (
            (around, _ORANGE, f"left out: {len(around)} points"),
            (skin, FAINT, f"skin: {len(skin)} points"),
            (scan.raised, _PURPLE, f"stands on the skin: {len(scan.raised)} points"),
        )
        for points, colour, words in parts:
            some = points[:: 1 + len(points) // _MOST_POINTS]
            axes.scatter(some[:, 0], some[:, 2], s=0.6, linewidths=0, color=colour, label=words)
        for level, at in measures.levels.items():
            if at is None:
                continue
            if at.tangent is not None:
                ends = np.stack([at.tangent.left, at.tangent.right])
                axes.plot(ends[:, 0], [at.height] * 2, color=INK, lw=0.9, marker="o", ms=2.0)
            words = level if at.tangent is not None else f"{level} –"
            axes.annotate(words, (low[0] + 5.0, at.height), fontsize=7, color=INK, ha="right", va="center")
        axes.set(xlim=(high[0], low[0]), ylim=(low[2], high[2]), aspect="equal", xlabel="to the left [mm]")
        axes.set_ylabel("up [mm]")
        axes.legend(loc="lower left", fontsize=7, markerscale=8.0, frameon=True)
        return file_of(figure, "png")
