"""The trunk in space: skin, bones, landmarks and the section at the worst level. Imports Rerun, which is heavy."""

from collections.abc import Callable
from typing import Any

import numpy as np
import rerun as rr

from warp_trunk.bone_motion.plan import fused_levels, plan_in
from warp_trunk.case import Case
from warp_trunk.case.landmarks import Landmarks
from warp_trunk.engine.trunk_mesh import TrunkMesh
from warp_trunk.geometry.surface import Surface, vertex_normals
from warp_trunk.measures import TrunkMeasures
from warp_trunk.measures.number_text import sided
from warp_trunk.measures.quantities import ACTUAL, MeasureTable
from warp_trunk.views.clothing import COLOURS, Garment
from warp_trunk.views.hump import SCALE_END, hump_palette

from .colours import BONE, FUSED, GREY, LABELS, NOW, TEXT, displacement_paint, hump_paint, painted, striped
from .numbers import apart

BESIDE = 85.0
"""The names of the sides are this far from the skin, so that their boxes lie on the ground [mm]."""


class Scene:
    """Logs new arrays only: Rerun keeps references to those it is given and writes them later."""

    def __init__(
        self, log: Callable[..., None], case: Case, trunk: TrunkMesh, before: TrunkMeasures, most: float
    ) -> None:
        """Logs what never changes.

        Args:
            log: receives an entity, its content, and whether it holds for all times.
            case: the case, whose skin and landmarks are those before surgery.
            trunk: its mesh.
            before: measures before surgery; the section at its worst level is drawn.
            most: displacement at the dark end of the colours of the skin of a part without a spine [mm].
        """
        self._log, self._case, self._trunk, self._level = log, case, trunk, before.worst_level
        if case.has_spine:
            self._paint, shades = hump_paint(case), np.round(255.0 * hump_palette()).astype(np.uint8)
            texts = [f"over {SCALE_END:g} mm forward", "as the other side", f"over {SCALE_END:g} mm back"]
        else:
            self._paint, shades = displacement_paint(case.skin, most), painted(np.linspace(0.0, 1.0, 100), 1.0)
            texts = [f"{value:.3g} mm" for value in (0.0, most / 2.0, most)]
        self._bone_nodes, bone_faces = np.unique(trunk.bone_faces, return_inverse=True)
        self._bone_faces = bone_faces.reshape(-1, 3).astype(np.uint32)
        self._worn: dict[str, Garment] = {}
        plan = plan_in(case.plan_text)
        self._fused = () if plan is None else fused_levels(plan)
        levels = [*case.landmarks_before.vertebrae()] if case.has_spine else []
        ends = [level for level in (*self._fused[:1], *self._fused[-1:]) if level in levels]
        self._levels = apart(levels, ends, 3)
        self._fused_bones = [row for row, name in enumerate(trunk.bone_names) if name in self._fused]
        low, high = self._low, self._high = case.skin.vertices.min(axis=0), case.skin.vertices.max(axis=0)
        log("/", rr.ViewCoordinates.LBU, static=True)
        faces = case.skin.faces.astype(np.uint32)
        log("now/skin", rr.Mesh3D.from_fields(triangle_indices=faces), static=True)
        self._dress("now", case.skin, case.landmarks_before)
        deep, at = (low[1] + high[1]) / 2.0, low[2] + 0.08 * (high[2] - low[2])
        sides = np.array([[high[0] + BESIDE, deep, at], [low[0] - BESIDE, deep, at]], np.float32)
        labels: dict[str, Any] = {"radii": 0.0, "colors": TEXT, "show_labels": True}
        if self._level:
            place = [[-(low[0] + high[0]) / 2.0, low[1] - 70.0]]
            log(
                "section/axes",
                rr.Points2D(place, labels=["from above: front above, back below"], **labels),
                static=True,
            )
        log("sides", rr.Points3D(sides, labels=["left", "right"], **labels), static=True)
        places = np.linspace(0.0, 1000.0, len(shades) + 1)
        edge = np.column_stack([places, np.zeros_like(places)]).astype(np.float32)
        strips = rr.LineStrips2D(np.stack([edge[:-1], edge[1:]], axis=1), radii=14.0, colors=shades)
        log("scale", strips, static=True)
        at = [[0.0, 16.0], [500.0, 16.0], [1000.0, 16.0]]
        if case.unseen is not None:
            at, texts = [*at, [1700.0, 16.0]], [*texts, "striped: not measured"]
        marks = rr.Points2D(at, labels=texts, **labels)
        log("scale/marks", marks, static=True)  # a label hangs below its point
        for when in ("before", "now", "target"):
            joined = np.isin(trunk.bone[self._bone_nodes], self._fused_bones) & (when != "before")
            bones = rr.Mesh3D.from_fields(
                triangle_indices=self._bone_faces.copy(),
                vertex_colors=np.where(joined[:, None], FUSED, BONE).astype(np.uint8),
            )
            log(f"{when}/bones", bones, static=True)

    def still(self, when: str, skin: Surface, displacement: np.ndarray, landmarks: np.ndarray) -> None:
        """Logs a trunk that does not move, `before` or `target`, without a time."""
        triangles = rr.Mesh3D.from_fields(triangle_indices=skin.faces.astype(np.uint32))
        self._log(f"{when}/skin", triangles, static=True)
        self._dress(when, skin, Landmarks(self._case.landmarks_before.names, landmarks))
        self._trunk_at(when, skin, displacement, landmarks, static=True)

    def _dress(self, when: str, skin: Surface, landmarks: Landmarks) -> None:
        """Logs the triangles of what the patient wears; a part without a spine is not dressed."""
        if not self._case.has_spine:
            return
        scanned = skin.vertices.shape != self._case.skin.vertices.shape  # another skin: the actual one
        garment = self._worn.get("now") if not scanned else None
        self._worn[when] = garment = garment or Garment(skin, landmarks)
        for name, faces in garment.faces.items():
            triangles = faces.astype(np.uint32)
            cloth = rr.Mesh3D.from_fields(triangle_indices=triangles, albedo_factor=COLOURS[name])
            self._log(f"{when}/{name}", cloth, static=True)

    def now(self, displacement: np.ndarray, landmarks: np.ndarray) -> None:
        """Logs bones, landmarks and the skin in its colours."""
        skin, way = self._case.skin, displacement[self._trunk.skin_nodes]
        if way.any():
            skin = skin.moved(skin.vertices + way)
        self._trunk_at("now", skin, displacement, landmarks, static=False)

    def _trunk_at(
        self, when: str, skin: Surface, displacement: np.ndarray, landmarks: np.ndarray, *, static: bool
    ) -> None:
        names = self._case.landmarks_before.names
        mesh = rr.Mesh3D.from_fields(
            vertex_positions=np.array(skin.vertices, np.float32),
            vertex_normals=vertex_normals(skin),
            vertex_colors=self._paint(skin, Landmarks(names, landmarks)),
        )
        self._log(f"{when}/skin", mesh, static=static)
        if garment := self._worn.get(when):
            for name, places in garment.on(skin.vertices).items():
                normals, hatched = vertex_normals(Surface(places, garment.faces[name])), None
                if name == "shirt" and self._case.unseen is not None:  # what it covers was not measured
                    hatched = striped(places, COLOURS[name], GREY).astype(np.uint8)
                cloth = rr.Mesh3D.from_fields(
                    vertex_positions=places.astype(np.float32), vertex_normals=normals, vertex_colors=hatched
                )
                self._log(f"{when}/{name}", cloth, static=static)
        moved = (self._trunk.nodes + displacement)[self._bone_nodes].astype(np.float32)
        normals = vertex_normals(Surface(moved, self._bone_faces))
        bones = rr.Mesh3D.from_fields(vertex_positions=moved, vertex_normals=normals)
        self._log(f"{when}/bones", bones, static=static)
        points = np.array(landmarks, np.float32)
        drawn = rr.Points3D(points, radii=2.5, colors=NOW, labels=list(names), show_labels=False)
        self._log(f"{when}/landmarks", drawn, static=static)
        if self._case.has_spine:
            marks = Landmarks(names, landmarks)
            middle_of = dict(zip(marks.vertebrae(), marks.middles(), strict=True))
            middles = np.array([middle_of[level] for level in self._levels], np.float32).reshape(-1, 3)
            beside = middles.copy()
            beside[:, 0] = self._low[0] - BESIDE
            joined = self._fused if when != "before" else ()
            colours = [LABELS[FUSED if level in joined else TEXT] for level in self._levels]
            levels = rr.Points3D(beside, radii=0.0, colors=colours, labels=self._levels, show_labels=True)
            self._log(f"{when}/levels", levels, static=static)
            leaders = rr.LineStrips3D(np.stack([middles, beside], axis=1), radii=0.4, colors=GREY)
            self._log(f"{when}/levels/leaders", leaders, static=static)

    def section(
        self,
        state: str,
        measures: TrunkMeasures,
        table: MeasureTable,
        colour: tuple[int, int, int],
        *,
        static: bool,
    ) -> None:
        """Logs outline and tangent at the worst level, in space and as a picture seen from above.

        Args:
            state: before, now or actual.
            measures: of the trunk in this state.
            table: has the rotation that is written beside the picture.
            colour: of the lines.
            static: whether they hold for all times.
        """
        when = "target" if state == ACTUAL else state
        spatial, flat, at, texts = [], [], [], []
        if self._level and (tangent := measures.tangents.get(self._level)):
            curves = [np.vstack([tangent.outline, tangent.outline[:1]]), tangent.line]
            spatial = [np.column_stack([c, np.full(len(c), tangent.height)]).astype(np.float32) for c in curves]
            flat = [(curve * [-1.0, 1.0]).astype(np.float32) for curve in curves]  # left on the left, back below
            low, high = self._low, self._high
            across = {"before": high[0], "target": (low[0] + high[0]) / 2.0, "now": low[0]}[when]
            at = [[-across, high[1] + 5.0]]  # clear of the outlines
            texts = [f"{state} {sided(table.value(state, 'bsr_deg', self._level))}"]
        self._log(f"{when}/section", rr.LineStrips3D(spatial, radii=1.2, colors=colour), static=static)
        strips = rr.LineStrips2D(flat, radii=rr.Radius.ui_points(1.5), colors=colour)
        self._log(f"section/{when}", strips, static=static)
        label = rr.Points2D(at, radii=0.0, colors=LABELS[colour], labels=texts, show_labels=True)
        self._log(f"section/{when}/angle", label, static=static)
