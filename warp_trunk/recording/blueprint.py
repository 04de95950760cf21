"""How the Rerun viewer lays a recording out when it opens."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from ..case import Case
    from ..measures import TrunkMeasures


def layout(case: Case, before: TrunkMeasures) -> Any:
    """Before and now from behind and slightly above; beside them the section, rotations and energies."""
    import rerun.blueprint as rrb

    low, high = case.skin.vertices.min(axis=0), case.skin.vertices.max(axis=0)
    centre, tall = (low + high) / 2.0, float((high - low).max())
    eye = rrb.EyeControls3D(
        kind=rrb.Eye3DKind.Orbital,
        position=centre + tall * np.array([0.0, 1.2, 0.25]),
        look_target=centre,
        eye_up=(0.0, 0.0, 1.0),
    )

    def trunk_view(name: str, *contents: str) -> Any:
        return rrb.Spatial3DView(origin="/", name=name, contents=list(contents), eye_controls=eye, line_grid=False)

    middle, around = -centre[0], 0.6 * float((high - low)[:2].max())
    largest = largest_bar(before)
    pictures = rrb.Tabs(
        rrb.Horizontal(
            trunk_view("Before surgery", "/before/skin"),
            trunk_view("Now", "/now/skin"),
            name="Back",
        ),
        rrb.Horizontal(
            trunk_view("Spine before surgery", "/before/bones", "/before/sections"),
            trunk_view("Spine now", "/now/bones", "/now/landmarks", "/now/sections"),
            name="Spine",
        ),
    )
    numbers = rrb.Vertical(
        rrb.Tabs(
            rrb.Spatial2DView(
                origin="/section",
                name=f"Section at {before.worst_level}, from above, back below",
                visual_bounds=rrb.VisualBounds2D(
                    x_range=(middle - around, middle + around),
                    y_range=(low[1] - 0.2 * around, high[1] + 0.2 * around),
                ),
            ),
            rrb.TextDocumentView(origin="/summary", name="Summary"),
        ),
        rrb.Spatial2DView(
            origin="/bars",
            name="Rotation of the back now [degrees]; grey before, blue now; to the right: hump on the right",
            visual_bounds=rrb.VisualBounds2D(x_range=(-largest, largest), y_range=(-1.0, len(before.bsr))),
        ),
        rrb.Tabs(
            rrb.TimeSeriesView(origin="/energy", name="Energy"),
            rrb.TimeSeriesView(origin="/error", name="Estimated error [mm]"),
            rrb.TimeSeriesView(origin="/bsr", name="Rotation by level [degrees]"),
        ),
        rrb.Spatial2DView(
            origin="/scale",
            name="Change of the skin: dark red moved furthest",
            visual_bounds=rrb.VisualBounds2D(x_range=(-30.0, 230.0), y_range=(-15.0, 30.0)),
        ),
        row_shares=[4, 5, 3, 1],
    )
    return rrb.Blueprint(
        rrb.Horizontal(pictures, numbers, column_shares=[5, 3]),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline="increment", fps=2.0),
    )


def largest_bar(before: TrunkMeasures) -> float:
    """Half the width of the plot of rotations [degrees]."""
    return 1.2 * max((abs(a) for a in before.bsr.values() if a is not None), default=10.0) + 3.0
