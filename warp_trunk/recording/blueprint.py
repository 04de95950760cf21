"""The layout of a recording when the Rerun viewer opens it. Imports Rerun, which is heavy."""

from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from warp_trunk.case import Case
from warp_trunk.measures import TrunkMeasures

from .colours import SKIN
from .numbers import BarPlot

FOV = np.radians(53.0)
"""The angle that a pane of the viewer sees from top to bottom, less a margin."""
GLASS = (255, 222, 200, 80)
"""Skin that shows what is behind it."""
NOW_SKIN = "/now/skin/displacement"


def layout(case: Case, before: TrunkMeasures, *, target: str, unit: str) -> Any:
    """Before, now and target side by side; below them section, rotations, table and plots.

    Args:
        case: the case that is simulated.
        before: its measures before surgery.
        target: what the third picture holds: actual (the skin after surgery) or target (the planned spine).
        unit: of the energy.
    """
    bones = "spine" if before.bsr else "bones"
    aim = "Actual, after surgery" if target == "actual" else f"Target: the planned {bones}"
    low, high = case.skin.vertices.min(axis=0), case.skin.vertices.max(axis=0)
    eye = _eye(low, high, behind=bool(case.landmarks_before.names))

    def trunk(name: str, *contents: str, glass: str = "", **override: Any) -> Any:
        """A view of its own each time: the viewer wants no view, and no override, in two places."""
        see_through: Any = {glass: rr.Mesh3D.from_fields(albedo_factor=GLASS, **override)} if glass else None
        return rrb.Spatial3DView(
            origin="/", name=name, contents=[*contents, "/sides"], eye_controls=eye, line_grid=False,
            overrides=see_through,
        )  # fmt: skip

    def planned() -> Any:
        return trunk(aim, "/target/bones", "/target/skin", glass="/target/skin")

    through = rrb.Horizontal(
        trunk("Before", "/before/bones", "/before/section", "/before/skin", glass="/before/skin"),
        trunk("Now", "/now/bones", "/now/section", NOW_SKIN, glass=NOW_SKIN, vertex_colors=SKIN),
        planned(),
        name=f"{bones.capitalize()} through the skin",
    )
    third = trunk(aim, "/target/skin") if target == "actual" else planned()
    scale = rrb.Spatial2DView(
        origin="/scale/displacement",
        name="Displacement from before surgery: dark red moved furthest",
        visual_bounds=rrb.VisualBounds2D(x_range=(-1300.0, 2300.0), y_range=(-20.0, 84.0)),
    )
    coloured = rrb.Vertical(
        rrb.Horizontal(trunk("Before", "/before/skin"), trunk("Now", NOW_SKIN), third),
        scale,
        row_shares=[12, 2],
        name="Displacement",
    )
    of_spine = [_section(low, high, before.worst_level), _bars(before)] if before.bsr else []
    plots = rrb.Tabs(
        rrb.TimeSeriesView(origin="/energy", name=f"Energy [{unit}]", plot_legend=rrb.Corner2D.LeftTop),
        rrb.TimeSeriesView(origin="/error", name="Error [log10 mm]"),
        rrb.TimeSeriesView(origin="/bsr", name="Rotation [°]"),
    )
    texts = rrb.Tabs(
        rrb.TextDocumentView(origin="/table", name="Summary"),
        rrb.TextDocumentView(origin="/summary", name="Report"),
    )
    return rrb.Blueprint(
        rrb.Vertical(
            rrb.Tabs(coloured, through, active_tab=0),
            rrb.Horizontal(*of_spine, plots, texts, column_shares=[*[4] * len(of_spine), 3, 5]),
            row_shares=[8, 5],
        ),
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
    middle, wide = -(low[0] + high[0]) / 2.0, 0.75 * (high - low)[0]  # with the labels on either side
    bounds = rrb.VisualBounds2D(x_range=(middle - wide, middle + wide), y_range=(low[1] - 20.0, high[1] + 50.0))
    name = f"Section at {level} from above, back below"
    return rrb.Spatial2DView(origin="/section", name=name, visual_bounds=bounds)


def _bars(before: TrunkMeasures) -> Any:
    plot = BarPlot(before.bsr)
    bounds = rrb.VisualBounds2D(x_range=(0.0, plot.width), y_range=(-1.0, len(plot.levels) + 3.0))
    return rrb.Spatial2DView(origin="/bars", name="Rotation of the back", visual_bounds=bounds)
