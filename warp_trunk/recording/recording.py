"""A recording of a simulation that the Rerun viewer steps through.

Rerun keeps references to the arrays it is given and writes them later from another thread, so everything
logged here is a new array (a test holds this).
"""

from collections.abc import Iterable
from pathlib import Path
from typing import Any, Self

import numpy as np

from warp_trunk.bone_motion.prescribed_motion import PrescribedMotion
from warp_trunk.case import Case
from warp_trunk.engine.simulation import Increment
from warp_trunk.engine.trunk_mesh import TrunkMesh
from warp_trunk.measures import TrunkMeasures
from warp_trunk.measures.quantities import ACTUAL, BEFORE, PREDICTED, Measured, MeasureTable, measured

from .colours import GREY, NOW, TARGET
from .stream import open_streams


class Recording:
    """Writes an .rrd file: one method for each event of a simulation.

    The increments recorded so far can be opened even if the process is killed. If the disk fails, the
    recording stops with a warning and the simulation continues.
    """

    def __init__(
        self,
        path: str | Path,
        case: Case,
        trunk: TrunkMesh,
        before: TrunkMeasures,
        actual: TrunkMeasures | None,
        bone_path: PrescribedMotion,
        *,
        unit: str = "its own unit",
        live: str | None = None,
    ) -> None:
        """Opens the file and records the trunk before surgery, as increment 0.

        Args:
            path: the file, which is replaced.
            case: the case that is simulated.
            trunk: its mesh.
            before: measures of the skin before surgery; its worst level is the one whose section is shown.
            actual: measures of the actual skin; None where it is not known.
            bone_path: where the bones go.
            unit: of the energy.
            live: URL of a viewer that listens, to show everything as it is recorded.
        """
        import rerun as rr  # heavy, as are the modules below

        from .blueprint import layout
        from .numbers import Numbers
        from .scene import Scene

        self.path, self._rr, self._case = Path(path), rr, case
        planned, skin = bone_path.at(1.0), case.skin
        carried = planned[trunk.skin_nodes]
        target_skin = case.actual_skin or skin.moved(skin.vertices + carried)
        states = {BEFORE: before} if actual is None else {BEFORE: before, ACTUAL: actual}
        self._before, self._still = before, MeasureTable.of(states)
        blueprint = layout(case, before, actual=actual is not None, unit=unit)
        self._streams = open_streams(case.name, self.path, live, blueprint)
        most = float(np.percentile(np.linalg.norm(carried, axis=1), 99.5))
        self._scene = scene = Scene(self._log, case, trunk, before, most)
        self._numbers = Numbers(self._log, self._still, before, tuple(states))
        scene.still("before", skin, np.zeros_like(planned), case.landmarks_before.points)
        scene.still("target", target_skin, planned, case.planned_landmarks.points)
        scene.section(BEFORE, before, self._still, GREY, static=True)
        if actual is not None:
            scene.section(ACTUAL, actual, self._still, TARGET, static=True)
        self._now(0, np.zeros_like(planned), before, 0.0)
        self._send()

    @property
    def failed(self) -> str:
        """Why the file stopped before its end; empty if it did not."""
        return self._streams[0].failed

    def increment(self, increment: Increment, measures: TrunkMeasures) -> None:
        """Records the trunk after an increment: skin, bones, landmarks, section, rotations, energy and error."""
        self.wait()
        if self.failed:
            return
        self._now(increment.number, increment.displacement, measures, increment.load_factor)
        self._numbers.relaxation(increment.relaxation.energy, increment.relaxation.estimated_error)
        self._send()

    def bands(self, rows: Iterable[Measured]) -> None:
        """Adds to the last increment how sure its rotations are, from the rows that have an interval."""
        self._numbers.bands(MeasureTable(rows).column(PREDICTED, "bsr_deg"))
        self._send()

    def wait(self) -> None:
        """Waits until all that was recorded has arrived; nothing to wait for where a relaxation lay between."""
        for stream in self._streams:
            stream.wait()

    def finish(self, text: str) -> None:
        """Records the closing text, Markdown, beside the pictures."""
        self._log("summary", self._rr.TextDocument(text, media_type="text/markdown"), static=True)

    def close(self) -> None:
        """Completes the file; does nothing the second time."""
        for stream in self._streams:
            stream.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _now(self, number: int, displacement: np.ndarray, measures: TrunkMeasures, load_factor: float) -> None:
        for stream in self._streams:
            stream.at(number)
        self._scene.now(displacement, self._case.landmarks_at(load_factor).points)
        table = self._still.with_rows(measured("now", measures, self._before))
        self._scene.section("now", measures, table, NOW, static=False)
        self._numbers.measures(table, load_factor)

    def _log(self, path: str, what: Any, /, *, static: bool = False) -> None:
        for stream in self._streams:
            stream.log(path, what, static=static)

    def _send(self) -> None:
        for stream in self._streams:
            stream.send()
