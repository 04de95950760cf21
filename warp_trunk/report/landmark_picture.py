"""The landmarks found on a spine, drawn over its bones from behind and from the left. Imports matplotlib."""

import textwrap
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection

from warp_trunk.case.anatomy import VERTEBRAE
from warp_trunk.case.landmarks import ASIS
from warp_trunk.geometry.scanned_points import in_cubes
from warp_trunk.geometry.surface import Surface, area_vectors, unit
from warp_trunk.preparation.landmark_finder import FoundLandmarks

from .style import FAINT, INK, RC, file_of, new_figure

DOUBT = "#d55e00"
"""Colour of the vertebrae whose landmarks were not found."""
_BONE, _DOUBTED = np.array([0.95, 0.94, 0.92]), np.array([0.99, 0.80, 0.66])
_SKIN = np.array([1.0, 0.93, 0.88])
KIND_COLOURS = {"endplate": "#0072b2", "left_pedicle": "#009e73", "right_pedicle": "#aa3377", "asis": "#000000"}
"""Colours of Okabe and Ito and of Tol, apart for every kind of colour vision."""
_WORDS = {"endplate": "endplate centres", "asis": "iliac spines"}
_MM = 1.0 / 32.0
"""Inches on the picture for each mm."""
_ROOM = 22.0
"""Around the bones, for names and scale [mm]."""
_LINE = 0.17
"""Height of a line of text [inches]."""
_FINE = 2.5
"""Smaller details of a bone are not drawn [mm]: surfaces from voxels have ten times the triangles that one
sees."""
_SCALE = 50.0
"""Length of the scale [mm]."""


@dataclass(frozen=True, eq=False)
class _View:
    """From where it is seen: right, up and towards the viewer make right-handed axes."""

    title: str
    sides: tuple[str, str]
    """The directions at the left and at the right edge of the picture."""
    right: np.ndarray
    viewer: np.ndarray

    def flat(self, points: np.ndarray) -> np.ndarray:
        """Points (..., 3) on the picture, (..., 2)."""
        return np.stack([points @ self.right, points[..., 2]], axis=-1)


_VIEWS = (
    _View("from behind", ("left", "right"), np.array([-1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])),
    _View("from the left side", ("front", "back"), np.array([0.0, 1.0, 0.0]), np.array([1.0, 0.0, 0.0])),
)


def landmark_picture(bones: Mapping[str, Surface], placed: FoundLandmarks, skin: Surface | None = None) -> bytes:
    """A picture on which a surgeon sees whether landmarks lie where they should, as a PNG file.

    Bones are seen through, as on a film: landmarks are drawn over all of them. Vertebrae whose landmarks
    were not found have their own colour, and the reason is given below.

    Args:
        bones: those that landmarks were looked for on [mm]; others than vertebrae and hip bones are not drawn.
        placed: what `find_landmarks` found on them.
        skin: drawn behind the bones [mm], where it is given.
    """
    drawn = {name: bones[name] for name in (*ASIS.values(), *VERTEBRAE) if name in bones}
    every = np.vstack([bone.vertices for bone in drawn.values()])
    told = np.vstack([placed.landmarks.points, *(drawn[name].vertices for name in drawn if name in VERTEBRAE)])
    every = every[every[:, 2] >= told[:, 2].min()]  # what is lower of the hip bones shows nothing
    if skin is not None:
        every = np.vstack([every, skin.vertices])
    spans = [(view.flat(every).min(axis=0) - _ROOM, view.flat(every).max(axis=0) + _ROOM) for view in _VIEWS]
    tall = (spans[0][1] - spans[0][0])[1] * _MM
    wide = [float((high - low)[0]) * _MM for low, high in spans]
    width, start, lines = sum(wide), 0.0, []
    for name, why in placed.unsure.items():
        text = f"{name}: not found: {why}"
        lines += textwrap.wrap(text, int(15.0 * width), subsequent_indent="    ")
    below, above = _LINE * (len(lines) + 2.5), 2.0 * _LINE
    height = below + tall + above
    with rc_context(RC):
        figure = new_figure(width, height)
        for view, (low, high), own in zip(_VIEWS, spans, wide, strict=True):
            axes = figure.add_axes((start / width, below / height, own / width, tall / height))
            axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal", title=view.title)
            axes.set_axis_off()
            if skin is not None:
                _draw_bone(axes, view, skin, _SKIN, FAINT, order=0)
            _draw_bones(axes, view, drawn, placed)
            _draw_landmarks(axes, view, placed)
            for text, at, align in zip(view.sides, (low[0] + 4.0, high[0] - 4.0), ("left", "right"), strict=True):
                axes.text(at, high[1] - 7.0, text, color=FAINT, ha=align, va="center")
            start += own
        axes, (x, y) = figure.axes[0], spans[0][0] + [2.0, 3.0]
        axes.plot([x, x + _SCALE], [y, y], color=INK, lw=1.0)
        axes.text(x, y + 2.0, f"{_SCALE:g} mm", va="bottom", fontsize=8.0)
        figure.legend(*axes.get_legend_handles_labels(), loc="lower center", ncols=4, fontsize=8.0)
        for row, line in enumerate(lines):
            figure.text(0.02, (below - _LINE * (row + 0.8)) / height, line, color=DOUBT, fontsize=8.0, va="center")
        return file_of(figure, "png")


