"""Pictures of docs/ribs.md: the cage before and after, and the skin of the flank."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from warp_trunk import Surface
from warp_trunk.geometry.normals import area_vectors, unit
from warp_trunk.measures.skin_quality import skin_change
from warp_trunk.run.options import RunOptions
from warp_trunk.run.paths import motions_of

from .study import PATIENTS, SHOWN, Study

if TYPE_CHECKING:
    from matplotlib.axes import Axes

View = tuple[tuple[float, float, float], tuple[float, float, float]]
"""What points to the right of a picture, and to its top."""
VIEWS: dict[str, View] = {
    "from behind": ((-1, 0, 0), (0, 0, 1)),
    "from her right": ((0, -1, 0), (0, 0, 1)),
    "from above": ((-1, 0, 0), (0, -1, 0)),
}
FLANK: View = ((0.44, -0.9, 0.0), (0.0, 0.0, 1.0))
"""The right flank, convex before surgery, seen from the right and a little from the front."""
HEIGHTS = (920.0, 1260.0)
"""Of the flank that is drawn [mm]."""
STRETCH = 0.3
"""The stretch at which the colours end."""
PAPERS = RunOptions(energy="itmsm", skin_rigidity=0.0)
"""The papers' tissue, whichever way bones are moved."""
BEFORE, AFTER = "#9a9a9a", "#e69f00"
INK = "#222222"


def draw_cage(study: Study, path: Path) -> None:
    """Draws ribs, sternum and spine of the thoracic curve of 60 degrees before surgery and as they follow it."""
    from matplotlib.figure import Figure  # heavy

    case = study.plan(PATIENTS[1], SHOWN, "follow")
    motions = motions_of(case)
    shown = {name: bone for name, bone in case.bones.items() if not name.startswith(("hip", "sacrum", "femur"))}
    moved = {name: Surface(motions[name].apply(bone.vertices), bone.faces) for name, bone in shown.items()}
    figure = Figure(figsize=(9.0, 7.6), layout="constrained")
    panels = figure.subplots(2, len(VIEWS), sharex="col", sharey="col")
    for axes, (name, view) in zip(panels.T, VIEWS.items(), strict=True):
        for one, bones, colour, when in ((axes[0], shown, BEFORE, "before"), (axes[1], moved, AFTER, "after")):
            if when == "after":
                for bone in shown.values():
                    at = bone.vertices[::4] @ np.array(view).T
                    one.plot(at[:, 0], at[:, 1], ",", color="#cfcfcf", zorder=0)
            _shade(one, _as_one(bones), view, colour)
            one.set_title(f"{name}, {when}", fontsize=10.5, color=INK, loc="left")
    figure.savefig(path, dpi=75, metadata={"Software": None}, pil_kwargs={"optimize": True})


def draw_flank(study: Study, path: Path) -> None:
    """Draws the skin of the flank before surgery, as it is predicted by default with either way to move bones and
    with the papers' tissue on ribs that follow, and as it was imposed; the second row tells by colour how far its
    edges are stretched."""
    from matplotlib.cm import ScalarMappable  # heavy
    from matplotlib.colors import Normalize
    from matplotlib.figure import Figure

    curve = PATIENTS[1]
    case, trunk = study.plan(curve, SHOWN, "spline"), study.patient(curve)[1]
    skins = {
        "before": case.skin,
        "spline": study.simulated(case, trunk, "spline", RunOptions())[1],
        "follow, papers' tissue": study.simulated(case, trunk, "follow", PAPERS)[1],
        "follow": study.simulated(case, trunk, "follow", RunOptions())[1],
        "imposed, no tissue": study.imposed(curve.corrected(SHOWN))[0],
    }
    figure = Figure(figsize=(12.5, 5.4), layout="constrained")
    panels = figure.subplots(2, len(skins), sharex=True, sharey=True)
    for axes, (name, skin) in zip(panels.T, skins.items(), strict=True):
        middle = skin.vertices[skin.faces][:, :, 2].mean(axis=1)
        kept = (middle > HEIGHTS[0]) & (middle < HEIGHTS[1])
        _shade(axes[0], skin, FLANK, "#f2d7c4", kept)
        axes[0].set_title(name, fontsize=10.5, color=INK, loc="left")
        _shade(axes[1], skin, FLANK, _stretch(case.skin, skin), kept)
    colours = ScalarMappable(Normalize(-STRETCH, STRETCH), "RdBu_r")
    bar = figure.colorbar(colours, ax=panels[1], location="bottom", shrink=0.5, aspect=40)
    bar.set_label("largest principal stretch of a triangle, less 1", color=INK)
    figure.savefig(path, dpi=95, metadata={"Software": None}, pil_kwargs={"optimize": True})


def _stretch(before: Surface, after: Surface) -> np.ndarray:
    """The largest principal stretch of each triangle, less 1, shape (faces,)."""
    return skin_change(before, after).stretch - 1.0


def _as_one(bones: dict[str, Surface]) -> Surface:
    starts = np.cumsum([0, *(len(bone.vertices) for bone in bones.values())])
    faces = [bone.faces + start for bone, start in zip(bones.values(), starts, strict=False)]
    return Surface(np.vstack([bone.vertices for bone in bones.values()]), np.vstack(faces))


def _shade(
    axes: Axes, surface: Surface, view: View, colour: str | np.ndarray, kept: np.ndarray | None = None
) -> None:
    """Draws the triangles that a view shows, in one colour and lit, or by a number of each."""
    from matplotlib.collections import PolyCollection
    from matplotlib.colors import to_rgb

    right, up = unit(np.array(view))
    to_viewer = np.cross(right, up)
    normal = unit(area_vectors(surface.vertices, surface.faces))
    seen = np.flatnonzero((normal @ to_viewer > 0.0) & (True if kept is None else kept))
    seen = seen[np.argsort(surface.vertices[surface.faces[seen]].mean(axis=1) @ to_viewer)]
    triangles = (surface.vertices @ np.stack([right, up], axis=1))[surface.faces[seen]]
    drawn = PolyCollection(list(triangles), edgecolors="face", linewidths=0.2)
    if isinstance(colour, str):
        light = unit((to_viewer + up - 0.6 * right)[None])[0]
        bright = np.clip(0.45 + 0.55 * normal[seen] @ light, 0.0, 1.0)
        drawn.set_facecolor(
            [(red, green, blue) for red, green, blue in bright[:, None] * np.array(to_rgb(colour))]
        )
    else:
        drawn.set(array=colour[seen], cmap="RdBu_r", clim=(-STRETCH, STRETCH))
    axes.add_collection(drawn)
    axes.autoscale()
    axes.set_aspect("equal")
    axes.set_axis_off()
