"""The trunk's own part of a section in which arms touch it."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from .section import enclosed_area, encloses

SHOULDERS = ("T1", "T2", "T3", "T4")
"""Levels at which shoulders are the trunk's own."""
_NOTCH = 2.0
"""An outline is notched where it lies this deep under its convex hull [mm]."""
_LEAST = 1200.0
"""No arm has a smaller section [mm2]."""
_STANDS_OUT = 0.35
"""An arm has at least this area over the square of the line that cuts it off: half a disc has 0.39, the fold of
skin before a shoulder blade less than 0.1."""
_ASIDE = 0.5
"""An arm is cut off between notches at least this part of the trunk's narrower half from the spine: not at the
groove of the back."""
_FILLET, _SIDE = 6.0, 10.0
"""Beside a notch the skin turns into the arm over the first length [mm]; points the second apart show where it
goes."""
_MOST = 0.4
"""An arm has less than this of the area of the trunk."""


def own_part(loop: np.ndarray, spine: np.ndarray) -> np.ndarray | None:
    """The part of an outline that is the trunk's, cut off from arms between notches in front of and behind them.

    Args:
        loop: outline of a section, x and y [mm], shape (points, 2), counterclockwise.
        spine: a point in the trunk [mm], shape (2,).

    Returns:
        The points of the trunk in their order, or None where all are the trunk's.
    """
    own = loop
    for _ in range(2):  # an arm on each side
        cut = _without_arm(own, spine)
        if cut is None:
            break
        own = cut
    return None if own is loop else own


def _without_arm(loop: np.ndarray, spine: np.ndarray) -> np.ndarray | None:
    """The outline without the part that stands out most; None where none does."""
    best, most = None, _STANDS_OUT
    middle = 0.5 * (loop.min(axis=0) + loop.max(axis=0))
    aside = loop[:, 0] - spine[0]
    aside /= min(aside.max(), -aside.min())  # an arm on one side does not widen the other half
    for first, second in combinations([n for n in _notches(loop) if abs(aside[n]) >= _ASIDE], 2):
        if aside[first] * aside[second] < 0.0:
            continue
        parts = loop[first : second + 1], np.vstack([loop[second:], loop[: first + 1]])
        areas = [enclosed_area(part) for part in parts]
        arm, trunk = (0, 1) if areas[0] < areas[1] else (1, 0)
        across, along = np.abs(parts[arm].mean(axis=0) - middle)
        chord = float(np.sum((loop[first] - loop[second]) ** 2))
        share = areas[arm] / max(chord, 1.0)
        size = _LEAST <= areas[arm] <= _MOST * areas[trunk]
        if size and across > along and share > most and encloses(parts[trunk], spine):
            best, most = parts[trunk], share
    return None if best is None else _closed(best)


def _closed(open_outline: np.ndarray) -> np.ndarray:
    """The outline from one notch round the trunk to the other, closed by the flank that was under the arm: a cubic
    that goes on as the outline does beside the notches."""
    way = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(open_outline, axis=0), axis=1)))

    def at(length: float) -> np.ndarray:
        return np.array([np.interp(length, way, column) for column in open_outline.T])

    kept = (way >= _FILLET) & (way <= way[-1] - _FILLET)
    start, before, long_before = (at(way[-1] - _FILLET - back) for back in (0.0, _SIDE, 2.0 * _SIDE))
    end, after, long_after = (at(_FILLET + ahead) for ahead in (0.0, _SIDE, 2.0 * _SIDE))
    # directions at both ends by parabolas through three points, of unit length, times the length between the ends
    scale = np.linalg.norm(end - start) / (2.0 * _SIDE)
    out = scale * (3.0 * start - 4.0 * before + long_before)
    into = scale * (4.0 * after - 3.0 * end - long_after)
    t = np.linspace(0.0, 1.0, 20)[:, None]
    flank = (1 + 2 * t) * (1 - t) ** 2 * start + t**2 * (3 - 2 * t) * end
    return np.vstack([open_outline[kept], flank + t * (1 - t) ** 2 * out + t**2 * (t - 1) * into])


def _notches(loop: np.ndarray) -> list[int]:
    """The deepest point of the outline under each edge of its convex hull, where deep enough, rising."""
    from scipy.spatial import ConvexHull, QhullError  # heavy

    try:
        corners = np.sort(ConvexHull(loop).vertices)
    except QhullError:  # all points on a line
        return []
    turned = np.roll(loop, -corners[0], axis=0)
    size = np.diff(corners - corners[0], append=len(loop))
    under = np.repeat(np.arange(len(corners)), size)  # the edge that each point lies under
    start = loop[corners]
    edge = np.roll(start, -1, axis=0) - start
    x, y = (turned - start[under]).T
    depth = np.abs(edge[under, 0] * y - edge[under, 1] * x) / np.linalg.norm(edge, axis=1)[under]
    deepest = np.lexsort((-depth, under))[np.cumsum(size) - size]
    return sorted(((deepest[depth[deepest] >= _NOTCH] + corners[0]) % len(loop)).tolist())
