"""Virtual patients on one anatomy, and plans for them, simulated one way or another."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Literal

from warp_trunk import (
    Case,
    Landmarks,
    MeshOptions,
    SpineCurve,
    Surface,
    build_trunk,
    make_case,
    predicted_skin,
    read_surface,
    simulate,
)
from warp_trunk.case.rib_shares import RibShares
from warp_trunk.engine.energies.by_name import EnergyName
from warp_trunk.engine.simulation import Increment, SimulationOptions
from warp_trunk.engine.trunk_mesh import TrunkMesh
from warp_trunk.geometry.rigid import fit_rigid
from warp_trunk.preparation.deformity import correct, impose
from warp_trunk.preparation.landmark_finder import find_landmarks
from warp_trunk.run.options import RunOptions
from warp_trunk.run.prepare import prepare

from .rows import Row, distance, rotations, shoulders, smoothness

Way = Literal["spline", "follow", "known"]
WAYS: tuple[Way, ...] = ("spline", "follow", "known")
PATIENTS = (
    *(SpineCurve(cobb=cobb) for cobb in (45.0, 60.0, 75.0)),
    SpineCurve(kind="thoracolumbar"),
    SpineCurve(kind="double_major"),
)
CORRECTIONS = (0.5, 0.6, 0.7, 0.8)
SHOWN = 0.7
"""The correction at which less derotation, known bones, skin and work are told."""
LESS = 5.0
"""Degrees of derotation left out, at the same Cobb angle."""


class Study:
    """The virtual patients on one anatomy."""

    def __init__(self, folder: Path, tets: int, energy: EnergyName | None = None) -> None:
        self.skin = read_surface(folder / "skin.ply")
        self.bones = {path.stem: read_surface(path) for path in sorted((folder / "bones").glob("*.ply"))}
        self.tets = tets
        self.energy: EnergyName | None = energy
        self.straight: Landmarks = find_landmarks(self.bones).complete()
        self.patient = cache(self._patient)

    def _patient(self, curve: SpineCurve) -> tuple[Case, TrunkMesh]:
        case = make_case(self.skin, self.bones, curve, SHOWN)
        return case, build_trunk(case.skin, case.bones, MeshOptions(tets=self.tets))

    def imposed(self, curve: SpineCurve) -> tuple[Surface, dict[str, Surface]]:
        """Skin and bones of a trunk that has a curve, no tissue simulated."""
        return impose(self.skin, self.bones, self.straight, curve)[:2]

    def plan(
        self, curve: SpineCurve, correction: float, way: Way, shares: RibShares | None = None, less: float = 0.0
    ) -> Case:
        """A patient with a part of her curve taken away, and some degrees of derotation left out."""
        case, left = self.patient(curve)[0], curve.corrected(correction)
        turned = replace(left, apical_rotation=left.rotation + less) if less else left
        case = replace(case, rib_shares=shares or RibShares(), landmarks_after=correct(self.straight, turned, 0.0))
        return case if way != "known" else replace(case, bones_after=_known(case, self.imposed(left)[1]))

    def simulated(
        self, case: Case, trunk: TrunkMesh, way: Way, options: RunOptions | None = None
    ) -> tuple[list[Increment], Surface]:
        """The increments of a plan, and the skin at its end; with other options than the study's energy."""
        ready = prepare(case, moved(way, options or RunOptions(energy=self.energy)), trunk)
        increments = list(simulate(ready.model, ready.bone_path, SimulationOptions(increments=5)))
        return increments, predicted_skin(case, ready.trunk, increments[-1].displacement)

    def row(
        self, curve: SpineCurve, correction: float, way: Way, shares: RibShares | None = None, less: bool = True
    ) -> Row:
        """Simulates a plan one way; with less derotation, too, where that is told and asked for."""
        trunk, plan = self.patient(curve)[1], self.plan(curve, correction, way, shares)
        with_less = None
        if less and way != "known" and correction == SHOWN:
            other = self.plan(curve, correction, way, shares, LESS)
            with_less = rotations(self.simulated(other, trunk, way)[1], other.planned_landmarks)
        increments, skin = self.simulated(plan, trunk, way)
        end, truth = increments[-1].relaxation, self.imposed(curve.corrected(correction))[0]
        return Row(
            patient=name_of(curve),
            correction=correction,
            way=way,
            derotation=curve.rotation - curve.corrected(correction).rotation,
            before=rotations(plan.skin, plan.landmarks_before),
            after=rotations(skin, plan.planned_landmarks),
            shoulders_before=shoulders(plan.skin, plan.landmarks_before),
            shoulders_after=shoulders(skin, plan.planned_landmarks),
            less=with_less,
            smooth=smoothness(plan.skin, skin),
            truth_before=distance(plan.skin, truth),
            truth_after=distance(skin, truth),
            iterations=sum(one.relaxation.linear_iterations for one in increments),
            inverted=end.inverted_tets,
            status=end.status.name,
        )


def moved(way: Way, options: RunOptions) -> RunOptions:
    """Options with the bones of a way."""
    return replace(options, bones="spline" if way == "spline" else "follow")


def name_of(curve: SpineCurve) -> str:
    """Kind and Cobb angle."""
    return f"{curve.kind.replace('_', ' ')} {curve.cobb:g}"


def _known(case: Case, after: dict[str, Surface]) -> dict[str, Surface]:
    """The bones after, each moved rigidly."""
    return {
        name: Surface(fit_rigid(bone.vertices, after[name].vertices).apply(bone.vertices), bone.faces)
        for name, bone in case.bones.items()
    }
