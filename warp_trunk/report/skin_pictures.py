"""The trunk from all sides, shaded, with what each view shows, and the back by its hump. Imports matplotlib."""

from collections.abc import Sequence
from typing import Literal

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import BoundaryNorm, ListedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke

from warp_trunk.geometry.surface import Surface
from warp_trunk.measures.back_rotation import hump_top
from warp_trunk.measures.quantities import QUANTITIES, Measured
from warp_trunk.measures.skin_quality import LOOK, STRETCH, SkinChange
from warp_trunk.measures.verdicts import NOT_KNOWN, is_known
from warp_trunk.views.clothing import cloth_surfaces
from warp_trunk.views.hump import COLOUR_STEP, SCALE_END, Painted, hump_colours, hump_palette
from warp_trunk.views.relief import BEHIND, FRONT, Relief, Viewpoint, Window, relief, seen_from, window

from .panels import CLAY, Coating, coloured, panels, shaded
from .style import INK, TrunkState

Wear = Literal["nothing", "shorts", "shirt"]
"""The clothes of a trunk; the shirt comes with the shorts."""
LINE_STEP = 10.0
"""Distance in depth between two lines [mm]."""
STEEP = 0.3
"""Where the skin faces back by less than this, lines would run into each other; the cosine of 73 degrees."""
FINE, COARSE = 0.75, 1.0
"""Size of a pixel, and where nothing is measured in the picture [mm]."""
BUST = 190.0
"""The picture of the shoulders ends this far below T1 [mm]."""
SHIRT = 2
"""The material of the shirt in a relief."""
GREY = np.array([0.62, 0.62, 0.62])
"""Colour of skin that was not measured."""
STRETCH_STEP = 0.05
"""Difference of stretch between two colours."""


Looks = tuple[Window, Sequence[Relief]]
"""The relief of every pose in one window."""


def looks(
    poses: Sequence[TrunkState], view: Viewpoint = BEHIND, pixel: float = COARSE, wear: Wear = "shorts"
) -> Looks:
    """The relief of every pose from one side, in one window, as it is dressed."""
    seen, reliefs = window([(pose.skin, pose.landmarks) for pose in poses], pixel, view), []
    for pose in poses:
        skin, cloth = pose.skin, None
        if pose.worn is not None:
            skin = pose.worn.skin
            cloth = None if wear == "nothing" else cloth_surfaces(pose.worn.cloth, shirt=wear == "shirt")
        reliefs.append(relief(skin, pose.landmarks, seen, view, cloth))
    return seen, reliefs


def back_picture(
    poses: Sequence[TrunkState], reliefs: Sequence[Relief], seen: Window, doubtful: np.ndarray | None = None
) -> Figure:
    """Every pose from behind, with lines through places that stand equally far back.

    Args:
        poses: what is shown.
        reliefs: the relief of each.
        seen: the window of all.
        doubtful: 1 at vertices of the second skin that are to be hatched, else 0, shape (vertices,).
    """
    headings = [pose.look.heading for pose in poses]
    figure, plots = panels(headings, seen.extent, BEHIND, [shaded(back) for back in reliefs])
    depths = np.array([back.depth for back in reliefs]) / LINE_STEP
    levels = LINE_STEP * np.arange(np.floor(np.nanmin(depths)), np.ceil(np.nanmax(depths)) + 1)
    for axes, back in zip(plots, reliefs, strict=True):
        steep = ~((back.normal[:, :, 1] > STEEP) & (back.cloth == 0))
        lines(axes, seen, np.ma.masked_where(steep, back.depth), levels.tolist(), "solid")
    if doubtful is not None:
        hatch(plots[1], seen, reliefs[1].values(doubtful))
    hatch_invented(plots, poses, reliefs, seen)
    return figure


