"""A recording of a simulation that the Rerun viewer steps through.

Rerun keeps references to the arrays it is given and writes them later from another thread, so everything
logged here is a new array (a test holds this).
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

import numpy as np

from warp_trunk.geometry.surface import Surface
from warp_trunk.measures import TrunkMeasures, measure

from . import drawing
from .blueprint import layout
from .colours import ColourName, FurtherColour, painters
from .numbers import Numbers
from .scene import Scene
from .stream import open_streams

if TYPE_CHECKING:
    from warp_trunk.bone_motion.bone_path import BonePath
    from warp_trunk.case import Case
    from warp_trunk.engine.model import Model
    from warp_trunk.engine.relaxation import RelaxStep
    from warp_trunk.engine.simulation import Increment
    from warp_trunk.engine.state import State
    from warp_trunk.engine.trunk_mesh import TrunkMesh
    from warp_trunk.results.bands import Bands


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
        bone_path: BonePath,
        *,
        model: Model | None = None,
        colours: Sequence[FurtherColour] = (),
        steps: bool = False,
        whiskers: bool = False,
        live: str | None = None,
        strict: bool = False,
    ) -> None:
        """Opens the file and records the trunk before surgery, as increment 0.

        Args:
            path: the file, which is replaced.
            case: the case that is simulated.
            trunk: its mesh.
            before: measures of the skin before surgery; its worst level is the one whose section is shown.
            bone_path: where the bones go.
            model: what is simulated: the colour `energy` asks for it, and its unit is shown.
            colours: choices for the colour of the skin beside its displacement, see `painters`.
            steps: record every step of the relaxations too, on a timeline `step`; see `watch`.
            whiskers: leave room beside the bars of rotations for `bands`.
            live: URL of a viewer that listens, to show everything as it is recorded.
            strict: raise where Rerun would only warn.

        Raises:
            InputError: a colour that this case cannot have.
        """
        import rerun as rr

        if strict:
            rr.set_strict_mode(True)
        self.path, self._steps = Path(path), 0
        self._rr, self._case, self._trunk = rr, case, trunk
        self.watch = self.step if steps else None
        """The observer of steps for `simulate`; None if they are not recorded."""
        planned = bone_path.at(1.0)
        self._values = painters(case, trunk, model, colours)
        most = self._most(planned)
        actual = case.actual_skin is not None
        target_skin = case.actual_skin or self._carried(planned)
        target = measure(target_skin, case.planned_landmarks)
        name = "actual" if actual else "target"
        unit = "its own unit" if model is None else model.elements.unit
        blueprint = layout(case, before, tuple(self._values), target=name, unit=unit)
        self._file, *self._viewer = open_streams(case.name, self.path, live, blueprint)
        self._streams = [self._file, *self._viewer]
        self._scene = Scene(self._log, case, trunk, before.worst_level, most)
        self._numbers = Numbers(self._log, before, target, name, whiskers=whiskers)
        self._still(before, target if actual else None, target_skin, planned)
        self._at(increment=0, step=0 if steps else None)
        self._now(np.zeros_like(planned), before, 0.0)
        self._send()

    def _still(
        self, before: TrunkMeasures, actual: TrunkMeasures | None, target_skin: Surface, planned: np.ndarray
    ) -> None:
        """Records what does not move: the trunk before, and the actual or the planned one."""
        case, scene = self._case, self._scene
        scene.still("before", case.skin, np.zeros_like(planned), case.landmarks_before.points)
        scene.still("target", target_skin, planned, case.planned_landmarks.points)
        scene.section("before", before, drawing.BEFORE, static=True)
        if actual is not None:
            scene.section("target", actual, drawing.TARGET, static=True)

    @property
    def failed(self) -> str:
        """Why the file stopped before its end; empty if it did not."""
        return self._file.failed

    def increment(self, increment: Increment, measures: TrunkMeasures) -> None:
        """Records the trunk after an increment: skin, bones, landmarks, section, rotations, energy and error."""
        self.wait()
        if self.failed:
            return
        self._at(increment=increment.number, step=self._steps or None)
        self._now(increment.displacement, measures, increment.load_factor)
        relaxation = increment.relaxation
        self._at(increment=increment.number, step=None)  # steps have set their own
        self._numbers.relaxation(relaxation.energy, relaxation.estimated_error, relaxation.linear_iterations)
        self._send()

    def step(self, step: RelaxStep, state: State) -> None:
        """Records the skin, energy and error after a step of a relaxation; a watcher for `simulate`."""
        self._steps += 1
        self._at(increment=None, step=self._steps)
        displacement = state.host_displacement()
        self._scene.skin(displacement, {"displacement": self._values["displacement"](displacement, 0.0)})
        self._numbers.relaxation(step.energy, step.estimated_error, step.linear_iterations)

    def bands(self, bands: Bands) -> None:
        """Adds to the last increment how sure its rotations are."""
        self._numbers.bands(bands.bsr_deg)
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

    def __enter__(self) -> Recording:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _now(self, displacement: np.ndarray, measures: TrunkMeasures, load_factor: float) -> None:
        landmarks = self._case.landmarks_at(load_factor)
        self._scene.now(displacement, landmarks.points, self._painted(displacement, load_factor))
        self._scene.section("now", measures, drawing.NOW, static=False)
        self._numbers.measures(measures, load_factor)

    def _painted(self, displacement: np.ndarray, load_factor: float) -> dict[ColourName, np.ndarray]:
        return {name: values(displacement, load_factor) for name, values in self._values.items()}

    def _most(self, planned: np.ndarray) -> dict[ColourName, float]:
        """Where the scale of each colour ends: almost all of its values, before surgery and as planned."""
        start, end = self._painted(np.zeros_like(planned), 0.0), self._painted(planned, 1.0)
        return {
            name: max(float(np.nanpercentile(np.abs(values), 99.5)) for values in (start[name], end[name]))
            for name in self._values
        }

    def _carried(self, displacement: np.ndarray) -> Surface:
        return Surface(self._case.skin.vertices + displacement[self._trunk.skin_nodes], self._case.skin.faces)

    def _log(self, path: str, what: Any, /, *, static: bool = False) -> None:
        for stream in self._streams:
            stream.log(path, what, static=static)

    def _at(self, **times: int | None) -> None:
        for stream in self._streams:
            stream.at(**times)

    def _send(self) -> None:
        for stream in self._streams:
            stream.send()
