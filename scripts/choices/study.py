"""Runs of one case, each kept on disk, so that a table can be made again, or go on where it was stopped."""

from __future__ import annotations

import hashlib
import os
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np

from warp_trunk import (
    Case,
    Landmarks,
    MeshOptions,
    RelaxOptions,
    RunOptions,
    SimulationOptions,
    Surface,
    Tissue,
    TrunkMesh,
    build_trunk,
    predicted_skin,
    prepare,
    simulate,
)
from warp_trunk.measures.volume import tissue_volume_change
from warp_trunk.meshing.cache import cache_key

from .choices import Choices
from .errors import carried_along, moved_bones, moved_landmarks


@dataclass(frozen=True, eq=False)
class Ending:
    """How a run ended."""

    skin: Surface
    """The skin after surgery; its vertices and faces are those of the case's skin."""
    tets: int
    """Tetrahedra of the mesh."""
    status: str
    """Why the last relaxation ended."""
    inverted: int
    """Tetrahedra without positive volume."""
    linear_iterations: int
    """Of all increments."""
    volume_change: float
    """Of the tissue [%]."""
    seconds: float
    """Time it took, with its model, on a machine that may have been busy."""


class Study:
    """The runs of one case."""

    def __init__(
        self,
        case: Case,
        folder: Path,
        threads: int = 0,
        make_mesh: Callable[[Surface, Mapping[str, Surface], MeshOptions], TrunkMesh] = build_trunk,
    ) -> None:
        self.case, self.folder, self.threads, self.make_mesh = case, folder, threads, make_mesh
        landmarks = np.stack([case.landmarks_before.points, case.planned_landmarks.points]).tobytes()
        names = repr((case.landmarks_before.names, case.tissue))
        self._case_key = cache_key(case.skin, case.bones, names + hashlib.sha256(landmarks).hexdigest())
        self._trunk = cache(lambda tets: make_mesh(case.skin, case.bones, MeshOptions(tets=tets)))

    def ending(self, choices: Choices) -> Ending:
        """How the run with these choices ends; fetched from the folder where it was run before."""
        key = hashlib.sha256(f"{self._case_key}\n{choices}".encode()).hexdigest()
        path = self.folder / f"{key[:32]}.npz"
        if not path.is_file():
            print(f"  running {told(choices)}", end="", flush=True)
            arrays = self._run(choices)
            print(f": {arrays['status']} in {arrays['seconds']:.0f} s", flush=True)
            self.folder.mkdir(parents=True, exist_ok=True)
            making = path.with_suffix(".making")
            with making.open("wb") as file:
                np.savez(file, allow_pickle=False, **arrays)
            os.replace(making, path)
        with np.load(path, allow_pickle=False) as kept:
            return Ending(
                skin=Surface(kept["skin"], self.case.skin.faces),
                tets=int(kept["tets"]),
                status=str(kept["status"]),
                inverted=int(kept["inverted"]),
                linear_iterations=int(kept["linear_iterations"]),
                volume_change=float(kept["volume_change"]),
                seconds=float(kept["seconds"]),
            )

    def landmarks(self, choices: Choices) -> tuple[Landmarks, Landmarks]:
        """The landmarks before and after that a run is given, with their errors."""
        before, after = self.case.landmarks_before, self.case.planned_landmarks
        if choices.landmark_error == "none":
            return before, after
        found = moved_landmarks(before, np.random.default_rng([choices.sample, 0]))
        if choices.landmark_error == "shared":
            return found, carried_along(before, after, found)
        return found, moved_landmarks(after, np.random.default_rng([choices.sample, 1]))

    def trunk(self, choices: Choices) -> TrunkMesh:
        """The mesh of a run, of one tissue."""
        if choices.bone_error == 0.0:
            return self._trunk(choices.tets)
        random = np.random.default_rng([choices.sample, 2])
        bones = moved_bones(self.case.bones, choices.bone_error, random)
        return self.make_mesh(self.case.skin, bones, MeshOptions(tets=choices.tets, cache=False))

    def _run(self, choices: Choices) -> dict[str, np.ndarray]:
        trunk = self.trunk(choices)
        start = time.perf_counter()
        before, after = self.landmarks(choices)
        case = replace(self.case, landmarks_before=before, landmarks_after=after, tissue=self._tissue(choices))
        prepared = prepare(case, self._options(choices), trunk)
        relax = RelaxOptions(tolerance=choices.tolerance)
        options = SimulationOptions(increments=choices.increments, relax=relax)
        increments = list(simulate(prepared.model, prepared.bone_path, options))
        last = increments[-1]
        found = {
            "skin": predicted_skin(self.case, trunk, last.displacement).vertices,
            "tets": len(trunk.tets),
            "status": last.relaxation.status.name,
            "inverted": last.relaxation.inverted_tets,
            "linear_iterations": sum(increment.relaxation.linear_iterations for increment in increments),
            "volume_change": tissue_volume_change(trunk, last.displacement),
            "seconds": time.perf_counter() - start,
        }
        return {name: np.asarray(value) for name, value in found.items()}

    def _tissue(self, choices: Choices) -> Tissue:
        return replace(
            self.case.tissue,
            epsilon=choices.epsilon,
            theta=choices.theta,
            poisson_ratio=choices.poisson_ratio,
        )

    def _options(self, choices: Choices) -> RunOptions:
        return RunOptions(
            energy=choices.energy,
            skin_rigidity=choices.skin_rigidity,
            weights=choices.weights,
            layers="depth" if choices.layers else "none",
            gravity=choices.gravity,
            rest=choices.rest,
            bones=choices.bones,
            precision=choices.precision,
            threads=self.threads,
        )


def told(choices: Choices) -> str:
    """What differs from the default run, in words."""
    default = Choices()
    differ = [f"{name} {value}" for name, value in vars(choices).items() if value != getattr(default, name)]
    return ", ".join(differ) or "the default"