def hatch(axes: Axes, seen: Window, doubtful: np.ndarray) -> None:
    """Hatch the pixels where an image, shape (rows, columns), is more than a half."""
    with rc_context({"hatch.linewidth": 0.8, "hatch.color": INK}):
        inside = np.nan_to_num(doubtful[::2, ::2])
        axes.contourf(seen.x[::2], seen.z[::2], inside, [0.5, 2.0], colors="none", hatches=["////"])


def hatch_invented(
    plots: Sequence[Axes],
    poses: Sequence[TrunkState],
    reliefs: Sequence[Relief],
    seen: Window,
    view: Viewpoint = BEHIND,
) -> None:
    """Hatch what was not measured of every pose: its skin, and the shirt where that covers such skin."""
    for axes, pose, look in zip(plots, poses, reliefs, strict=False):
        if pose.unseen is None:
            continue
        invented = np.nan_to_num(look.values(pose.unseen))
        if pose.worn is not None and (look.cloth == SHIRT).any():
            bare = relief(pose.worn.skin, pose.landmarks, seen, view)
            invented = np.where(look.cloth == SHIRT, np.nan_to_num(bare.values(pose.unseen)), invented)
        hatch(axes, seen, invented)


def lines(axes: Axes, seen: Window, values: np.ma.MaskedArray, levels: Sequence[float], style: str) -> None:
    """Lines of equal values, from every second pixel: the others are not visible, and they take four times as
    long."""
    axes.contour(seen.x[::2], seen.z[::2], values[::2, ::2], levels, colors=INK, linewidths=0.5, linestyles=style)


def plain_picture(poses: Sequence[TrunkState], view: Viewpoint, looked: Looks) -> tuple[Figure, list[Axes]]:
    """Every pose as it looks from one side, in the colours of its scan; and the panels."""
    seen, reliefs = looked
    headings = [pose.look.heading for pose in poses]
    images = []
    for pose, look in zip(poses, reliefs, strict=True):
        own, unseen, skin = pose.skin.colours, pose.unseen, CLAY
        if own is not None:
            skin = np.nan_to_num(np.stack([look.values(band / 255.0) for band in own.T], axis=2))
        part = None if unseen is None else np.nan_to_num(look.values(unseen))
        images.append(shaded(look, GREY, part, skin))
    figure, plots = panels(headings, seen.extent, view, images)
    hatch_invented(plots, poses, reliefs, seen, view)
    return figure, plots


def shoulders_picture(poses: Sequence[TrunkState], front: Looks) -> Figure | None:
    """The upper trunk of every pose as it looks from the front, with the heights of its shoulders; None without
    T1, or where the front was not measured."""
    if any("T1" not in pose.landmarks.vertebrae() or pose.unseen is not None for pose in poses):
        return None
    tops = [seen_from(pose.landmarks.of_bone("T1").points, pose.landmarks, FRONT).mean(axis=0) for pose in poses]
    seen, reliefs = front
    rows = int((seen.z > min(z for _, _, z in tops) - BUST).sum())
    upper = Window(seen.x, seen.z[:rows], seen.pixel), [look.uppermost(rows) for look in reliefs]
    figure, plots = plain_picture(poses, FRONT, upper)
    for axes, pose, (x, _, z) in zip(plots, poses, tops, strict=True):
        shoulders, colour = pose.measures.shoulders, pose.look.colour
        if shoulders is None:
            continue
        row, was = pose.main("shoulder_difference_mm"), poses[0].number("shoulder_difference_mm")
        is_sure = is_known(QUANTITIES["shoulder_difference_mm"], row, was)
        for height, sign in ((shoulders.right, 1.0), (shoulders.left, -1.0)) if is_sure else ():
            outer, inner = x + sign * shoulders.outer, x + sign * shoulders.inner
            axes.plot([outer, inner], [z + height] * 2, color=colour, linewidth=2.2)
            axes.plot([inner, x], [z + height] * 2, color=colour, linewidth=0.8, linestyle=":")
        difference, words = pose.number("shoulder_difference_mm") or 0.0, "level"
        if not is_sure:
            words = f"difference\n{NOT_KNOWN}"
        elif abs(difference) >= 0.5:
            side = "right" if difference > 0.0 else "left"
            words = f"{side} shoulder\n{abs(difference):.0f} mm higher"
        axes.text(x, z - 0.55 * BUST, words, ha="center", va="center", fontsize=9, color=INK)
    return figure