def _draw_bones(axes: Axes, view: _View, drawn: Mapping[str, Surface], placed: FoundLandmarks) -> None:
    """Each bone shaded, with its outline, the farthest first but vertebrae over hip bones; their names beside."""
    edge = max(view.flat(bone.vertices)[:, 0].max() for name, bone in drawn.items() if name in VERTEBRAE)
    centres = {name: bone.vertices.mean(axis=0) for name, bone in drawn.items()}
    for name in sorted(drawn, key=lambda name: (name in VERTEBRAE, float(centres[name] @ view.viewer))):
        doubted = name in placed.unsure
        _draw_bone(axes, view, drawn[name], _DOUBTED if doubted else _BONE, DOUBT if doubted else FAINT)
        if name in VERTEBRAE:
            text, colour, line = (f"{name} ?", DOUBT, DOUBT) if doubted else (name, INK, "#cccccc")
            x, z = view.flat(centres[name])
            axes.plot([x, edge + 2.0], [z, z], color=line, lw=0.4, zorder=2)
            axes.text(edge + 3.0, z, text, color=colour, fontsize=8.0, va="center")


def _draw_bone(
    axes: Axes, view: _View, bone: Surface, colour: np.ndarray, outline: str, *, order: int = 1
) -> None:
    bone = _coarser(bone)
    corners = bone.vertices[bone.faces]
    towards = unit(area_vectors(bone.vertices, bone.faces)) @ view.viewer
    seen = np.flatnonzero(towards > 0.0)
    seen = seen[np.argsort(corners[seen].mean(axis=1) @ view.viewer)]
    shade = (0.72 + 0.28 * towards[seen])[:, None] * colour
    edges = np.stack([bone.faces[seen], np.roll(bone.faces[seen], -1, axis=1)], axis=2).reshape(-1, 2)
    ends, times = np.unique(np.sort(edges, axis=1), axis=0, return_counts=True)
    rim = list(view.flat(bone.vertices[ends[times == 1]]))  # where what is seen ends
    axes.add_collection(LineCollection(rim, colors=outline, linewidths=1.6, capstyle="round", zorder=order))
    drawn: Any = view.flat(corners[seen])  # one array: a list of them takes three times as long
    axes.add_collection(PolyCollection(drawn, facecolors=shade, edgecolors=shade, linewidths=0.2, zorder=order))


def _coarser(bone: Surface) -> Surface:
    """Vertices of one small cube become one, as far as a picture shows."""
    middle, number = in_cubes(bone.vertices, _FINE)
    faces = number[bone.faces]
    return Surface(middle, faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)].astype(np.int32))


def _draw_landmarks(axes: Axes, view: _View, placed: FoundLandmarks) -> None:
    """Triangles that point up are the upper of two points of a kind, those that point down the lower."""
    marks = placed.landmarks
    for kind, colour in KIND_COLOURS.items():
        for marker, word in (("^", "superior"), ("v", "inferior")) if kind != "asis" else (("D", ""),):
            own = [i for i, name in enumerate(marks.names) if kind in name and word in name]
            if not own:
                continue
            label = ", ".join(filter(None, (_WORDS.get(kind, kind.replace("_", " ")), word)))
            x, y = view.flat(marks.points[own]).T
            axes.plot(x, y, marker, color=colour, ms=5.0, mew=0.5, mec="white", zorder=3, label=label)
