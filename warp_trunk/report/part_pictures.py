"""Pictures of a part of the body without a spine: its skin, how far it moves, and sections where it moves most."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib import rc_context
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from warp_trunk.case.landmarks import NO_LANDMARKS, Landmarks
from warp_trunk.geometry.surface import Surface, area_vectors
from warp_trunk.io.atomic_write import write_whole
from warp_trunk.measures import measure
from warp_trunk.measures.body_part import agreement
from warp_trunk.measures.quantities import MeasureTable
from warp_trunk.views.relief import BEHIND, FRONT, LEFT, RIGHT, Viewpoint

from .skin_pictures import values_picture
from .style import FAINT, PREDICTED, RC, TrunkState, file_of, new_figure

_VIEWS = {BEHIND: (0.0, 1.0), RIGHT: (-1.0, 0.0), FRONT: (0.0, -1.0), LEFT: (1.0, 0.0)}
"""Where the viewer stands, x and y of LPS."""
_PLANES = (("from the left", (1, 2), 0), ("from the front", (0, 2), 1), ("from above", (0, 1), 2))
"""Of each section what is seen, the axes across and up, and the normal."""
_REACH = 60.0
"""Sections show what is nearer to the largest change than this [mm]."""


def frame_of(skin: Surface) -> Landmarks:
    """Two points that stand for the iliac spines, so that pictures are in the axes of the case."""
    low, high = skin.vertices.min(axis=0), skin.vertices.max(axis=0)
    middle = (low[1] + high[1]) / 2.0
    return Landmarks(("asis_left", "asis_right"), np.array([[high[0], middle, low[2]], [low[0], middle, low[2]]]))


def changed_views(skin: Surface, size: np.ndarray) -> list[Viewpoint]:
    """The side from which most of a change of a skin is seen, and the neighbour from which more is seen.

    Counted is the size of the change at each vertex, shape (vertices,), times the area that faces the viewer.
    """
    faces, of_face = area_vectors(skin.vertices, skin.faces)[:, :2], size[skin.faces].mean(axis=1)
    seen = {view: float(np.maximum(faces @ side, 0.0) @ of_face) for view, side in _VIEWS.items()}
    first = max(seen, key=seen.__getitem__)
    return [first, max((view for view in seen if (view.turn - first.turn) % 2), key=seen.__getitem__)]


def write_distances(path: Path, predicted: Surface, actual: Surface) -> Path:
    """Write a picture of the distances of a predicted skin from the actual one, seen from where most is seen."""
    distance = agreement(predicted, actual).signed
    view = changed_views(predicted, np.nan_to_num(np.abs(distance)))[0]
    pose = TrunkState(
        PREDICTED, predicted, frame_of(predicted), measure(predicted, NO_LANDMARKS), MeasureTable(())
    )
    with rc_context(RC):
        picture = values_picture(pose, distance, view, "distance [mm], orange outside", signed=True)
        write_whole(path, file_of(picture, "png"))
    return path


def change_sections(poses: Sequence[TrunkState], bones: Sequence[Surface]) -> Figure:
    """Skin and bone of every pose cut by the three planes through the largest change of the skin.

    Args:
        poses: before surgery, predicted, and the actual one where it is known.
        bones: the bones before surgery and after, open or closed.
    """
    way = np.linalg.norm(poses[1].skin.vertices - poses[0].skin.vertices, axis=1)
    at = poses[0].skin.vertices[way.argmax()]
    figure = new_figure(7.6, 3.1, "constrained")
    for axes, (title, across, normal) in zip(figure.subplots(1, 3), _PLANES, strict=True):
        for number, pose in enumerate(poses):
            for width, surface in zip((1.3, 0.7), (pose.skin, *bones[number : number + 1]), strict=False):
                label = pose.look.title if surface is pose.skin else None
                lines = list(_cut(surface, at, normal)[:, :, across])
                axes.add_collection(LineCollection(lines, colors=pose.look.colour, linewidths=width, label=label))
        axes.set_title(f"{title}, at {'xyz'[normal]} = {at[normal]:.0f} mm", fontsize=8.5)
        axes.set_xlim(at[across[0]] - _REACH, at[across[0]] + _REACH)
        axes.set_ylim(at[across[1]] - _REACH, at[across[1]] + _REACH)
        words = "to the back [mm]" if normal == 0 else "to the patient's left [mm]"
        axes.set_xlabel(words, fontsize=8, color=FAINT)
        axes.set_aspect("equal")
        axes.tick_params(labelsize=7)
    handles = figure.axes[0].get_legend_handles_labels()
    figure.legend(*handles, loc="outside upper center", ncols=len(poses))
    return figure


def _cut(surface: Surface, at: np.ndarray, normal: int) -> np.ndarray:
    """Lines of a surface on the plane through a point across an axis, shape (lines, 2, 3)."""
    from trimesh import Trimesh
    from trimesh.intersections import mesh_plane

    mesh = Trimesh(surface.vertices, surface.faces, process=False)
    return np.asarray(mesh_plane(mesh, np.eye(3)[normal], at)).reshape(-1, 2, 3)
