"""The layout of a recording when the Rerun viewer opens it. Imports Rerun, which is heavy."""

from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from warp_trunk.case import Case
from warp_trunk.measures import TrunkMeasures
from warp_trunk.views.clothing import COLOURS

from .colours import GROUND, SKIN
from .numbers import BarPlot

FOV = np.radians(53.0)
"""The angle that a pane of the viewer sees from top to bottom, less a margin."""
GLASS = (255, 222, 200, 80)
"""Skin that shows what is behind it."""


def layout(case: Case, before: TrunkMeasures, *, actual: bool, unit: str) -> Any:
    """Skins and bones side by side; below them section, rotations and plots, beside them the numbers.

    Args:
        case: the case that is simulated.
        before: its measures before surgery.
        actual: whether the target is the actual skin after surgery, or the planned spine.
        unit: of the energy.
    """
    bones = "spine" if before.bsr else "bones"
    aim = "Actual, after surgery" if actual else f"The planned {bones}"
    low, high = case.skin.vertices.min(axis=0), case.skin.vertices.max(axis=0)
    eye = _eye(low, high, behind=bool(case.landmarks_before.names))

    def trunk(name: str, when: str, *inside: str, skinned: bool = True, **override: Any) -> Any:
        """A view of its own each time: the viewer wants none in two places. Bones are seen through the skin."""
        skin, contents = f"/{when}/skin", [f"/{when}/{name}" for name in inside]
        if contents:
            override = {"albedo_factor": GLASS, "vertex_colors": SKIN}
        worn = [f"/{when}/{part}" for part in COLOURS] if case.has_spine else []
        return rrb.Spatial3DView(
            origin="/",
            name=name,
            contents=[*contents, *([skin, *worn] if skinned else []), "/sides"],
            eye_controls=eye,
            line_grid=False,
            background=GROUND,
            overrides={skin: rr.Mesh3D.from_fields(**override)} if override else None,
        )

    third = [trunk(aim, "target")] if actual else []
    scale = rrb.Spatial2DView(
        origin="/scale",
        name="How far the back stands behind its other side" if before.bsr else "Displacement from before surgery",
        visual_bounds=rrb.VisualBounds2D(x_range=(-1300.0, 2300.0), y_range=(-20.0, 84.0)),
        background=GROUND,
    )
    coloured = rrb.Vertical(
        rrb.Horizontal(
            trunk("Before", "before"),
            trunk("Now", "now"),
            *third,
            trunk(f"The {bones} now", "now", "bones", "section", "levels/**"),
        ),
        scale,
        row_shares=[12, 2],
        name="Hump" if before.bsr else "Displacement",
    )
    through = rrb.Horizontal(
        trunk("Before", "before", "bones", "section", "levels/**"),
        trunk("Now", "now", "bones", "section", "levels/**"),
        trunk(aim, "target", "bones", "levels/**", skinned=actual),  # the skin of the spline is no goal
        name=f"{bones.capitalize()} through the skin",
    )
    own = case.skin.colours
    scanned = rrb.Horizontal(
        *(trunk(when.capitalize(), when, vertex_colors=own) for when in ("before", "now")), name="Own colours"
    )
    of_spine = [_section(low, high, before.worst_level), _bars(before)] if before.bsr else []
    rotation = rrb.TimeSeriesView(origin="/bsr", name="Rotation [°]")
    plots = rrb.Tabs(
        *([rotation] if before.bsr else []),
        rrb.TimeSeriesView(origin="/energy", name=f"Energy [{unit}]", plot_legend=rrb.Corner2D.LeftTop),
        rrb.TimeSeriesView(origin="/error", name="Error [log10 mm]"),
        active_tab=0,
    )
    texts = rrb.Tabs(
        rrb.TextDocumentView(origin="/table", name="Summary"),
        *([rrb.TextDocumentView(origin="/levels", name="Rotation by level")] if before.bsr else []),
        rrb.TextDocumentView(origin="/summary", name="Report"),
        active_tab=0,
    )
    pictures = rrb.Tabs(coloured, through, *([] if own is None else [scanned]), active_tab=0)
    below = rrb.Horizontal(*of_spine, plots, column_shares=[*[3, 4][: len(of_spine)], 4])
    return rrb.Blueprint(
        rrb.Horizontal(rrb.Vertical(pictures, below, row_shares=[7, 6]), texts, column_shares=[7, 3]),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline="increment", fps=2.0),  # the increments can be played
    )


def _eye(low: np.ndarray, high: np.ndarray, *, behind: bool) -> Any:
    """The eye from which a pane shows the whole back, or the front where there is no spine."""
    centre, tall = (low + high) / 2.0, float((high - low)[[0, 2]].max())
    away = np.array([0.0, 1.0 if behind else -1.0, 0.25]) / np.hypot(1.0, 0.25)
    distance = high[1] - centre[1] + 0.5 * tall / np.tan(FOV / 2.0)
    position = centre + distance * away
    return rrb.EyeControls3D(
        kind=rrb.Eye3DKind.Orbital, position=position, look_target=centre, eye_up=(0.0, 0.0, 1.0)
    )


def _section(low: np.ndarray, high: np.ndarray, level: str | None) -> Any:
    middle, wide = -(low[0] + high[0]) / 2.0, 0.95 * (high - low)[0]  # with the labels on either side
    bounds = rrb.VisualBounds2D(x_range=(middle - wide, middle + wide), y_range=(low[1] - 90.0, high[1] + 50.0))
    return rrb.Spatial2DView(
        origin="/section", name=f"Section at {level}", visual_bounds=bounds, background=GROUND
    )


def _bars(before: TrunkMeasures) -> Any:
    plot = BarPlot(before.bsr)
    bounds = rrb.VisualBounds2D(x_range=(0.0, plot.width), y_range=(-1.0, len(plot.levels) + 4.2))
    return rrb.Spatial2DView(origin="/bars", name="Rotation of the back", visual_bounds=bounds, background=GROUND)