def stretch_picture(pose: TrunkState, change: SkinChange, view: Viewpoint) -> tuple[Figure, np.ndarray]:
    """The predicted skin from one side, coloured where it is stretched to more than `LOOK` times its length.

    What is stretched to more than `STRETCH` or sharply folded is hatched.

    Args:
        pose: the prediction.
        change: how its triangles are stretched and folded.
        view: from where it is seen.

    Returns:
        The picture, and which triangles of the skin are seen in it, bool, shape (faces,).
    """
    seen, (skin,) = looks([pose], view)
    stretch, doubtful = (
        skin.values(at_vertices(pose.skin, values))
        for values in (change.stretch, change.doubtful.astype(np.float64))
    )
    norm = BoundaryNorm(np.arange(LOOK, 1.55, STRETCH_STEP), 256, extend="max")
    coating = Coating(
        values=stretch, part=0.9 * (np.nan_to_num(stretch) > LOOK), colours="YlOrRd", norm=norm,
        label="length over that before", ticks=[1.25, STRETCH, 1.45],
    )  # fmt: skip
    figure, axes = coloured(pose, seen, view, skin, coating)
    hatch(axes, seen, doubtful)
    hatch_invented([axes], [pose], [skin], seen, view)
    visible = np.zeros(len(pose.skin.vertices), bool)
    visible[skin.corners[np.isfinite(skin.weights)]] = True
    return figure, np.all(visible[pose.skin.faces], axis=1, out=np.empty(len(pose.skin.faces), bool))


def at_vertices(skin: Surface, values: np.ndarray) -> np.ndarray:
    """Mean of a value of the triangles around each vertex, shape (vertices,)."""
    corner, count = skin.faces.ravel(), len(skin.vertices)
    triangles = np.maximum(np.bincount(corner, minlength=count), 1)
    return np.bincount(corner, np.repeat(values, 3), minlength=count) / triangles


def sure_picture(pose: TrunkState, seen: Window, back: Relief, skin_sd: np.ndarray | None) -> Figure | None:
    """The predicted back, darker where its places are less sure, in steps of 1 mm.

    Args:
        pose: the prediction.
        seen: the window of its relief.
        back: its relief.
        skin_sd: standard deviation of each vertex along its normal [mm], shape (vertices,); None gives no picture.
    """
    if skin_sd is None:
        return None
    values = back.values(skin_sd)
    norm = BoundaryNorm(np.arange(max(2.0, float(np.ceil(np.nanmax(values)))) + 1.0), 256)
    part, label = 0.9 * np.isfinite(values), "standard deviation [mm]"
    coating = Coating(values=values, part=part, colours="YlOrBr", norm=norm, label=label)
    figure, axes = coloured(pose, seen, BEHIND, back, coating)
    hatch_invented([axes], [pose], [back], seen)
    return figure


def values_picture(
    pose: TrunkState, values: np.ndarray, view: Viewpoint, label: str, *, signed: bool = False
) -> Figure:
    """A skin from one side, coloured by a number of each vertex, shape (vertices,), NaN for none."""
    most = max(float(np.nanquantile(np.abs(values), 0.999)), 1e-3)
    colours, norm = "PuOr_r" if signed else "YlOrRd", Normalize(-most if signed else 0.0, most)
    seen, (skin,) = looks([pose], view)
    shown = skin.values(values)
    coating = Coating(values=shown, part=1.0 * np.isfinite(shown), colours=colours, norm=norm, label=label)
    return coloured(pose, seen, view, skin, coating)[0]


