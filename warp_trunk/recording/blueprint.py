"""How the Rerun viewer lays a recording out when it opens."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from . import drawing
from .colours import COLOURS, ColourName

if TYPE_CHECKING:
    from warp_trunk.case import Case
    from warp_trunk.measures import TrunkMeasures

FOV = np.radians(53.0)
"""The angle that a pane of the viewer sees from top to bottom, less a margin."""
GLASS = (255, 222, 200, 80)
"""Skin that shows what is behind it."""


def layout(
    case: Case, before: TrunkMeasures, colours: Sequence[ColourName], *, target: str, unit: str, tab: int = 0
) -> Any:
    """Before, now and target side by side; below them section, rotations, table and plots.

    Args:
        case: the case that is simulated.
        before: its measures before surgery.
        colours: the choice of colours of the skin, a tab for each; one more shows the spine through the skin.
        target: what the third picture holds: actual (the skin after surgery) or target (the planned spine).
        unit: of the energy.
        tab: the tab that is open.
    """
    import rerun.blueprint as rrb

    trunk, bones = partial(_trunk, case), "spine" if before.bsr else "bones"
    aim = "Actual, after surgery" if target == "actual" else f"Target: the planned {bones}"

    def third() -> Any:
        if target == "actual":
            return trunk(aim, "/target/skin")
        return trunk(aim, "/target/bones", "/target/skin", glass="/target/skin")

    skin = f"/now/skin/{colours[0]}"
    through = rrb.Horizontal(
        trunk("Before", "/before/bones", "/before/section", "/before/skin", glass="/before/skin"),
        trunk("Now", "/now/bones", "/now/section", skin, glass=skin, vertex_colors=drawing.SKIN),
        trunk(aim, "/target/bones", "/target/skin", glass="/target/skin"),
        name=f"{bones.capitalize()} through the skin",
    )
    coloured = [
        rrb.Vertical(
            rrb.Horizontal(trunk("Before", "/before/skin"), trunk("Now", f"/now/skin/{name}"), third()),
            _scale(name),
            row_shares=[12, 2],
            name=COLOURS[name].tab,
        )
        for name in colours
    ]
    of_spine = [_section(case, before), _bars(before)] if before.bsr else []
    return rrb.Blueprint(
        rrb.Vertical(
            rrb.Tabs(*coloured, through, active_tab=tab),
            rrb.Horizontal(*of_spine, _plots(unit), _texts(), column_shares=[*[4] * len(of_spine), 3, 5]),
            row_shares=[8, 5],
        ),
        *_panels(),
    )


def _trunk(case: Case, name: str, *contents: str, glass: str = "", **override: Any) -> Any:
    """A view of its own each time: the viewer wants no view, and no override, in two places."""
    import rerun as rr
    import rerun.blueprint as rrb

    return rrb.Spatial3DView(
        origin="/",
        name=name,
        contents=[*contents, "/sides"],
        eye_controls=_behind_and_above(case),
        line_grid=False,
        overrides={glass: rr.Mesh3D.from_fields(albedo_factor=GLASS, **override)} if glass else None,
    )


def _panels() -> tuple[Any, ...]:
    """The viewer's own panels, out of the way; the increments can be played."""
    import rerun.blueprint as rrb

    time = rrb.TimePanel(state="collapsed", timeline="increment", fps=2.0)
    return rrb.BlueprintPanel(state="collapsed"), rrb.SelectionPanel(state="collapsed"), time


def _scale(name: ColourName) -> Any:
    """The legend of the colours."""
    import rerun.blueprint as rrb

    bounds = rrb.VisualBounds2D(x_range=(-1300.0, 2300.0), y_range=(-20.0, 84.0))
    return rrb.Spatial2DView(origin=f"/scale/{name}", name=COLOURS[name].red, visual_bounds=bounds)


def _behind_and_above(case: Case) -> Any:
    """The eye from which a pane shows the whole back, or the front where there is no spine."""
    import rerun.blueprint as rrb

    low, high = case.skin.vertices.min(axis=0), case.skin.vertices.max(axis=0)
    centre, tall = (low + high) / 2.0, float((high - low)[[0, 2]].max())
    away = np.array([0.0, 1.0 if case.landmarks_before.names else -1.0, 0.25]) / np.hypot(1.0, 0.25)
    distance = high[1] - centre[1] + 0.5 * tall / np.tan(FOV / 2.0)
    return rrb.EyeControls3D(
        kind=rrb.Eye3DKind.Orbital,
        position=centre + distance * away,
        look_target=centre,
        eye_up=(0.0, 0.0, 1.0),
    )


def _section(case: Case, before: TrunkMeasures) -> Any:
    import rerun.blueprint as rrb

    low, high = case.skin.vertices.min(axis=0), case.skin.vertices.max(axis=0)
    middle, wide = -(low[0] + high[0]) / 2.0, 0.75 * (high - low)[0]  # with the labels on either side
    return rrb.Spatial2DView(
        origin="/section",
        name=f"Section at {before.worst_level} from above, back below",
        visual_bounds=rrb.VisualBounds2D(
            x_range=(middle - wide, middle + wide), y_range=(low[1] - 20.0, high[1] + 50.0)
        ),
    )


def _bars(before: TrunkMeasures) -> Any:
    import rerun.blueprint as rrb

    plot = drawing.BarPlot.of(before.bsr)
    bounds = rrb.VisualBounds2D(x_range=(0.0, plot.width), y_range=(-1.0, len(plot.levels) + 3.0))
    return rrb.Spatial2DView(
        origin="/bars",
        name="Rotation of the back",
        visual_bounds=bounds,
    )


def _plots(unit: str) -> Any:
    import rerun.blueprint as rrb

    return rrb.Tabs(
        rrb.TimeSeriesView(origin="/energy", name=f"Energy [{unit}]", plot_legend=rrb.Corner2D.LeftTop),
        rrb.TimeSeriesView(origin="/error", name="Error [log10 mm]"),
        rrb.TimeSeriesView(origin="/bsr", name="Rotation [°]"),
    )


def _texts() -> Any:
    import rerun.blueprint as rrb

    return rrb.Tabs(
        rrb.TextDocumentView(origin="/table", name="Summary"),
        rrb.TextDocumentView(origin="/summary", name="Report"),
    )
