"""The spine before surgery and as planned, from behind and from the right, with its vertebrae as boxes."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from warp_trunk.case.landmarks import Landmarks
from warp_trunk.geometry.surface import unit
from warp_trunk.measures.quantities import QUANTITIES
from warp_trunk.measures.verdicts import NOT_KNOWN, is_known
from warp_trunk.spine.spine import sacral_line, spine_of
from warp_trunk.views.relief import BEHIND, RIGHT, Viewpoint, seen_from

from .panels import Extent, panels
from .style import FAINT, INK, TrunkState

MARGIN = 22.0
"""Space around the spine [mm]."""
REACH = 62.0
"""How far from its vertebra a line of an angle reaches [mm]."""
BONE, FUSED, ROD = np.array([0.97, 0.94, 0.87]), np.array([0.66, 0.80, 0.93]), "#3c4650"
Boxes = Mapping[str, tuple[np.ndarray, np.ndarray]]
"""By level corners (8, 3) and pedicles (2, 3) of a vertebra [mm]."""


def spine_picture(poses: Sequence[TrunkState], view: Viewpoint, fused: Sequence[Sequence[str]]) -> Figure:
    """The spine of every pose, all at one scale: the first is before surgery, the others are planned.

    Vertebrae that are `fused`, by pose, are filled, and lines along their pedicles show the rods.

    From behind (`BEHIND`) every curve has its Cobb angle between the end vertebrae before surgery, as on a film;
    from the right (`RIGHT`) kyphosis and lordosis are written beside their vertebrae.
    """
    boxes = [vertebra_boxes(pose.landmarks) for pose in poses]
    placed = [
        {level: (seen_from(corners, pose.landmarks, view), seen_from(pedicles, pose.landmarks, view))
         for level, (corners, pedicles) in spine.items()}
        for pose, spine in zip(poses, boxes, strict=True)
    ]  # fmt: skip
    half, bottom, top, middle = 100.0, 0.0, 400.0, 0.0
    if any(boxes):
        corners = np.concatenate([corners for spine in boxes for corners, _ in spine.values()])
        across = np.concatenate([corners[:, 0] for spine in placed for corners, _ in spine.values()])
        low, high = corners.min(axis=0), corners.max(axis=0)
        half = max(0.5 * float((high - low)[:2].max()) + REACH, half)  # as wide from either side
        bottom, top, middle = low[2] - MARGIN, high[2] + MARGIN, 0.5 * (across.min() + across.max())
    extent = (middle + half, middle - half, bottom, top)
    headings = [pose.look.spine[:1].upper() + pose.look.spine[1:] for pose in poses]
    figure, plots = panels(headings, extent, view, scale=50.0)
    for axes, pose, spine, joined in zip(plots, poses, placed, fused, strict=True):
        _plumb_lines(axes, pose, view, extent)
        _vertebrae(axes, spine, INK, joined)
        if view is BEHIND:
            for curve in poses[0].measures.cobb:
                angle = _angle_text(poses, pose, "cobb_deg", curve.ends)
                hollow = 1.0 if curve.convex == "right" else -1.0  # x is positive to the patient's left
                ends = curve.upper, curve.lower
                _angle(axes, spine, ends, angle, hollow, -4.0 * hollow, size=11, weight="bold")
        elif view is RIGHT:
            for name, ends, hollow in (("kyphosis", ("T5", "T12"), -1.0), ("lordosis", ("L1", "L5"), 1.0)):
                angle = _angle_text(poses, pose, f"{name}_deg", "-".join(ends), fixed=bool(joined))
                named = f"{name}\n{ends[0]} to {ends[1]}\n"
                _angle(axes, spine, ends, angle, hollow, 3.0 * hollow, named, size=8.5)
    return figure


def _angle_text(
    poses: Sequence[TrunkState], pose: TrunkState, key: str, level: str, *, fixed: bool = False
) -> str | None:
    """An angle as text, in words where its interval is wider than what it says and no plan fixes it; None where it
    is missing."""
    row, was = pose.column(key).get(level), poses[0].number(key, level)
    if row is None or row.value is None:
        return None
    sure = fixed or pose is poses[0] or is_known(QUANTITIES[key], row, was)
    return f"{row.value:.0f}°" if sure else NOT_KNOWN


def _vertebrae(axes: Axes, spine: Boxes, colour: str, fused: Sequence[str]) -> None:
    """The faces that look at the viewer, the furthest first, the brighter the more they do; rods over them."""
    faces = np.array([corners[list(face)] for corners, _ in spine.values() for face in FACES]).reshape(-1, 4, 3)
    bones = np.repeat([FUSED if level in fused else BONE for level in spine], len(FACES), axis=0)
    facing = unit(np.cross(faces[:, 2] - faces[:, 0], faces[:, 3] - faces[:, 1]))[:, 1]
    order = np.argsort(faces[:, :, 1].mean(axis=1), kind="stable")
    order = order[facing[order] > 0.0]
    shades = (0.72 + 0.28 * facing[order, None]) * bones[order].reshape(-1, 3)
    places = list(faces[order][:, :, [0, 2]])
    axes.add_collection(PolyCollection(places, facecolor=shades, edgecolor=colour, linewidth=0.7), autolim=False)
    rods = np.array([spine[level][1] for level in spine if level in fused]).reshape(-1, 2, 3)
    for side in (0, 1):
        axes.plot(*rods[:, side, ::2].T, color=ROD, linewidth=2.6, solid_capstyle="round")
    for level, (corners, pedicles) in spine.items():
        axes.plot(*pedicles[:, [0, 2]].T, "o", color=colour, markersize=2.2)
        x, z = corners[:, [0, 2]].mean(axis=0) - [0.0, 3.5]  # below its pedicles
        axes.text(x, z, level, ha="center", va="center", fontsize=5.5, color=INK)


def _plumb_lines(axes: Axes, pose: TrunkState, view: Viewpoint, extent: Extent) -> None:
    """The vertical through the sacrum, solid, and that of the top of the spine, dotted."""
    shift = pose.measures.trunk_shift
    line = sacral_line(pose.landmarks)
    if shift is None or (view is RIGHT and shift.forward is None):
        return
    spine = spine_of(pose.landmarks)
    top = spine.centroids[spine.levels.index(shift.upper)]
    for point, style in ((np.array([*line.point, 0.0]), "-"), (top, ":")):
        x = seen_from(point[None], pose.landmarks, view)[0, 0]
        axes.plot([x, x], extent[2:], color=FAINT, linewidth=0.8, linestyle=style, zorder=0)


def _angle(
    axes: Axes,
    spine: Boxes,
    ends: tuple[str, str],
    angle: str | None,
    hollow: float,
    aside: float,
    named: str = "",
    **words: Any,
) -> None:
    """Lines along the end vertebrae towards the hollow, 1 or -1 along x, with the angle `aside` of their ends."""
    if angle is None or not all(end in spine for end in ends):
        return
    rings = slice(0, 4), slice(4, 8)
    tips = [_across(axes, spine[end][0][:, [0, 2]], ring, hollow) for end, ring in zip(ends, rings, strict=True)]
    x, z = np.mean(tips, axis=0)
    align = "left" if aside < 0.0 else "right"
    axes.text(x + aside, z, f"{named}{angle}", ha=align, va="center", color=INK, **words)


def _across(axes: Axes, corners: np.ndarray, ring: slice, hollow: float) -> np.ndarray:
    """A line across the axis of a vertebra from its upper or lower end; returns where it ends."""
    axis = corners[:4].mean(axis=0) - corners[4:].mean(axis=0)
    start = corners[ring].mean(axis=0)
    tip = start + REACH * hollow * np.array([axis[1], -axis[0]]) / np.hypot(*axis)
    axes.plot(*np.array([start, tip]).T, color=INK, linewidth=0.8)
    return tip


WIDE, DEEP = 1.6, 1.3
"""Width and depth of a vertebral body over its height: usual ones, because the landmarks give only the height."""


FACES = ((0, 1, 2, 3), (7, 6, 5, 4), (1, 0, 4, 5), (2, 1, 5, 6), (3, 2, 6, 7), (0, 3, 7, 4))
"""Corners of the faces of a box, counterclockwise from outside: top, bottom, left, back, right, front."""


def vertebra_boxes(landmarks: Landmarks) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """The bodies of the vertebrae that have all six landmarks as boxes, top to bottom.

    A box stands on the axis between the endplate centres, and its left side points to the left pedicle: so it
    leans and turns as the vertebra does.

    Returns:
        By level its corners [mm], shape (8, 3): the upper four, then the lower four, each counterclockwise from
        above; and the left and the right pedicle [mm], shape (2, 3).
    """
    spine = spine_of(landmarks)
    boxes = {}
    for level, endplates, pedicles in zip(spine.levels, spine.endplates, spine.pedicles, strict=True):
        if not (np.isfinite(endplates).all() and np.isfinite(pedicles).all()):
            continue
        axis = endplates[0] - endplates[1]
        height = np.linalg.norm(axis)
        up, to_left = axis / height, pedicles[0] - pedicles[1]
        to_left = unit(to_left - (to_left @ up) * up)
        back = np.cross(up, to_left)
        around = [(1, -1), (1, 1), (-1, 1), (-1, -1)]  # left and front first
        rim = np.array([0.5 * height * (x * WIDE * to_left + y * DEEP * back) for x, y in around])
        boxes[level] = np.concatenate([endplates[0] + rim, endplates[1] + rim]), pedicles
    return boxes
