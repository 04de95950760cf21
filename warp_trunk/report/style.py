"""How the report's pictures look, and how they become files."""

from __future__ import annotations

import io
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal

from warp_trunk.case.landmarks import Landmarks
from warp_trunk.geometry.surface import Surface
from warp_trunk.measures import TrunkMeasures, quantities
from warp_trunk.measures.quantities import Measured, MeasureTable
from warp_trunk.views.clothing import cloth_of, soft, softened

if TYPE_CHECKING:
    import numpy as np
    from matplotlib.figure import Figure

INK, FAINT = "#222222", "#6e6e6e"
RC: dict[Any, Any] = {
    "font.size": 9.0,
    "text.color": INK,
    "axes.labelcolor": INK,
    "axes.edgecolor": FAINT,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "axes.titlesize": 10.5,
    "axes.titley": 1.0,  # to look for what is in its way takes a fifth of the time
    "xtick.color": INK,
    "ytick.color": INK,
    "grid.color": "#dddddd",
    "grid.linewidth": 0.6,
    "legend.frameon": False,
    "svg.fonttype": "path",  # looks the same where the font is missing
    "svg.hashsalt": "warp-trunk",  # the same picture is the same file
}
"""Settings of matplotlib in which all pictures are drawn and written."""
_PATH, _DIGITS = re.compile(rb'(?: d| x| y)="[^"]*"|translate\([^)]*\)'), re.compile(rb"(\.\d)\d+")
"""Places in an SVG, and numbers with more digits than can be seen: a tenth of a point is 0.04 mm on paper."""
_EMPTY = re.compile(rb"<!--.*?-->|(?<=>)\s+(?=<)|\n(?=[LCQz])")
"""Parts that an SVG can be without."""


@dataclass(frozen=True)
class Look:
    """The style of one state of the trunk; mark and line distinguish it without colour too."""

    title: str
    """Its name."""
    colour: str
    """Colours differ for every kind of colour vision and, by their lightness, in print without colour."""
    marker: str
    """Its points."""
    line: str
    """Its lines."""
    spine: str = "planned"
    """The name of its spine: that of a prediction is planned."""
    state: str = quantities.PREDICTED
    """The name of the state in a table of numbers."""

    @property
    def heading(self) -> str:
        """Its title with a capital."""
        return self.title[:1].upper() + self.title[1:]


BEFORE = Look("before surgery", "#767676", "o", "--", "before surgery", quantities.BEFORE)
PREDICTED = Look("predicted", "#005a96", "s", "-")
BETTER = Look(quantities.BETTER, "#005a96", "s", "-")
WORSE = Look(quantities.WORSE, "#005a96", "s", "-")
ACTUAL = Look("actual, after surgery", "#bf4d00", "^", ":", state=quantities.ACTUAL)
PLANS = (
    Look("plan A", "#005a96", "s", "-", "plan A"),
    Look("plan B", "#bf4d00", "^", "-", "plan B"),
    Look("plan C", "#004d38", "D", "-", "plan C"),
    Look("plan D", "#c28a00", "v", "-", "plan D"),
)
"""Most plans in a comparison; more are hard to compare."""


@dataclass(frozen=True, eq=False)
class TrunkState:
    """One state of the trunk, as the report compares them."""

    look: Look
    """Which state it is."""
    skin: Surface
    """Its skin [mm]."""
    landmarks: Landmarks
    """The landmarks that go with it [mm]."""
    measures: TrunkMeasures
    """Where it was measured: lines, points and levels."""
    table: MeasureTable
    """Its numbers, which pictures write."""
    unseen: np.ndarray | None = None
    """1 for vertices of the skin that were not measured, else 0, shape (vertices,); None where all were."""
    worn: Worn | None = None
    """How it is shown dressed; None for a part of the body, which has no clothes."""

    def column(self, quantity: str) -> Mapping[str, Measured]:
        """The rows of a quantity by level, top to bottom."""
        return self.table.column(self.look.state, quantity)

    def main(self, quantity: str) -> Measured | None:
        """The row of a quantity that is measured at one place; None where it is missing."""
        return next(iter(self.column(quantity).values()), None)

    def number(self, quantity: str, level: str = "") -> float | None:
        """A single value; None where it is missing."""
        return self.table.value(self.look.state, quantity, level)


@dataclass(frozen=True, eq=False)
class Worn:
    """A trunk as pictures show it."""

    skin: Surface
    """Its skin, the edges of cuts rounded [mm]; same vertices."""
    cloth: np.ndarray
    """Shorts and shirt over it (`cloth_of`) [mm], shape (rows, columns, 3)."""


def dressed(poses: Sequence[TrunkState]) -> list[TrunkState]:
    """States of one trunk with their clothes; the first is before surgery, and all with its triangles are rounded
    where it is."""
    part, clothed = soft(poses[0].skin), []
    for pose in poses:
        if pose.worn is not None:
            clothed.append(pose)
            continue
        same = len(pose.skin.vertices) == len(part)
        skin = softened(pose.skin, part if same else soft(pose.skin))
        clothed.append(replace(pose, worn=Worn(skin, cloth_of(skin, pose.landmarks))))
    return clothed


def new_figure(width: float, height: float, layout: Literal["constrained"] | None = None) -> Figure:
    """An empty figure of a size in inches, which no window and no other figure knows of."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout=layout)


def file_of(figure: Figure, ending: str, source: str | None = None) -> bytes:
    """The figure as a file, 'svg' or 'png' (with its source); the same figure gives the same bytes."""
    file = io.BytesIO()
    metadata: dict[str, Any] = {"svg": {"Date": None}, "png": {"Software": None, "Source": source}}[ending]
    packing: dict[str, Any] = {"png": {"pil_kwargs": {"compress_level": 1}}}.get(ending, {})
    if (layout := figure.get_layout_engine()) is not None:  # once, not twice for each file
        layout.execute(figure)
        figure.set_layout_engine("none")
    figure.savefig(file, format=ending, dpi=200, metadata=metadata, **packing)
    return file.getvalue()


def embedded(figure: Figure, png: bytes) -> bytes:
    """The figure, with its PNG, as pages hold it: lines as a short SVG, shades as WebP of a fifth of the size."""
    from PIL import Image  # heavy

    if any(axes.images for axes in figure.axes):
        file = io.BytesIO()
        Image.open(io.BytesIO(png)).convert("RGB").save(file, "webp", quality=68, method=2)
        return file.getvalue()
    short = _PATH.sub(lambda path: _DIGITS.sub(rb"\1", path[0]), file_of(figure, "svg"))
    return _EMPTY.sub(b"", short).replace(b"DejaVuSans", b"f").replace(b"xlink:href", b"href")
