"""A back that was scanned alone, from behind: its skin, what was left out, and where its levels were measured."""

from __future__ import annotations

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure

from warp_trunk.geometry.back_points import BackPoints
from warp_trunk.measures import BackMeasures

from .style import FAINT, INK, RC, file_of

_OUT, _ON = "#ee7733", "#aa3377"
_MARGIN = 150.0
"""Points farther than this beside the skin are counted and not drawn [mm]."""
_SHOWN = 20_000


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
            (around, _OUT, f"left out: {len(around)} points"),
            (skin, FAINT, f"skin: {len(skin)} points"),
            (scan.raised, _ON, f"stands on the skin: {len(scan.raised)} points"),
        )
        for points, colour, words in parts:
            some = points[:: 1 + len(points) // _SHOWN]
            axes.scatter(some[:, 0], some[:, 2], s=0.6, linewidths=0, color=colour, label=words)
        for level, at in measures.levels.items():
            if at is None:
                continue
            if at.tangent is not None:
                ends = np.stack([at.tangent.left, at.tangent.right])
                axes.plot(ends[:, 0], [at.height] * 2, color=INK, lw=0.9, marker="o", ms=2.0)
            words = level if at.tangent is not None else f"{level} –"
            axes.annotate(words, (high[0] - 5.0, at.height), fontsize=7, color=INK, ha="right", va="center")
        axes.set(xlim=(low[0], high[0]), ylim=(low[2], high[2]), aspect="equal", xlabel="to the left [mm]")
        axes.set_ylabel("up [mm]")
        axes.legend(loc="lower left", fontsize=7, markerscale=8.0, frameon=True)
        return file_of(figure, "png")
