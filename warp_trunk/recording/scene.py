"""The trunk in space: skin in each choice of colour, bones, landmarks and the section at the worst level."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from warp_trunk.geometry.normals import MovingNormals

from . import drawing
from .colours import COLOURS, ColourName

if TYPE_CHECKING:
    from warp_trunk.case import Case
    from warp_trunk.engine.trunk_mesh import TrunkMesh
    from warp_trunk.geometry.surface import Surface
    from warp_trunk.measures import TrunkMeasures


class Log(Protocol):
    """Where drawings go: an entity, what to put there, and whether it holds for all times."""

    def __call__(self, path: str, what: Any, /, *, static: bool = False) -> None: ...


class Scene:
    """Logs new arrays only: Rerun keeps references to those it is given and writes them later."""

    def __init__(
        self, log: Log, case: Case, trunk: TrunkMesh, level: str | None, most: Mapping[ColourName, float]
    ) -> None:
        """Logs what never changes.

        Args:
            log: where to.
            case: the case, whose skin and landmarks are those before surgery.
            trunk: its mesh.
            level: the level whose section is drawn.
            most: the dark end of the scale of each colour of the skin.
        """
        import rerun as rr

        self._rr, self._log, self._case, self._trunk, self._level = rr, log, case, trunk, level
        self._most = most
        self._skin_normals = MovingNormals(case.skin.faces, len(case.skin.vertices))
        self._bone_nodes, bone_faces = np.unique(trunk.bone_faces, return_inverse=True)
        self._bone_faces = bone_faces.reshape(-1, 3).astype(np.int32)
        self._bone_normals = MovingNormals(self._bone_faces, len(self._bone_nodes))
        log("/", rr.ViewCoordinates.LBU, static=True)
        for name in most:
            self._triangles(f"now/skin/{name}", case.skin.faces, None)
            self._scale(name)
        self._triangles("now/bones", self._bone_faces, drawing.BONE)
        self._sides()

    def still(self, when: str, skin: Surface, displacement: np.ndarray, landmarks: np.ndarray) -> None:
        """Logs a trunk that does not move, `before` or `target`, without a time."""
        same = skin.faces is self._case.skin.faces
        normals = self._skin_normals if same else MovingNormals(skin.faces, len(skin.vertices))
        self._triangles(f"{when}/skin", skin.faces, drawing.SKIN)
        self._move(f"{when}/skin", np.array(skin.vertices, np.float32), normals, static=True)
        self._triangles(f"{when}/bones", self._bone_faces, drawing.BONE)
        self._bones(when, displacement, static=True)
        self._landmarks(when, landmarks, static=True)

    def now(
        self, displacement: np.ndarray, landmarks: np.ndarray, values: Mapping[ColourName, np.ndarray]
    ) -> None:
        """Logs bones, landmarks and the skin in the colours of its values."""
        self.skin(displacement, values)
        self._bones("now", displacement, static=False)
        self._landmarks("now", landmarks, static=False)

    def skin(self, displacement: np.ndarray, values: Mapping[ColourName, np.ndarray]) -> None:
        """Logs the skin alone, once for each choice of colour."""
        moved = (self._case.skin.vertices + displacement[self._trunk.skin_nodes]).astype(np.float32)
        normals = self._skin_normals(moved)
        for name, value in values.items():
            mesh = self._rr.Mesh3D.from_fields(
                vertex_positions=moved,
                vertex_normals=normals,
                vertex_colors=COLOURS[name].painted(value, self._most[name]),
            )
            self._log(f"now/skin/{name}", mesh)

    def section(self, when: str, measures: TrunkMeasures, colour: tuple[int, int, int], *, static: bool) -> None:
        """Logs outline and tangent at the worst level, in space and as a picture seen from above."""
        rr, tangent = self._rr, measures.tangents.get(self._level) if self._level else None
        curves = drawing.section_curves(tangent)
        spatial = [drawing.at_height(curve, tangent.height) for curve in curves] if tangent else []
        self._log(f"{when}/section", rr.LineStrips3D(spatial, radii=1.2, colors=colour), static=static)
        flat = [drawing.seen_from_above(curve) for curve in curves]
        strips = rr.LineStrips2D(flat, radii=rr.Radius.ui_points(1.5), colors=colour)
        self._log(f"section/{when}", strips, static=static)
        low, high = self._case.skin.vertices[:, :2].min(axis=0), self._case.skin.vertices[:, :2].max(axis=0)
        across = {"before": high[0], "target": (low[0] + high[0]) / 2.0, "now": low[0]}[when]
        at = [[-across, high[1] + 5.0]] if tangent else []  # clear of the outlines
        texts = [f"{'actual' if when == 'target' else when} {drawing.degrees(tangent.angle)}"] if tangent else []
        angle = rr.Points2D(at, radii=0.0, colors=colour, labels=texts, show_labels=True)
        self._log(f"section/{when}/angle", angle, static=static)

    def _bones(self, when: str, displacement: np.ndarray, *, static: bool) -> None:
        moved = (self._trunk.nodes + displacement)[self._bone_nodes].astype(np.float32)
        self._move(f"{when}/bones", moved, self._bone_normals, static=static)

    def _landmarks(self, when: str, points: np.ndarray, *, static: bool) -> None:
        points3d = self._rr.Points3D(
            np.array(points, np.float32),
            radii=2.5,
            colors=drawing.NOW,
            labels=list(self._case.landmarks_before.names),
            show_labels=False,
        )
        self._log(f"{when}/landmarks", points3d, static=static)

    def _triangles(self, path: str, faces: np.ndarray, colour: tuple[int, int, int] | None) -> None:
        mesh = self._rr.Mesh3D.from_fields(triangle_indices=faces.astype(np.uint32), albedo_factor=colour)
        self._log(path, mesh, static=True)

    def _move(self, path: str, vertices: np.ndarray, normals: MovingNormals, *, static: bool) -> None:
        mesh = self._rr.Mesh3D.from_fields(vertex_positions=vertices, vertex_normals=normals(vertices))
        self._log(path, mesh, static=static)

    def _sides(self) -> None:
        """Says in space which side of the patient is which, from wherever it is seen."""
        low, high = self._case.skin.vertices.min(axis=0), self._case.skin.vertices.max(axis=0)
        deep, at = (low[1] + high[1]) / 2.0, low[2] + 0.08 * (high[2] - low[2])
        sides = self._rr.Points3D(
            np.array([[high[0] + 20.0, deep, at], [low[0] - 20.0, deep, at]], np.float32),
            radii=0.0,
            colors=drawing.TEXT,
            labels=["left", "right"],
            show_labels=True,
        )
        self._log("sides", sides, static=True)

    def _scale(self, name: ColourName) -> None:
        """The scale of a colour, 1000 wide, with its title and numbers."""
        rr, colour, most = self._rr, COLOURS[name], self._most[name]
        edge = np.linspace(0.0, 1000.0, 101)
        pieces = np.stack([np.column_stack([edge[k : k + 100], np.zeros(100)]) for k in (0, 1)], axis=1)
        least = -most if colour.signed else 0.0
        shades = colour.painted(np.linspace(least, most, 100), most)
        self._log(
            f"scale/{name}", rr.LineStrips2D(pieces.astype(np.float32), radii=14.0, colors=shades), static=True
        )
        texts = [f"{value:.3g} {colour.unit}" for value in (least, (least + most) / 2.0, most)]
        marks = rr.Points2D(
            [[0.0, 16.0], [500.0, 16.0], [1000.0, 16.0]],  # a label hangs below its point
            radii=0.0,
            colors=drawing.TEXT,
            labels=texts,
            show_labels=True,
        )
        self._log(f"scale/{name}/marks", marks, static=True)