def humps_of(pose: TrunkState) -> list[Measured]:
    """The humps that are ringed: where the hump is largest before surgery, and where it is larger now."""
    rows = pose.main("main_hump_mm"), pose.table.elsewhere(pose.look.state, "main_hump_mm")
    return [row for row in rows if row is not None and row.value]


def hump_picture(
    poses: Sequence[TrunkState],
    reliefs: Sequence[Relief],
    painted: Sequence[Painted],
    seen: Window,
) -> Figure:
    """Every pose coloured by how far each place stands behind the other side of the back, with its spine. The two
    places of a hump are ringed (`humps_of`)."""
    bounds, palette = np.arange(-SCALE_END, SCALE_END + COLOUR_STEP, COLOUR_STEP), hump_palette()
    images = [
        shaded(back, hump_colours(np.nan_to_num(difference)), part * np.isfinite(difference))
        for back, (difference, part) in zip(reliefs, painted, strict=True)
    ]
    figure, plots = panels([pose.look.heading for pose in poses], seen.extent, BEHIND, images, legend=0.95)
    for axes, pose, back, (difference, part) in zip(plots[:-1], poses, reliefs, painted, strict=True):
        compared = np.ma.masked_where(~((part > 0.5) & np.isfinite(difference)), np.nan_to_num(difference))
        steps = np.arange(LINE_STEP, SCALE_END + LINE_STEP, LINE_STEP)
        lines(axes, seen, compared, steps.tolist(), "solid")
        lines(axes, seen, compared, (-steps[::-1]).tolist(), "dashed")
        axes.plot(*back.spine.T, "o-", color=INK, markersize=1.8, linewidth=0.7)
        for hump in humps_of(pose):
            _ring(axes, pose, back, hump, poses[0].number("hump_mm", hump.level))
    hatch_invented(plots, poses, reliefs, seen)
    ticks = np.arange(-SCALE_END, SCALE_END + LINE_STEP, LINE_STEP)
    scale = ScalarMappable(BoundaryNorm(bounds, len(palette), extend="both"), ListedColormap(palette))
    bar = figure.colorbar(scale, cax=plots[-1], orientation="horizontal", ticks=ticks)
    bar.ax.set_xlabel("difference from the other side of the back [mm]", fontsize=8.5)
    for x, ha, words in ((0.0, "left", "purple, dashed: further forward"), (1.0, "right", "orange: further back")):
        bar.ax.text(x, 1.35, words, transform=bar.ax.transAxes, ha=ha, va="bottom", fontsize=8.5)
    return figure


def _ring(axes: Axes, pose: TrunkState, back: Relief, hump: Measured, before: float | None) -> None:
    """Ring the two places of a hump and write its height and level beside the one that stands further back."""
    words = f"{abs(hump.value or 0.0):.0f} mm" if is_known(QUANTITIES["hump_mm"], hump, before) else NOT_KNOWN
    tangent, z = pose.measures.tangents[hump.level], back.spine[pose.landmarks.vertebrae().index(hump.level)][1]
    top, height = None if tangent is None else hump_top(tangent), hump.value
    assert top is not None
    assert height is not None  # there is a hump
    places = seen_from(np.column_stack([top[1], [z, z]]), pose.landmarks, BEHIND)[:, 0]  # right, left
    for edge, thick in (("white", 2.4), (INK, 1.2)):
        axes.plot(places, [z, z], "o", ms=7.0, mfc="none", mec=edge, mew=thick)
    axes.text(
        places[0 if height > 0.0 else 1] - np.copysign(14.0, height), z + 20.0,
        f"{hump.level}: {words}", ha="center", va="center", fontsize=10, fontweight="bold",
        color=INK, path_effects=[withStroke(linewidth=2.5, foreground="white")],
    )  # fmt: skip
