"""A recording of a simulation that the Rerun viewer steps through.

Rerun keeps references to the arrays it is given and writes them later from another thread, so everything
logged here is a new array (a test holds this).
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

import numpy as np

from ..measures import TrunkMeasures
from ..surface import Surface
from . import drawing
from .blueprint import largest_bar, layout

if TYPE_CHECKING:
    from ..case import Case
    from ..simulation import Increment
    from ..trunk_mesh import TrunkMesh

WAIT = 30.0
"""Longest wait for the disk [s]; Rerun waits for ever when it is full."""
_log = logging.getLogger("warp_trunk")


class Recording:
    """Writes an .rrd file: one method for each event of a simulation.

    The increments recorded so far can be opened even if the process is killed. If the disk fails, the
    recording stops with a warning and the simulation goes on.
    """

    def __init__(
        self,
        path: str | Path,
        case: Case,
        trunk: TrunkMesh,
        before: TrunkMeasures,
        largest_change: float,
        *,
        strict: bool = False,
    ) -> None:
        """Opens the file and records the trunk before surgery, as increment 0.

        Args:
            path: the file, which is replaced.
            case: the case that is simulated.
            trunk: its mesh.
            before: measures of the skin before surgery; its worst level is the one whose section is shown.
            largest_change: the change of the skin at the dark end of the colour scale [mm].
            strict: raise where Rerun would only warn.
        """
        import rerun as rr

        if strict:
            rr.set_strict_mode(True)
        self.path = Path(path)
        self.failed = ""
        """Why recording stopped before its end; empty if it did not."""
        self._closed = False
        self._rr, self._case, self._trunk, self._before = rr, case, trunk, before
        self._scale = max(largest_change, 1e-3)
        bone_nodes, bone_faces = np.unique(trunk.bone_faces, return_inverse=True)
        self._bone_nodes, self._bone_faces = bone_nodes, bone_faces.reshape(-1, 3).astype(np.int32)
        self._level = before.worst_level
        self._stream = rr.RecordingStream("warp_trunk", recording_id=None)
        self._stream.save(self.path)
        self._stream.send_blueprint(layout(case, before), make_active=True, make_default=True)
        self._stream.send_recording_name(case.name)
        self._once()
        self._stream.set_time("increment", sequence=0)
        self._trunk_now(case.skin, np.zeros_like(trunk.nodes), before, 0.0)
        self._flush()

    def increment(self, increment: Increment, skin: Surface, measures: TrunkMeasures) -> None:
        """Records the trunk after an increment: skin, bones, landmarks, sections, energies and rotations."""
        if self.failed:
            return
        rr, relaxation = self._rr, increment.relaxation
        self._stream.set_time("increment", sequence=increment.number)
        self._trunk_now(skin, increment.displacement, measures, increment.load_factor)
        for term in ("distance", "area", "volume", "gravity", "total"):
            self._log(f"energy/{term}", rr.Scalars(float(getattr(relaxation.energy, term))))
        self._log("error/estimated_mm", rr.Scalars(float(relaxation.estimated_error)))
        self._log("steps/steps", rr.Scalars(float(relaxation.steps)))
        self._log("steps/linear_iterations", rr.Scalars(float(relaxation.linear_iterations)))
        self._flush()

    def finish(self, text: str) -> None:
        """Records the closing text, Markdown, beside the pictures."""
        if not self.failed:
            self._log("summary", self._rr.TextDocument(text, media_type="text/markdown"), static=True)

    def close(self) -> None:
        """Completes the file; does nothing the second time."""
        if not self._closed:
            self._closed = True
            if not _within(WAIT, self._stream.disconnect):
                self._fail(f"closing took more than {WAIT:g} s")

    def __enter__(self) -> Recording:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _once(self) -> None:
        """What never changes, without a time."""
        rr, case = self._rr, self._case
        skin, nodes = case.skin, self._trunk.nodes[self._bone_nodes]
        self._log("/", rr.ViewCoordinates.LBU, static=True)
        self._log("before/skin", _mesh(rr, skin.vertices, skin.faces, drawing.SKIN), static=True)
        self._log("before/bones", _mesh(rr, nodes, self._bone_faces, drawing.BONE), static=True)
        self._log("before/landmarks", self._landmarks(case.landmarks_before.points), static=True)
        self._log("before/sections", self._sections(self._before, drawing.BEFORE), static=True)
        self._log("target/landmarks", self._landmarks(case.landmarks_after.points), static=True)
        self._log("now/skin", rr.Mesh3D.from_fields(triangle_indices=skin.faces.copy()), static=True)
        self._log(
            "now/bones",
            rr.Mesh3D.from_fields(triangle_indices=self._bone_faces.copy(), albedo_factor=drawing.BONE),
            static=True,
        )
        self._log("bars/before", self._bars(self._before, drawing.BEFORE, 0), static=True)
        self._section("section/before", self._before, drawing.BEFORE, static=True)
        self._colour_scale()
        for name in self._before.bsr:
            self._log(f"bsr/{name}", rr.SeriesLines(names=name), static=True)

    def _trunk_now(
        self, skin: Surface, displacement: np.ndarray, measures: TrunkMeasures, load_factor: float
    ) -> None:
        rr, case = self._rr, self._case
        change = np.linalg.norm(skin.vertices - case.skin.vertices, axis=1)
        self._log(
            "now/skin",
            rr.Mesh3D.from_fields(
                vertex_positions=np.array(skin.vertices, np.float32),
                vertex_normals=drawing.vertex_normals(skin.vertices, skin.faces),
                vertex_colors=drawing.change_colours(change, self._scale),
            ),
        )
        bones = self._trunk.nodes[self._bone_nodes] + displacement[self._bone_nodes]
        self._log(
            "now/bones",
            rr.Mesh3D.from_fields(
                vertex_positions=np.array(bones, np.float32),
                vertex_normals=drawing.vertex_normals(bones, self._bone_faces),
            ),
        )
        before, after = case.landmarks_before.points, case.landmarks_after.points
        self._log("now/landmarks", self._landmarks(before + load_factor * (after - before)))
        self._log("now/sections", self._sections(measures, drawing.NOW))
        self._log("bars/now", self._bars(measures, drawing.NOW, 1))
        self._log("bars/levels", self._levels(measures))
        self._section("section/now", measures, drawing.NOW, static=False)
        for level, angle in measures.bsr.items():
            if angle is not None:
                self._log(f"bsr/{level}", rr.Scalars(angle))

    def _landmarks(self, points: np.ndarray) -> Any:
        return self._rr.Points3D(
            np.array(points, np.float32),
            radii=2.5,
            colors=drawing.NOW,
            labels=list(self._case.landmarks_before.names),
            show_labels=False,
        )

    def _sections(self, measures: TrunkMeasures, colour: tuple[int, int, int]) -> Any:
        return self._rr.LineStrips3D(drawing.section_strips(measures.tangents), radii=0.8, colors=colour)

    def _section(self, path: str, measures: TrunkMeasures, colour: tuple[int, int, int], *, static: bool) -> None:
        rr, tangent = self._rr, measures.tangents.get(self._level) if self._level else None
        strips, labels, places = [], [], []
        if tangent is not None:
            curves = (drawing.closed(tangent.outline), drawing.tangent_line(tangent))
            strips = [drawing.seen_from_above(curve) for curve in curves]
            labels = [f"{path.split('/')[-1]} {tangent.angle:+.1f}°"]
            places = [strips[1][0 if static else 1]]  # the two labels at opposite ends of the tangents
        self._log(path, rr.LineStrips2D(strips, radii=1.0, colors=colour), static=static)
        self._log(f"{path}/angle", rr.Points2D(places, radii=2.0, colors=colour, labels=labels), static=static)

    def _bars(self, measures: TrunkMeasures, colour: tuple[int, int, int], place: int) -> Any:
        return self._rr.LineStrips2D(drawing.bars(measures.bsr, place), radii=0.45 * drawing.BAR, colors=colour)

    def _levels(self, measures: TrunkMeasures) -> Any:
        """Names and angles of the levels, left of their bars."""
        angles = {level: "missing" if a is None else f"{a:+.1f}°" for level, a in measures.bsr.items()}
        largest = largest_bar(self._before)
        return self._rr.Points2D(
            [[-0.8 * largest, row - 0.8] for row in range(len(angles))],  # a label hangs below its point
            radii=0.0,
            colors=(230, 230, 230),
            labels=[f"{level}  {angle}" for level, angle in angles.items()],
            show_labels=True,
        )

    def _colour_scale(self) -> None:
        rr, value = self._rr, np.linspace(0.0, self._scale, 41)
        x = value / self._scale * 200.0
        strips = np.stack([np.column_stack([x[k : k + 40], np.zeros(40)]) for k in (0, 1)], axis=1)
        colours = drawing.change_colours(value[:-1], self._scale)
        self._log("scale", rr.LineStrips2D(strips.astype(np.float32), radii=6.0, colors=colours), static=True)
        marks = rr.Points2D(
            [[0.0, 4.0], [100.0, 4.0], [200.0, 4.0]],
            radii=0.0,
            colors=(230, 230, 230),
            labels=[f"{part * self._scale:.0f} mm" for part in (0.0, 0.5, 1.0)],
            show_labels=True,
        )
        self._log("scale/marks", marks, static=True)

    def _log(self, path: str, what: Any, *, static: bool = False) -> None:
        self._stream.log(path, what, static=static)

    def _flush(self) -> None:
        try:
            self._stream.flush(timeout_sec=WAIT)
        except Exception as error:  # Rerun raises types of its own
            self._fail(str(error))

    def _fail(self, reason: str) -> None:
        self.failed = reason
        _log.warning("%s: recording stopped (%s); the simulation goes on without it", self.path, reason)


def _mesh(rr: Any, vertices: np.ndarray, faces: np.ndarray, colour: tuple[int, int, int]) -> Any:
    return rr.Mesh3D(
        vertex_positions=np.array(vertices, np.float32),
        triangle_indices=faces.copy(),
        vertex_normals=drawing.vertex_normals(vertices, faces),
        albedo_factor=colour,
    )


def _within(seconds: float, action: Callable[[], None]) -> bool:
    """Whether an action that may never return ended in time."""
    thread = threading.Thread(target=action, daemon=True)
    thread.start()
    thread.join(seconds)
    return not thread.is_alive()
